//! `armplane topics`: the topics of a graph, with their types, sizes, rates, writers and readers.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use session::{Failure, load};
use shared_types::topics::TOPICS;

use crate::out::say;
use session::table::{number, table};

#[derive(Args)]
pub(crate) struct TopicsArgs {
    /// A process graph of your own instead of the built-in one.
    #[arg(value_name = "FILE.toml")]
    graph: Option<PathBuf>,
}

pub(crate) fn topics(args: &TopicsArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let graph = load::graph(args.graph.as_deref())?;
    let names = TOPICS.into_iter().chain(graph.topic.iter().map(|declared| declared.name.as_str()));
    let mut rows = table(&["topic", "type", "layout", "bytes", "writer", "readers"]);
    let mut all = Vec::new();
    for name in names {
        let (Some(layout), Some(writer)) = (graph.layout(name), graph.writer(name)) else { continue };
        let readers: Vec<&str> = graph.readers(name).map(|process| process.name.as_str()).collect();
        let hash = format!("{:016x}", layout.hash);
        all.push(serde_json::json!({
            "topic": name, "type": layout.type_name, "layout": hash, "bytes": layout.bytes, "writer": writer.name, "readers": readers,
            "messages_per_tick": 1,
        }));
        let (writer, readers) = (writer.name.clone(), readers.join("\n"));
        rows.add_row([name.into(), layout.type_name.into(), hash.into(), number(layout.bytes), writer.into(), readers.into()]);
    }
    if as_json {
        say!("{}", serde_json::to_string_pretty(&all).map_err(Failure::work)?);
        return Ok(ExitCode::SUCCESS);
    }
    say!("{rows}");
    say!(
        "One message per tick of each. Each is an iceoryx2 publish-subscribe service of that name and type; a run's services live under its own"
    );
    say!("directory and prefix, /dev/shm/armplane-… : docs/wire.md. Fields: armplane wire");
    Ok(ExitCode::SUCCESS)
}
