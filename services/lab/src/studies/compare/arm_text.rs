//! Lines through exactly singular postures, as text for people.

use std::fmt;

use session::table::{number, table};
use viz::plot::digits;

use super::arm_sweep::{ArmLines, Line, Outcome};
use super::score::Score;

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

/// A row a line, the reasons of those that did not reach their goal, and a row a singularity.
impl fmt::Display for ArmLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {} lines through exactly singular postures, {} m/s, {} (seed {})",
            self.robot,
            self.lines.len(),
            self.speed_m_s,
            self.law,
            self.seed
        )?;
        self.by_line(f)?;
        for (i, line) in self
            .lines
            .iter()
            .enumerate()
            .filter(|(_, line)| line.outcome != Outcome::Reached)
        {
            writeln!(f, "line {}, {}: {}", i + 1, line.outcome, line.reason)?;
        }
        self.by_singularity(f)
    }
}

impl ArmLines {
    fn by_line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let headings = [
            "line",
            "singular",
            "at its",
            "goal",
            "⊥ ζ, mm",
            "⊥ ζ, °",
            "∥ ζ, mm",
            "∥ ζ, °",
            "speed",
            "torque step",
            "time",
            "plan, ms",
            "S2",
        ];
        let mut rows = table(&headings);
        for (i, line) in self.lines.iter().enumerate() {
            let of = |value: &dyn Fn(&Score) -> String| {
                number(line.score.as_ref().map_or_else(|| "–".to_owned(), value))
            };
            rows.add_row([
                number(i + 1),
                line.singularities.clone().into(),
                line.place.into(),
                line.outcome.to_string().into(),
                of(&|score| digits(score.orthogonal_max_mm)),
                of(&|score| digits(score.orthogonal_max_deg)),
                of(&|score| digits(score.along_max_mm)),
                of(&|score| digits(score.along_max_deg)),
                of(&|score| format!("{:.0} %", score.speed_max_ratio * 100.0)),
                of(&|score| format!("{:.1} %", score.torque_step_max_ratio * 100.0)),
                of(&|score| format!("× {:.2}", score.time_stretch)),
                number(format!("{:.0}", line.planning_ms)),
                line.score
                    .as_ref()
                    .map_or_else(String::new, Score::success)
                    .into(),
            ]);
        }
        writeln!(f, "{rows}")
    }

    fn by_singularity(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut names: Vec<&str> = self
            .lines
            .iter()
            .map(|line| line.singularities.as_str())
            .collect();
        names.sort_unstable();
        names.dedup();
        let mut rows = table(&[
            "singular",
            "lines",
            "reached",
            "refused",
            "missed",
            "silent",
            "S2 %",
            "torque step, largest",
            "plan, median and largest, ms",
        ]);
        for name in names.iter().map(Some).chain([None]) {
            let of: Vec<&Line> = self
                .lines
                .iter()
                .filter(|line| name.is_none_or(|name| line.singularities == **name))
                .collect();
            let count = |outcome| number(of.iter().filter(|line| line.outcome == outcome).count());
            let scores = || of.iter().filter_map(|line| line.score.as_ref());
            let mut planning: Vec<f64> = of.iter().map(|line| line.planning_ms).collect();
            planning.sort_by(f64::total_cmp);
            let step = scores()
                .map(|score| score.torque_step_max_ratio)
                .fold(0.0, f64::max);
            rows.add_row([
                name.map_or("all", |name| *name).into(),
                number(of.len()),
                count(Outcome::Reached),
                count(Outcome::Refused),
                count(Outcome::Missed),
                count(Outcome::Silent),
                number(format!(
                    "{:.0}",
                    100.0 * scores().filter(|score| score.s2).count() as f64 / of.len() as f64
                )),
                number(format!("{:.1} %", step * 100.0)),
                number(format!(
                    "{:.0} {:.0}",
                    planning[planning.len() / 2],
                    planning[planning.len() - 1]
                )),
            ]);
        }
        writeln!(f, "{rows}")
    }
}
