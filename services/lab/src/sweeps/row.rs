//! One run of a sweep: computed on one thread, judged, and written as a row.

use std::panic::{AssertUnwindSafe, catch_unwind};

use model::{Refused, Robot};
use shared_types::scenario::Scenario;
use shared_types::topics::{COUNT, TOPICS};

use super::cell::{Cell, Kind};
use super::spec::unit_of;
use crate::row::Row;
use crate::trial::Trial;

/// A column of the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    /// Its name.
    pub(super) name: String,
    /// The type of its values.
    pub(super) kind: Kind,
    /// Unit of its numbers; empty where there is none.
    pub(super) unit: String,
    /// Its meaning.
    pub(super) about: String,
}

type Of = fn(&Row) -> Cell;

/// The results of a run: name, kind, meaning, value.
const RESULTS: [(&str, Kind, &str, Of); 27] = [
    ("ticks", Kind::Whole, "ticks done", |v| whole(v.ticks)),
    (
        COMPLETED,
        Kind::Boolean,
        "whether the task ran to its end",
        |v| Cell::Boolean(v.completed),
    ),
    (
        "s1",
        Kind::Boolean,
        "success by the strict bar of `armplane compare`",
        |v| Cell::Boolean(v.task.s1),
    ),
    (
        "s2",
        Kind::Boolean,
        "success by its bar for lines that are not along ζ",
        |v| Cell::Boolean(v.task.s2),
    ),
    (
        "missed",
        Kind::Text,
        "the conditions of s2 that failed",
        |v| Cell::Text(v.task.missed.join(", ")),
    ),
    (
        "position_max_mm",
        Kind::Number,
        "largest position error",
        |v| Cell::Number(v.task.position_max_mm),
    ),
    (
        "position_rms_mm",
        Kind::Number,
        "root mean square position error",
        |v| Cell::Number(v.task.position_rms_mm),
    ),
    (
        "orientation_max_deg",
        Kind::Number,
        "largest orientation error",
        |v| Cell::Number(v.task.orientation_max_deg),
    ),
    (
        "orthogonal_max_mm",
        Kind::Number,
        "largest position error orthogonal to ζ",
        |v| Cell::Number(v.task.orthogonal_max_mm),
    ),
    (
        "orthogonal_max_deg",
        Kind::Number,
        "largest orientation error orthogonal to ζ",
        |v| Cell::Number(v.task.orthogonal_max_deg),
    ),
    (
        "along_max_mm",
        Kind::Number,
        "largest position error along ζ",
        |v| Cell::Number(v.task.along_max_mm),
    ),
    (
        "along_max_deg",
        Kind::Number,
        "largest orientation error along ζ",
        |v| Cell::Number(v.task.along_max_deg),
    ),
    (
        "final_position_mm",
        Kind::Number,
        "position error at the end",
        |v| Cell::Number(v.task.final_position_mm),
    ),
    (
        "final_orientation_deg",
        Kind::Number,
        "orientation error at the end",
        |v| Cell::Number(v.task.final_orientation_deg),
    ),
    (
        "time_stretch_ratio",
        Kind::Number,
        "ticks done over ticks planned",
        |v| Cell::Number(v.task.time_stretch),
    ),
    (
        "speed_max_ratio",
        Kind::Number,
        "largest joint speed over its limit",
        |v| Cell::Number(v.joints.speed_max_ratio),
    ),
    (
        "torque_max_ratio",
        Kind::Number,
        "largest torque over its limit",
        |v| Cell::Number(v.joints.torque_max_ratio),
    ),
    (
        "torque_step_max_ratio",
        Kind::Number,
        "largest change of a torque in one tick over its limit",
        |v| Cell::Number(v.joints.torque_step_max_ratio),
    ),
    (
        "torque_step_p95_ratio",
        Kind::Number,
        "95th percentile of that change",
        |v| Cell::Number(v.joints.torque_step_p95_ratio),
    ),
    (
        "saturated_ticks",
        Kind::Whole,
        "ticks with any torque at its limit",
        |v| whole(v.joints.saturated_ticks),
    ),
    (
        "chatter",
        Kind::Whole,
        "torque jumps back within 10 ms",
        |v| whole(v.joints.chatter),
    ),
    (
        "jump_energy_j",
        Kind::Number,
        "½ΔΓᵀA⁻¹ΔΓ/k_v² over the torque jumps",
        |v| Cell::Number(v.joints.jump_energy_j),
    ),
    ("switches", Kind::Whole, "changes of mode", |v| {
        whole(v.joints.switches)
    }),
    (
        "switch_energy_j",
        Kind::Number,
        "energy put in at changes of mode",
        |v| Cell::Number(v.joints.switch_energy_j),
    ),
    (
        "stopped_by_plant",
        Kind::Boolean,
        "whether a joint ran against its stop, or the drive stopped the arm",
        |v| Cell::Boolean(v.joints.stopped_ticks > 0),
    ),
    (
        "s_min",
        Kind::Number,
        "smallest |s| of any singularity",
        |v| v.s_min.map_or(Cell::Absent, Cell::Number),
    ),
    (
        "inside_ticks",
        Kind::Whole,
        "ticks inside the neighbourhood of any singularity, each counted",
        |v| whole(v.inside_ticks),
    ),
];

fn whole(number: u64) -> Cell {
    Cell::Whole(number as i64)
}

/// The name of the column of the runs' numbers.
pub(super) const RUN: &str = "run";
/// The name of the column of outcomes.
pub(super) const OUTCOME: &str = "outcome";
/// The name of the column of runs that came to their task's end.
pub(super) const COMPLETED: &str = "completed";
/// The name of the column of reasons.
pub(super) const REASON: &str = "reason";
/// The outcome of a run that a cycle refused before its first tick.
pub(super) const REFUSED: &str = "refused";
/// The outcome of a run that ended in a defect of this program.
pub(super) const FAILED: &str = "failed";

/// The columns of a table with these keys.
pub(super) fn columns<'a>(keys: impl Iterator<Item = (&'a str, Kind, &'a str)>) -> Vec<Column> {
    let column = |name: &str, kind: Kind, unit: &str, about: &str| Column {
        name: name.into(),
        kind,
        unit: unit.into(),
        about: about.into(),
    };
    let mut columns = vec![column(RUN, Kind::Whole, "", "number of the run, from 0")];
    columns.extend(keys.map(|(key, kind, unit)| column(key, kind, unit, "set by the sweep")));
    columns.push(column(
        OUTCOME,
        Kind::Text,
        "",
        "goal reached, goal missed, stopped, refused (before the first tick) or failed",
    ));
    columns.push(column(REASON, Kind::Text, "", "why, in one sentence"));
    columns.extend(RESULTS.iter().map(|(name, kind, about, _)| {
        let ratio = *name == "s_min";
        column(
            name,
            *kind,
            if ratio {
                "1"
            } else {
                unit_of(name).unwrap_or_default()
            },
            about,
        )
    }));
    columns.extend(TOPICS.map(|topic| {
        column(
            &hash_column(topic),
            Kind::Text,
            "",
            "XXH3-64 over the topic, as in summary.json",
        )
    }));
    columns
}

/// The name of the column with a topic's hash.
pub(super) fn hash_column(topic: &str) -> String {
    format!("hash.{topic}")
}

/// Computes a run and gives its results: what comes after the keys in its row, and its ticks.
pub(super) fn results(loaded: Result<(&Robot, &Scenario), String>) -> (Vec<Cell>, u64) {
    let computed = loaded.and_then(|(robot, scenario)| guarded(|| run(robot, scenario)));
    let without = |outcome: &str, reason: String| {
        let head = [Cell::Text(outcome.to_owned()), Cell::Text(reason)];
        (
            head.into_iter()
                .chain(std::iter::repeat_n(Cell::Absent, RESULTS.len() + COUNT))
                .collect(),
            0,
        )
    };
    match computed {
        Err(reason) if reason.is_empty() => without(
            FAILED,
            "the program ended this run by a panic: a defect, please report it".to_owned(),
        ),
        Err(reason) => without(REFUSED, reason),
        Ok(row) => {
            let mut cells = vec![
                Cell::Text(row.outcome.clone()),
                Cell::Text(row.reason.clone()),
            ];
            cells.extend(RESULTS.iter().map(|(.., of)| of(&row)));
            cells.extend(TOPICS.map(|topic| {
                let hash = row.hash.get(topic);
                hash.map_or(Cell::Absent, |hash| Cell::Text(hash.clone()))
            }));
            (cells, row.ticks)
        }
    }
}

/// The results of a run, or the reason why there are none; a panic leaves no further detail.
fn guarded<T>(run: impl FnOnce() -> Result<T, Refused>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(run))
        .map_err(|_| String::new())?
        .map_err(|refused| refused.to_string())
}

fn run(robot: &Robot, scenario: &Scenario) -> Result<Row, Refused> {
    // As `armplane run` does it: a start that the control law refuses is no run.
    chain::try_first_tick(robot, scenario)?;
    let scenario = scenario.clone();
    Trial { robot, scenario }.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_row_and_not_the_end_of_the_sweep() {
        let ended: Result<(), String> = guarded(|| panic!("planted"));
        assert_eq!(ended, Err(String::new()));
        let (row, ticks) = results(Err(String::new()));
        assert_eq!(
            (&row[0], ticks, row.len()),
            (&Cell::Text(FAILED.to_owned()), 0, 2 + RESULTS.len() + COUNT)
        );
        let (row, _) = results(Err("no such posture".to_owned()));
        assert_eq!(
            row[..2],
            [
                Cell::Text(REFUSED.to_owned()),
                Cell::Text("no such posture".to_owned())
            ]
        );
    }

    #[test]
    fn rows_and_columns_have_the_same_length_and_names_are_unique() {
        let columns = columns([("control.k_p", Kind::Number, "1/s²")].into_iter());
        assert_eq!(columns.len(), 2 + results(Err(String::new())).0.len());
        let names: std::collections::BTreeSet<_> =
            columns.iter().map(|column| &column.name).collect();
        assert_eq!(names.len(), columns.len());
    }
}
