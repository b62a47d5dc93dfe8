//! Many seeded lines through and near each singularity, under each law.

use control::Kind;
use control::sweep::{Line, lines};
use serde_json::{Value, json};
use shared_types::scenario::Strategy;

use super::score::{Score, score};
use super::{CompareArgs, Failure, digits, load, name_of, number, on_all_cores, say, table, under};

/// The singularities in turn.
pub(super) const KINDS: [Kind; 3] = [Kind::Elbow, Kind::Wrist, Kind::Overhead];

/// The lines and what each law made of them.
pub(super) struct Sweep {
    pub(super) seed: u64,
    pub(super) speed: f64,
    pub(super) near: Vec<Kind>,
    pub(super) laws: Vec<(Strategy, Vec<Score>)>,
}

/// The lines of a sweep.
///
/// # Errors
/// [`Failure::Input`] for an arm without a PUMA's factors.
pub(super) fn draw(loaded: &load::Loaded, seed: u64, args: &CompareArgs) -> Result<Vec<Line>, Failure> {
    let mut template = loaded.scenario.clone();
    // The lines fill the arm's whole reach: where a floor would be, too.
    template.plant.floor_m = None;
    let lines = lines(&loaded.robot, &template, seed, args.count as usize, args.speed);
    if lines.is_empty() {
        return Err(Failure::Input(format!(
            "the sweep's lines are drawn for a PUMA, and '{}' has no such factors: compare scenarios of your own instead",
            loaded.robot.name
        )));
    }
    Ok(lines)
}

impl Sweep {
    pub(super) fn run(loaded: &load::Loaded, laws: &[Strategy], args: &CompareArgs) -> Result<Self, Failure> {
        let lines = draw(loaded, loaded.scenario.seed, args)?;
        let work: Vec<_> = laws.iter().flat_map(|law| lines.iter().map(move |line| under(&line.scenario, *law))).collect();
        let mut scores = on_all_cores("sweep", &work, |scenario| score(&loaded.robot, scenario)).into_iter();
        let mut of_laws = Vec::new();
        for law in laws {
            let mine = scores.by_ref().take(lines.len()).collect::<Result<Vec<_>, _>>().map_err(Failure::input)?;
            of_laws.push((*law, mine));
        }
        Ok(Self { seed: loaded.scenario.seed, speed: args.speed, near: lines.iter().map(|line| line.near).collect(), laws: of_laws })
    }

    /// How many of a law's lines near a singularity (near any: `None`) are so, and of how many.
    pub(super) fn count(&self, scores: &[Score], near: Option<Kind>, so: impl Fn(&Score) -> bool) -> (usize, usize) {
        let of = || self.near.iter().zip(scores).filter(|(kind, _)| near.is_none_or(|near| near == **kind));
        (of().filter(|(_, score)| so(score)).count(), of().count())
    }

    pub(super) fn print(&self) {
        say!("sweep: {} lines at {} m/s (seed {})", self.near.len(), self.speed, self.seed);
        let mut rows = table(&[
            "law",
            "S1 %",
            "S2 %",
            "elbow S1 S2",
            "wrist S1 S2",
            "overhead S1 S2",
            "ends %",
            "across p95, mm",
            "torque step p95",
            "switches p95, J",
            "time p90",
            "S2 missed by",
        ]);
        for (law, scores) in &self.laws {
            let share = |near: Option<Kind>, so: &dyn Fn(&Score) -> bool| {
                let (yes, all) = self.count(scores, near, so);
                format!("{:.1}", 100.0 * yes as f64 / all.max(1) as f64)
            };
            let both = |kind: Kind| format!("{} {}", share(Some(kind), &|score| score.s1), share(Some(kind), &|score| score.s2));
            let mut row = vec![law.name().into(), number(share(None, &|score| score.s1)), number(share(None, &|score| score.s2))];
            row.extend(KINDS.map(|kind| number(both(kind))));
            row.extend([
                number(share(None, &Score::ended)),
                number(digits(quantile(scores, 0.95, |score| score.across_max_mm))),
                number(digits(quantile(scores, 0.95, |score| score.torque_step_p95_ratio))),
                number(digits(quantile(scores, 0.95, |score| score.switch_energy_j))),
                number(format!("× {:.2}", quantile(scores, 0.9, |score| score.time_stretch))),
                missed(scores).into(),
            ]);
            rows.add_row(row);
        }
        say!("{rows}");
    }

    pub(super) fn json(&self) -> Value {
        let laws = self.laws.iter().map(|(law, scores)| {
            let counts = |near: Option<Kind>| {
                let (s1, lines) = self.count(scores, near, |score| score.s1);
                json!({"lines": lines, "s1": s1, "s2": self.count(scores, near, |score| score.s2).0, "ends": self.count(scores, near, Score::ended).0})
            };
            let near: serde_json::Map<_, _> = KINDS.iter().map(|kind| (name_of(*kind), counts(Some(*kind)))).collect();
            let lines: Vec<_> = self.near.iter().zip(scores).map(|(kind, score)| json!({"near": name_of(*kind), "score": score})).collect();
            json!({"law": law.name(), "all": counts(None), "near": near, "lines": lines})
        });
        json!({"scenario": super::SWEEP, "seed": self.seed, "speed_m_s": self.speed, "laws": laws.collect::<Vec<_>>()})
    }
}

/// The value that a share of the runs does not exceed.
fn quantile(scores: &[Score], share: f64, of: impl Fn(&Score) -> f64) -> f64 {
    let mut values: Vec<f64> = scores.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64).ceil() as usize;
    values.get(place.saturating_sub(1)).copied().unwrap_or_default()
}

/// "along 12, torque 4": how many lines missed S2 by what, the most frequent first.
pub(super) fn missed(scores: &[Score]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for what in scores.iter().flat_map(|score| &score.missed) {
        match counts.iter_mut().find(|(known, _)| known == what) {
            Some((_, count)) => *count += 1,
            None => counts.push((what, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    counts.iter().map(|(what, count)| format!("{what} {count}")).collect::<Vec<_>>().join(", ")
}
