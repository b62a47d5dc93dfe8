//! The built-in graphs, and their names for `extends`.

/// The built-in graph.
pub const BUILT_IN: &str = include_str!("../../graph.toml");

/// The built-in graph of a steered run.
pub const STEERED: &str = include_str!("../../servo.toml");

/// The built-in graph of a run that controls a force.
pub const PRESSING: &str = include_str!("../../force.toml");

/// The built-in graph of a steered run that may press.
pub const STEERED_PRESSING: &str = include_str!("../../servo-force.toml");

/// The names of the built-in graphs where another one extends them.
pub(super) const BUILT_IN_NAME: &str = "armplane";
pub(super) const STEERED_NAME: &str = "servo";
pub(super) const PRESSING_NAME: &str = "force";
pub(super) const STEERED_PRESSING_NAME: &str = "servo-force";

/// In `reads`: all topics that others write.
pub(super) const EVERYTHING: &str = "*";
