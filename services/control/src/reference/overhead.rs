//! Reference of a PUMA's waist at the overhead lock: q1 from the desired place of the wrist centre about the waist axis.

use super::{Memory, Situation, Target};
use crate::linear::{linear, wrap_angle};
use crate::singular::PumaFactors;
use crate::types::Mode;

/// Damping on the in-plane radius, m.
const MU: f64 = 0.05;

/// Analytic inverse kinematics of the waist: the arm's plane, at `d` from the waist axis, must hold p_d.
///
/// With r_d the distance of p_d from the waist axis, R_d = ±√(r_d² − d²) and q1_d = q1 + atan2(y, x) − atan2(d, R_d) in the arm's own axes; the
/// nearer of the two is taken. A goal nearer to the axis than d is beyond reach: R_d = 0.
pub(super) fn target<const N: usize>(_puma: &PumaFactors, at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let terms = at.terms;
    let [z1, z2] = [terms.z[0], terms.z[1]];
    let x = z2.cross(&z1);
    let S = PumaFactors::shoulder(terms);
    let p_d = at.desired.p - S;
    let d = (at.at.p - S).dot(&z2);
    let (along, across) = (p_d.dot(&x), p_d.dot(&z2));
    let v = linear(&at.desired.V);
    let r2 = along * along + across * across - d * d;
    let clipped = r2 < -1e-7;
    let R = r2.max(0.0).sqrt();
    let azimuth = libm::atan2(across, along);
    let turn = |R: f64| wrap_angle(azimuth - libm::atan2(d, R));
    let (one, two) = (turn(R), turn(-R));
    let fits = |turn: f64| {
        let q1 = at.q[0] + turn;
        q1 > at.lower[0] && q1 < at.upper[0]
    };
    let error = match (fits(one), fits(two)) {
        (true, false) => one,
        (false, true) => two,
        _ if one.abs() <= two.abs() => one,
        _ => two,
    };
    let weight = R * R / (R * R + MU * MU);
    let rate = if clipped { 0.0 } else { v.dot(&z2) * along / (along * along + MU * MU) };
    memory.holding = weight < if memory.holding { 0.2 } else { 0.06 };
    let mode = match (clipped, memory.holding) {
        (true, _) => Mode::Slide,
        (false, true) => Mode::Hold,
        (false, false) => Mode::Track,
    };
    Target { error, rate, weight, mode, clipped }
}
