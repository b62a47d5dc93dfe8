//! Records the synthetic run and says what it cost: `cargo run --release -p viz --example synthetic -- OUT.rrd [REPEATS] [LAYOUT]`.

#![allow(non_snake_case)]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use model::Robot;
use shared_types::scenario::{Layout, Scenario};
use viz::{Recording, RunInfo, TickRow};

#[path = "../src/synthetic.rs"]
mod synthetic;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path: PathBuf = arguments.next().ok_or("usage: synthetic OUT.rrd [REPEATS] [control|timing|faults]")?.into();
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
    let run = RunInfo { scenario: &scenario, robot: &robot, run: "synthetic", version: env!("CARGO_PKG_VERSION"), seed: 1 };
    let mut recording = Recording::<6>::create(&path, &run)?;
    let mut spent = Duration::ZERO;
    let mut tick = 0;
    for _ in 0..repeats {
        let mut motion = synthetic::Run::new(&robot);
        for _ in 0..(synthetic::Run::DURATION_S * 1e3) as u64 {
            let m = motion.step();
            let row = TickRow {
                tick,
                sensor: Some(&m.sensor),
                plant_state: Some(&m.plant_state),
                estimate: Some(&m.estimate),
                report: Some(&m.report),
                command: Some(&m.command),
            };
            let start = Instant::now();
            recording.tick(&row)?;
            spent += start.elapsed();
            tick += 1;
        }
    }
    recording.save_blueprint(&path.with_extension("rbl"), layout)?;
    let start = Instant::now();
    let file = recording.finish()?;
    let minutes = tick as f64 / 60e3;
    println!(
        "{} ticks: {:.2} µs a tick, {:.1} MB a minute, {} chunks, {} bytes; finish {:.1} ms",
        file.ticks,
        spent.as_secs_f64() * 1e6 / tick as f64,
        file.bytes as f64 / 1e6 / minutes,
        file.chunks,
        file.bytes,
        start.elapsed().as_secs_f64() * 1e3
    );
    Ok(())
}
