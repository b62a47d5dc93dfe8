//! `armplane graph`: which process writes and reads which topic, and the topics with their types, sizes and rates.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use session::graph_text::{dot, mermaid, processes, topics, topics_json};
use session::{Failure, load};

use crate::out::{say, say_json, show};

#[derive(Args)]
pub(crate) struct GraphArgs {
    /// Your own process graph [default: the built-in one].
    #[arg(value_name = "FILE.toml")]
    file: Option<PathBuf>,
    /// Output format.
    #[arg(long, value_enum, default_value = "text")]
    format: GraphFormat,
}

#[derive(Clone, Copy, ValueEnum)]
enum GraphFormat {
    /// A table.
    Text,
    /// Graphviz.
    Dot,
    /// Mermaid, for Markdown.
    Mermaid,
    /// A table of the topics: types, sizes, writers, readers.
    Topics,
}

pub(crate) fn graph(args: &GraphArgs, as_json: bool) -> Result<bool, Failure> {
    let graph = load::graph(args.file.as_deref())?;
    match args.format {
        GraphFormat::Topics if as_json => say_json(&topics_json(&graph))?,
        _ if as_json => say!("{}", serde_json::to_string(&graph).map_err(Failure::work)?),
        GraphFormat::Text => show(&processes(&graph)),
        GraphFormat::Dot => show(&dot(&graph)),
        GraphFormat::Topics => show(&topics(&graph)),
        GraphFormat::Mermaid => show(&mermaid(&graph)),
    }
    Ok(true)
}
