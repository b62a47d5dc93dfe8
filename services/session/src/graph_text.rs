//! A process graph as text: a table, a drawing for Graphviz or Mermaid, or its topics.

use serde::Serialize;
use serde_json::{Value, json};
use shared_types::graph::Graph;
use shared_types::topics::TOPICS;

use crate::table::{number, table};

/// A row a process.
pub fn processes(graph: &Graph) -> String {
    let mut rows = table(&["process", "reads", "writes", "core", "priority"]);
    for process in &graph.process {
        let feedback = process
            .feedback
            .iter()
            .map(|topic| format!("{topic} (to reach the next tick)"));
        let reads: Vec<_> = process.reads.iter().cloned().chain(feedback).collect();
        let priority = if process.priority == 0 {
            "ordinary".to_owned()
        } else {
            format!("FIFO {}", process.priority)
        };
        rows.add_row([
            process.name.clone().into(),
            reads.join("\n").into(),
            process.writes.join("\n").into(),
            number(process.core),
            number(priority),
        ]);
    }
    format!("{rows}\n")
}

/// Writer, reader, topic and whether it closes the loop.
fn edges(graph: &Graph) -> impl Iterator<Item = (&str, &str, &str, bool)> {
    graph.process.iter().flat_map(|reader| {
        let now = reader.reads.iter().map(|topic| (topic, false));
        let later = reader.feedback.iter().map(|topic| (topic, true));
        now.chain(later).filter_map(|(topic, feedback)| {
            Some((
                graph.writer(topic)?.name.as_str(),
                reader.name.as_str(),
                topic.as_str(),
                feedback,
            ))
        })
    })
}

/// A drawing for Graphviz.
pub fn dot(graph: &Graph) -> String {
    let edges = edges(graph).map(|(writer, reader, topic, feedback)| {
        let style = if feedback { ", style=dashed" } else { "" };
        format!("  {writer} -> {reader} [label=\"{topic}\"{style}];\n")
    });
    let edges: String = edges.collect();
    format!("digraph armplane {{\n  rankdir=LR;\n  node [shape=box, style=rounded];\n{edges}}}\n")
}

/// A drawing for Mermaid, as Markdown pages show it.
pub fn mermaid(graph: &Graph) -> String {
    let edges = edges(graph).map(|(writer, reader, topic, feedback)| {
        let arrow = if feedback { "-.->" } else { "-->" };
        format!("  {writer} {arrow}|{topic}| {reader}\n")
    });
    "flowchart LR\n".to_owned() + &edges.collect::<String>()
}

/// The topics of a graph, as an array of one object a topic.
pub fn topics_json(graph: &Graph) -> Value {
    rows(graph).map(|row| json!(row)).collect()
}

fn rows(graph: &Graph) -> impl Iterator<Item = Topic<'_>> {
    let declared = graph.topic.iter().map(|declared| declared.name.as_str());
    TOPICS.into_iter().chain(declared).filter_map(|name| {
        let (layout, writer) = (graph.layout(name)?, graph.writer(name)?);
        let readers = graph
            .readers(name)
            .map(|process| process.name.as_str())
            .collect();
        Some(Topic {
            topic: name,
            type_name: layout.type_name,
            layout: format!("{:016x}", layout.hash),
            bytes: layout.bytes,
            writer: &writer.name,
            readers,
            messages_per_tick: 1,
        })
    })
}

#[derive(Serialize)]
struct Topic<'a> {
    topic: &'a str,
    #[serde(rename = "type")]
    type_name: String,
    layout: String,
    bytes: usize,
    writer: &'a str,
    readers: Vec<&'a str>,
    messages_per_tick: u32,
}

/// The topics of a graph: types, sizes, writers and readers.
pub fn topics(graph: &Graph) -> String {
    let mut topics = table(&["topic", "type", "layout", "bytes", "writer", "readers"]);
    for row in rows(graph) {
        topics.add_row([
            row.topic.into(),
            row.type_name.into(),
            row.layout.into(),
            number(row.bytes),
            row.writer.into(),
            row.readers.join("\n").into(),
        ]);
    }
    format!(
        "{topics}\n\
         Each topic has one message per tick, and is an iceoryx2 publish-subscribe service with that name and type; \
             a run's services live under its own directory and prefix, /dev/shm/armplane-… (docs/wire.md).\n\
             Fields: `armplane generate wire`\n"
    )
}
