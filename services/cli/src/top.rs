//! `armplane top`: a running graph, seen from its control page. It only reads: the run's processes are not affected.
//! Percentiles are those of the time between two samples, the longest that of the whole run.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use session::Failure;
use session::observation::{Observation, ObservedFault, ObservedProcess, ObservedSingularity, Observer, Times, choose};

use crate::out::say;
use session::table::{fitted, number};
use viz::plot::digits;

#[derive(Args)]
pub(crate) struct TopArgs {
    /// The run's name, where several are alive (see `armplane doctor --json`).
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    /// Print one sample, then leave.
    #[arg(long)]
    once: bool,
    /// Time between two samples; ms.
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(10..=60_000))]
    every_ms: u64,
}

pub(crate) fn top(args: &TopArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let mut observer = Observer::open(&choose(args.run.as_deref())?)?;
    loop {
        std::thread::sleep(Duration::from_millis(args.every_ms));
        let observation = observer.observe();
        if as_json {
            say!("{}", serde_json::to_string(&observation).map_err(Failure::work)?);
        } else {
            if !args.once {
                // To the upper left corner, and clear what is below.
                print!("\x1b[H\x1b[J");
            }
            print(&observation);
        }
        let is_over = observer.is_over();
        if args.once || is_over {
            if is_over && !as_json {
                say!("the run has ended");
            }
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// "p50 / p99 / longest" in µs; empty for a process that computes nothing.
fn in_words(times: &Times) -> String {
    let part = |time: Option<f64>| time.map_or("–".to_owned(), digits);
    if times.in_all == 0 { String::new() } else { format!("{} / {} / {}", part(times.p50), part(times.p99), digits(times.max)) }
}

fn print(run: &Observation) {
    say!("{}: {}, {} Hz", run.run, run.mode, run.rate_hz);
    let mut rows = fitted(&["process", "state", "pid", "starts", "core", "ticks", "ticks/s"]);
    let mut times = fitted(&["process", "step, µs", "age, µs", "missed", "lost", "refused"]);
    for ObservedProcess { name, state, pid, starts, core, ticks, ticks_per_s, missed, counts, step_us, age_us } in &run.processes {
        rows.add_row([
            name.into(),
            (*state).into(),
            number(pid),
            number(starts),
            number(core.map_or("any".to_owned(), |core| core.to_string())),
            number(ticks),
            number(format!("{ticks_per_s:.0}")),
        ]);
        times.add_row([
            name.into(),
            number(in_words(step_us)),
            number(in_words(age_us)),
            number(missed),
            number(counts.lost),
            number(counts.not_finite + counts.fenced),
        ]);
    }
    say!("{rows}\n{times}");
    say!("step: input to output; age: since the tick's sample; p50 / p99 / longest");
    let stale = if run.stale_ticks > 0 { format!(", no fresh torque for {} ticks", run.stale_ticks) } else { String::new() };
    say!("arm   drive {}{stale}; task {}", run.drive, run.phase);
    for ObservedSingularity { name, s, inside, class, mode } in &run.singularities {
        say!("      {name:<9} s = {s:+.4}, {}, {class}, {mode}", if *inside { "inside" } else { "outside" });
    }
    for ObservedFault { process, kind, origin, tick, active } in &run.faults {
        say!("fault {kind} of {process} from tick {tick}, {origin}, {}", if *active { "active" } else { "inactive" });
    }
}
