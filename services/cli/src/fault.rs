//! `armplane fault`: injects a fault into a running graph.

use clap::Args;
use serde_json::json;
use session::{Failure, fault_kinds, inject};
use shared_types::fault::{Fault, Kind, Way};

use crate::out::{answer, say_json, show};

/// A stretch of time as people write it: `100ms`, `0.5s`, or a bare number of ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Length {
    Ticks(u64),
    Seconds(f64),
}

impl std::str::FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let seconds = |number: &str, unit: f64| {
            number
                .trim()
                .parse::<f64>()
                .ok()
                .map(|number| Self::Seconds(number * unit))
        };
        let parsed = match text.strip_suffix("ms") {
            Some(number) => seconds(number, 1e-3),
            None => match text.strip_suffix('s') {
                Some(number) => seconds(number, 1.0),
                None => text.trim().parse().ok().map(Self::Ticks),
            },
        };
        parsed.ok_or_else(|| {
            format!("`{text}` is not a duration: give 100ms, 0.5s, or a number of ticks")
        })
    }
}

#[derive(Args)]
pub(crate) struct FaultArgs {
    /// The process.
    process: Option<String>,
    /// The kind of fault; --list shows all.
    kind: Option<Kind>,
    /// List all kinds of faults, their effects, and the processes they apply to.
    #[arg(long)]
    list: bool,
    /// Variant of the fault, if its kind has several.
    #[arg(long = "as", value_name = "VARIANT")]
    way: Option<Way>,
    /// Duration: 100ms, 0.5s, or a number of ticks [default: the kind's].
    #[arg(long = "for", value_name = "LENGTH")]
    length: Option<Length>,
    /// Share of messages affected, 0 to 1.
    #[arg(long, value_name = "P")]
    probability: Option<f64>,
    /// Delay of messages, in ticks.
    #[arg(long, value_name = "TICKS")]
    delay: Option<u64>,
    /// Largest random extra delay, in ticks.
    #[arg(long, value_name = "TICKS")]
    jitter: Option<u64>,
    /// Field to corrupt, for example tau[2].
    #[arg(long, value_name = "FIELD")]
    field: Option<String>,
    /// Topic to cut [default: the first it reads].
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Joint, counted from 1.
    #[arg(long, value_name = "N")]
    joint: Option<u32>,
    /// Amount, in the unit that --list shows.
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    amount: Option<f64>,
    /// The run's folder or scenario; needed if several are alive, or the run was started from another folder (`armplane ps` lists them).
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
}

pub(crate) fn fault(args: &FaultArgs, as_json: bool) -> Result<bool, Failure> {
    let (Some(process), Some(kind)) = (&args.process, args.kind) else {
        if args.list {
            if as_json {
                say_json(&fault_kinds::json())?;
            } else {
                show(&fault_kinds::text());
            }
            return Ok(true);
        }
        return Err(Failure::input(
            "name a process and a kind: armplane fault PROCESS KIND; `armplane fault --list` shows the kinds",
        ));
    };
    let (for_ticks, for_s) = match args.length {
        Some(Length::Ticks(ticks)) => (Some(ticks), None),
        Some(Length::Seconds(seconds)) => (None, Some(seconds)),
        None => (None, None),
    };
    let fault = Fault {
        way: args.way,
        for_ticks,
        for_s,
        probability: args.probability,
        delay_ticks: args.delay,
        jitter_ticks: args.jitter,
        field: args.field.clone(),
        topic: args.topic.clone(),
        joint: args.joint,
        amount: args.amount,
        ..Fault::new(process, kind)
    };
    let (living, in_force) = inject(args.run.as_deref(), &fault)?;
    answer(
        as_json,
        &json!({ "run": living.run, "tick": in_force.at_tick, "fault": in_force }),
        &format_args!("{in_force} ({living})\n"),
    );
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_read_with_and_without_a_unit() {
        assert_eq!("100ms".parse(), Ok(Length::Seconds(0.1)));
        assert_eq!("0.5 s".parse(), Ok(Length::Seconds(0.5)));
        assert_eq!("40".parse(), Ok(Length::Ticks(40)));
        assert!(
            "soon"
                .parse::<Length>()
                .unwrap_err()
                .contains("a number of ticks")
        );
    }
}
