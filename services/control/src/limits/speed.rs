//! Speed limits of the joints, kept by acceleration: what the clock cannot slow down, the null-space motion above all, is held here.
//!
//! With the gap g_i = 0.98 v_i − |q̇_i|, a joint may gain speed by no more than what its torque rate takes back in time, √(2 j_i g_i) with
//! j_i = ½·(torque rate)/A_ii, and by no more than g_i/4 ms, near the limit g_i/25 ms.
//!
//! Reduces to the paper's law: while every joint is below 0.5 v_i the torques are passed on unchanged (proof: `far_from_the_limits_nothing_changes`).

use super::clock::MARGIN;
use super::{Parts, shares};
use crate::linear::Joints;
use crate::paper::operational_space::Cholesky;
use crate::types::Refusal;
use nalgebra::SMatrix;

/// Shares of a speed limit from which on it is watched, from which on it is approached slowly, and at which a joint gains no more speed.
const WATCHED: f64 = 0.5;
const FROM: f64 = 0.85;
const MOST: f64 = 0.98;
/// Share of a joint's torque rate that is reckoned with: the rest is for the joints that move with it.
const RATE_SHARE: f64 = 0.5;
/// Time constants of the approach, s: the velocity feedback's, and a few ticks, within which a joint of next to no inertia does not leap to its limit.
const APPROACH_S: f64 = 0.025;
const LEAP_S: f64 = 0.004;

/// The torques, scaled down so that no joint is driven beyond its speed limit.
///
/// Shapes N, `A` N×N · Units N·m, rad/s; `torque_rate` N·m/s · Errors [`Refusal::Singular`] for a singular mass matrix · Cost none below half of every limit,
/// else about 1 µs; no allocation
#[inline]
pub fn held<const N: usize>(
    torques: &Parts<N>,
    A: &SMatrix<f64, N, N>,
    qdot: &Joints<N>,
    velocity: &Joints<N>,
    torque_rate: &Joints<N>,
) -> Result<Parts<N>, Refusal> {
    let is_watched = |i: usize| qdot[i].abs() > WATCHED * velocity[i];
    if !(0..N).any(is_watched) {
        return Ok(*torques);
    }
    let mut limits = [f64::NEG_INFINITY, f64::INFINITY].map(Joints::<N>::repeat);
    for i in (0..N).filter(|i| is_watched(*i)) {
        let gap = MOST * velocity[i] - qdot[i].abs();
        let is_near = qdot[i].abs() > FROM * velocity[i];
        let near = gap / if is_near { APPROACH_S } else { LEAP_S };
        let room = near.min((2.0 * RATE_SHARE * torque_rate[i] / A[(i, i)] * gap.max(0.0)).sqrt());
        let is_up = qdot[i] > 0.0;
        limits[usize::from(is_up)][i] = if is_up { room } else { -room };
    }
    let A = Cholesky::new(*A)?;
    let accelerations = Parts {
        null: A.solve(&torques.null),
        path: A.solve(&torques.path),
        rest: A.solve(&torques.rest),
    };
    let [low, high] = &limits;
    Ok(torques.scaled(shares(&Joints::zeros(), &accelerations, [low, high])))
}

/// The largest of |v_i|/limit_i, 0 where there is none.
#[inline]
pub fn largest_share<const N: usize>(v: &Joints<N>, limits: &Joints<N>) -> f64 {
    (0..N).fold(0.0, |share, i| share.max(v[i].abs() / limits[i]))
}

/// Demand on the clock by the joints' present speeds, beyond the share of a limit that the path may take; 0 below it.
#[inline]
pub fn demand<const N: usize>(qdot: &Joints<N>, velocity: &Joints<N>) -> f64 {
    let share = largest_share(qdot, velocity);
    if share > MARGIN { share } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    fn torques(null: f64) -> Parts<2> {
        Parts {
            path: Vector2::new(1.0, 0.0),
            rest: Vector2::new(0.0, 1.0),
            null: Vector2::new(null, 0.5),
        }
    }

    const LIMIT: Vector2<f64> = Vector2::new(2.0, 2.0);

    /// From `qdot` rad/s, with a torque rate of `rate` N·m/s.
    fn given(null: f64, A: &Matrix2<f64>, qdot: &Vector2<f64>, rate: f64) -> Parts<2> {
        held(&torques(null), A, qdot, &LIMIT, &Vector2::repeat(rate)).unwrap()
    }

    #[test]
    fn far_from_the_limits_nothing_changes() {
        let qdot = Vector2::new(0.99, -1.0);
        assert_eq!(given(1e3, &Matrix2::identity(), &qdot, 1e4), torques(1e3));
        assert_eq!(demand(&Vector2::new(1.8, 0.0), &LIMIT), 0.0);
    }

    /// 40 N·m in the null space, at once, and so slowly that 20 rad/s² are gone after 0.4 s at the earliest.
    #[test]
    fn a_joint_never_exceeds_its_limit_though_its_torque_changes_slowly() {
        let dt = 1e-3;
        for (A, rate) in [
            (Matrix2::new(2.0, 0.3, 0.3, 1.0), 1e9),
            (Matrix2::identity() * 2.0, 1e2),
        ] {
            let (mut qdot, mut tau) = (Vector2::zeros(), Vector2::zeros());
            let mut fastest = 0.0_f64;
            for _ in 0..5000 {
                let wanted = given(40.0, &A, &qdot, rate).sum();
                tau += (wanted - tau).map(|change| change.clamp(-rate * dt, rate * dt));
                qdot += Cholesky::new(A).unwrap().solve(&tau) * dt;
                qdot[1] *= 0.9;
                fastest = fastest.max(qdot[0]);
            }
            assert!(
                fastest <= LIMIT[0] && fastest > 0.9 * LIMIT[0],
                "{rate}: {fastest}"
            );
        }
    }

    #[test]
    fn the_null_space_goes_first() {
        let given = given(40.0, &Matrix2::identity(), &Vector2::new(1.9, 0.0), 1e4);
        assert!(given.path == torques(0.0).path && given.rest == torques(0.0).rest);
        let room = (MOST * LIMIT[0] - 1.9) / APPROACH_S;
        assert!(
            (given.path[0] + given.null[0] - room).abs() < 1e-9,
            "{given:?}"
        );
    }
}
