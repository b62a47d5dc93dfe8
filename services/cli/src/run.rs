//! `armplane run`: one run, and its summary for people or machines.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Parser, ValueEnum};
use launcher::End;
use session::{Failure, Finished, Place, Request, load};
use shared_types::job::Mode;

use crate::out::{Form, show_run, tell};
use crate::progress::observe;

#[derive(Parser)]
pub(crate) struct RunArgs {
    /// A built-in scenario, or a scenario file.
    #[arg(value_name = "SCENARIO|FILE.toml", default_value = load::DEFAULT_SCENARIO)]
    scenario: String,
    /// Folder for the results [default: the next free runs/SCENARIO-NNN].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on from a tick of a run in lockstep: with the same bytes, or with --set as a branch of it.
    #[arg(
        long,
        value_name = "RUN@TICK",
        conflicts_with_all = ["scenario", "mode", "plant", "ros2", "seed", "graph", "no_record"]
    )]
    from: Option<Place>,
    /// Pace of the run [default: lockstep; realtime on a robot].
    #[arg(long, value_enum, hide_default_value = true)]
    mode: Option<ModeArg>,
    /// In place of the simulated arm: MuJoCo (docs/python.md), or a Franka arm, fci://HOST (docs/franka.md).
    #[arg(long, value_name = "mujoco|mujoco:SCENE.xml|ADDRESS")]
    plant: Option<String>,
    /// Seed of every random number of the run [default: the scenario's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Override a value of the scenario, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Your own process graph.
    #[arg(long, value_name = "FILE.toml")]
    graph: Option<PathBuf>,
    /// Keep no record, hence no picture; the run is still judged and hashed.
    #[arg(long)]
    no_record: bool,
    /// Show the run live in the Rerun viewer; the run does not wait for it.
    #[arg(long, conflicts_with = "no_record")]
    live: bool,
    /// Show the run on topics of ROS 2 (docs/ros2.md); options: rate=HZ, units, clock, network.
    #[arg(long, value_name = "OPTION,…", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    ros2: Option<String>,
    /// Replace a process that makes no progress for this long [default: in real time 2, or 0.1 if something has stopped it (SIGSTOP); none in lockstep].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    silence_limit: Option<Duration>,
}

/// A number of seconds that a clock can count.
fn seconds(text: &str) -> Result<Duration, String> {
    let parsed = text
        .parse()
        .ok()
        .filter(|seconds| (0.001..=1e6).contains(seconds));
    parsed
        .map(Duration::from_secs_f64)
        .ok_or_else(|| format!("`{text}` is not a time: seconds from 0.001 to 1000000"))
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum ModeArg {
    /// As fast as the machine allows; reproducible to the bit.
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

pub(crate) fn run(args: &RunArgs, form: Form) -> Result<bool, Failure> {
    let request = Request {
        scenario: match &args.from {
            Some(place) => place.run.display().to_string(),
            None => args.scenario.clone(),
        },
        from: args.from.clone(),
        settings: args.set.clone(),
        seed: args.seed,
        graph: args.graph.clone(),
        plant: args.plant.clone(),
        ros2: args.ros2.clone(),
        mode: args
            .mode
            .map_or_else(|| session::mode_of(args.plant.as_deref()), Mode::from),
        out: args.out.clone(),
        record: !args.no_record,
        live: args.live,
        silence_limit: args.silence_limit,
        unread: crate::out::unread,
    };
    let replaced = args.out.as_ref().filter(|out| session::holds_run(out));
    let finished = session::run(&request, &observe)?;
    if let Some(out) = replaced {
        tell(&format_args!(
            "{}: replaces the run that was there",
            out.display()
        ));
    }
    conclude(finished, form)
}

/// Prints the results of a run; whether it did its task.
pub(crate) fn conclude(finished: Finished, form: Form) -> Result<bool, Failure> {
    let Finished {
        summary,
        folder,
        end,
        saved,
        signals,
    } = finished;
    // These words have a limit of their own.
    std::mem::forget(signals);
    show_run(&summary, &folder, form)?;
    match (end, saved) {
        (End::Failed(failure), _) => Err(Failure::work(failure)),
        (_, Err(failure)) => Err(failure),
        // For people the outcome is the last line; a program that keeps the summary may not look into it.
        (End::Interrupted { .. }, _) if matches!(form, Form::Json) => Err(Failure::Work(format!(
            "{}: the run was {}",
            folder.display(),
            summary.reason
        ))),
        _ => Ok(summary.is_success()),
    }
}
