//! An hour of the arm's time in lockstep, everything recorded: what memory, files and processor time come to, and whether they stay level.

use std::collections::BTreeMap;

use launcher::{End, Event};
use model::Robot;
use serde::Serialize;
use session::{Failure, Observer, Progress, load};
use shared_types::job::Mode;
use shared_types::scenario::Scenario;

use crate::folder::scratch;
use crate::prolonged::prolonged;

/// Memory is looked at so often; s of the arm's time.
pub const EVERY_S: u64 = 60;

/// Anonymous memory of a process; MB. Shared memory is apart: its pages count for each process that has touched them.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Memory {
    /// Anonymous memory, MB.
    pub own_mb: f64,
    /// Shared memory that it has touched, MB.
    pub shared_mb: f64,
}

/// All processes at a moment of the arm's time.
#[derive(Debug, Serialize)]
pub struct Look {
    /// The arm's time, s.
    pub at_s: f64,
    /// By process.
    pub processes: BTreeMap<String, Memory>,
}

/// The results of the hour.
#[derive(Debug, Serialize)]
pub struct Hour {
    /// Ticks run.
    pub ticks: u64,
    /// Ticks per second of wall-clock time.
    pub ticks_per_s: f64,
    /// Outcome as in `summary.json`.
    pub outcome: String,
    /// The recorder's processor time per tick, µs.
    pub recorder_cpu_us_per_tick: f64,
    /// Size of the recording per minute of the arm's time, MB.
    pub recording_mb_per_min: f64,
    /// Size of the message log per minute of the arm's time, MB.
    pub messages_mb_per_min: f64,
    /// Parts of the recording.
    pub parts: u32,
    /// Messages lost by the recorder.
    pub lost: u64,
    /// Memory over time.
    pub memory: Vec<Look>,
}

/// Runs `scenario`, prolonged to `seconds` of the arm's time, in lockstep.
///
/// # Errors
/// The run fails.
pub fn hour(
    robot: &Robot,
    scenario: &Scenario,
    seconds: u64,
    observer: Observer<'_>,
) -> Result<Hour, Failure> {
    let folder = scratch()?;
    let job = load::job(
        robot,
        prolonged(scenario, scenario.rate_hz, seconds),
        load::graph(None)?,
        Mode::Lockstep,
        folder.path().to_owned(),
    );
    let rate_hz = f64::from(job.scenario.rate_hz);
    observer(Progress::Begin {
        title: &job.scenario.name,
        length: job.scenario.planned_ticks(),
        unit: "ticks",
    });
    let mut memory: Vec<Look> = Vec::new();
    let launched =
        session::launch_watched(&job, session::plan(&job)?, &mut |_| Ok(()), &mut |event| {
            match event {
                Event::Progress { ticks } => {
                    observer(Progress::Position(*ticks));
                    let at_s = *ticks as f64 / rate_hz;
                    // Not at once: a process that has just started has not touched yet what it will always need.
                    if at_s >= (EVERY_S * (memory.len() as u64 + 1)) as f64 {
                        memory.push(Look {
                            at_s,
                            processes: children(),
                        });
                    }
                }
                Event::Line { process, line } => {
                    observer(Progress::Line(&format!("{process}: {line}")))
                }
                _ => {}
            }
        });
    observer(Progress::End);
    let (outcome, account) = launched?;
    match &outcome.end {
        End::Completed => {}
        End::Interrupted { signal } => return Err(Failure::Work(format!("stopped by {signal}"))),
        End::Failed(failure) => return Err(Failure::work(failure)),
    }
    let account = account
        .ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?;
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
    let threads = std::fs::read_dir("/proc/self/task")
        .into_iter()
        .flatten()
        .flatten();
    let pids: Vec<String> = threads
        .flat_map(|thread| {
            let children =
                std::fs::read_to_string(thread.path().join("children")).unwrap_or_default();
            children
                .split_whitespace()
                .map(str::to_owned)
                .collect::<Vec<_>>()
        })
        .collect();
    let of = |pid: &String| {
        let name = read(format!("/proc/{pid}/cmdline"))
            .split('\0')
            .nth(1)?
            .to_owned();
        let status = read(format!("/proc/{pid}/status"));
        let mb = |key: &str| {
            let line = status
                .lines()
                .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
            line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok())
                .unwrap_or(0.0)
                / 1e3
        };
        Some((
            name,
            Memory {
                own_mb: mb("RssAnon"),
                shared_mb: mb("RssShmem"),
            },
        ))
    };
    pids.iter().filter_map(of).collect()
}
