//! A comparison as text for people.

use std::fmt;

use lines::KINDS;
use recorder::Bounds;
use session::table::count as plural;
use viz::digits;

use super::verdict::{findings, verdicts};
use super::{Compared, Law, Race, Racer, name_of};
use crate::row::Row;
use crate::text::{Columns, optional, percent, quantile};

/// A table of the laws, the verdict, and its terms.
impl fmt::Display for Compared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, faults) = (&self.scenario.name, self.faults_left_out);
        if faults > 0 {
            let remedy = "`armplane sweep` over `control.strategy` has them";
            writeln!(f, "{name}: without its planned faults ({faults}); {remedy}")?;
        }
        if self.near.is_empty() {
            self.one_path(f)
        } else {
            self.lines(f)
        }
    }
}

/// Adds the columns of errors, of a row that may be none.
pub(super) fn with_errors<'a, R>(
    columns: Columns<'a, R>,
    row: impl Fn(&R) -> Option<&Row> + Copy + 'a,
) -> Columns<'a, R> {
    let error = move |of: fn(&Row) -> f64| move |one: &R| optional(row(one), |row| digits(of(row)));
    columns
        .number("⊥\u{a0}ζ, mm", error(|row| row.task.orthogonal_max_mm))
        .number("⊥\u{a0}ζ, °", error(|row| row.task.orthogonal_max_deg))
        .number("∥\u{a0}ζ, mm", error(|row| row.task.along_max_mm))
        .number("∥\u{a0}ζ, °", error(|row| row.task.along_max_deg))
}

impl Compared {
    fn one_path(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scenario = &self.scenario;
        let (name, title, seed) = (&scenario.name, &scenario.title, scenario.seed);
        let colon = if title.is_empty() { "" } else { ": " };
        writeln!(f, "{name}{colon}{title} (seed {seed})")?;
        let rows: Vec<Row> = self.laws.iter().flat_map(|law| law.1.clone()).collect();
        let columns = Columns::<(&Row, String)>::new()
            .text("law", |(row, _)| row.law.clone())
            .text("verdict", |(_, verdict)| verdict.clone());
        let columns = with_errors(columns, |(row, _)| row.completed.then_some(*row))
            .number("speed", |(row, _)| percent(row.joints.speed_max_ratio))
            .number("torque", |(row, _)| {
                percent(row.joints.torque_commanded_max_ratio)
            })
            .number("time", |(row, _)| format!("× {:.2}", row.task.time_stretch));
        writeln!(f, "{}", columns.print(rows.iter().zip(verdicts(&rows))))?;
        findings(&rows)
            .iter()
            .try_for_each(|line| writeln!(f, "{line}"))?;
        let (s1, s2) = (Bounds::s1(), Bounds::s2());
        writeln!(
            f,
            "⊥ ζ: largest error orthogonal to the singular directions, ∥ ζ: along them; speed, torque: of the joints' limits, load: the larger of both.\n\
             Laws within 10 % of the smallest error tie.\n\
             S1: less than {} mm and {}° orthogonal to ζ.\n\
             S2: less than {} mm and {}° orthogonal to ζ, less than {} mm and {}° along it.",
            s1.orthogonal_mm,
            s1.orthogonal_deg,
            s2.orthogonal_mm,
            s2.orthogonal_deg,
            s2.along_mm,
            s2.along_deg
        )
    }

    fn lines(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        type Of = (Law, Vec<Row>);
        let (count, seed) = (self.near.len(), self.scenario.seed);
        writeln!(
            f,
            "sweep: {} at {} m/s (seed {seed})",
            plural(count as u64, "line"),
            self.speed
        )?;
        let share = |near, so: fn(&Row) -> bool| {
            move |(_, rows): &&Of| match self.count(rows, near, so) {
                (_, 0) => "–".to_owned(),
                (yes, all) => format!("{:.1}", 100.0 * yes as f64 / all as f64),
            }
        };
        let names = KINDS.map(name_of);
        let mut columns = Columns::<&Of>::new()
            .text("law", |law| law.0.name().to_owned())
            .number("S1 %", share(None, |row| row.task.s1))
            .number("S2 %", share(None, |row| row.task.s2));
        for (name, kind) in names.iter().zip(KINDS) {
            columns = columns.number(name, share(Some(kind), |row| row.task.s2));
        }
        let columns = columns
            .number("ends %", share(None, Row::ended))
            .number("orthogonal p95, mm", |law| {
                let errors = law.1.iter().map(|row| row.task.orthogonal_max_mm);
                digits(quantile(errors, 0.95))
            })
            .number("time p90", |law| {
                let times = law.1.iter().map(|row| row.task.time_stretch);
                format!("× {:.2}", quantile(times, 0.9))
            })
            .text("S2 missed by", |law| missed(&law.1));
        writeln!(f, "{}", columns.print(&self.laws))?;
        writeln!(
            f,
            "elbow, wrist, overhead: S2 % of the lines near that singularity; –: no such line"
        )
    }
}

/// "along 12, torque 4": how many lines missed S2 by what, the most frequent first.
fn missed(rows: &[Row]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for what in rows.iter().flat_map(|row| &row.task.missed) {
        match counts.iter_mut().find(|(known, _)| known == what) {
            Some((_, count)) => *count += 1,
            None => counts.push((what, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let counts = counts.iter().map(|(what, count)| format!("{what} {count}"));
    counts.collect::<Vec<_>>().join(", ")
}

/// A row for each of the two laws.
impl fmt::Display for Race {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scenario, seed) = (&self.scenario, self.seed);
        writeln!(
            f,
            "{scenario}: the same plant, seed {seed} and task under two laws"
        )?;
        let columns = Columns::<&(String, Racer)>::new()
            .text("law", |one| one.0.clone())
            .number("position error, mm", |one| digits(one.1.position_max_mm))
            .number("orientation error, °", |one| {
                digits(one.1.orientation_max_deg)
            })
            // An arm without limits has no share of them.
            .number("joint speed", |one| {
                let ratio = Some(one.1.speed_max_ratio);
                optional(ratio.filter(|ratio| *ratio != 0.0), percent)
            });
        writeln!(f, "{}", columns.print([&self.law, &self.rival]))
    }
}
