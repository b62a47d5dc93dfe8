//! A comparison as text for people.

use std::fmt;

use recorder::Bounds;
use session::table::count as plural;
use viz::digits;

use super::verdict::{findings, verdicts};
use super::{Compared, Counts, Line, Outcome, Race, Racer};
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
        match self.speed {
            None => self.one_path(f),
            Some(speed) => self.lines(f, speed),
        }
    }
}

/// Adds the columns of errors, of a row that may be none.
fn with_errors<'a, R>(
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
        let lines = self.laws.iter().flat_map(|law| &law.1);
        let rows: Vec<Row> = lines.filter_map(|line| line.score.clone()).collect();
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
            "⊥ ζ: largest error orthogonal to the singular directions, ∥ ζ: along them; speed, torque: of the joints' limits.\n\
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

    fn lines(&self, f: &mut fmt::Formatter<'_>, speed: f64) -> fmt::Result {
        let (count, seed) = (self.tasks.len() as u64, self.scenario.seed);
        let (robot, count) = (&self.robot, plural(count, "line"));
        writeln!(f, "sweep of {robot}: {count} at {speed} m/s (seed {seed})")?;
        if self.is_exact {
            self.by_line(f)?;
        }
        let names = self.names();
        let mut groups = Vec::new();
        for (law, lines) in &self.laws {
            let each = names.iter().copied().map(Some).chain([None]);
            groups.extend(each.map(|name| Group {
                law: law.name().to_owned(),
                near: name.unwrap_or("all").to_owned(),
                of: Counts::of(lines, name),
            }));
        }
        writeln!(f, "{}", self.columns().print(groups))?;
        writeln!(
            f,
            "reached, refused, missed: in words; silent: without; ends: at the goal's pose, by the usual bounds"
        )
    }

    /// A row for each law and singularity.
    fn columns(&self) -> Columns<'_, Group<'_>> {
        let share = |so: fn(&Row) -> bool| {
            move |group: &Group<'_>| {
                let (yes, all) = (group.of.so(so), group.of.0.len());
                format!("{:.1}", 100.0 * yes as f64 / all as f64)
            }
        };
        let ended = |outcome| move |group: &Group<'_>| group.of.ended(outcome);
        let of = |group: &Group<'_>, of: fn(&Row) -> f64, share| {
            quantile(group.of.rows().map(of), share)
        };
        let columns = Columns::<Group<'_>>::new()
            .text("law", |group| group.law.clone())
            .text("singular", |group| group.near.clone())
            .number("lines", |group| group.of.0.len())
            .number("reached", ended(Outcome::Reached))
            .number("refused", ended(Outcome::Refused))
            .number("missed", ended(Outcome::Missed))
            .number("silent", ended(Outcome::Silent))
            .number("S1 %", share(|row| row.task.s1))
            .number("S2 %", share(|row| row.task.s2))
            .number("ends %", share(Row::ended))
            .number("orthogonal p95, mm", move |group| {
                digits(of(group, |row| row.task.orthogonal_max_mm, 0.95))
            })
            .number("time p90", move |group| {
                format!("× {:.2}", of(group, |row| row.task.time_stretch, 0.9))
            })
            .number("torque step", move |group| {
                let largest = of(group, |row| row.joints.torque_step_max_ratio, 1.0);
                format!("{:.1} %", 100.0 * largest)
            })
            .text("S2 missed by", |group| missed(group.of.rows()));
        if !self.is_exact {
            return columns;
        }
        columns.number("plan, median and largest, ms", |group| {
            let plans = || group.of.0.iter().filter_map(|line| line.planning_ms);
            let [median, largest] = [0.5, 1.0].map(|share| quantile(plans(), share));
            format!("{median:.0} {largest:.0}")
        })
    }

    /// A row a line, and the reasons of those that did not reach their goal.
    fn by_line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        type Numbered<'a> = (usize, &'a Line);
        let load = |of: fn(&Row) -> String| {
            move |(_, line): &Numbered<'_>| optional(line.score.as_ref(), of)
        };
        for (_, lines) in &self.laws {
            let columns = Columns::<Numbered<'_>>::new()
                .number("line", |(number, _)| *number)
                .text("singular", |(_, line)| line.singularities.clone())
                .text("at its", |(_, line)| line.place)
                .text("goal", |(_, line)| line.outcome);
            let columns = with_errors(columns, |(_, line)| line.score.as_ref())
                .number("speed", load(|row| percent(row.joints.speed_max_ratio)))
                .number(
                    "time",
                    load(|row| format!("× {:.2}", row.task.time_stretch)),
                )
                .text("S2", |(_, line)| {
                    optional(line.score.as_ref(), Row::success)
                });
            writeln!(f, "{}", columns.print((1..).zip(lines)))?;
            for (number, line) in (1..).zip(lines) {
                if line.outcome != Outcome::Reached {
                    writeln!(f, "line {number}, {}: {}", line.outcome, line.reason)?;
                }
            }
        }
        Ok(())
    }
}

/// The lines of a law near a singularity.
struct Group<'a> {
    law: String,
    near: String,
    of: Counts<'a>,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Reached => "reached",
            Self::Refused => "refused",
            Self::Missed => "missed",
            Self::Silent => "SILENT",
        })
    }
}

/// "along 12, torque 4": how many lines missed S2 by what, the most frequent first.
fn missed<'a>(rows: impl Iterator<Item = &'a Row>) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for what in rows.flat_map(|row| &row.task.missed) {
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
