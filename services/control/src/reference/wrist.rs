//! Type 2 reference of a PUMA's wrist: the direction of z5 from the desired direction of z6.

use super::{Memory, Situation, Target, line_angle, pass};
use crate::linear::angular;
use crate::types::Mode;

/// Damping on the sine of the desired wrist angle.
const MU: f64 = 0.08;

/// z5 → ±z4×z6_d: with z5 there, a turn of joint 5 alone reaches z6_d.
///
/// With w = z4×z6_d, |w| the sine of the desired wrist angle: e = angle from z5 to the line of w, believed by |w|²/(|w|² + μ²);
/// φ̇_ff = z4·(w×ẇ)/(|w|² + μ²). Passing: z5 → ±ẇ, so that z6 travels in the plane normal to z5.
pub(super) fn target<const N: usize>(at: &Situation<'_, N>, memory: &mut Memory) -> Target {
    let terms = at.terms;
    let [z4, z5] = [terms.z[3], terms.z[4]];
    let z6_d = at.desired.R * (terms.X_BE.R.transpose() * terms.z[5]);
    let w = z4.cross(&z6_d);
    let z4_rate = terms.omega[3].cross(&z4);
    let flat = |x: nalgebra::Vector3<f64>| x - z4 * z4.dot(&x);
    let rate_of = |omega_d: nalgebra::Vector3<f64>| flat(z4_rate.cross(&z6_d) + z4.cross(&omega_d.cross(&z6_d)));
    let (w_rate, w_rate_nominal) = (rate_of(angular(&at.desired.V)), rate_of(angular(at.V_nominal)));
    let size = w.norm_squared();
    memory.passing = pass(&w, &w_rate_nominal, &z4, size < 0.05, at.rate_max, at.pass_ratio, memory.passing);
    memory.holding = size < MU * MU * if memory.holding { 0.25 } else { 0.06 };
    let (error, rate, weight, mode) = if memory.passing {
        let speed = w_rate_nominal.norm_squared();
        (line_angle(&z5, &w_rate_nominal, &z4), 0.0, speed / (speed + MU * MU), Mode::Pass)
    } else {
        let rate = z4.dot(&w.cross(&w_rate)) / (size + MU * MU);
        (line_angle(&z5, &w, &z4), rate, size / (size + MU * MU), if memory.holding { Mode::Hold } else { Mode::Track })
    };
    Target { error: within_limits(error, at), rate, weight, mode, clipped: false }
}

/// The same line reached the other way round, where joints 4 and 6 allow only that.
fn within_limits<const N: usize>(error: f64, at: &Situation<'_, N>) -> f64 {
    use std::f64::consts::PI;
    let fits = |turn: f64| {
        let (q4, q6) = (at.q[3] + turn, at.q[5] - turn);
        q4 > at.lower[3] && q4 < at.upper[3] && q6 > at.lower[5] && q6 < at.upper[5]
    };
    let other = error - PI.copysign(error);
    if !fits(error) && fits(other) { other } else { error }
}
