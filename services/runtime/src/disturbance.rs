//! Disturbances of a process in a run of `verify`: a late start, a nice value, deliberate pauses.

use std::time::Duration;

use shared_types::random::at as random;

use crate::manifest::Disturbance;

/// Seeded short pauses before a process looks for its next message.
#[derive(Debug)]
pub(crate) struct Pauses {
    seed: u64,
    looks: u64,
}

impl Pauses {
    /// One look in so many is late.
    const ONE_IN: u64 = 8;
    /// The longest pause; µs.
    const LONGEST_US: u64 = 200;

    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, looks: 0 }
    }

    /// The pause before the next look, if there is one.
    pub(crate) fn next(&mut self) -> Option<Duration> {
        self.looks += 1;
        let random = random(self.seed, self.looks);
        let length = Duration::from_micros((random >> 32) % (Self::LONGEST_US + 1));
        random.is_multiple_of(Self::ONE_IN).then_some(length)
    }
}

/// Applies the disturbance's nice value and the delay of its start.
pub(crate) fn begin(
    Disturbance {
        start_delay, nice, ..
    }: Disturbance,
) {
    if nice != 0
        && let Err(errno) = rustix::process::setpriority_process(None, nice)
    {
        tracing::warn!("cannot take the nice value {nice}: {errno}");
    }
    if !start_delay.is_zero() {
        std::thread::sleep(start_delay);
    }
}
