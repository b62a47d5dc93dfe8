//! The launcher's side of all topics.

use std::fs::DirEntry;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use shared_types::topics::TOPICS;

use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::node::{Bus, join, unusable};
use crate::bus::topic::Topic as Service;
use crate::manifest::Manifest;
use crate::run_dir::RunDir;

/// How long to wait for another thread of this process that cleans up at the same time: iceoryx2
/// allows one.
const CLEAR_LIMIT: Duration = Duration::from_millis(100);

/// The launcher's side: creates every topic of the run, and removes leftovers of dead processes.
pub struct Hub {
    // Dropped in this order: the services first.
    _topics: Vec<Service>,
    node: Bus,
}

impl std::fmt::Debug for Hub {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hub").finish_non_exhaustive()
    }
}

impl Hub {
    /// Makes all topics of the run.
    ///
    /// # Errors
    /// When the graph names a topic that has no message, or shared memory cannot be used.
    pub fn create(run: &RunDir, manifest: &Manifest) -> Result<Self, TopicError> {
        let node = join(run, "launcher", true)?;
        run.make_private().map_err(|e| unusable(run.name(), e))?;
        // A replacement of the recorder gets the messages once more that its predecessor had not written yet.
        let has_history = !manifest.is_lockstep();
        let topics = manifest.topics().into_iter().map(|topic| {
            let unknown = || TopicError::Unknown {
                topic: topic.to_owned(),
                known: TOPICS.join(", "),
            };
            let format = Format::in_run(manifest, topic).ok_or_else(unknown)?;
            Service::create(&node, format, manifest.readers_of(topic), has_history)
        });
        Ok(Self {
            _topics: topics.collect::<Result<_, _>>()?,
            node,
        })
    }

    /// Clears away what dead processes left, so that their replacements find room. Takes milliseconds.
    ///
    /// # Errors
    /// When something of a dead process cannot be cleared away.
    pub fn clear_dead(&self) -> Result<u64, TopicError> {
        let (mut dead, run) = (Vec::new(), &self.node.config().global.prefix);
        let found = Node::<ipc::Service>::list(self.node.config(), |state| {
            if let NodeState::Dead(view) = state {
                dead.push(view);
            }
            CallbackProgression::Continue
        });
        found.map_err(|e| unusable(&run.to_string(), e))?;
        let count = dead.len() as u64;
        dead.iter()
            .for_each(|view| remove_unfinished_tags(self.node.config(), view.id()));
        let failures = dead.into_iter().filter_map(|view| {
            let name = view.details().as_ref().map_or_else(
                || "a process that has not joined".to_owned(),
                |node| node.name().to_string(),
            );
            let failure = view.blocking_remove_stale_resources(CLEAR_LIMIT).err()?;
            Some(format!(
                "what the dead {name} left is not cleared away ({failure:?})"
            ))
        });
        match failures.collect::<Vec<_>>() {
            failures if failures.is_empty() => Ok(count),
            failures => Err(unusable(&run.to_string(), failures.join("; "))),
        }
    }
}

/// Removes unfinished files from a dead process's node folder. iceoryx2 lists only finished ones,
/// and then cannot remove the folder.
fn remove_unfinished_tags(config: &Config, id: &UniqueNodeId) {
    // Its text is hexadecimal, the folder's name is decimal.
    let Ok(number) = u128::from_str_radix(&id.to_string(), 16) else {
        return;
    };
    let nodes = PathBuf::from(config.global.root_path().to_string())
        .join(config.global.node.directory.to_string());
    let entries = std::fs::read_dir(nodes.join(number.to_string()))
        .into_iter()
        .flatten()
        .flatten();
    // Finished ones cannot be written to.
    let is_unfinished = |entry: &DirEntry| {
        entry
            .metadata()
            .is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o200 != 0)
    };
    entries
        .filter(is_unfinished)
        .for_each(|entry| drop(std::fs::remove_file(entry.path())));
}
