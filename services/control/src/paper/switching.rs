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
    #[must_use]
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
    use shared_types::codes::{MODES, name_of};

    /// The table above, cell by cell.
    #[test]
    fn the_printed_table_is_the_code() {
        let conditions = [
            Condition::Inside,
            Condition::Near,
            Condition::Boundary,
            Condition::Away,
            Condition::Clear,
        ];
        let cells = |line: &str| {
            line.trim_start_matches("//! |")
                .trim_end_matches('|')
                .split('|')
                .map(|cell| cell.trim().to_owned())
                .collect::<Vec<_>>()
        };
        let rows: Vec<_> = include_str!("switching.rs")
            .lines()
            .filter(|line| line.starts_with("//! |"))
            .map(cells)
            .collect();
        assert_eq!(
            rows[0][1..],
            conditions.map(|condition| format!("{condition:?}").to_lowercase())
        );
        assert_eq!(rows.len() - 2, MODES.len(), "one row for each mode");
        let mut strategies = 0;
        for row in &rows[2..] {
            let (code, _) = MODES.iter().find(|(_, name)| *name == row[0]).unwrap();
            let mode = Mode::from_code(*code).unwrap();
            for (condition, cell) in conditions.into_iter().zip(&row[1..]) {
                for strategy in [
                    Mode::Track,
                    Mode::Pass,
                    Mode::Hold,
                    Mode::Reorient,
                    Mode::Slide,
                ] {
                    let expected = if cell == "strategy" {
                        strategy
                    } else {
                        next(mode, condition, strategy)
                    };
                    strategies += usize::from(cell == "strategy");
                    assert_eq!(
                        next(mode, condition, strategy),
                        expected,
                        "{mode:?}, {condition:?}"
                    );
                    assert!(
                        cell == "strategy" || name_of(MODES, expected.code()) == cell,
                        "{mode:?}, {condition:?}: {expected:?}, printed {cell}"
                    );
                }
            }
        }
        assert_eq!(strategies, 5 * MODES.len());
    }
}
