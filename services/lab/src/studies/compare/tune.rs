//! The best that each baseline can be made: a search over its own parameters, on lines that no comparison uses.
//!
//! The defaults in `shared_types::scenario::Baseline` are the winners on 27 to 36 lines at 0.28 m/s; the two leading settings of damped least squares
//! were told apart on 126. The governor is searched too: no baseline does better without it.

use session::{Failure, Observer, load};
use shared_types::scenario::{Baseline, Damping, HoldAndBlend, Scenario, Strategy};

use super::law::under;
use super::score::{Score, score};
use super::sweep::{SWEEP, SweepSize, draw};
use crate::pool::on_all_cores;

/// Added to the seed: the lines tuned on are never those compared on.
const SEED_OFFSET: u64 = 1000;

/// One point of a search.
pub struct Point {
    law: Strategy,
    /// As `--set` takes them.
    pub settings: String,
    baseline: Baseline,
    governor: bool,
}

/// All points of a law's search; none for a law without parameters of its own.
fn points(law: Strategy) -> Vec<Point> {
    let mut baselines: Vec<(String, Baseline)> = Vec::new();
    let base = Baseline::default();
    match law {
        Strategy::DampedLeastSquares | Strategy::JointPd => {
            for onset in [0.01, 0.02, 0.04, 0.08, 0.16, 0.32] {
                for largest in [0.0025, 0.005, 0.01, 0.02, 0.04, 0.08] {
                    let damping = Damping { onset, largest };
                    let (name, baseline) = match law {
                        Strategy::JointPd => (
                            "joint_pd",
                            Baseline {
                                joint_pd: damping,
                                ..base.clone()
                            },
                        ),
                        _ => (
                            "damped_least_squares",
                            Baseline {
                                damped_least_squares: damping,
                                ..base.clone()
                            },
                        ),
                    };
                    baselines.push((
                        format!("{name}={{onset={onset},largest={largest}}}"),
                        baseline,
                    ));
                }
            }
        }
        Strategy::TruncatedSvd => {
            for truncated_svd_floor in [
                0.003, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.06, 0.08,
            ] {
                baselines.push((
                    format!("truncated_svd_floor={truncated_svd_floor}"),
                    Baseline {
                        truncated_svd_floor,
                        ..base.clone()
                    },
                ));
            }
        }
        Strategy::HoldAndBlend => {
            for blend in [
                [0.001, 0.004],
                [0.001, 0.01],
                [0.001, 0.02],
                [0.003, 0.02],
                [0.006, 0.06],
            ] {
                for (hold_k_p, hold_k_v) in [
                    (0.001, 2.0),
                    (0.001, 5.0),
                    (5.0, 4.5),
                    (50.0, 14.0),
                    (400.0, 40.0),
                ] {
                    for push in [0.001, 0.01, 0.1] {
                        let tuned = HoldAndBlend {
                            blend,
                            hold_k_p,
                            hold_k_v,
                            push,
                            ..base.hold_and_blend
                        };
                        let text = format!(
                            "hold_and_blend={{blend={blend:?},hold_k_p={hold_k_p},hold_k_v={hold_k_v},push={push}}}"
                        );
                        baselines.push((
                            text,
                            Baseline {
                                hold_and_blend: tuned,
                                ..base.clone()
                            },
                        ));
                    }
                }
            }
        }
        _ => return Vec::new(),
    }
    let with = |governor: bool, (text, baseline): &(String, Baseline)| Point {
        law,
        settings: format!("control.baseline.{text} control.governor={governor}"),
        baseline: baseline.clone(),
        governor,
    };
    baselines
        .iter()
        .flat_map(|one| [with(true, one), with(false, one)])
        .collect()
}

impl Point {
    fn lay_over(&self, scenario: &Scenario) -> Scenario {
        let mut scenario = under(scenario, self.law);
        scenario.control.baseline = self.baseline.clone();
        scenario.control.governor = self.governor;
        scenario
    }
}

/// Lines with S2, with S1, and reached ends: in this order of weight.
pub fn worth(scores: &[Score]) -> [usize; 3] {
    let count = |so: &dyn Fn(&Score) -> bool| scores.iter().filter(|score| so(score)).count();
    [
        count(&|score| score.s2),
        count(&|score| score.s1),
        count(&Score::ended),
    ]
}

/// The points of a search with their scores, the best first.
pub type Ranked<'a> = [(&'a Point, &'a [Score])];

/// Searches each law's parameters; `each` gets each law's points with their scores, the best first. Returns the seed of the lines, and their
/// number.
///
/// # Errors
/// [`Failure`] where the sweep cannot be drawn or a law refuses it.
pub fn tune(
    settings: &[String],
    seed: Option<u64>,
    size: SweepSize,
    laws: &[Strategy],
    observer: Observer<'_>,
    each: &mut dyn FnMut(Strategy, u64, &Ranked<'_>),
) -> Result<(u64, usize), Failure> {
    let loaded = load::scenario(SWEEP, settings, seed)?;
    let seed = loaded.scenario.seed + SEED_OFFSET;
    let lines = draw(&loaded, seed, size)?;
    for law in laws {
        let points = points(*law);
        if points.is_empty() {
            continue;
        }
        let work: Vec<_> = points
            .iter()
            .flat_map(|point| lines.iter().map(|line| point.lay_over(&line.scenario)))
            .collect();
        let scores = on_all_cores(
            law.name(),
            &work,
            |scenario| score(&loaded.robot, scenario),
            observer,
        );
        let scores = scores
            .into_iter()
            .collect::<Result<Vec<_>, _>>()
            .map_err(Failure::input)?;
        let mut ranked: Vec<_> = points.iter().zip(scores.chunks(lines.len())).collect();
        ranked.sort_by_key(|(_, scores)| std::cmp::Reverse(worth(scores)));
        each(*law, seed, &ranked);
    }
    Ok((seed, lines.len()))
}
