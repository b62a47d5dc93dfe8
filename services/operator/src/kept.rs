//! Targets of a live session in lockstep, in a file that outlives a roll-back: each is written
//! before it is published, and comes again at its tick when all processes have started again.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use bytemuck::{bytes_of, pod_read_unaligned};
use shared_types::TargetContent;
use shared_types::wire::wire;

/// The ticks that have been published, before the first target.
const HEAD: usize = size_of::<u64>();

wire! {
    /// A target, and the tick at which it took effect.
    Given {
        tick: u64,
        target: TargetContent,
    }
}

/// The targets of the earlier starts, and the file to which new ones go.
pub(crate) struct Kept {
    file: File,
    /// Targets in the file.
    count: u64,
    /// Those that are to come again.
    earlier: VecDeque<Given>,
    /// Ticks that have been published before.
    ticks: u64,
    /// Something could not be written, and that has been said.
    has_failed: bool,
}

impl Kept {
    /// Reads the file, which is made where there is none. Targets of ticks before the first one do not come again.
    pub(crate) fn open(path: &Path, first: u64) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let file = options.open(path)?;
        let bytes = std::fs::read(path)?;
        let (head, given) = bytes.split_at_checked(HEAD).unwrap_or_default();
        let ticks = if head.is_empty() {
            0
        } else {
            pod_read_unaligned(head)
        };
        let given = given.chunks_exact(size_of::<Given>());
        let all = given.map(pod_read_unaligned::<Given>);
        Ok(Self {
            file,
            count: all.len() as u64,
            earlier: all.filter(|given| given.tick >= first).collect(),
            ticks,
            has_failed: false,
        })
    }

    /// Whether a tick has been published before a roll-back: nothing new comes in it.
    pub(crate) fn has(&self, tick: u64) -> bool {
        tick < self.ticks
    }

    /// The next target of an earlier start that came at a tick.
    pub(crate) fn take(&mut self, tick: u64) -> Option<TargetContent> {
        self.earlier
            .pop_front_if(|given| given.tick <= tick)
            .map(|given| given.target)
    }

    /// Keeps a target that is about to take effect at a tick.
    pub(crate) fn add(&mut self, tick: u64, target: &TargetContent) {
        let target = *target;
        let place = HEAD as u64 + self.count * size_of::<Given>() as u64;
        self.write(bytes_of(&Given { tick, target }), place);
        self.count += 1;
    }

    /// A tick is about to be published, with all its targets.
    pub(crate) fn close(&mut self, tick: u64) {
        if tick >= self.ticks {
            self.ticks = tick + 1;
            self.write(&self.ticks.to_ne_bytes(), 0);
        }
    }

    fn write(&mut self, bytes: &[u8], place: u64) {
        if let Err(error) = self.file.write_all_at(bytes, place)
            && !std::mem::replace(&mut self.has_failed, true)
        {
            let what = "a death of a process would cost the targets given so far";
            runtime::complain(&format_args!("{what}: they cannot be kept: {error}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_given_comes_again_at_its_tick() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("targets");
        let target = |valid_s: f64| TargetContent {
            valid_s,
            ..TargetContent::default()
        };
        let mut first = Kept::open(&path, 0).unwrap();
        assert!(!first.has(0));
        first.add(3, &target(1.0));
        first.add(3, &target(2.0));
        first.close(3);
        // Its process is killed before the tick of this one is over.
        first.add(5, &target(3.0));
        let mut again = Kept::open(&path, 0).unwrap();
        assert_eq!((again.has(3), again.has(4)), (true, false));
        assert_eq!(again.take(2), None);
        let taken: Vec<_> = std::iter::from_fn(|| again.take(3)).collect();
        assert_eq!(taken, [target(1.0), target(2.0)]);
        assert_eq!(again.take(5), Some(target(3.0)));
        assert_eq!(Kept::open(&path, 4).unwrap().take(9), Some(target(3.0)));
    }
}
