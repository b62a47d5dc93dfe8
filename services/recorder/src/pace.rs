//! The pause between two rounds of the recorder.
//!
//! To wake up with cold caches costs more than a tick's messages do, so the recorder takes several at a time: in real time a quarter of what the buffers
//! hold at 1 kHz, or what a viewer that watches sees as motion. In lockstep, where all processes run at full speed and wait for a recorder that is too far
//! behind, half as many ticks as it may be behind.

use std::time::{Duration, Instant};

use runtime::Mode;

/// Bounds of a pause in lockstep: a run that has just begun, or stands still, says little of its speed.
const LOCKSTEP: [Duration; 2] = [Duration::from_millis(1), Duration::from_millis(20)];

/// Gives the pause before each round.
pub(crate) struct Pace {
    mode: Mode,
    is_watched: bool,
    /// Ticks that a round is to find in lockstep.
    wanted: u64,
    last: Option<(Instant, u64)>,
    pause: Duration,
}

impl Pace {
    /// For a run that may be `most_ahead` ticks ahead of the recorder in lockstep.
    pub(crate) fn new(mode: Mode, is_watched: bool, most_ahead: u64) -> Self {
        Self { mode, is_watched, wanted: (most_ahead / 2).max(1), last: None, pause: Duration::from_millis(5) }
    }

    /// The pause before the next round, where so many ticks have begun.
    pub(crate) fn pause(&mut self, ticks: u64) -> Duration {
        match self.mode {
            Mode::Realtime if self.is_watched => Duration::from_millis(100),
            Mode::Realtime => Duration::from_millis(250),
            Mode::Lockstep => {
                let now = Instant::now();
                if let Some((then, before)) = self.last.replace((now, ticks)) {
                    self.pause = self.next(now - then, ticks.saturating_sub(before));
                }
                self.pause
            }
        }
    }

    /// The pause in which the wanted ticks begin, where so many have begun in a time.
    fn next(&self, elapsed: Duration, ticks: u64) -> Duration {
        let [least, most] = LOCKSTEP;
        let wanted = elapsed.mul_f64(self.wanted as f64 / ticks.max(1) as f64);
        // No pause is twice the one before: a process that stood still for a moment goes on at its speed.
        wanted.min(2 * self.pause).clamp(least, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_in_lockstep_finds_half_of_what_the_recorder_may_be_behind() {
        let mut pace = Pace::new(Mode::Lockstep, false, 256);
        // From 5 ms on, at 12 800 and at 40 000 ticks a second.
        for (ticks_per_ms, expected_us) in [(12.8, 10_000), (40.0, 3_200)] {
            for _ in 0..8 {
                let ticks = (pace.pause.as_secs_f64() * 1e3 * ticks_per_ms).round() as u64;
                pace.pause = pace.next(pace.pause, ticks);
            }
            assert!((pace.pause.as_micros() as i64 - expected_us).abs() < 200, "{:?}", pace.pause);
        }
        let pause = pace.pause;
        assert_eq!(pace.next(Duration::from_secs(1), 0), 2 * pause, "nothing has begun");
        pace.pause = LOCKSTEP[1];
        assert_eq!(pace.next(Duration::from_secs(1), 0), LOCKSTEP[1]);
        assert_eq!(pace.next(Duration::from_millis(1), 100_000), LOCKSTEP[0]);
    }
}
