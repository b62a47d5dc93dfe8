//! `armplane run`: one run, and its summary for people or machines.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, ValueEnum};
use launcher::End;
use session::{Failure, Request, SUMMARY, load};
use shared_types::job::Mode;
use shared_types::summary::Summary;

use crate::out::say;
use crate::progress::Terminal;
use crate::table::{digits, number, table};

#[derive(Args)]
pub(crate) struct RunArgs {
    /// A built-in scenario's name, or a scenario file.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: String,
    /// Folder for the results [default: the next free runs/SCENARIO-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// How time passes.
    #[arg(long, value_enum, default_value = "lockstep")]
    mode: ModeArg,
    /// Seed of every random number of the run [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Lay a value over the scenario's, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// A process graph of your own instead of the built-in one.
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Judge and hash, but write no recording.
    #[arg(long)]
    no_record: bool,
    /// Show the recording in the installed Rerun viewer as it is made; the run does not wait for it.
    #[arg(long, conflicts_with = "no_record")]
    live: bool,
    /// Do not keep the messages themselves, which `armplane replay` reads.
    #[arg(long)]
    no_messages: bool,
    /// Kill and replace a process that makes no progress for so many seconds [default: 2 in real time, no limit in lockstep].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    silence_limit: Option<Duration>,
}

/// A number of seconds that a clock can count.
fn seconds(text: &str) -> Result<Duration, String> {
    let parsed = text.parse().ok().filter(|seconds| (0.001..=1e6).contains(seconds));
    parsed.map(Duration::from_secs_f64).ok_or_else(|| format!("`{text}` is not a time: seconds from 0.001 to 1000000"))
}

impl Default for RunArgs {
    fn default() -> Self {
        Self {
            scenario: load::DEFAULT_SCENARIO.to_owned(),
            out: None,
            mode: ModeArg::Lockstep,
            seed: None,
            set: Vec::new(),
            graph: None,
            no_record: false,
            live: false,
            no_messages: false,
            silence_limit: None,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum ModeArg {
    /// As fast as the machine allows, bit-identical.
    Lockstep,
    /// Paced on absolute deadlines.
    Realtime,
}

impl From<ModeArg> for Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Lockstep => Self::Lockstep,
            ModeArg::Realtime => Self::Realtime,
        }
    }
}

pub(crate) fn run(args: &RunArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let request = Request {
        scenario: args.scenario.clone(),
        settings: args.set.clone(),
        seed: args.seed,
        graph: args.graph.clone(),
        mode: args.mode.into(),
        out: args.out.clone(),
        record: !args.no_record,
        messages: !args.no_messages,
        live: args.live,
        silence_limit: args.silence_limit,
    };
    let terminal = Terminal::default();
    let finished = session::run(&request, &|progress| terminal.show(progress))?;
    if as_json {
        say!("{}", serde_json::to_string_pretty(&finished.summary).map_err(Failure::work)?);
    } else {
        print(&finished.summary, &finished.folder);
    }
    if let End::Failed(failure) = &finished.end {
        return Err(Failure::Work(failure.to_string()));
    }
    finished.kept?;
    Ok(if finished.summary.outcome == "goal reached" { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

pub(crate) fn print(summary: &Summary, folder: &Path) {
    say!("{}: {} — {}\n", summary.scenario, summary.outcome, summary.reason);
    let mut rows = table(&["task", "largest", "orthogonal to ζ", "at the end"]);
    let task = &summary.task;
    rows.add_row([
        "position, mm".into(),
        number(digits(task.position_max_mm)),
        number(digits(task.orthogonal_max_mm)),
        number(digits(task.final_position_mm)),
    ]);
    rows.add_row([
        "orientation, °".into(),
        number(digits(task.orientation_max_deg)),
        number(digits(task.orthogonal_max_deg)),
        number(digits(task.final_orientation_deg)),
    ]);
    say!("{rows}");
    let mut rows = table(&["singularity", "type", "min |s|", "inside, ticks", "ζ turned, °"]);
    for singularity in &summary.singularities {
        rows.add_row([
            singularity.name.clone().into(),
            singularity.class.clone().into(),
            number(digits(singularity.s_min)),
            number(singularity.inside_ticks),
            number(digits(singularity.zeta_turned_deg)),
        ]);
    }
    say!("{rows}");
    for turn in &summary.turns {
        let joints = |moves: &[f64]| moves.iter().map(|by| format!("{by:+.2}")).collect::<Vec<_>>().join(" ");
        say!("ζ turned   {} at tick {}", turn.singularity, turn.tick);
        say!("           planned: joints by {} ° in {:.2} s", joints(&turn.planned_deg), turn.planned_s);
        say!(
            "           actual:  joints by {} ° in {:.2} s",
            joints(&turn.moved_deg),
            turn.took_ticks as f64 / f64::from(summary.rate_hz.max(1))
        );
    }
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let joints = &summary.joints;
    // An arm that moves has used some of each limit that it has.
    let torque = match joints.torque_max_ratio > 0.0 {
        true => format!(
            "torque {} of the limit, largest step in one tick {}",
            percent(joints.torque_max_ratio),
            percent(joints.torque_step_max_ratio)
        ),
        false => "torque without a limit".to_owned(),
    };
    let speed = match joints.speed_max_ratio > 0.0 {
        true => format!("speed {} of the limit", percent(joints.speed_max_ratio)),
        false => "speed without a limit".to_owned(),
    };
    say!("joints     {torque}; {speed}");
    if joints.switches > 0 {
        say!("switches   {} changes of mode; mode switches injected {} mJ", joints.switches, digits(joints.switch_energy_j * 1e3));
    }
    let simulated_s = summary.ticks as f64 / f64::from(summary.rate_hz.max(1));
    say!(
        "time       {} ticks at {} Hz in {:.2} s: {:.0} ticks/s, {:.1} × real time, {}",
        summary.ticks,
        summary.rate_hz,
        summary.wall_s,
        summary.ticks_per_s,
        simulated_s / summary.wall_s.max(1e-9),
        summary.mode
    );
    if let Some(chain) = summary.latency_us.get("chain") {
        say!(
            "latency    sensor sent to torque received: p50 {:.1} µs, p99 {:.1}, p99.9 {:.1}, max {:.1}",
            chain.p50,
            chain.p99,
            chain.p999,
            chain.max
        );
    }
    if summary.deadlines.total > 0 {
        say!("deadlines  {} missed of {}", summary.deadlines.missed, summary.deadlines.total);
        for (cause, count) in &summary.deadlines.by_cause {
            say!("           {count} {cause}");
        }
    }
    for fault in summary.faults.iter().filter(|fault| fault.fault.is_some()) {
        let ms = |event: &str, ms: Option<f64>| ms.map(|ms| format!(", {event} after {ms:.2} ms")).unwrap_or_default();
        let course = if fault.injected {
            ms("detected", fault.detected_ms) + &ms("recovered", fault.recovered_ms)
        } else {
            ", did not take effect".into()
        };
        say!("fault      {} ({}){course}", fault.detail, fault.origin);
    }
    if !summary.recorder.error.is_empty() {
        say!("recording  {}", summary.recorder.error);
    }
    say!("\n{}", folder.display());
    if folder.join(SUMMARY).exists() {
        say!("  {SUMMARY}  all of this and more, for machines");
    }
    if !summary.recorder.file.is_empty() {
        say!(
            "  {}       {:.1} MB{}; open it with: armplane view {}",
            summary.recorder.file,
            summary.recorder.bytes as f64 / 1e6,
            if summary.recorder.parts > 1 { format!(" in {} parts", summary.recorder.parts) } else { String::new() },
            folder.display()
        );
    }
    if summary.recorder.messages_bytes > 0 {
        let (messages, megabytes) = (recorder::MESSAGES, summary.recorder.messages_bytes as f64 / 1e6);
        say!("  {messages}/     {megabytes:.1} MB; compute it again with: armplane replay {}", folder.display());
    }
}
