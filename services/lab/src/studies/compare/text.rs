//! A comparison as text for people.

use std::fmt;

use recorder::Bounds;
use session::table::{Cell, Fitted, count as plural, number, table};
use shared_types::summary::TaskSummary;
use viz::digits;

use super::verdict::{findings, verdicts};
use super::{Compared, Counts, Outcome, Race};
use crate::row::Row;
use crate::text::{optional, percent, quantile};

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

/// Headings of a row's errors.
const ERRORS: [&str; 4] = [
    "orthogonal\nto ζ, mm",
    "orthogonal\nto ζ, °",
    "along\nζ, mm",
    "along\nζ, °",
];

/// The errors of a row that may be none.
fn errors(row: Option<&Row>) -> [Cell; 4] {
    let all: [fn(&TaskSummary) -> f64; 4] = [
        |task| task.orthogonal_max_mm,
        |task| task.orthogonal_max_deg,
        |task| task.along_max_mm,
        |task| task.along_max_deg,
    ];
    all.map(|of| number(optional(row, |row| digits(of(&row.task)))))
}

fn stretch(factor: f64) -> String {
    format!("× {factor:.2}")
}

impl Compared {
    fn one_path(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scenario = &self.scenario;
        let (name, title, seed) = (&scenario.name, &scenario.title, scenario.seed);
        let colon = if title.is_empty() { "" } else { ": " };
        writeln!(f, "{name}{colon}{title} (seed {seed})")?;
        let lines = self.laws.iter().flat_map(|law| &law.1);
        let rows: Vec<Row> = lines.filter_map(|line| line.score.clone()).collect();
        let headings = [
            &["law", "verdict"][..],
            &ERRORS,
            &["speed", "torque", "time"],
        ];
        let mut laws = table(&headings.concat());
        for (row, verdict) in rows.iter().zip(verdicts(&rows)) {
            let Row { task, joints, .. } = row;
            let loads = [joints.speed_max_ratio, joints.torque_commanded_max_ratio];
            let [speed, torque] = loads.map(percent);
            laws.add_row(
                [row.law.as_str().into(), verdict.into()]
                    .into_iter()
                    .chain(errors(row.completed.then_some(row)))
                    .chain([speed, torque, stretch(task.time_stretch)].map(number)),
            );
        }
        writeln!(f, "{laws}")?;
        (self.refused()).try_for_each(|(law, why)| writeln!(f, "{law} refused: {why}"))?;
        findings(&rows)
            .iter()
            .try_for_each(|line| writeln!(f, "{line}"))?;
        let (s1, s2) = (Bounds::s1(), Bounds::s2());
        writeln!(
            f,
            "Largest errors, orthogonal to the singular directions ζ and along them; largest speed and torque, of the joints' limits.\n\
             Laws within 10 % of the smallest error tie.\n\
             S1: orthogonal to ζ and at the end less than {} mm and {}°, no limit of a joint broken.\n\
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
        writeln!(
            f,
            "{}\nreached, refused, missed: in words; silent: without; ends: at the goal's pose, by the usual bounds",
            self.groups()
        )
    }

    /// A row for each law and singularity.
    fn groups(&self) -> Fitted {
        let plan = "plan, median and largest, ms";
        let headings = [
            "law",
            "singular",
            "lines",
            "reached",
            "refused",
            "missed",
            "silent",
            "S1 %",
            "S2 %",
            "ends %",
            "orthogonal p95, mm",
            "time p90",
            "torque step",
            "S2 missed by",
            plan,
        ];
        let count = headings.len() - usize::from(!self.is_exact);
        let mut groups = table(&headings[..count]);
        for (law, lines) in &self.laws {
            for name in self.names().into_iter().map(Some).chain([None]) {
                let near = name.unwrap_or("all");
                let mut row: Vec<Cell> = vec![law.name().into(), near.into()];
                row.extend(Counts::of(lines, name).cells());
                groups.add_row(row.into_iter().take(count));
            }
        }
        groups
    }

    /// A row a line, and the reasons of those that did not reach their goal.
    fn by_line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = ["line", "singular", "at its", "goal"];
        let headings = [&names[..], &ERRORS, &["speed", "time", "S2"]].concat();
        for (_, lines) in &self.laws {
            let mut rows = table(&headings);
            for (place, line) in (1..).zip(lines) {
                let score = line.score.as_ref();
                let load = |of: fn(&Row) -> String| optional(score, of);
                let names = [
                    number(place),
                    line.singularities.as_str().into(),
                    line.place.into(),
                    line.outcome.to_string().into(),
                ];
                let speed = load(|row| percent(row.joints.speed_max_ratio));
                let time = load(|row| stretch(row.task.time_stretch));
                let loads = [number(speed), number(time), load(Row::success).into()];
                rows.add_row(names.into_iter().chain(errors(score)).chain(loads));
            }
            writeln!(f, "{rows}")?;
            for (place, line) in (1..).zip(lines) {
                if line.outcome != Outcome::Reached {
                    writeln!(f, "line {place}, {}: {}", line.outcome, line.reason)?;
                }
            }
        }
        Ok(())
    }
}

impl Counts<'_> {
    /// Counts, shares and quantiles of the lines, and the time of their plans.
    fn cells(&self) -> Vec<Cell> {
        let share = |so: fn(&Row) -> bool| {
            let share = self.so(so) as f64 / self.0.len() as f64;
            format!("{:.1}", 100.0 * share)
        };
        let of = |of: fn(&Row) -> f64, share| quantile(self.rows().map(of), share);
        let step = 100.0 * of(|row| row.joints.torque_step_max_ratio, 1.0);
        let plans = || self.0.iter().filter_map(|line| line.planning_ms);
        let [median, largest] = [0.5, 1.0].map(|share| quantile(plans(), share));
        // Of lines that were all refused there are no numbers.
        let run = |text: String| optional(self.rows().next(), |_| text);
        vec![
            number(self.0.len()),
            number(self.ended(Outcome::Reached)),
            number(self.ended(Outcome::Refused)),
            number(self.ended(Outcome::Missed)),
            number(self.ended(Outcome::Silent)),
            number(share(|row| row.task.s1)),
            number(share(|row| row.task.s2)),
            number(share(Row::ended)),
            number(run(digits(of(|row| row.task.orthogonal_max_mm, 0.95)))),
            number(run(stretch(of(|row| row.task.time_stretch, 0.9)))),
            number(run(format!("{step:.1} %"))),
            missed(self.rows()).into(),
            number(format!("{median:.0} {largest:.0}")),
        ]
    }
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
        let mut laws = table(&[
            "law",
            "position error, mm",
            "orientation error, °",
            "joint speed",
        ]);
        for (law, racer) in [&self.law, &self.rival] {
            // An arm without limits has no share of them.
            let speed = Some(racer.speed_max_ratio).filter(|ratio| *ratio != 0.0);
            laws.add_row([
                law.as_str().into(),
                number(digits(racer.position_max_mm)),
                number(digits(racer.orientation_max_deg)),
                number(optional(speed, percent)),
            ]);
        }
        writeln!(f, "{laws}")
    }
}
