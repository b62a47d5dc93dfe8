//! JSON Schemas of the files that a run reads and writes; `docs/schema/make.py` writes them from the types.

/// Of a scenario.
pub const SCENARIO: &str = include_str!("../../../docs/schema/scenario.json");
/// Of `summary.json`.
pub const SUMMARY: &str = include_str!("../../../docs/schema/summary.json");
