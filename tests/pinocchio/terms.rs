//! Times of armplane's algorithms on the built-in arm that is named, at the states of `terms.cpp`: one line per algorithm, its name and its median in ns.
#![allow(clippy::print_stdout, missing_docs)]

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use model::{Model, Robot};
use nalgebra::SVector;

const SAMPLES: usize = 5000;
const BATCH: u32 = 100;

fn row<const N: usize>(name: &str, work: impl Fn(&SVector<f64, N>, &SVector<f64, N>)) {
    let mut times: Vec<_> = (0..SAMPLES)
        .map(|sample| {
            let angle = sample as f64 * 0.01;
            let q = SVector::from_fn(|joint, _| 0.3 + (angle + joint as f64).sin());
            let qdot = SVector::from_fn(|joint, _| (angle * joint as f64).cos());
            let began = Instant::now();
            (0..BATCH).for_each(|_| work(black_box(&q), black_box(&qdot)));
            began.elapsed().as_secs_f64() * 1e9 / f64::from(BATCH)
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name} {:.1}", times[SAMPLES / 2]);
}

fn terms<const N: usize>(robot: &Robot) -> Result<(), Box<dyn Error>> {
    let model = Model::<N>::new(robot, None)?;
    row("A, bias and J in one pass", |q, qdot| {
        black_box(model.evaluate(q, qdot));
    });
    row("mass matrix", |q, _| {
        black_box(model.mass_matrix(q));
    });
    row("inverse dynamics", |q, qdot| {
        black_box(model.inverse_dynamics(q, qdot, qdot));
    });
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1).unwrap_or_default();
    let robot = Robot::builtin(&name)?;
    match robot.joints.len() {
        6 => terms::<6>(&robot),
        _ => terms::<7>(&robot),
    }
}
