//! An hour of the arm's time in lockstep, everything recorded: what memory, files and processor time come to, and whether they stay level.

use std::collections::BTreeMap;

use launcher::{End, Event};
use model::Robot;
use serde::Serialize;
use shared_types::job::Mode;
use shared_types::scenario::Scenario;

use super::super::failure::Failure;
use super::super::out::say;
use super::super::run;
use super::super::table::{digits, number, table};
use super::realtime::prolonged;

/// Memory is looked at so often; s of the arm's time.
const EVERY_S: u64 = 60;

/// What a process holds that no file backs; MB. Shared memory is apart: its pages count for everyone that has touched them.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Memory {
    own_mb: f64,
    shared_mb: f64,
}

/// All processes at a moment of the arm's time.
#[derive(Debug, Serialize)]
struct Look {
    at_s: f64,
    processes: BTreeMap<String, Memory>,
}

/// What the hour came to.
#[derive(Debug, Serialize)]
pub(super) struct Hour {
    ticks: u64,
    ticks_per_s: f64,
    outcome: String,
    recorder_cpu_us_per_tick: f64,
    recording_mb_per_min: f64,
    messages_mb_per_min: f64,
    parts: u32,
    lost: u64,
    memory: Vec<Look>,
}

pub(super) fn hour(robot: &Robot, scenario: &Scenario, seconds: u64) -> Result<Hour, Failure> {
    let folder = super::scratch()?;
    let job = super::job(robot, prolonged(scenario, scenario.rate_hz, seconds), Mode::Lockstep, folder.path())?;
    let rate_hz = f64::from(job.scenario.rate_hz);
    let bar = run::progress_bar(&job.scenario);
    let mut memory: Vec<Look> = Vec::new();
    let launched = run::launch_quietly(&job, run::plan(&job)?, &mut |_| Ok(()), &mut |event| match event {
        Event::Progress { ticks } => {
            bar.set_position(*ticks);
            let at_s = *ticks as f64 / rate_hz;
            // Not at once: a process that has just started has not touched yet what it will always need.
            if at_s >= (EVERY_S * (memory.len() as u64 + 1)) as f64 {
                memory.push(Look { at_s, processes: children() });
            }
        }
        Event::Line { process, line } => bar.suspend(|| eprintln!("{process}: {line}")),
        _ => {}
    });
    bar.finish_and_clear();
    let (outcome, account) = launched?;
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(failure) => return Err(Failure::work(failure)),
    }
    let account = account.ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?;
    if !account.recorder.error.is_empty() {
        return Err(Failure::Work(account.recorder.error));
    }
    let per_tick = |amount: f64| amount / outcome.ticks.max(1) as f64;
    let mb_per_min = |bytes: u64| per_tick(bytes as f64 * 1e-6) * rate_hz * 60.0;
    Ok(Hour {
        ticks: outcome.ticks,
        ticks_per_s: account.ticks_per_s,
        outcome: account.outcome,
        recorder_cpu_us_per_tick: per_tick(account.recorder.cpu_s * 1e6),
        recording_mb_per_min: mb_per_min(account.recorder.bytes),
        messages_mb_per_min: mb_per_min(account.recorder.messages_bytes),
        parts: account.recorder.parts,
        lost: account.recorder.lost,
        memory,
    })
}

/// Memory of this program's children, by the name of the process each of them is.
fn children() -> BTreeMap<String, Memory> {
    let read = |path: String| std::fs::read_to_string(path).unwrap_or_default();
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let pids: Vec<String> = threads
        .flat_map(|thread| {
            let children = std::fs::read_to_string(thread.path().join("children")).unwrap_or_default();
            children.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        })
        .collect();
    let of = |pid: &String| {
        let name = read(format!("/proc/{pid}/cmdline")).split('\0').nth(1)?.to_owned();
        let status = read(format!("/proc/{pid}/status"));
        let mb = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
            line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok()).unwrap_or(0.0) / 1e3
        };
        Some((name, Memory { own_mb: mb("RssAnon"), shared_mb: mb("RssShmem") }))
    };
    pids.iter().filter_map(of).collect()
}

impl Hour {
    pub(super) fn tell(&self) {
        let Some((first, last)) = self.memory.first().zip(self.memory.last()) else {
            say!("shorter than the {EVERY_S} s after which memory is looked at first");
            return;
        };
        say!(
            "\n{:.0} s of the arm's time, {} ticks at {:.0} a second, {}: {:.1} µs of processor time a tick in the recorder, {:.1} MB a minute of \
             recording in {} parts and {:.0} of messages, {} lost",
            last.at_s,
            self.ticks,
            self.ticks_per_s,
            self.outcome,
            self.recorder_cpu_us_per_tick,
            self.recording_mb_per_min,
            self.parts,
            self.messages_mb_per_min,
            self.lost
        );
        let headings = ["process", "after 1 min, MB", "most", "at the end", "change in the second half", "shared, MB"];
        let mut rows = table(&headings);
        for name in first.processes.keys() {
            let own = |look: &Look| look.processes.get(name).map_or(0.0, |memory| memory.own_mb);
            let most = self.memory.iter().map(own).fold(0.0, f64::max);
            let half = &self.memory[self.memory.len() / 2];
            let shared = last.processes.get(name).map_or(0.0, |memory| memory.shared_mb);
            let numbers = [own(first), most, own(last)].map(|mb| number(digits(mb)));
            let change = number(format!("{:+.2}", own(last) - own(half)));
            rows.add_row([name.into()].into_iter().chain(numbers).chain([change, number(digits(shared))]));
        }
        say!("{rows}");
    }
}
