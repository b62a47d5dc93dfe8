//! Speed limits of the joints, kept by acceleration (+): what the governor cannot slow down, the null-space motion above all, is held here.
//!
//! A joint near its limit v_i may gain speed by no more than b_i = (0.98 v_i − |q̇_i|)/25 ms. The null-space torque is scaled down first, then the task
//! torque along the path, then its rest, as at the torque limits.
//!
//! Reduces to the paper's law: while every joint is below 0.85 v_i the torques are passed on unchanged (proof: `far_from_the_limits_nothing_changes`).

use super::governor::MARGIN;
use crate::law::Torques;
use crate::linear::{Lu, SolveError};
use nalgebra::{SMatrix, SVector};

/// Shares of a speed limit from which on it is watched, and at which a joint gains no more speed.
const FROM: f64 = 0.85;
const MOST: f64 = 0.98;
/// Time constant of the approach, s: the velocity feedback's.
const APPROACH_S: f64 = 0.025;

/// The torques, scaled down so that no joint is driven beyond its speed limit.
///
/// Shapes N, `A` N×N · Units N·m, rad/s · Errors [`SolveError`] for a singular mass matrix · Cost none below 0.85 of every limit, else about 1 µs; no
/// allocation
pub fn held<const N: usize>(
    torques: &Torques<N>,
    A: &SMatrix<f64, N, N>,
    qdot: &SVector<f64, N>,
    velocity: &SVector<f64, N>,
) -> Result<Torques<N>, SolveError> {
    if (0..N).all(|i| qdot[i].abs() <= FROM * velocity[i]) {
        return Ok(*torques);
    }
    let lu = Lu::new(*A)?;
    let [path, rest, null] = [&torques.path, &torques.rest, &torques.null].map(|torque| lu.solve(torque));
    let share = |fixed: &SVector<f64, N>, part: &SVector<f64, N>| {
        (0..N).filter(|i| qdot[*i].abs() > FROM * velocity[*i]).fold(1.0_f64, |share, i| {
            let (out, room) = (qdot[i].signum(), (MOST * velocity[i] - qdot[i].abs()) / APPROACH_S);
            let (fixed, part) = (out * fixed[i], out * part[i]);
            if part > 0.0 && fixed + part > room { share.min(((room - fixed) / part).max(0.0)) } else { share }
        })
    };
    let null_share = share(&(path + rest), &null);
    let path_share = share(&(rest + null * null_share), &path);
    let rest_share = share(&(null * null_share + path * path_share), &rest);
    Ok(Torques { path: torques.path * path_share, rest: torques.rest * rest_share, null: torques.null * null_share, ..*torques })
}

/// Demand on the clock by the joints' present speeds, beyond the share of a limit that the path may take; 0 below it.
#[must_use]
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

    #[test]
    fn far_from_the_limits_nothing_changes() {
        let wanted = torques(1e3);
        assert_eq!(held(&wanted, &Matrix2::identity(), &Vector2::new(1.69, -1.0), &LIMIT).unwrap(), wanted);
        assert_eq!(demand(&Vector2::new(1.8, 0.0), &LIMIT), 0.0);
    }

    #[test]
    fn a_joint_never_exceeds_its_limit() {
        let A = Matrix2::new(2.0, 0.3, 0.3, 1.0);
        let (mut qdot, dt) = (Vector2::new(1.5, 0.0), 1e-3);
        for _ in 0..3000 {
            let given = held(&torques(40.0), &A, &qdot, &LIMIT).unwrap();
            qdot += Lu::new(A).unwrap().solve(&(given.path + given.rest + given.null)) * dt;
            qdot[1] *= 0.9;
            assert!(qdot[0] <= 0.99 * LIMIT[0], "{qdot}");
        }
        assert!(qdot[0] > 0.9 * LIMIT[0], "the null-space motion goes on: {qdot}");
    }

    #[test]
    fn the_null_space_goes_first() {
        let given = held(&torques(40.0), &Matrix2::identity(), &Vector2::new(1.9, 0.0), &LIMIT).unwrap();
        assert!(given.path == torques(0.0).path && given.rest == torques(0.0).rest, "{given:?}");
        let room = (MOST * LIMIT[0] - 1.9) / APPROACH_S;
        assert!((given.path[0] + given.null[0] - room).abs() < 1e-9, "{given:?}");
    }
}
