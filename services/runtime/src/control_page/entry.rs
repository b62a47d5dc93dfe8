//! One process on the control page: its doorbell, heartbeat, state and counts.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use crate::control_page::doorbell::Doorbell;
use crate::control_page::live_statistics::{Distribution, DurationHistogram};

/// The state of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum State {
    /// Not started yet.
    Absent = 0,
    /// Started, opening its ports.
    Starting = 1,
    /// All its ports are open; it waits for those of the other processes.
    Ready = 2,
    /// It is connected to all others; it waits for the first tick.
    Connected = 3,
    /// Working.
    Running = 4,
    /// It has ended.
    Gone = 5,
    /// It is stopped (SIGSTOP).
    Stopped = 6,
    /// It makes the ticks, and there are no more.
    Done = 7,
}

/// Declares the counters: their variants, and a record of all of them.
macro_rules! counts {
    ($( $(#[$meta:meta])* $variant:ident $field:ident ),* $(,)?) => {
        /// The counters of a process.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(usize)]
        pub enum Count { $( $(#[$meta])* $variant ),* }

        /// Everything a process has counted.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
        pub struct Counts { $( $(#[$meta])* pub $field: u64 ),* }

        const COUNTS: usize = [$(Count::$variant),*].len();

        impl ProcessEntry {
            /// All its counts.
            pub fn counts(&self) -> Counts {
                Counts { $( $field: self.count(Count::$variant) ),* }
            }
        }
    };
}
counts! {
    /// Ticks whose torque came by its deadline; of the process that makes the ticks, as the next two.
    InTime in_time,
    /// Ticks whose torque came after its deadline.
    Late late,
    /// Ticks whose torque has not come.
    NoTorque none,
    /// Ticks whose torque missed its deadline while this process was the first of the chain that had not sent: counted by the one that makes the ticks.
    Silent silent,
    /// Periods without a tick, with a major page fault of the process that makes the ticks.
    SkippedMajorFault skipped_major_fault,
    /// Periods without a tick, with an involuntary context switch of it.
    SkippedPreempted skipped_preempted,
    /// Periods without a tick while a peer was being restarted.
    SkippedPeerRestart skipped_peer_restart,
    /// Periods without a tick for no other cause: its computation took too long, or it stood still.
    SkippedOverrun skipped_overrun,
    /// Own messages refused because a number in them was not finite.
    NotFinite not_finite,
    /// Received messages refused because a dead incarnation had sent them.
    Fenced fenced,
    /// Received messages of a tick already passed.
    Repeated repeated,
    /// Ticks never received.
    Lost lost,
    /// Received messages refused because a number in them was not finite.
    Refused refused,
    /// Messages sent.
    Sent sent,
}

/// One process on the control_page.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub struct ProcessEntry {
    doorbell: Doorbell,
    /// Ticks done: the heartbeat. Tick k done is k + 1.
    ticks: AtomicU64,
    /// Of a process that only reads: the tick that it was shown last. Those done lag behind, by all that it takes in at once.
    shown: AtomicU64,
    pid: AtomicU32,
    incarnation: AtomicU32,
    state: AtomicU32,
    counts: [AtomicU64; COUNTS],
    step: DurationHistogram,
    age: DurationHistogram,
}

impl ProcessEntry {
    /// Its doorbell.
    #[inline]
    pub(crate) fn doorbell(&self) -> &Doorbell {
        &self.doorbell
    }

    /// Ticks done.
    #[inline]
    pub fn ticks(&self) -> u64 {
        self.ticks.load(Ordering::Acquire)
    }

    #[inline]
    pub(crate) fn set_ticks(&self, ticks: u64) {
        self.ticks.store(ticks, Ordering::Release);
    }

    #[inline]
    pub(crate) fn show(&self, tick: u64) {
        self.shown.store(tick, Ordering::Release);
    }

    /// Of a process that has ended: the first tick that it has not done.
    pub fn end_tick(&self) -> u64 {
        self.ticks().max(self.shown.load(Ordering::Acquire))
    }

    /// The launcher, for a dead process: closes the ticks before `tick`, which the process has answered and not closed any more.
    pub fn close_before(&self, tick: u64) {
        self.ticks.fetch_max(tick, Ordering::AcqRel);
    }

    /// Its process id; 0 before its first start.
    pub fn pid(&self) -> u32 {
        self.pid.load(Ordering::Relaxed)
    }

    /// How often it has been started.
    #[inline]
    pub fn incarnation(&self) -> u32 {
        self.incarnation.load(Ordering::Acquire)
    }

    /// Its state.
    pub fn state(&self) -> State {
        match self.state.load(Ordering::Acquire) {
            1 => State::Starting,
            2 => State::Ready,
            3 => State::Connected,
            4 => State::Running,
            5 => State::Gone,
            6 => State::Stopped,
            7 => State::Done,
            _ => State::Absent,
        }
    }

    pub(crate) fn set_state(&self, state: State) {
        self.state.store(state as u32, Ordering::Release);
    }

    /// The launcher, before it starts the process (again): from now on the next incarnation's messages count.
    pub fn begin_incarnation(&self) -> u32 {
        self.set_state(State::Starting);
        self.incarnation.fetch_add(1, Ordering::AcqRel) + 1
    }

    /// The launcher, when it has started the process.
    pub fn set_pid(&self, pid: u32) {
        self.pid.store(pid, Ordering::Relaxed);
    }

    /// The launcher, when the process has ended.
    pub fn end(&self) {
        self.set_state(State::Gone);
        self.doorbell.disarm();
    }

    /// One of its counts.
    pub fn count(&self, count: Count) -> u64 {
        self.counts[count as usize].load(Ordering::Relaxed)
    }

    /// Time from its input received to its output sent; for the tick source in real time, from the
    /// tick's due time.
    pub fn step(&self) -> Distribution {
        self.step.read()
    }

    /// Age of the tick when its output is sent, or, for the tick source, when its answer arrives;
    /// in real time since it was due.
    pub fn age(&self) -> Distribution {
        self.age.read()
    }

    /// Number of polls of its inputs. It rises while a process waits, but not while it is stuck or
    /// stopped.
    pub fn looks(&self) -> u32 {
        self.doorbell.sleeps()
    }

    #[inline]
    pub(crate) fn note_step(&self, ns: u64) {
        self.step.record(ns);
    }

    #[inline]
    pub(crate) fn note_age(&self, ns: u64) {
        self.age.record(ns);
    }

    #[inline]
    pub(crate) fn add(&self, count: Count, n: u64) {
        // A load and a store: each count has one writer.
        let count = &self.counts[count as usize];
        count.store(count.load(Ordering::Relaxed) + n, Ordering::Relaxed);
    }

    /// A torque counted as missing has arrived.
    pub(crate) fn came_late(&self) {
        self.add(Count::Late, 1);
        let none = &self.counts[Count::NoTorque as usize];
        none.store(
            none.load(Ordering::Relaxed).saturating_sub(1),
            Ordering::Relaxed,
        );
    }
}
