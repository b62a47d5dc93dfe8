//! Many seeded lines through and near each singularity, under each law.

use control::Kind;
use lines::{KINDS, Line, lines};
use serde_json::{Value, json};
use session::{Failure, Observer, load};
use shared_types::scenario::Strategy;

use super::law::{name_of, under};
use super::score::{Score, score};
use crate::pool::on_all_cores;

/// The scenario that stands for many lines.
pub const SWEEP: &str = "sweep";

/// How many lines, and how fast.
#[derive(Clone, Copy, Debug)]
pub struct SweepSize {
    /// Lines.
    pub count: u32,
    /// Peak speed; m/s.
    pub speed: f64,
}

/// The lines and what each law made of them.
pub struct Sweep {
    /// Seed.
    pub seed: u64,
    /// Speed of the lines relative to the default.
    pub speed: f64,
    /// Singularities that the lines pass.
    pub near: Vec<Kind>,
    /// Scores by law.
    pub laws: Vec<(Strategy, Vec<Score>)>,
}

/// The lines of a sweep.
///
/// # Errors
/// [`Failure::Input`] for an arm without a PUMA's factors.
pub(super) fn draw(
    loaded: &load::Loaded,
    seed: u64,
    size: SweepSize,
) -> Result<Vec<Line>, Failure> {
    let mut template = loaded.scenario.clone();
    // The lines fill the arm's whole reach: where a floor would be, too.
    template.plant.floor_m = None;
    let lines = lines(
        &loaded.robot,
        &template,
        seed,
        size.count as usize,
        size.speed,
    );
    if lines.is_empty() {
        return Err(Failure::Input(format!(
            "the sweep's lines are drawn for a PUMA, and '{}' has no such factors: compare scenarios of your own instead",
            loaded.robot.name
        )));
    }
    Ok(lines)
}

impl Sweep {
    /// Runs the lines under each law.
    ///
    /// # Errors
    /// The scenario is refused.
    pub fn run(
        loaded: &load::Loaded,
        laws: &[Strategy],
        size: SweepSize,
        observer: Observer<'_>,
    ) -> Result<Self, Failure> {
        let lines = draw(loaded, loaded.scenario.seed, size)?;
        let work: Vec<_> = laws
            .iter()
            .flat_map(|law| lines.iter().map(move |line| under(&line.scenario, *law)))
            .collect();
        let mut scores = on_all_cores(
            "sweep",
            &work,
            |scenario| score(&loaded.robot, scenario),
            observer,
        )
        .into_iter();
        let mut of_laws = Vec::new();
        for law in laws {
            let mine = scores
                .by_ref()
                .take(lines.len())
                .collect::<Result<Vec<_>, _>>()
                .map_err(Failure::input)?;
            of_laws.push((*law, mine));
        }
        Ok(Self {
            seed: loaded.scenario.seed,
            speed: size.speed,
            near: lines.iter().map(|line| line.near).collect(),
            laws: of_laws,
        })
    }

    /// How many of a law's lines near a singularity (near any: `None`) are so, and of how many.
    pub fn count(
        &self,
        scores: &[Score],
        near: Option<Kind>,
        so: impl Fn(&Score) -> bool,
    ) -> (usize, usize) {
        let of = || {
            self.near
                .iter()
                .zip(scores)
                .filter(|(kind, _)| near.is_none_or(|near| near == **kind))
        };
        (of().filter(|(_, score)| so(score)).count(), of().count())
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let laws = self.laws.iter().map(|(law, scores)| {
            let counts = |near: Option<Kind>| {
                let (s1, lines) = self.count(scores, near, |score| score.s1);
                json!({"lines": lines, "s1": s1, "s2": self.count(scores, near, |score| score.s2).0, "ends": self.count(scores, near, Score::ended).0})
            };
            let near: serde_json::Map<_, _> = KINDS.iter().map(|kind| (name_of(*kind), counts(Some(*kind)))).collect();
            let lines: Vec<_> = self.near.iter().zip(scores).map(|(kind, score)| json!({"near": name_of(*kind), "score": score})).collect();
            json!({"law": law.name(), "all": counts(None), "near": near, "lines": lines})
        });
        json!({"scenario": SWEEP, "seed": self.seed, "speed_m_s": self.speed, "laws": laws.collect::<Vec<_>>()})
    }
}

/// "along 12, torque 4": how many lines missed S2 by what, the most frequent first.
pub fn missed(scores: &[Score]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for what in scores.iter().flat_map(|score| &score.missed) {
        match counts.iter_mut().find(|(known, _)| known == what) {
            Some((_, count)) => *count += 1,
            None => counts.push((what, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    counts
        .iter()
        .map(|(what, count)| format!("{what} {count}"))
        .collect::<Vec<_>>()
        .join(", ")
}
