//! `armplane replay`: recorded inputs, fed to the step of one process again.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use lab::conformance::Topic;
use lab::conformance::replay::{self, Replayed};
use message_log::{Difference, FieldDifference};
use serde_json::json;
use session::Failure;
use shared_types::job::Job;
use shared_types::process::Program;

use crate::out::say;
use crate::progress::Terminal;
use crate::table::{digits, number, table};

#[derive(Args)]
pub(crate) struct ReplayArgs {
    /// The results folder of a run.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Which process.
    #[arg(long, value_name = "PROCESS", default_value = "controller", value_parser = replayable)]
    process: Program,
    /// Lay a value over the recorded scenario's, for example control.k_p=900 (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// A process whose step can be fed again: all but the one that records.
fn replayable(name: &str) -> Result<Program, String> {
    let is_replayable = |program: &Program| *program != Program::Recorder;
    let known =
        || Program::ALL.iter().filter(|program| is_replayable(program)).map(|program| program.name()).collect::<Vec<_>>().join(", ");
    Program::named(name).filter(is_replayable).ok_or_else(|| format!("its step cannot be fed again; it can be of {}", known()))
}

pub(crate) fn replay(args: &ReplayArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let terminal = Terminal::default();
    let process = args.process;
    let (job, replayed) = replay::replay(&args.run, process, &args.set, &|progress| terminal.show(progress))?;
    if as_json {
        print_json(args, process.name(), &job, &replayed);
    } else {
        print(process.name(), &job, &replayed);
    }
    Ok(ExitCode::from(u8::from(replayed.first().is_some())))
}

fn print(process: &str, job: &Job, replayed: &Replayed) {
    if let Some((tick, topic, Difference { field, expected, found })) = replayed.first() {
        let mut rows = table(&["topic", "field", "messages", "largest", "at tick", "element", "recorded", "replayed"]);
        for topic in &replayed.topics {
            for FieldDifference { field, messages, largest, tick, difference } in &topic.fields {
                rows.add_row([
                    topic.name.into(),
                    field.clone().into(),
                    number(format!("{messages} of {}", topic.messages)),
                    number(digits(*largest)),
                    number(tick),
                    difference.field.clone().into(),
                    number(&difference.expected),
                    number(&difference.found),
                ]);
            }
        }
        say!("{rows}");
        say!("{process} first differs at tick {tick}, topic {topic}, field {field}: {found} instead of {expected}");
    }
    if replayed.without_input > 0 {
        say!("{} outputs could not be computed: their inputs are not in the record", replayed.without_input);
    }
    if !replayed.ended.is_empty() {
        say!("{}", replayed.ended);
    }
    let messages: u64 = replayed.topics.iter().map(|topic| topic.messages).sum();
    let verdict = if replayed.first().is_none() { "the same bytes" } else { "NOT the same bytes" };
    say!("{}, seed {}, {process}, {messages} messages: {verdict}", job.scenario.name, job.scenario.seed);
}

fn print_json(args: &ReplayArgs, process: &str, job: &Job, replayed: &Replayed) {
    let first = replayed.first().map(|(tick, topic, Difference { field, expected, found })| {
        json!({"tick": tick, "topic": topic, "field": field, "recorded": expected, "replayed": found})
    });
    let topic = |topic: &Topic| {
        let field = |field: &FieldDifference| {
            json!({
                "field": field.field, "messages": field.messages, "largest": field.largest, "tick": field.tick,
                "element": field.difference.field, "recorded": field.difference.expected, "replayed": field.difference.found,
            })
        };
        json!({"topic": topic.name, "messages": topic.messages, "fields": topic.fields.iter().map(field).collect::<Vec<_>>()})
    };
    say!(
        "{}",
        json!({
            "run": job.run, "scenario": job.scenario.name, "seed": job.scenario.seed, "version": job.version, "process": process,
            "set": args.set, "identical": first.is_none(), "difference": first, "topics": replayed.topics.iter().map(topic).collect::<Vec<_>>(),
            "without_input": replayed.without_input, "ended": replayed.ended,
        })
    );
}
