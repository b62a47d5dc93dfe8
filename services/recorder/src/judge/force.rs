//! Forces of the hand, by the simulator's true contact.

use control::{Contact, GroundTruth, Progress};
use shared_types::WristForce;
use shared_types::bounds::{larger, within};
use shared_types::scenario::Goal;
use shared_types::summary::ForceSummary;

use super::tick::Tick;

/// Gathers the figures of the segments with a force.
#[derive(Debug, Default)]
pub(super) struct ForceMeter {
    summary: ForceSummary,
    square_sum: f64,
    has_sensor: bool,
    /// A segment with a force has begun: a contact is no surprise from then on.
    pub(super) has_begun: bool,
}

impl ForceMeter {
    /// Takes in a tick at a place of the path; `dt_s`: length of a tick.
    pub(super) fn tick(
        &mut self,
        tick: &Tick<'_>,
        truth: &dyn GroundTruth,
        place: &Progress,
        dt_s: f64,
    ) {
        let state = tick.truth;
        let Some(contact) = truth.force(place, state) else {
            return;
        };
        self.has_begun = true;
        // Without a sensor the place of its message is empty.
        let now = state.header.tick;
        let is_of_now = |wrist: &WristForce| now > 0 && wrist.header.tick == now;
        self.has_sensor |= tick.wrist.is_some_and(is_of_now);
        // The path waits at the segment's beginning, within a tick of it, until the force has come about.
        self.take(&contact, place.time_s >= dt_s, state.contacts > 0);
    }

    fn take(&mut self, contact: &Contact, moves: bool, touches: bool) {
        let one = &mut self.summary;
        one.newtons = larger(one.newtons, contact.newtons);
        one.borne_max = larger(one.borne_max, contact.borne);
        if !moves {
            one.approach_ticks += 1;
            one.impact_max_n = larger(one.impact_max_n, contact.pressed_n);
            return;
        }
        let error = (contact.pressed_n - contact.newtons).abs();
        one.ticks += 1;
        one.error_max_n = larger(one.error_max_n, error);
        one.lift_off_ticks += u64::from(!touches);
        one.tangential_max_mm = larger(one.tangential_max_mm, contact.across_mm);
        self.square_sum += error * error;
    }

    /// The findings; `None` where no segment with a force has begun.
    pub(super) fn finish(mut self) -> Option<ForceSummary> {
        let source = if self.has_sensor {
            "wrist sensor"
        } else {
            "observer"
        };
        source.clone_into(&mut self.summary.source);
        if self.summary.ticks > 0 {
            self.summary.rms_n = (self.square_sum / self.summary.ticks as f64).sqrt();
        }
        self.has_begun.then_some(self.summary)
    }
}

/// The defect of a force, in words; `None`: it was kept.
pub(super) fn unkept(force: &ForceSummary, goal: &Goal) -> Option<String> {
    if force.lift_off_ticks > 0 {
        let ticks = force.lift_off_ticks;
        return Some(format!("the hand lost its contact for {ticks} ticks"));
    }
    let (rms_n, newtons, bound) = (force.rms_n, force.newtons, goal.force_n);
    (!within(rms_n, bound)).then(|| {
        format!("force of {newtons} N off by {rms_n:.3} N (root mean square), allowed {bound} N")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_approach_is_its_own_and_a_hand_in_the_air_is_counted() {
        let mut meter = ForceMeter {
            has_begun: true,
            ..ForceMeter::default()
        };
        let mut tick = |pressed_n, moves, touches| {
            let contact = Contact {
                newtons: 10.0,
                pressed_n,
                across_mm: 0.3,
                borne: 0.0,
            };
            meter.take(&contact, moves, touches);
        };
        tick(0.0, false, false);
        tick(14.0, false, true);
        tick(13.0, true, true);
        tick(6.0, true, true);
        tick(0.0, true, false);
        let found = meter.finish().unwrap();
        assert_eq!(
            (found.ticks, found.approach_ticks, found.lift_off_ticks),
            (3, 2, 1)
        );
        assert_eq!(
            (
                found.impact_max_n,
                found.error_max_n,
                found.tangential_max_mm
            ),
            (14.0, 10.0, 0.3)
        );
        assert!((found.rms_n - (125.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(ForceMeter::default().finish(), None);
    }
}
