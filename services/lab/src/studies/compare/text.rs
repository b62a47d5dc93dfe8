//! A comparison as text for people.

use lines::KINDS;
use std::fmt;

use control::Kind;
use session::table::{number, table};
use shared_types::scenario::Scenario;
use viz::plot::digits;

use crate::quantile::quantile;

use super::race::Race;
use super::scenarios::Compared;
use super::score::{Bounds, Score};
use super::sweep::{SWEEP, Sweep, missed};
use super::verdict::{failures, margin, verdicts};

/// A table of the laws, the verdict, and its terms.
impl fmt::Display for Compared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, faults_left_out) = match self {
            Self::Scenario {
                scenario,
                faults_left_out,
                ..
            } => (scenario.name.as_str(), *faults_left_out),
            Self::Sweep {
                faults_left_out, ..
            } => (SWEEP, *faults_left_out),
        };
        if faults_left_out > 0 {
            let remedy = "`armplane sweep` over `control.strategy` has them";
            writeln!(
                f,
                "{name}: without its planned faults ({faults_left_out}); {remedy}"
            )?;
        }
        match self {
            Self::Scenario {
                scenario, scores, ..
            } => scenario_text(f, scenario, scores),
            Self::Sweep { sweep, .. } => sweep_text(f, sweep),
        }
    }
}

fn percent(ratio: f64) -> String {
    format!("{:.0} %", ratio * 100.0)
}

fn scenario_text(f: &mut fmt::Formatter<'_>, scenario: &Scenario, scores: &[Score]) -> fmt::Result {
    writeln!(
        f,
        "{}: {} (seed {})",
        scenario.name, scenario.title, scenario.seed
    )?;
    let mut rows = table(&[
        "law",
        "⊥ ζ, mm",
        "⊥ ζ, °",
        "∥ ζ, mm",
        "∥ ζ, °",
        "speed",
        "torque",
        "time",
        "verdict",
    ]);
    for (score, verdict) in scores.iter().zip(verdicts(scores)) {
        let error = |value: f64| {
            number(if score.completed {
                digits(value)
            } else {
                "–".to_owned()
            })
        };
        rows.add_row([
            score.law.clone().into(),
            error(score.orthogonal_max_mm),
            error(score.orthogonal_max_deg),
            error(score.along_max_mm),
            error(score.along_max_deg),
            number(percent(score.speed_max_ratio)),
            number(percent(score.torque_max_ratio)),
            number(format!("× {:.2}", score.time_stretch)),
            verdict.into(),
        ]);
    }
    writeln!(f, "{rows}")?;
    for line in failures(scores).iter().chain(&margin(scores)) {
        writeln!(f, "{line}")?;
    }
    writeln!(
        f,
        "⊥ ζ: largest error orthogonal to the singular directions, ∥ ζ: along them; speed, torque: of the joints' limits."
    )?;
    let (s1, s2) = (Bounds::s1(), Bounds::s2());
    writeln!(
        f,
        "S1: less than {} mm and {}° orthogonal to ζ.",
        s1.orthogonal_mm, s1.orthogonal_deg
    )?;
    let Bounds {
        orthogonal_mm,
        orthogonal_deg,
        along_mm,
        along_deg,
    } = s2;
    writeln!(
        f,
        "S2: less than {orthogonal_mm} mm and {orthogonal_deg}° orthogonal to ζ, less than {along_mm} mm and {along_deg}° along it."
    )
}

fn sweep_text(f: &mut fmt::Formatter<'_>, sweep: &Sweep) -> fmt::Result {
    writeln!(
        f,
        "sweep: {} lines at {} m/s (seed {})",
        sweep.near.len(),
        sweep.speed,
        sweep.seed
    )?;
    let mut rows = table(&[
        "law",
        "S1 %",
        "S2 %",
        "elbow",
        "wrist",
        "overhead",
        "ends %",
        "orthogonal p95, mm",
        "time p90",
        "S2 missed by",
    ]);
    for (law, scores) in &sweep.laws {
        let share = |near: Option<Kind>, so: &dyn Fn(&Score) -> bool| {
            let (yes, all) = sweep.count(scores, near, so);
            if all == 0 {
                "–".to_owned()
            } else {
                format!("{:.1}", 100.0 * yes as f64 / all as f64)
            }
        };
        let mut row = vec![
            law.name().into(),
            number(share(None, &|score| score.s1)),
            number(share(None, &|score| score.s2)),
        ];
        row.extend(KINDS.map(|kind| number(share(Some(kind), &|score| score.s2))));
        row.extend([
            number(share(None, &Score::ended)),
            number(digits(quantile(
                scores.iter().map(|score| score.orthogonal_max_mm),
                0.95,
            ))),
            number(format!(
                "× {:.2}",
                quantile(scores.iter().map(|score| score.time_stretch), 0.9)
            )),
            missed(scores).into(),
        ]);
        rows.add_row(row);
    }
    writeln!(
        f,
        "{rows}\nelbow, wrist, overhead: S2 % of the lines near that singularity; –: none is"
    )
}

/// A row for each of the two laws.
impl fmt::Display for Race {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: the same plant, seed {} and task under two laws",
            self.scenario, self.seed
        )?;
        let mut rows = table(&[
            "law",
            "position error, mm",
            "orientation error, °",
            "joint speed",
        ]);
        for (law, racer) in [&self.law, &self.rival] {
            // An arm without limits has no share of them.
            let speed = if racer.speed_max_ratio == 0.0 {
                "–".to_owned()
            } else {
                format!("{:.0} %", racer.speed_max_ratio * 100.0)
            };
            rows.add_row([
                law.clone().into(),
                number(digits(racer.position_max_mm)),
                number(digits(racer.orientation_max_deg)),
                number(speed),
            ]);
        }
        writeln!(f, "{rows}")
    }
}
