//! The best that each baseline can be made: a search over its own parameters, on lines that no comparison uses.
//!
//! The defaults in `shared_types::scenario::Baseline` are the winners on 27 to 36 lines at 0.28 m/s; the two leading settings of damped least squares
//! were told apart on 126. The governor is searched too: no baseline does better without it.

use session::{Failure, Observer, load};
use shared_types::scenario::{Scenario, Strategy};

use super::{SWEEP, SweepSize, draw, rows};
use crate::row::Row;
use crate::trial::Trial;

/// Added to the seed: the lines tuned on are never those compared on.
const SEED_OFFSET: u64 = 1000;

/// One point of a search: values as `--set` takes them.
pub type Point = Vec<String>;

/// All points of a law's search; none for a law without parameters of its own.
fn points(law: Strategy) -> Vec<Point> {
    let product = |one: &[&str], other: &[&str], write: fn(&str, &str) -> String| {
        let write_all = |a: &&str| other.iter().map(|b| write(a, b)).collect::<Vec<_>>();
        one.iter().flat_map(write_all).collect::<Vec<_>>()
    };
    let damping = || {
        product(
            &["0.01", "0.02", "0.04", "0.08", "0.16", "0.32"],
            &["0.0025", "0.005", "0.01", "0.02", "0.04", "0.08"],
            |onset, largest| format!("={{onset={onset},largest={largest}}}"),
        )
    };
    let baselines: Vec<String> = match law {
        Strategy::DampedLeastSquares => damping()
            .iter()
            .map(|it| format!("damped_least_squares{it}"))
            .collect(),
        Strategy::JointPd => damping().iter().map(|it| format!("joint_pd{it}")).collect(),
        Strategy::TruncatedSvd => [
            0.003, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.06, 0.08,
        ]
        .map(|floor| format!("truncated_svd_floor={floor}"))
        .to_vec(),
        Strategy::HoldAndBlend => {
            let blends = [
                "0.001, 0.004",
                "0.001, 0.01",
                "0.001, 0.02",
                "0.003, 0.02",
                "0.006, 0.06",
            ];
            let gains = [
                "0.001,hold_k_v=2",
                "0.001,hold_k_v=5",
                "5,hold_k_v=4.5",
                "50,hold_k_v=14",
                "400,hold_k_v=40",
            ];
            let held = product(&blends, &gains, |blend, gains| {
                format!("[{blend}],hold_k_p={gains}")
            });
            let held: Vec<_> = held.iter().map(String::as_str).collect();
            product(&held, &["0.001", "0.01", "0.1"], |held, push| {
                format!("hold_and_blend={{blend={held},push={push}}}")
            })
        }
        _ => Vec::new(),
    };
    let with = |baseline: &String| {
        [true, false].map(|governor| {
            let governor = format!("control.governor={governor}");
            vec![format!("control.baseline.{baseline}"), governor]
        })
    };
    baselines.iter().flat_map(with).collect()
}

/// Lines with S2, with S1, and reached ends: in this order of weight.
#[must_use]
pub fn worth(rows: &[Row]) -> [usize; 3] {
    let of: [fn(&Row) -> bool; 3] = [|row| row.task.s2, |row| row.task.s1, Row::ended];
    of.map(|so| rows.iter().filter(|row| so(row)).count())
}

/// The points of a search with their rows, the best first.
pub type Ranked<'a> = [(&'a Point, &'a [Row])];

/// Searches each law's parameters; `each` gets each law's points with their rows, the best first. Returns the seed of the lines, and their
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
        let mut trials = Vec::new();
        for point in &points {
            let control = load::scenario(SWEEP, &[settings, point].concat(), None)?
                .scenario
                .control;
            trials.extend(lines.iter().map(|line| {
                let scenario = Scenario {
                    control: control.clone(),
                    ..line.scenario.clone()
                };
                Trial::under(*law, &loaded.robot, &scenario)
            }));
        }
        if points.is_empty() {
            continue;
        }
        let rows = rows(law.name(), &trials, observer).map_err(Failure::input)?;
        let mut ranked: Vec<_> = points.iter().zip(rows.chunks(lines.len())).collect();
        ranked.sort_by_key(|(_, rows)| std::cmp::Reverse(worth(rows)));
        each(*law, seed, &ranked);
    }
    Ok((seed, lines.len()))
}
