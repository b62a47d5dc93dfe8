//! Records the synthetic run repeatedly and prints its cost:
//! `cargo run --release -p viz --example synthetic -- FOLDER [REPEATS] [control|timing|faults]`.

#![allow(non_snake_case)]

use std::path::PathBuf;

use model::Robot;
use shared_types::scenario::{Layout, Scenario};
use viz::{Recording, RunInfo, TickRow};

#[path = "../src/synthetic.rs"]
mod synthetic;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder: PathBuf = arguments
        .next()
        .ok_or("usage: synthetic FOLDER [REPEATS] [control|timing|faults]")?
        .into();
    let repeats: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let layout = match arguments.next().as_deref() {
        None | Some("control") => Layout::Control,
        Some("timing") => Layout::Timing,
        Some("faults") => Layout::Faults,
        Some(other) => return Err(format!("no layout {other:?}: control, timing or faults").into()),
    };
    let robot = Robot::builtin("puma560")?;
    let mut scenario = Scenario::parse("synthetic.toml", synthetic::SCENARIO, &[])?;
    scenario.view.layout = layout;
    let run = RunInfo {
        scenario: &scenario,
        robot: &robot,
        run: "synthetic",
        version: env!("CARGO_PKG_VERSION"),
        seed: 1,
        hops: Some([0, 1, 2, 3]),
        lives: viz::Lives::default(),
    };
    let mut motion = synthetic::Run::new(&robot);
    let messages: Vec<_> = (0..(synthetic::Run::DURATION_S * 1e3) as u64)
        .map(|_| motion.step())
        .collect();

    let mut recording = Recording::create(&folder, &run)?;
    let mut best_us = f64::INFINITY;
    let mut tick = 0;
    let begin = cpu_ns()?;
    for _ in 0..repeats {
        let start = cpu_ns()?;
        for m in &messages {
            recording.tick(&TickRow::new(tick, m.lent()))?;
            tick += 1;
        }
        best_us = best_us.min((cpu_ns()? - start) * 1e-3 / messages.len() as f64);
    }
    let mean_us = (cpu_ns()? - begin) * 1e-3 / tick as f64;
    recording.save_blueprint(&folder.join("run.rbl"), layout)?;
    let start = cpu_ns()?;
    let file = recording.finish()?;
    let minutes = tick as f64 / 60e3;
    println!(
        "{} ticks: {mean_us:.2} µs CPU a tick (best pass {best_us:.2}), {:.1} MB a minute, {} chunks, {} bytes; finish {:.1} ms",
        file.ticks,
        file.bytes as f64 / 1e6 / minutes,
        file.chunks,
        file.bytes,
        (cpu_ns()? - start) * 1e-6,
    );
    Ok(())
}

/// CPU time of this thread, which other load does not lengthen; ns.
fn cpu_ns() -> Result<f64, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(text
        .split(' ')
        .next()
        .ok_or("schedstat is empty")?
        .parse()?)
}
