//! The whole graph in real time beside a competing load on every core: which deadlines are missed, by which process, and why.

use std::collections::BTreeMap;

use launcher::End;
use model::Robot;
use serde_json::{Value, json};
use session::{Failure, Observer, load};
use shared_types::job::Mode;
use shared_types::scenario::Scenario;
use shared_types::summary::{Deadlines, Latency, RecorderSummary};

use crate::cpu_load::CpuLoad;
use crate::folder::scratch;
use crate::prolonged::prolonged;

/// The result of one rate.
pub struct Ran {
    /// Ticks per second.
    pub rate_hz: u32,
    /// Whether every core had a competing load.
    pub loaded: bool,
    /// Ticks run.
    pub ticks: u64,
    /// Outcome as in `summary.json`.
    pub outcome: String,
    /// By process.
    pub processes: Vec<String>,
    /// Missed deadlines by cause.
    pub deadlines: Deadlines,
    /// Latencies by hop, µs.
    pub latency_us: BTreeMap<String, Latency>,
    /// The recorder's summary.
    pub recorder: RecorderSummary,
}

/// Runs the graph in real time at `rate_hz` for `seconds`, with or without a competing load on every core.
///
/// # Errors
/// The run fails.
pub fn graph(
    robot: &Robot,
    scenario: &Scenario,
    rate_hz: u32,
    seconds: u64,
    loaded: bool,
    observer: Observer<'_>,
) -> Result<Ran, Failure> {
    let scenario = prolonged(scenario, rate_hz, seconds);
    let folder = scratch()?;
    let job = load::job(
        robot,
        scenario,
        load::graph(None)?,
        Mode::Realtime,
        folder.path().to_owned(),
    );
    let load = loaded.then(CpuLoad::start);
    let (outcome, account) = session::launch(&job, session::plan(&job)?, observer)?;
    drop(load);
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(failure) => return Err(Failure::work(failure)),
    }
    let account = account
        .ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?;
    Ok(Ran {
        rate_hz,
        loaded,
        ticks: outcome.ticks,
        outcome: account.outcome,
        processes: job
            .graph
            .process
            .iter()
            .map(|process| process.name.clone())
            .collect(),
        deadlines: session::deadlines(&job, &outcome),
        latency_us: account.latency_us,
        recorder: account.recorder,
    })
}

impl Ran {
    /// Deadlines that a process missed, by cause.
    pub fn missed(&self, process: &str) -> BTreeMap<&str, u64> {
        self.deadlines
            .by_cause
            .iter()
            .filter_map(|(name, count)| {
                let cause = name.strip_prefix(process)?.strip_prefix(": ")?;
                Some((cause, *count))
            })
            .collect()
    }

    /// Processor time per tick, µs.
    pub fn cpu_us_per_tick(&self) -> f64 {
        self.recorder.cpu_s * 1e6 / self.ticks.max(1) as f64
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let process = |name: &String| json!({"process": name, "missed": self.missed(name).values().sum::<u64>(), "causes": self.missed(name)});
        json!({
            "rate_hz": self.rate_hz, "load": self.loaded, "ticks": self.ticks, "outcome": self.outcome,
            "missed": self.deadlines.missed, "processes": self.processes.iter().map(process).collect::<Vec<_>>(),
            "latency_us": self.latency_us, "recorder": {"lost": self.recorder.lost, "cpu_us_per_tick": self.cpu_us_per_tick()},
        })
    }
}
