//! The whole graph in real time beside somebody else who wants every core: which deadlines are missed, by whom, and why.

use std::collections::BTreeMap;

use launcher::End;
use model::Robot;
use serde_json::{Value, json};
use shared_types::job::Mode;
use shared_types::scenario::{Scenario, Segment, Turn};
use shared_types::summary::{Deadlines, Latency, RecorderSummary};

use super::super::failure::Failure;
use super::super::hogs::Hogs;
use super::super::out::say;
use super::super::run;
use super::super::table::{digits, number, table};

/// What one rate gave.
pub(super) struct Ran {
    rate_hz: u32,
    loaded: bool,
    ticks: u64,
    outcome: String,
    processes: Vec<String>,
    deadlines: Deadlines,
    latency_us: BTreeMap<String, Latency>,
    recorder: RecorderSummary,
}

/// The default scenario's motion, there and back again until the time is over.
pub(super) fn prolonged(scenario: &Scenario, rate_hz: u32, seconds: u64) -> Scenario {
    let mut scenario = Scenario { rate_hz, ..scenario.clone() };
    let back = |segment: &Segment| {
        let turn = segment.turn.clone().map(|turn| Turn { by_deg: -turn.by_deg, ..turn });
        Segment { turn, ..segment.clone() }
    };
    let Some(last) = scenario.segment.last().cloned() else { return scenario };
    while scenario.duration_s() < seconds as f64 {
        let next = scenario.segment.last().map(back).unwrap_or_else(|| last.clone());
        scenario.segment.push(next);
    }
    scenario
}

pub(super) fn graph(robot: &Robot, scenario: &Scenario, rate_hz: u32, seconds: u64, loaded: bool) -> Result<Ran, Failure> {
    let scenario = prolonged(scenario, rate_hz, seconds);
    let folder = super::scratch()?;
    let job = super::job(robot, scenario, Mode::Realtime, folder.path())?;
    let hogs = loaded.then(Hogs::start);
    let (outcome, account) = run::launch(&job, run::plan(&job)?)?;
    drop(hogs);
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(failure) => return Err(Failure::work(failure)),
    }
    let account = account.ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?;
    Ok(Ran {
        rate_hz,
        loaded,
        ticks: outcome.ticks,
        outcome: account.outcome,
        processes: job.graph.process.iter().map(|process| process.name.clone()).collect(),
        deadlines: run::deadlines(&job, &outcome),
        latency_us: account.latency_us,
        recorder: account.recorder,
    })
}

impl Ran {
    /// Deadlines that a process missed, by cause.
    fn missed(&self, process: &str) -> BTreeMap<&str, u64> {
        self.deadlines
            .by_cause
            .iter()
            .filter_map(|(name, count)| {
                let cause = name.strip_prefix(process)?.strip_prefix(": ")?;
                Some((cause, *count))
            })
            .collect()
    }

    fn cpu_us_per_tick(&self) -> f64 {
        self.recorder.cpu_s * 1e6 / self.ticks.max(1) as f64
    }

    pub(super) fn json(&self) -> Value {
        let process =
            |name: &String| json!({"process": name, "missed": self.missed(name).values().sum::<u64>(), "causes": self.missed(name)});
        json!({
            "rate_hz": self.rate_hz, "load": self.loaded, "ticks": self.ticks, "outcome": self.outcome,
            "missed": self.deadlines.missed, "processes": self.processes.iter().map(process).collect::<Vec<_>>(),
            "latency_us": self.latency_us, "recorder": {"lost": self.recorder.lost, "cpu_us_per_tick": self.cpu_us_per_tick()},
        })
    }

    pub(super) fn tell(&self) {
        let load = if self.loaded { "a busy thread on every core" } else { "no load of ours" };
        let seconds = self.ticks as f64 / f64::from(self.rate_hz);
        say!(
            "\n{} Hz for {seconds:.0} s, {load}: {} of {} deadlines missed, {}",
            self.rate_hz,
            self.deadlines.missed,
            self.ticks,
            self.outcome
        );
        let mut rows = table(&["process", "missed", "why"]);
        for process in &self.processes {
            let causes = self.missed(process);
            let why = causes.iter().map(|(cause, count)| format!("{count} {cause}")).collect::<Vec<_>>().join(", ");
            rows.add_row([process.clone().into(), number(causes.values().sum::<u64>()), why.into()]);
        }
        say!("{rows}");
        let mut rows = table(&["latency", "samples", "p50 µs", "p99", "p99.9", "max"]);
        for (name, latency) in &self.latency_us {
            let times = [latency.p50, latency.p99, latency.p999, latency.max].map(|time| number(digits(time)));
            rows.add_row([name.clone().into(), number(latency.count)].into_iter().chain(times));
        }
        say!("{rows}");
        say!("recorder: {} lost, {:.1} µs of processor time a tick", self.recorder.lost, self.cpu_us_per_tick());
    }
}
