//! Anti-windup: the lead of the reference over the reference arm is bounded, so that it does not grow while the arm cannot follow.
//!
//! Along a singular direction inside its neighbourhood D_si the reference leads: its lead is what a fold opens by, and what it slides along. Elsewhere,
//! and orthogonal to the singular directions, it is never further away than the accuracy asked for.

use crate::linear::{Vector3, Vector6, angular, linear, rotation_exp, served, smoothstep, stack};
use crate::reference::free_axis::{free_axis, rotation_error};
use crate::types::{Class, Report};
use model::Pose;
use shared_types::MAX_SINGULARITIES;

/// Longest distance orthogonal to the singular directions, and along them, m: ten times the error of tracking, and little to come back from.
const ACROSS_M: f64 = 0.0003;
const ALONG_M: f64 = 0.003;
/// Longest angle, rad.
const ANGLE: f64 = 0.02;
/// Rate at which the reference comes back to the arm once the twist no longer leads away from it, 1/s.
const BACK: f64 = 10.0;
/// Share of the longest lead from which a twist that would increase it is taken away.
const SATURATING: f64 = 0.5;

/// Slide along ζ per turn that counts for nothing, m/rad.
const SLIDE_M: f64 = 0.02;

/// The lead at a tick: the error orthogonal to the singular directions, along them, and of orientation; each with its longest length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lead {
    parts: [(Vector3, f64); 3],
    /// Of each lost translation the way along it that a turn of the hand takes from the arm, m/rad, signed so that more of it increases the lead.
    slides: [Vector3; MAX_SINGULARITIES],
    /// How near it is to its bound, 0 to 1: 1 at the bound.
    pub saturation: f64,
}

impl Lead {
    /// Between the reference and the arm, whose singularities are those of `report`, in the directions that the `task` serves.
    pub fn between<const N: usize>(
        reference: &Pose,
        arm: &Pose,
        report: &Report<N>,
        task: &[bool; 6],
    ) -> Self {
        let turn = rotation_error(&reference.R, &arm.R, free_axis(task).as_ref());
        let off = served(task, &stack(&(reference.p - arm.p), &turn));
        let (error, turn) = (linear(&off), angular(&off));
        let (mut across, mut length) = (error, ACROSS_M);
        let mut slides = [Vector3::zeros(); MAX_SINGULARITIES];
        for (place, s) in (report.listed().iter().enumerate()).filter(|(_, s)| s.inside) {
            let axis = linear(&s.zeta_B);
            if axis.norm() < 0.5 {
                continue;
            }
            across -= axis * (axis.dot(&across) / axis.norm_squared());
            // At a fold the hand may turn while it slides along the boundary of reach. Elsewhere nothing would bring it back.
            if s.class != Class::Type1 {
                // ζ·v_C + other·ω = 0, where v_C = v + ω×r.
                let lever = s.other + (report.p_BC - arm.p).cross(&axis);
                slides[place] = lever * axis.dot(&error).signum();
            }
            let closed = 1.0 - s.openness(s.s);
            length = length.max(ACROSS_M + (ALONG_M - ACROSS_M) * closed);
        }
        let parts = [(across, ACROSS_M), (error - across, length), (turn, ANGLE)];
        Self {
            parts,
            slides,
            saturation: parts
                .iter()
                .fold(0.0, |most, part| most.max(saturation_of(part))),
        }
    }

    /// The reference at the bound, where it is further away; and how far it has been taken back, m.
    #[must_use]
    pub fn hold(&self, reference: &Pose, arm: &Pose) -> (Pose, f64) {
        let held = self
            .parts
            .map(|(error, length)| error * (length / error.norm().max(length)));
        let p = arm.p + held[0] + held[1];
        let is_turned = held[2] != self.parts[2].0;
        let R = if is_turned {
            rotation_exp(&held[2]) * arm.R
        } else {
            reference.R
        };
        let is_moved = held[0] != self.parts[0].0 || held[1] != self.parts[1].0;
        (
            Pose {
                R,
                p: if is_moved { p } else { reference.p },
            },
            if is_moved {
                (reference.p - p).norm()
            } else {
                0.0
            },
        )
    }

    /// The reference on its way back to the arm, where `V` no longer leads away from it.
    #[must_use]
    pub fn relax(&self, reference: &Pose, V: &Vector6, dt: f64) -> Pose {
        let [(across, _), (along, _), (turn, _)] = self.parts;
        let mut relaxed = *reference;
        for p in [across, along] {
            if linear(V).dot(&p) <= 0.0 {
                relaxed.p -= p * (BACK * dt);
            }
        }
        if angular(V).dot(&turn) <= 0.0 {
            relaxed.R = rotation_exp(&(turn * (-BACK * dt))) * relaxed.R;
        }
        relaxed
    }

    /// A twist without the part that would increase a lead that is near its bound: of a turn, what would slide the hand further along a lost direction.
    #[must_use]
    pub fn without_increase(&self, V: &Vector6) -> Vector6 {
        let without = |v: Vector3, part: &(Vector3, f64)| {
            let (error, saturation) = (&part.0, saturation_of(part));
            if saturation > 0.0 {
                v - error * (v.dot(error).max(0.0) * saturation / error.norm_squared())
            } else {
                v
            }
        };
        let [across, along, turn] = &self.parts;
        let (mut turning, saturation) = (without(angular(V), turn), saturation_of(along));
        for slide in &self.slides {
            let share = saturation / (slide.norm_squared() + SLIDE_M * SLIDE_M);
            turning -= slide * (slide.dot(&turning).max(0.0) * share);
        }
        stack(&without(without(linear(V), across), along), &turning)
    }
}

/// How near one part is to its bound, 0 to 1.
fn saturation_of((error, length): &(Vector3, f64)) -> f64 {
    smoothstep((error.norm() / length - SATURATING) / (1.0 - SATURATING))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::empty_report;

    fn between(x: f64) -> Lead {
        Lead::between(
            &Pose::translation(Vector3::new(x, 0.0, 0.0)),
            &Pose::identity(),
            &empty_report::<6>(),
            &[true; 6],
        )
    }

    #[test]
    fn the_lead_stays_within_its_bound_and_the_reference_may_always_come_back() {
        let (arm, far) = (
            Pose::identity(),
            Pose::translation(Vector3::new(0.05, 0.0, 0.0)),
        );
        let lead = between(0.05);
        let (held, back) = lead.hold(&far, &arm);
        assert!(
            (held.p.x - ACROSS_M).abs() < 1e-12
                && (back - 0.05 + ACROSS_M).abs() < 1e-12
                && lead.saturation == 1.0
        );
        let V = Vector6::new(0.1, 0.2, 0.0, 0.0, 0.0, 0.3);
        assert_eq!(
            lead.without_increase(&V),
            Vector6::new(0.0, 0.2, 0.0, 0.0, 0.0, 0.3)
        );
        assert_eq!(lead.without_increase(&-V), -V);
        assert_eq!(between(0.0001).without_increase(&V), V);
        assert_eq!(lead.relax(&held, &V, 1e-3), held, "the twist leads away");
        assert!(
            (lead.relax(&far, &-V, 1e-3).p.x - 0.0495).abs() < 1e-12,
            "1 % of the way back in a tick"
        );
    }

    #[test]
    fn along_a_singular_direction_the_reference_leads_by_more() {
        let mut report = empty_report::<6>();
        report.count = 1;
        report.singularities[0].zeta_B[0] = 1.0;
        (
            report.singularities[0].inside,
            report.singularities[0].eta_in,
            report.singularities[0].eta_out,
        ) = (true, 0.1, 0.2);
        let far = Pose::translation(Vector3::new(0.05, 0.05, 0.0));
        let (held, _) = Lead::between(&far, &Pose::identity(), &report, &[true; 6])
            .hold(&far, &Pose::identity());
        assert!(
            (held.p - Vector3::new(ALONG_M, ACROSS_M, 0.0)).norm() < 1e-12,
            "{}",
            held.p
        );
        // Beyond D_si nothing opens: there the judge counts all of it.
        report.singularities[0].inside = false;
        let (held, _) = Lead::between(&far, &Pose::identity(), &report, &[true; 6])
            .hold(&far, &Pose::identity());
        assert!((held.p.norm() - ACROSS_M).abs() < 1e-12, "{}", held.p);
    }

    /// ζ is x and comes with a turn about z: while the reference is ahead along x, the hand does not turn on that way.
    #[test]
    fn a_turn_that_slides_the_hand_along_a_lost_direction_waits() {
        let mut report = empty_report::<6>();
        report.count = 1;
        let lost = &mut report.singularities[0];
        (lost.zeta_B[0], lost.other.z, lost.inside) = (1.0, 0.2, true);
        (lost.eta_in, lost.eta_out, lost.class) = (0.1, 0.2, Class::Mixed);
        let turn = Vector6::new(0.0, 0.0, 0.0, 0.3, 0.0, 0.3);
        let left = |x: f64, report: &Report<6>| {
            let reference = Pose::translation(Vector3::new(x, 0.0, 0.0));
            let lead = Lead::between(&reference, &Pose::identity(), report, &[true; 6]);
            lead.without_increase(&turn)
        };
        let held = left(ALONG_M, &report);
        assert!(
            (held[3], held[5] > 0.0, held[5] < 0.004) == (0.3, true, true),
            "{held}"
        );
        assert_eq!(
            (left(0.001, &report), left(-ALONG_M, &report)),
            (turn, turn)
        );
        report.singularities[0].class = Class::Type1;
        assert_eq!(
            left(ALONG_M, &report),
            turn,
            "along the boundary of reach it slides"
        );
    }
}
