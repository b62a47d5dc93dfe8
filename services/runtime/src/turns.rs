//! Turns: processes of a chain on one core hand it to each other without sleeping.

use std::cell::Cell;

use crate::clock::now_ns;
use crate::manifest::Manifest;
use crate::realtime;

/// In lockstep, a process that waits for another one on its core yields the core like this.
///
/// One process of the chain works at a time there. One that waits stays ready to run behind the others: it is neither put to sleep nor woken, and its
/// message is there when its turn comes, in a third of the time that a sleep and a wake take. Where it is not, the process sleeps.
///
/// A program that does not wait keeps a core that is given away for some milliseconds. Where that happens, or most turns are in vain, processes sleep at
/// once, and try again after a number of waits that doubles with each such try. Under `SCHED_FIFO` and `SCHED_RR` they always sleep: the kernel keeps the
/// order there in which processes wait, and once that is not the order of their messages each turn is in vain.
#[derive(Debug)]
pub(crate) struct Turns {
    /// Whether a process that this one waits for has the same core, under ordinary scheduling.
    is_shared: Cell<bool>,
    /// Waits to go before the core is given away again.
    off: Cell<u32>,
    /// The waits of the next time off.
    pause: Cell<u32>,
    /// Turns in a row after which the core came back soon.
    kept: Cell<u32>,
    /// Turns in vain, less those that were not.
    vain: Cell<u32>,
}

impl Turns {
    /// Longer than a tick of any chain of which hand-overs are a notable part, shorter than the kernel leaves a core to one program; ns.
    const LONG_NS: u64 = 400_000;
    /// The first time off and the longest, of which a program that never waits makes 1 % more time of a run at 30 000 ticks a second; waits.
    const OFF: [u32; 2] = [512, 8192];
    /// Turns in a row after which no other program has the core: a long one is an exception then, as a short task of the kernel's is.
    const KEPT: u32 = 256;
    /// Turns in vain, less those that were not, after which there are none for a time.
    const VAIN: u32 = 64;

    /// The turns of the process at `me`.
    pub(crate) fn of(manifest: &Manifest, me: usize) -> Self {
        let process = &manifest.processes[me];
        let is_beside = |topic: &String| {
            let writer = manifest
                .writer_of(topic)
                .filter(|&writer| writer != me)
                .map(|writer| &manifest.processes[writer]);
            writer.is_some_and(|writer| writer.core == process.core)
        };
        let is_shared =
            manifest.is_lockstep() && process.core.is_some() && process.reads.iter().any(is_beside);
        Self {
            is_shared: Cell::new(is_shared),
            off: Cell::default(),
            pause: Cell::new(Self::OFF[0]),
            kept: Cell::default(),
            vain: Cell::default(),
        }
    }

    /// To be called when the process's scheduling is settled.
    pub(crate) fn begin(&self) {
        self.is_shared
            .set(self.is_shared.get() && realtime::is_ordinary());
    }

    /// Gives the core to the next process that is ready to run there, and comes back when that one waits. `false`: this process is to sleep instead.
    #[inline]
    pub(crate) fn pass(&self) -> bool {
        if !self.is_on() {
            return false;
        }
        let began_ns = now_ns();
        rustix::thread::sched_yield();
        self.note(now_ns() - began_ns);
        true
    }

    #[inline]
    fn is_on(&self) -> bool {
        let off = self.off.get();
        self.off.set(off.saturating_sub(1));
        self.is_shared.get() && off == 0
    }

    /// The core came back after so long.
    #[inline]
    fn note(&self, ns: u64) {
        self.vain.update(|vain| vain.saturating_sub(1));
        if ns < Self::LONG_NS {
            self.kept.update(|kept| kept.saturating_add(1));
        } else if self.kept.take() < Self::KEPT {
            self.rest();
        } else {
            self.pause.set(Self::OFF[0]);
        }
    }

    /// The core came back without the message.
    pub(crate) fn note_vain(&self) {
        self.vain.update(|vain| vain + 2);
        if self.vain.get() >= Self::VAIN {
            self.rest();
        }
    }

    fn rest(&self) {
        self.vain.set(0);
        self.off.set(self.pause.get());
        self.pause.set((2 * self.pause.get()).min(Self::OFF[1]));
    }
}

#[cfg(test)]
mod tests {
    use shared_types::job::Mode;

    use super::*;
    use crate::manifest::Process;

    /// A plant and a controller in a loop on these cores, and a recorder on the first of them.
    fn run(mode: Mode, cores: [Option<usize>; 2]) -> Manifest {
        let process = |name: &str, reads: &[&str], writes: &[&str], core| Process {
            name: name.into(),
            reads: reads.iter().map(ToString::to_string).collect(),
            writes: writes.iter().map(ToString::to_string).collect(),
            core,
            ..Process::default()
        };
        let processes = vec![
            process("plant", &["torque"], &["sensor"], cores[0]),
            process("controller", &["sensor"], &["torque"], cores[1]),
            process("alone", &[], &["other"], cores[0]),
        ];
        Manifest {
            mode,
            rate_hz: 1000,
            wait_limit: None,
            processes,
            messages: Vec::new(),
            from: 0,
        }
    }

    #[test]
    fn only_those_that_wait_for_a_neighbour_on_their_core_in_lockstep_take_turns() {
        let taken = |mode, cores| [0, 1, 2].map(|me| Turns::of(&run(mode, cores), me).pass());
        assert_eq!(
            taken(Mode::Lockstep, [Some(0), Some(0)]),
            [true, true, false]
        );
        assert_eq!(taken(Mode::Lockstep, [Some(0), Some(1)]), [false; 3]);
        assert_eq!(taken(Mode::Lockstep, [None, None]), [false; 3]);
        assert_eq!(taken(Mode::Realtime, [Some(0), Some(0)]), [false; 3]);
    }

    #[test]
    fn a_core_that_others_keep_is_given_away_ever_more_rarely() {
        let turns = Turns::of(&run(Mode::Lockstep, [Some(0), Some(0)]), 0);
        let off = || (0..).take_while(|_| !turns.is_on()).count();
        let mut waits = Vec::new();
        for _ in 0..6 {
            turns.note(Turns::LONG_NS);
            waits.push(off());
        }
        assert_eq!(waits, [512, 1024, 2048, 4096, 8192, 8192]);
        // It is ours again: one long turn is an exception, two are none.
        for _ in 0..Turns::KEPT {
            turns.note(Turns::LONG_NS - 1);
        }
        turns.note(Turns::LONG_NS);
        assert_eq!(off(), 0);
        turns.note(Turns::LONG_NS);
        assert_eq!(off(), 512);
    }

    #[test]
    fn turns_that_are_mostly_in_vain_are_given_up() {
        let turns = Turns::of(&run(Mode::Lockstep, [Some(0), Some(0)]), 0);
        let taken = |vain_of_8: u32| {
            (0..4096).find(|at| {
                turns.note(0);
                if at % 8 < vain_of_8 {
                    turns.note_vain();
                }
                !turns.is_on()
            })
        };
        assert_eq!(taken(4), None, "half of them");
        assert!(taken(5).is_some_and(|at| (64..1024).contains(&at)), "more");
    }
}
