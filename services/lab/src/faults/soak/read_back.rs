//! The remains of a round: its messages, read back, and leftovers.

use std::path::Path;

use message_log::{LogError, LogReader};
use serde::Serialize;
use shared_types::codes::{DRIVE_BRAKED, DRIVE_STOPPING};
use shared_types::topics::{self, COUNT, Each, STEERED, Topic};
use shared_types::{Message, PlantState, SensorSample};

use super::super::motion::Motion;
use super::inject::state_and_parent;
use super::judge::Files;

/// A stretch of ticks in which the drives stopped the arm or held it by the brakes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stop {
    pub from: u64,
    pub until: u64,
}

/// Reads the messages back: what the arm did, when the drives stopped it, and how many there are of each topic.
pub(super) fn read(
    mut motion: Motion,
    messages: &Path,
) -> (Motion, Vec<Stop>, Files, [u64; COUNT]) {
    let (mut files, mut stops) = (Files::default(), Vec::<Stop>::new());
    each::<PlantState>(messages, &mut files, |state| {
        motion.add(state);
        let tick = state.header.tick;
        if matches!(state.drive, DRIVE_STOPPING | DRIVE_BRAKED) {
            match stops.last_mut().filter(|stop| stop.until == tick) {
                Some(stop) => stop.until = tick + 1,
                None => stops.push(Stop {
                    from: tick,
                    until: tick + 1,
                }),
            }
        }
    });
    each::<SensorSample>(messages, &mut files, |sample| motion.add_age(sample));
    struct CountEach<'a>(&'a Path, &'a mut Files);
    impl Each for CountEach<'_> {
        type Output = u64;
        fn each<M: Topic>(&mut self) -> u64 {
            // The soak's arm is not steered.
            if STEERED.contains(&M::TOPIC) {
                0
            } else {
                each::<M>(self.0, self.1, |_| ())
            }
        }
    }
    let counts = topics::each(&mut CountEach(messages, &mut files));
    (motion, stops, files, counts)
}

fn each<M: Message>(messages: &Path, files: &mut Files, mut each: impl FnMut(&M)) -> u64 {
    let mut n = 0;
    let mut read = || -> Result<(), LogError> {
        let mut log = LogReader::<M>::open(messages)?;
        while let Some(message) = log.next_message()? {
            n += 1;
            each(&message);
        }
        Ok(())
    };
    if let Err(error) = read() {
        files.unreadable.push(error.to_string());
    }
    n
}

/// Leftovers of a run: files in shared memory or among the temporary ones, children, living or not.
pub(super) fn left_over(run: &str) -> Vec<String> {
    let names = |folder: &Path| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries
            .filter(|entry| entry.file_name().to_string_lossy().contains(run))
            .map(|entry| entry.path().display().to_string())
            .collect()
    };
    let mut left: Vec<String> = names(Path::new(runtime::SHM));
    left.extend(names(&std::env::temp_dir()));
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    for pid in processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok()) {
        if let Some((state, parent)) = state_and_parent(pid)
            && parent == std::process::id()
        {
            left.push(format!("process {pid} ({state})"));
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_that_nobody_waited_for_is_left_over() {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let name = format!("process {}", child.id());
        assert!(
            left_over("no-such-run")
                .iter()
                .any(|left| left.starts_with(&name))
        );
        child.wait().unwrap();
        assert!(
            !left_over("no-such-run")
                .iter()
                .any(|left| left.starts_with(&name))
        );
    }
}
