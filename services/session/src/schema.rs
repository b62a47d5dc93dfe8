//! JSON Schemas of the files that a run reads and writes; `docs/schema/make.py` writes them from the types.

/// Schema of a scenario.
pub const SCENARIO: &str = include_str!("../../../docs/schema/scenario.json");
/// Schema of a process graph.
pub const GRAPH: &str = include_str!("../../../docs/schema/graph.json");
/// Schema of `summary.json`.
pub const SUMMARY: &str = include_str!("../../../docs/schema/summary.json");
