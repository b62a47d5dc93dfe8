//! Speed limits of the joints, kept by acceleration (+): what the governor cannot slow down, the null-space motion above all, is held here.
//!
//! With the gap g_i = 0.98 v_i − |q̇_i|, a joint may gain speed by no more than what its torque rate takes back in time, √(2 j_i g_i) with
//! j_i = ½·(torque rate)/A_ii, and near the limit by no more than g_i/25 ms. The null-space torque is scaled down first, then the task torque along the
//! path, then its rest, as at the torque limits.
//!
//! Reduces to the paper's law: while every joint is below 0.5 v_i the torques are passed on unchanged (proof: `far_from_the_limits_nothing_changes`).

use super::governor::MARGIN;
use crate::law::Torques;
use crate::linear::{Lu, SolveError};
use nalgebra::{SMatrix, SVector};

/// Shares of a speed limit from which on it is watched, from which on it is approached slowly, and at which a joint gains no more speed.
const WATCHED: f64 = 0.5;
const FROM: f64 = 0.85;
const MOST: f64 = 0.98;
/// Share of a joint's torque rate that is reckoned with: the rest is for the joints that move with it.
const RATE_SHARE: f64 = 0.5;
/// Time constant of the approach, s: the velocity feedback's.
const APPROACH_S: f64 = 0.025;

/// The torques, scaled down so that no joint is driven beyond its speed limit.
///
/// Shapes N, `A` N×N · Units N·m, rad/s; `torque_rate` N·m/s · Errors [`SolveError`] for a singular mass matrix · Cost none below half of every limit,
/// else about 1 µs; no allocation
#[inline]
pub fn held<const N: usize>(
    torques: &Torques<N>,
    A: &SMatrix<f64, N, N>,
    qdot: &SVector<f64, N>,
    velocity: &SVector<f64, N>,
    torque_rate: &SVector<f64, N>,
) -> Result<Torques<N>, SolveError> {
    if (0..N).all(|i| qdot[i].abs() <= WATCHED * velocity[i]) {
        return Ok(*torques);
    }
    let room = |i: usize| {
        let gap = MOST * velocity[i] - qdot[i].abs();
        let near = if qdot[i].abs() > FROM * velocity[i] {
            gap / APPROACH_S
        } else {
            f64::INFINITY
        };
        near.min((2.0 * RATE_SHARE * torque_rate[i] / A[(i, i)] * gap.max(0.0)).sqrt())
    };
    let lu = Lu::new(*A)?;
    let [path, rest, null] =
        [&torques.path, &torques.rest, &torques.null].map(|torque| lu.solve(torque));
    let share = |fixed: &SVector<f64, N>, part: &SVector<f64, N>| {
        (0..N)
            .filter(|i| qdot[*i].abs() > WATCHED * velocity[*i])
            .fold(1.0_f64, |share, i| {
                let (out, room) = (qdot[i].signum(), room(i));
                let (fixed, part) = (out * fixed[i], out * part[i]);
                if part > 0.0 && fixed + part > room {
                    share.min(((room - fixed) / part).max(0.0))
                } else {
                    share
                }
            })
    };
    let null_share = share(&(path + rest), &null);
    let path_share = share(&(rest + null * null_share), &path);
    let rest_share = share(&(null * null_share + path * path_share), &rest);
    Ok(Torques {
        path: torques.path * path_share,
        rest: torques.rest * rest_share,
        null: torques.null * null_share,
        ..*torques
    })
}

/// Demand on the clock by the joints' present speeds, beyond the share of a limit that the path may take; 0 below it.
#[must_use]
#[inline]
pub fn demand<const N: usize>(qdot: &SVector<f64, N>, velocity: &SVector<f64, N>) -> f64 {
    let share = (0..N).fold(0.0_f64, |share, i| share.max(qdot[i].abs() / velocity[i]));
    if share > MARGIN { share } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    fn torques(null: f64) -> Torques<2> {
        Torques {
            path: Vector2::new(1.0, 0.0),
            rest: Vector2::new(0.0, 1.0),
            null: Vector2::new(null, 0.5),
            qdot_nominal: Vector2::zeros(),
            qddot_path: Vector2::zeros(),
        }
    }

    const LIMIT: Vector2<f64> = Vector2::new(2.0, 2.0);
    const RATE: Vector2<f64> = Vector2::new(1e4, 1e4);

    #[test]
    fn far_from_the_limits_nothing_changes() {
        let wanted = torques(1e3);
        assert_eq!(
            held(
                &wanted,
                &Matrix2::identity(),
                &Vector2::new(0.99, -1.0),
                &LIMIT,
                &RATE
            )
            .unwrap(),
            wanted
        );
        assert_eq!(demand(&Vector2::new(1.8, 0.0), &LIMIT), 0.0);
    }

    #[test]
    fn a_joint_never_exceeds_its_limit() {
        let A = Matrix2::new(2.0, 0.3, 0.3, 1.0);
        let (mut qdot, dt) = (Vector2::new(1.5, 0.0), 1e-3);
        for _ in 0..3000 {
            let given = held(&torques(40.0), &A, &qdot, &LIMIT, &RATE).unwrap();
            qdot += Lu::new(A)
                .unwrap()
                .solve(&(given.path + given.rest + given.null))
                * dt;
            qdot[1] *= 0.9;
            assert!(qdot[0] <= 0.99 * LIMIT[0], "{qdot}");
        }
        assert!(
            qdot[0] > 0.9 * LIMIT[0],
            "the null-space motion goes on: {qdot}"
        );
    }

    #[test]
    fn a_torque_that_changes_slowly_is_taken_back_in_time() {
        // 40 N·m on 2 kg·m², its change bounded by 100 N·m/s: 20 rad/s² are gone after 0.4 s at the earliest.
        let (rate, dt) = (Vector2::new(1e2, 1e2), 1e-3);
        let (mut qdot, mut tau) = (0.0, 0.0);
        let inertia = Matrix2::identity() * 2.0;
        let mut fastest = 0.0_f64;
        for _ in 0..5000 {
            let given = held(
                &torques(40.0),
                &inertia,
                &Vector2::new(qdot, 0.0),
                &LIMIT,
                &rate,
            )
            .unwrap();
            let wanted = given.path[0] + given.rest[0] + given.null[0];
            tau += f64::clamp(wanted - tau, -rate[0] * dt, rate[0] * dt);
            qdot += tau / inertia[(0, 0)] * dt;
            fastest = fastest.max(qdot);
        }
        assert!(fastest <= LIMIT[0] && fastest > 0.9 * LIMIT[0], "{fastest}");
    }

    #[test]
    fn the_null_space_goes_first() {
        let given = held(
            &torques(40.0),
            &Matrix2::identity(),
            &Vector2::new(1.9, 0.0),
            &LIMIT,
            &RATE,
        )
        .unwrap();
        assert!(
            given.path == torques(0.0).path && given.rest == torques(0.0).rest,
            "{given:?}"
        );
        let room = (MOST * LIMIT[0] - 1.9) / APPROACH_S;
        assert!(
            (given.path[0] + given.null[0] - room).abs() < 1e-9,
            "{given:?}"
        );
    }
}
