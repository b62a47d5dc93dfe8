//! A process's node: its side of all topics of a run.

use iceoryx2::prelude::*;

use crate::bus::error::TopicError;
use crate::run_dir::{RunDir, SHM};

/// Dead writers whose last messages a reader can still have to read.
const MAX_DEAD_WRITERS: usize = 8;

/// One process's side of all topics.
pub(crate) type Bus = Node<ipc::Service>;

/// The run cannot be joined, or used.
pub(super) fn unusable(run: &str, reason: impl std::fmt::Display) -> TopicError {
    TopicError::Node {
        run: run.to_owned(),
        reason: reason.to_string(),
    }
}

fn config(run: &RunDir, is_launcher: bool) -> Result<Config, TopicError> {
    let unusable = |reason: String| unusable(run.name(), reason);
    let path = run.path().to_str().unwrap_or(SHM);
    let mut config = Config::default();
    config.global.set_root_path(
        &Path::new(path.as_bytes()).map_err(|e| unusable(format!("{path}: {e:?}")))?,
    );
    config.global.prefix = FileName::new(format!("{}.", run.name()).as_bytes())
        .map_err(|e| unusable(format!("{e:?}")))?;
    // Cleaning up after a dead process takes milliseconds: the launcher does it, never a process of the chain.
    config.global.node.cleanup_dead_nodes_on_creation = is_launcher;
    config.global.node.cleanup_dead_nodes_on_destruction = is_launcher;
    config.global.service.cleanup_dead_nodes_on_open = is_launcher;
    // Every look into an empty buffer walks over the places for connections to dead writers: 128 by default, a tenth of a hop.
    config
        .defaults
        .publish_subscribe
        .subscriber_expired_connection_buffer = MAX_DEAD_WRITERS;
    Ok(config)
}

pub(crate) fn join(run: &RunDir, name: &str, is_launcher: bool) -> Result<Bus, TopicError> {
    let node_name = NodeName::new(name);
    let node_name = node_name.map_err(|e| unusable(run.name(), format_args!("{name:?}: {e:?}")))?;
    NodeBuilder::new()
        .name(&node_name)
        .config(&config(run, is_launcher)?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .map_err(|e| unusable(run.name(), e))
}
