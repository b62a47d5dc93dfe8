//! Time between two rounds of the recorder.
//!
//! Waking up with a cold cache costs more than one tick's messages, so the recorder takes several
//! ticks at once. In real time it takes a quarter of the buffers at 1 kHz, or less if a viewer
//! shows motion. In lockstep, where all processes wait for a recorder that falls too far behind, it
//! takes half of that distance.

use std::time::{Duration, Instant};

use runtime::Mode;

/// Bounds in lockstep.
const LOCKSTEP: [Duration; 2] = [Duration::from_millis(1), Duration::from_millis(20)];
/// A run that has just begun may be as quick as any; ticks per second.
const QUICKEST: f64 = 50_000.0;
/// So much of its speed is a run trusted to lose from one round to the next: one that was held up for a moment goes on as before, and to wake up too soon
/// costs less than to hold it up.
const KEPT: f64 = 0.8;

/// Gives the time from the beginning of each round to the next.
pub(crate) struct Pace {
    mode: Mode,
    is_watched: bool,
    /// Ticks that a round is to find in lockstep.
    wanted: u64,
    last: Option<(Instant, u64)>,
    ticks_per_s: f64,
}

impl Pace {
    /// For a run that may be `most_ahead` ticks ahead of the recorder in lockstep.
    pub(crate) fn new(mode: Mode, is_watched: bool, most_ahead: u64) -> Self {
        Self {
            mode,
            is_watched,
            wanted: (most_ahead / 2).max(1),
            last: None,
            ticks_per_s: QUICKEST,
        }
    }

    /// The time to the next round, where so many ticks have begun.
    pub(crate) fn next(&mut self, ticks: u64) -> Duration {
        match self.mode {
            Mode::Realtime if self.is_watched => Duration::from_millis(100),
            Mode::Realtime => Duration::from_millis(250),
            Mode::Lockstep => {
                let now = Instant::now();
                if let Some((then, before)) = self.last.replace((now, ticks)) {
                    self.note(now - then, ticks.saturating_sub(before));
                }
                self.in_lockstep()
            }
        }
    }

    /// Ticks begun in a span of time.
    fn note(&mut self, elapsed: Duration, ticks: u64) {
        let found = ticks as f64 / elapsed.as_secs_f64().max(1e-6);
        self.ticks_per_s = found.max(KEPT * self.ticks_per_s);
    }

    /// The time in which the wanted ticks begin.
    fn in_lockstep(&self) -> Duration {
        let [least, most] = LOCKSTEP;
        Duration::from_secs_f64((self.wanted as f64 / self.ticks_per_s.max(1.0)).min(1.0))
            .clamp(least, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_in_lockstep_finds_half_of_what_the_recorder_may_be_behind() {
        let mut pace = Pace::new(Mode::Lockstep, false, 256);
        // From the quickest on, at 12 800 and at 40 000 ticks a second.
        for (ticks_per_s, expected_us) in [(12_800.0, 10_000), (40_000.0, 3_200)] {
            for _ in 0..8 {
                let time = pace.in_lockstep();
                pace.note(time, (time.as_secs_f64() * ticks_per_s).round() as u64);
            }
            assert!(
                (pace.in_lockstep().as_micros() as i64 - expected_us).abs() < 200,
                "{:?}",
                pace.in_lockstep()
            );
        }
        let time = pace.in_lockstep();
        pace.note(Duration::from_secs(1), 0);
        assert_eq!(pace.in_lockstep(), time.div_f64(KEPT), "nothing has begun");
        (0..40).for_each(|_| pace.note(Duration::from_secs(1), 0));
        assert_eq!(pace.in_lockstep(), LOCKSTEP[1]);
        pace.note(Duration::ZERO, 100_000);
        assert_eq!(pace.in_lockstep(), LOCKSTEP[0]);
    }
}
