//! The waist of an arm whose shoulder axes meet at a right angle: measure, and the direction of ζ from the desired place about the waist axis.

use super::axes::{EXACT, shoulder, unit};
use super::family::{Posture, Situation};
use crate::linear::{linear, sign, stack, wrap_angle};
use crate::paper::reference::Memory;
use crate::paper::type_2::Direction;
use crate::types::{Class, Kind, Singularity};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Damping on the in-plane radius, m: only desired quantities are divided by it, so it need not cover noise.
const MU: f64 = 3e-5;

/// Largest extra error of a path straight past the waist axis instead of around it, m.
const PASS: f64 = 3e-4;

/// In-plane radius beyond which the present side of the waist axis holds, m.
const FREE: f64 = 0.1;

/// Time over which turning is weighed against following, s.
const SETTLE: f64 = 0.2;

/// Distance from the waist axis below which the waist angle hardly follows from the desired place, m.
const NEAR: f64 = 0.03;

/// Overhead: C, above the waist axis, cannot move along the normal z2 of the arm's plane.
///
/// The joints `in_plane` move C within the plane, so ζᵀJ = R·e1 exactly, R the in-plane distance of C from the waist axis; s = R/`reach`. A
/// shoulder offset makes it a one-sided fold: no C nearer than the offset to the waist axis can be reached.
#[inline]
pub(super) fn measure<const N: usize>(
    at: &Posture<'_, N>,
    in_plane: Range<usize>,
    reach: f64,
) -> Singularity<N> {
    let [z1, z2] = [at.terms.z[0], at.terms.z[1]];
    let x = z2.cross(&z1);
    let p = at.at.p - shoulder(at.terms);
    let (radius, offset) = (p.dot(&x), p.dot(&z2));
    let column = |j: usize| x.x * at.at.J[(0, j)] + x.y * at.at.J[(1, j)] + x.z * at.at.J[(2, j)];
    Singularity {
        kind: Kind::Overhead,
        class: if offset.abs() > EXACT {
            Class::Mixed
        } else {
            Class::Type2
        },
        s: radius / reach,
        s_rate: in_plane.map(|j| column(j) * at.qdot[j]).sum::<f64>() / reach,
        zeta_B: stack(&z2, &Vector3::zeros()),
        R_BS: Matrix3::from_columns(&[z2, z1, x]),
        gain: radius,
        aux: at.q[0],
        aux_rate: at.qdot[0],
        aux_row: unit(0),
        kappa_1: offset.abs(),
        kappa_2: 1.0,
        ..Singularity::none()
    }
}

/// Analytic inverse kinematics of the waist: the arm's plane, at `d` from the waist axis, must hold p_d.
///
/// With r_d the distance of p_d from the waist axis, R_d = ±√(r_d² − d²) and q1_d = q1 + atan2(y, x) − atan2(d, R_d) in the arm's own axes; the
/// nearer of the two is taken. A goal nearer to the axis than d is beyond reach: R_d = 0. The rate is its derivative,
/// q̇1_d = (z1×r_d)·v_d/r_d² + (d/r_d²)·Ṙ_d with Ṙ_d = (r_d·v_d)/R_d damped; the weight r_d²/(r_d² + 0.03²) vanishes where r_d determines no angle.
pub(super) fn direction<const N: usize>(at: &Situation<'_, N>, memory: &mut Memory) -> Direction {
    let terms = at.terms;
    let [z1, z2] = [terms.z[0], terms.z[1]];
    let x = z2.cross(&z1);
    let S = shoulder(terms);
    let p_d = at.desired.p - S;
    let d = (at.at.p - S).dot(&z2);
    let (along, across) = (p_d.dot(&x), p_d.dot(&z2));
    let v = linear(&at.desired.V);
    let R2 = along * along + across * across - d * d;
    let clipped = R2 < -1e-7;
    let R = R2.max(0.0).sqrt();
    let azimuth = libm::atan2(across, along);
    let turn = |R: f64| wrap_angle(azimuth - libm::atan2(d, R));
    let (one, two) = (turn(R), turn(-R));
    let fits = |turn: f64| {
        let q1 = at.q[0] + turn;
        q1 > at.lower[0] && q1 < at.upper[0]
    };
    let r2 = along * along + across * across;
    let weight = r2 / (r2 + NEAR * NEAR);
    let (v_along, v_across) = (v.dot(&x), v.dot(&z2));
    let around = (along * v_across - across * v_along) / r2.max(1e-9);
    let fold = d / r2.max(1e-9) * (along * v_along + across * v_across) * R / (R * R + MU * MU);
    let rate_on = |side: f64| {
        if clipped {
            around
        } else {
            around + side * fold
        }
    };
    // The side of the waist axis on which the wrist centre shall be: the one it is on, but where going straight on costs little, the one that the
    // waist reaches and follows with less motion.
    let motion = |turn: f64, side: f64| turn.abs() + SETTLE * rate_on(side).abs();
    let easier = sign(motion(one, 1.0) <= motion(two, -1.0));
    let present = sign((at.at.p - S).dot(&x) >= 0.0);
    if memory.side == 0.0 {
        memory.side = present;
    }
    if r2.sqrt() - d.abs() < PASS || (R > 2.0 * FREE && present != memory.side) {
        memory.side = easier;
    }
    let side = match (fits(one), fits(two)) {
        (true, false) => 1.0,
        (false, true) => -1.0,
        _ => memory.side,
    };
    let error = if side > 0.0 { one } else { two };
    let rate = rate_on(side) * weight;
    memory.holding = weight < if memory.holding { 0.5 } else { 0.3 };
    Direction {
        error,
        rate,
        weight,
        passing: false,
        holding: memory.holding,
        clipped,
    }
}
