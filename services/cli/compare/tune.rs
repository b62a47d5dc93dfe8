//! The best that each baseline can be made: a search over its own parameters, on lines that no comparison uses.

use std::process::ExitCode;

use serde_json::json;
use shared_types::scenario::{Baseline, Damping, HoldAndBlend, Scenario, Strategy};

use super::score::{Score, score};
use super::sweep::{draw, missed};
use super::{CompareArgs, Failure, SWEEP, load, number, on_all_cores, say, table, under};

/// Added to the seed: the lines tuned on are never those compared on.
const SEED_OFFSET: u64 = 1000;

/// How many of the best are shown.
const SHOWN: usize = 5;

/// One point of a search.
struct Point {
    law: Strategy,
    /// As `--set` takes them.
    settings: String,
    baseline: Baseline,
    governor: bool,
}

/// All points of a law's search; none for a law without parameters of its own.
fn points(law: Strategy) -> Vec<Point> {
    let mut baselines: Vec<(String, Baseline)> = Vec::new();
    let base = Baseline::default();
    match law {
        Strategy::DampedLeastSquares | Strategy::JointPd => {
            for onset in [0.02, 0.04, 0.08, 0.16, 0.32, 0.64] {
                for largest in [0.005, 0.01, 0.02, 0.03, 0.04, 0.08] {
                    let damping = Damping { onset, largest };
                    let (name, baseline) = match law {
                        Strategy::JointPd => ("joint_pd", Baseline { joint_pd: damping, ..base.clone() }),
                        _ => ("damped_least_squares", Baseline { damped_least_squares: damping, ..base.clone() }),
                    };
                    baselines.push((format!("{name}={{onset={onset},largest={largest}}}"), baseline));
                }
            }
        }
        Strategy::TruncatedSvd => {
            for truncated_svd_floor in [0.003, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.06, 0.08] {
                baselines.push((format!("truncated_svd_floor={truncated_svd_floor}"), Baseline { truncated_svd_floor, ..base.clone() }));
            }
        }
        Strategy::HoldAndBlend => {
            for blend in [[0.001, 0.004], [0.001, 0.01], [0.001, 0.02], [0.003, 0.02], [0.006, 0.06]] {
                for (hold_k_p, hold_k_v) in [(0.001, 2.0), (0.001, 5.0), (5.0, 4.5), (50.0, 14.0), (400.0, 40.0)] {
                    for push in [0.001, 0.01, 0.1] {
                        let tuned = HoldAndBlend { blend, hold_k_p, hold_k_v, push, ..base.hold_and_blend };
                        let text = format!("hold_and_blend={{blend={blend:?},hold_k_p={hold_k_p},hold_k_v={hold_k_v},push={push}}}");
                        baselines.push((text, Baseline { hold_and_blend: tuned, ..base.clone() }));
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
    baselines.iter().flat_map(|one| [with(true, one), with(false, one)]).collect()
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
fn worth(scores: &[Score]) -> [usize; 3] {
    let count = |so: &dyn Fn(&Score) -> bool| scores.iter().filter(|score| so(score)).count();
    [count(&|score| score.s2), count(&|score| score.s1), count(&Score::ended)]
}

/// Searches each law's parameters and says the best.
pub(super) fn tune(args: &CompareArgs, laws: &[Strategy], as_json: bool) -> Result<ExitCode, Failure> {
    if args.scenarios != [SWEEP] {
        return Err(Failure::Input("--tune searches on the lines of the sweep: armplane compare sweep --tune".to_owned()));
    }
    let loaded = load::scenario(SWEEP, &args.set, args.seed)?;
    let seed = loaded.scenario.seed + SEED_OFFSET;
    let lines = draw(&loaded, seed, args)?;
    let mut told = Vec::new();
    for law in laws {
        let points = points(*law);
        if points.is_empty() {
            continue;
        }
        let work: Vec<_> = points.iter().flat_map(|point| lines.iter().map(|line| point.lay_over(&line.scenario))).collect();
        let scores = on_all_cores(law.name(), &work, |scenario| score(&loaded.robot, scenario));
        let scores = scores.into_iter().collect::<Result<Vec<_>, _>>().map_err(Failure::input)?;
        let mut ranked: Vec<_> = points.iter().zip(scores.chunks(lines.len())).collect();
        ranked.sort_by_key(|(_, scores)| std::cmp::Reverse(worth(scores)));
        told.push(json!({"law": law.name(), "points": ranked.iter().map(|(point, scores)| {
            let [s2, s1, ends] = worth(scores);
            json!({"settings": point.settings, "s2": s2, "s1": s1, "ends": ends})
        }).collect::<Vec<_>>()}));
        if as_json {
            continue;
        }
        say!("{}: {} settings on {} lines at {} m/s (seed {seed})", law.name(), ranked.len(), lines.len(), args.speed);
        let mut rows = table(&["S2", "S1", "ends", "settings", "S2 missed by"]);
        for (point, scores) in ranked.iter().take(SHOWN) {
            let mut row = worth(scores).map(number).to_vec();
            row.extend([point.settings.clone().into(), missed(scores).into()]);
            rows.add_row(row);
        }
        say!("{rows}");
    }
    if as_json {
        say!("{}", json!({"lines": lines.len(), "seed": seed, "speed_m_s": args.speed, "laws": told}));
    }
    Ok(ExitCode::SUCCESS)
}
