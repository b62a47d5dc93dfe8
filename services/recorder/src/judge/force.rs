//! Forces of the hand, by the simulator's true contact.

use control::{Contact, GroundTruth, Progress};
use nalgebra::{Vector3, Vector6};
use shared_types::WristForce;
use shared_types::bounds::{larger, within};
use shared_types::scenario::Goal;
use shared_types::summary::ForceSummary;

use super::tick::Tick;

/// Multiple of the force asked for beyond which a contact is one that nobody asked for.
const MOST: f64 = 2.0;

/// Time after which a force that has not come about counts as one that does not, s.
const PATIENCE_S: f64 = 1.0;

/// Gathers the figures of the segments, or of the targets, with a force.
#[derive(Debug, Default)]
pub(super) struct ForceMeter {
    summary: ForceSummary,
    has_sensor: bool,
    /// A segment with a force has begun.
    pub(super) has_begun: bool,
    leg: Leg,
}

/// The present segment, or the present force of targets.
#[derive(Debug, Default)]
struct Leg {
    index: usize,
    asked_n: f64,
    /// The force of the segment before, while its contact lasts.
    before_n: f64,
    square_sum: f64,
    moment_square_sum: f64,
    ticks: u64,
    /// For how long the force has been what a target asks for, s.
    reached_s: f64,
    /// For how long it has been asked for, s.
    asked_s: f64,
    /// The set-point of a target as it changes to what is asked for, N; and its direction, base axes.
    set_n: f64,
    e: Vector3<f64>,
}

impl ForceMeter {
    /// Takes in a tick at a place of the path, or of a steered run, with the error of its pose; `dt_s`: length of a tick.
    pub(super) fn tick(
        &mut self,
        tick: &Tick<'_>,
        truth: &dyn GroundTruth,
        place: Option<&Progress>,
        error: &Vector6<f64>,
        dt_s: f64,
    ) {
        let state = tick.truth;
        let target = tick.target.map(|message| &message.target);
        let target = target.filter(|target| {
            let age = state.header.tick.saturating_sub(target.given_tick);
            age as f64 * dt_s <= target.valid_s
        });
        let force = truth.force(place, target, state, error);
        let is_next = match force {
            Some(force) => self.leg.asked_n == 0.0 || force.is_away_from(&self.leg.e),
            None => self.leg.asked_n > 0.0,
        };
        let leg = place.map_or(self.leg.index + usize::from(is_next), |place| place.leg);
        self.reach(leg, force.as_ref(), state.contacts > 0);
        let Some(contact) = force else {
            return;
        };
        self.has_begun = true;
        // Without a sensor the place of its message is empty.
        let now = state.header.tick;
        let is_of_now = |wrist: &WristForce| now > 0 && wrist.header.tick == now;
        self.has_sensor |= tick.wrist.is_some_and(is_of_now);
        // The path waits at the segment's beginning, within a tick of it, until the force has come about.
        let is_reached = self.is_reached(&contact, dt_s);
        let contact = Contact {
            newtons: place.map_or(self.leg.set_n, |_| contact.newtons),
            ..contact
        };
        let moves = place.map_or(is_reached, |place| place.time_s >= dt_s);
        self.take(&contact, moves, state.contacts > 0);
    }

    /// Whether the force has come about since it was asked for: the time before that is a target's approach. From then on its set-point changes in the time of its ramp.
    fn is_reached(&mut self, contact: &Contact, dt_s: f64) -> bool {
        let leg = &mut self.leg;
        leg.asked_s += dt_s;
        leg.e = contact.e;
        let (share, long_s) = Contact::REACHED;
        if leg.reached_s < long_s {
            let off = (contact.pressed_n - contact.newtons).abs();
            let is_near = off <= share * contact.newtons;
            leg.reached_s = if is_near { leg.reached_s + dt_s } else { 0.0 };
            leg.set_n = contact.newtons;
        }
        leg.set_n = contact.set_point(leg.set_n, dt_s);
        leg.reached_s >= long_s
    }

    /// The largest force of a contact that is asked for at this tick; N.
    pub(super) fn most_n(&self) -> f64 {
        // A set-point on its way down is still asked for.
        let now_n = larger(self.leg.asked_n, self.leg.set_n);
        MOST * larger(now_n, self.leg.before_n)
    }

    fn reach(&mut self, index: usize, force: Option<&Contact>, touches: bool) {
        if index != self.leg.index {
            self.end_leg();
            let before_n = self.leg.asked_n;
            self.leg = Leg {
                index,
                before_n,
                ..Leg::default()
            };
        }
        self.leg.asked_n = force.map_or(0.0, |force| force.newtons);
        if !touches {
            self.leg.before_n = 0.0;
        }
    }

    /// A force that one segment did not keep shall not vanish among those of the others: the largest root mean square counts.
    fn end_leg(&mut self) {
        if self.leg.ticks == 0 && self.leg.asked_s >= PATIENCE_S {
            self.summary.unreached += 1;
        }
        if self.leg.ticks > 0 {
            let rms = |sum: f64| (sum / self.leg.ticks as f64).sqrt();
            let one = &mut self.summary;
            one.rms_n = larger(one.rms_n, rms(self.leg.square_sum));
            if let Some(largest) = &mut one.moment_rms_nm {
                *largest = larger(*largest, rms(self.leg.moment_square_sum));
            }
        }
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
        self.leg.ticks += 1;
        self.leg.square_sum += error * error;
        if let Some(off) = contact.moment_off_nm {
            self.leg.moment_square_sum += off * off;
            one.moment_rms_nm.get_or_insert_default();
            let most = one.moment_max_nm.get_or_insert_default();
            *most = larger(*most, off);
        }
    }

    /// The findings; `None` where no segment with a force has begun.
    pub(super) fn finish(mut self) -> Option<ForceSummary> {
        let source = if self.has_sensor {
            "wrist sensor"
        } else {
            "observer"
        };
        source.clone_into(&mut self.summary.source);
        self.end_leg();
        self.has_begun.then_some(self.summary)
    }
}

/// Share of an axis that is mostly lost.
const MOSTLY: f64 = 0.5;

/// A cause of a miss, in words: most of the axis was lost.
pub(super) fn borne(force: &ForceSummary) -> Option<String> {
    let percent = 100.0 * force.borne_max;
    (force.borne_max > MOSTLY).then(|| {
        format!("up to {percent:.0} % of the axis of the force or of a moment was lost in a singularity: there the hand leaves its path, or presses less")
    })
}

/// The defect of a force, in words; `None`: it was kept.
pub(super) fn unkept(force: &ForceSummary, goal: &Goal) -> Option<String> {
    if force.lift_off_ticks > 0 {
        let ticks = force.lift_off_ticks;
        return Some(format!("the hand lost its contact for {ticks} ticks"));
    }
    let rms_n = force.rms_n;
    let newtons = force.newtons;
    let bound = goal.force_n;
    if force.ticks == 0 || force.unreached > 0 {
        return Some(format!("a force of up to {newtons} N did not come about"));
    }
    if !within(rms_n, bound) {
        return Some(format!(
            "force of {newtons} N off by {rms_n:.3} N (root mean square), allowed {bound} N"
        ));
    }
    let off = force.moment_rms_nm?;
    let bound = goal.moment_nm;
    (!within(off, bound))
        .then(|| format!("moments off by {off:.3} N·m (root mean square), allowed {bound} N·m"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(newtons: f64, pressed_n: f64) -> Contact {
        Contact {
            newtons,
            ramp_s: 0.3,
            e: Vector3::z(),
            pressed_n,
            across_mm: 0.0,
            borne: 0.0,
            moment_off_nm: None,
        }
    }

    #[test]
    fn the_approach_is_its_own_and_a_hand_in_the_air_is_counted() {
        let mut meter = ForceMeter {
            has_begun: true,
            ..ForceMeter::default()
        };
        let mut tick = |pressed_n, moves: bool, touches| {
            let contact = Contact {
                across_mm: 0.3,
                moment_off_nm: moves.then_some(0.2),
                ..contact(10.0, pressed_n)
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
        assert_eq!(found.moment_max_nm, Some(0.2));
        assert!((found.moment_rms_nm.unwrap() - 0.2).abs() < 1e-12 && borne(&found).is_none());
        let lost = ForceSummary {
            borne_max: 0.9,
            ..found
        };
        assert!(borne(&lost).is_some());
        assert_eq!(ForceMeter::default().finish(), None);
    }

    /// A second of 10 N without an error, then two ticks of 100 N that are 20 N off, then a segment without a force.
    #[test]
    fn each_segment_counts_for_itself() {
        let mut meter = ForceMeter {
            has_begun: true,
            ..ForceMeter::default()
        };
        let mut most_n = Vec::new();
        let mut tick = |leg, newtons, pressed_n: f64| {
            let contact = contact(newtons, pressed_n);
            let force = (newtons > 0.0).then_some(&contact);
            meter.reach(leg, force, pressed_n > 0.0);
            if newtons > 0.0 {
                meter.take(&contact, true, true);
            }
            most_n.push(meter.most_n());
        };
        for _ in 0..1000 {
            tick(0, 10.0, 10.0);
        }
        tick(1, 100.0, 80.0);
        tick(1, 100.0, 120.0);
        tick(2, 0.0, 90.0);
        tick(2, 0.0, 0.0);
        tick(2, 0.0, 5.0);
        assert_eq!(most_n[999..], [20.0, 200.0, 200.0, 200.0, 0.0, 0.0]);
        assert!((meter.finish().unwrap().rms_n - 20.0).abs() < 1e-12);
    }

    /// A target's 10 N that are there, 1 N that they ramp down to, then a second of 10 N that are not.
    #[test]
    fn a_changed_force_is_judged_by_its_ramp_and_one_that_never_comes_is_counted() {
        let mut meter = ForceMeter::default();
        let mut tick = |newtons, pressed_n, e: Vector3<f64>| {
            let contact = Contact {
                e,
                ..contact(newtons, pressed_n)
            };
            if contact.is_away_from(&meter.leg.e) {
                meter.reach(meter.leg.index + 1, Some(&contact), true);
            }
            let is_reached = meter.is_reached(&contact, 1e-3);
            meter.take(&contact, is_reached, true);
            meter.leg.set_n
        };
        let down = -Vector3::z();
        (0..100).for_each(|_| assert!((tick(10.0, 10.0, down) - 10.0).abs() < 1e-12));
        let ramped: Vec<f64> = (0..1000).map(|_| tick(1.0, 1.0, down)).collect();
        assert!(ramped[99] > 6.0 && ramped[999] == 1.0, "{ramped:?}");
        (0..1001).for_each(|_| _ = tick(10.0, 0.0, Vector3::x()));
        let found = ForceMeter {
            has_begun: true,
            ..meter
        };
        let found = found.finish().unwrap();
        assert_eq!((found.unreached, found.ticks), (1, 1051));
        assert!(unkept(&found, &Goal::default()).is_some());
    }
}
