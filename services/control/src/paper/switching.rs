//! Switching between operational control and a singularity's strategy: one table.
//!
//! | mode | inside | near | boundary | away | clear |
//! |---|---|---|---|---|---|
//! | regular | strategy | blend | regular | regular | regular |
//! | blend | strategy | blend | blend | regular | regular |
//! | track | strategy | recover | recover | recover | regular |
//! | pass | strategy | recover | recover | recover | regular |
//! | hold | strategy | recover | recover | recover | regular |
//! | reorient | strategy | recover | recover | recover | regular |
//! | slide | strategy | recover | recover | recover | regular |
//! | recover | strategy | recover | recover | recover | regular |
//!
//! *Strategy* is the mode that the singularity's type asks for: track or slide (Type 1), track, pass, slide or hold (Type 2), reorient (a commanded
//! turn of ζ). The paper switches by the columns *inside* and *clear* alone: D_si and its complement. The three columns between are ours (+): they
//! separate entry from exit, so that noise at η switches nothing, and return control only when the error along ζ is gone.

use crate::types::Mode;

/// Where a posture is, as far as switching is concerned; the first that holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// q is in D_si.
    Inside,
    /// |s_i| < η_out.
    Near,
    /// |s_i| ≥ η_out, and neither of the next two.
    Boundary,
    /// Well beyond η_out, and the error's share in β restored.
    Away,
    /// Away, and the error along ζ gone; or far away.
    Clear,
}

impl Condition {
    /// The paper's: inside D_si or not.
    pub fn hard(inside: bool) -> Self {
        if inside { Self::Inside } else { Self::Clear }
    }
}

/// The mode after `mode` under `condition`; `strategy` is the mode that the singularity's strategy asks for.
///
/// Ensures the printed table, cell by cell · Errors none · Cost O(1)
#[must_use]
pub fn next(mode: Mode, condition: Condition, strategy: Mode) -> Mode {
    match (mode, condition) {
        (_, Condition::Inside) => strategy,
        (Mode::Regular, Condition::Near) => Mode::Blend,
        (Mode::Regular, _) => Mode::Regular,
        (Mode::Blend, Condition::Near | Condition::Boundary) => Mode::Blend,
        (_, Condition::Clear) | (Mode::Blend, Condition::Away) => Mode::Regular,
        (_, Condition::Near | Condition::Boundary | Condition::Away) => Mode::Recover,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::MODES;

    /// The table above, cell by cell, for any mode that a strategy asks for.
    #[test]
    fn the_printed_table_is_the_code() {
        let lines = include_str!("switching.rs").lines();
        let rows = lines.filter_map(|line| line.strip_prefix("//! | "));
        let cells = |row: &'static str| row.trim_end_matches(" |").split(" | ").collect();
        let rows: Vec<Vec<&str>> = rows.map(cells).collect();
        let columns = [
            Condition::Inside,
            Condition::Near,
            Condition::Boundary,
            Condition::Away,
            Condition::Clear,
        ];
        let names = columns.map(|condition| format!("{condition:?}").to_lowercase());
        assert_eq!(rows[0][1..], names);
        assert_eq!(rows.len() - 1, MODES.len(), "one row for each mode");
        let named = |name: &str| {
            let (code, _) = MODES.iter().find(|(_, known)| *known == name).unwrap();
            Mode::from_code(*code).unwrap()
        };
        for row in &rows[1..] {
            for (condition, cell) in columns.into_iter().zip(&row[1..]) {
                for strategy in MODES.iter().map(|(_, name)| named(name)) {
                    let expected = match *cell {
                        "strategy" => strategy,
                        cell => named(cell),
                    };
                    let found = next(named(row[0]), condition, strategy);
                    assert_eq!(found, expected, "{row:?}, {condition:?}");
                }
            }
        }
    }
}
