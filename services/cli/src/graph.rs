//! `armplane graph`: which process writes and reads which topic.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use session::{Failure, load};
use shared_types::graph::Graph;

use crate::out::say;
use session::table::{number, table};

#[derive(Args)]
pub(crate) struct GraphArgs {
    /// A process graph of your own instead of the built-in one.
    #[arg(value_name = "FILE.toml")]
    file: Option<PathBuf>,
    /// How to draw it.
    #[arg(long, value_enum, default_value = "text")]
    format: GraphFormat,
}

#[derive(Clone, Copy, ValueEnum)]
enum GraphFormat {
    /// A table for people.
    Text,
    /// Graphviz.
    Dot,
    /// Mermaid, as Markdown pages show it.
    Mermaid,
}

pub(crate) fn graph(args: &GraphArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let graph = load::graph(args.file.as_deref())?;
    match args.format {
        _ if as_json => say!("{}", serde_json::to_string(&graph).map_err(Failure::work)?),
        GraphFormat::Text => print_text(&graph),
        GraphFormat::Dot => print_dot(&graph),
        GraphFormat::Mermaid => print_mermaid(&graph),
    }
    Ok(ExitCode::SUCCESS)
}

fn print_text(graph: &Graph) {
    let mut rows = table(&["process", "reads", "writes", "core", "priority"]);
    for process in &graph.process {
        let feedback = process.feedback.iter().map(|topic| format!("{topic} (to reach the next tick)"));
        let reads: Vec<_> = process.reads.iter().cloned().chain(feedback).collect();
        let priority = if process.priority == 0 { "ordinary".to_owned() } else { format!("FIFO {}", process.priority) };
        rows.add_row([
            process.name.clone().into(),
            reads.join("\n").into(),
            process.writes.join("\n").into(),
            number(process.core),
            number(priority),
        ]);
    }
    say!("{rows}");
}

/// Writer, reader, topic and whether it closes the loop.
fn edges(graph: &Graph) -> impl Iterator<Item = (&str, &str, &str, bool)> {
    graph.process.iter().flat_map(|reader| {
        let now = reader.reads.iter().map(|topic| (topic, false));
        let later = reader.feedback.iter().map(|topic| (topic, true));
        now.chain(later)
            .filter_map(|(topic, feedback)| Some((graph.writer(topic)?.name.as_str(), reader.name.as_str(), topic.as_str(), feedback)))
    })
}

fn print_dot(graph: &Graph) {
    say!("digraph armplane {{\n  rankdir=LR;\n  node [shape=box, style=rounded];");
    for (writer, reader, topic, feedback) in edges(graph) {
        say!("  {writer} -> {reader} [label=\"{topic}\"{}];", if feedback { ", style=dashed" } else { "" });
    }
    say!("}}");
}

fn print_mermaid(graph: &Graph) {
    say!("flowchart LR");
    for (writer, reader, topic, feedback) in edges(graph) {
        say!("  {writer} {}|{topic}| {reader}", if feedback { "-.->" } else { "-->" });
    }
}
