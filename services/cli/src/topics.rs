//! `armplane topics`: the topics of a graph, with their types, sizes, rates, writers and readers.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use session::{Failure, Topics, load};

use crate::out::{say, show};

#[derive(Args)]
pub(crate) struct TopicsArgs {
    /// A process graph of your own instead of the built-in one.
    #[arg(value_name = "FILE.toml")]
    graph: Option<PathBuf>,
}

pub(crate) fn topics(args: &TopicsArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let graph = load::graph(args.graph.as_deref())?;
    match as_json {
        true => say!(
            "{}",
            serde_json::to_string_pretty(&Topics(&graph).json()).map_err(Failure::work)?
        ),
        false => show(&Topics(&graph)),
    }
    Ok(ExitCode::SUCCESS)
}
