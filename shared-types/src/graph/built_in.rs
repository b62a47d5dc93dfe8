//! The built-in graphs, and their names for `extends`.

/// The built-in graph.
pub const BUILT_IN: &str = include_str!("../../graph.toml");

/// The built-in graph of a steered run.
pub const STEERED: &str = include_str!("../../servo.toml");

/// The built-in graph of a run that controls a force.
pub const PRESSING: &str = include_str!("../../force.toml");

/// The built-in graph of a steered run that may press.
pub const STEERED_PRESSING: &str = include_str!("../../servo-force.toml");

/// The built-in graphs by their names, where another one extends them.
pub(super) const NAMED: [(&str, &str); 4] = [
    ("armplane", BUILT_IN),
    ("servo", STEERED),
    ("force", PRESSING),
    ("servo-force", STEERED_PRESSING),
];

/// In `reads`: all topics that others write.
pub(super) const EVERYTHING: &str = "*";
