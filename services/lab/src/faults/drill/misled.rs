//! How far an arm goes while one of its encoders reads wrong: the bound of the drill for such a fault, from the arm's own data.
//!
//! The drives refuse torque as soon as a reading is further from their own sensors than the encoders' tolerance e. Until then the controller may push the
//! joint with all its torque, v² = v₀² + 2 e τ_max / A_jj(q), but not beyond its speed limit. The last torque is held for at most 5 ms; then the stop law
//! lets the speed fall as exp(−k t): the way is e + v (5 ms + 1/k). v₀ is the highest speed that the joint has without a fault, and A_jj the least of many
//! postures. Where a joint has no limit of torque, v₀ stands for v. The other joints are stopped with it, each v₀ (5 ms + 1/k) off the path at most, and
//! the end-effector goes as far as all of them carry it.

use model::{JointKind, Model, Refused, Robot, with_dof};
use nalgebra::SVector;
use shared_types::scenario::Scenario;
use sim::{Encoders, STOP_GAIN};

use super::fall::{MARGIN, postures};
use super::limits::{Excursion, STALE_MS};

/// The way of an arm of which any one encoder reads wrong, and whose joints are at most so fast before; rad/s.
///
/// # Errors
/// [`Refused`] where the arm has no model.
pub(super) fn misled(
    robot: &Robot,
    scenario: &Scenario,
    speed: &[f64],
) -> Result<Excursion, Refused> {
    with_dof!(robot.dof(), N => sized::<N>(robot, scenario, speed))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

fn sized<const N: usize>(
    robot: &Robot,
    scenario: &Scenario,
    speed: &[f64],
) -> Result<Excursion, Refused> {
    let model = Model::<N>::new(robot, scenario.frame()).map_err(Refused::because)?;
    let encoders = Encoders::<N>::new(
        robot,
        scenario.plant.encoder_bits,
        scenario.plant.encoder_noise_counts,
        scenario.seed,
    );
    let (mut inertia, mut lever) = (
        SVector::<f64, N>::repeat(f64::INFINITY),
        SVector::<f64, N>::zeros(),
    );
    for q in postures::<N>(robot) {
        let (A, J) = (model.mass_matrix(&q), model.jacobian(&q));
        for joint in 0..N {
            inertia[joint] = inertia[joint].min(A[(joint, joint)]);
            lever[joint] = lever[joint].max(J.fixed_view::<3, 1>(0, joint).norm());
        }
    }
    let stop_s = 1e-3 * STALE_MS + 1.0 / STOP_GAIN;
    let before = |joint: usize| speed.get(joint).copied().unwrap_or_default();
    let stopped_m: f64 = (0..N)
        .map(|joint| before(joint) * stop_s * lever[joint])
        .sum();
    let mut most = Excursion::NONE;
    for (joint, description) in robot.joints.iter().enumerate() {
        let (error, push) = (
            encoders.tolerance()[joint],
            model.effort()[joint] / inertia[joint],
        );
        let pushed = if push.is_finite() {
            (before(joint).powi(2) + 2.0 * error * push).sqrt()
        } else {
            before(joint)
        };
        let fastest = pushed.min(model.velocity()[joint]).max(before(joint));
        let way = error + fastest * stop_s;
        let hand_m = stopped_m + (way - before(joint) * stop_s) * lever[joint];
        let joint_rad = if description.kind == JointKind::Prismatic {
            0.0
        } else {
            MARGIN * way
        };
        most = most.or(Excursion {
            joint_rad,
            hand_mm: 1e3 * MARGIN * hand_m,
        });
    }
    Ok(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, speed: f64) -> Excursion {
        let text = sim::scenarios::text(name).unwrap();
        let scenario = Scenario::parse(name, text, &[]).unwrap();
        misled(
            &Robot::builtin(&scenario.robot).unwrap(),
            &scenario,
            &[speed; 8],
        )
        .unwrap()
    }

    #[test]
    fn a_joint_goes_no_further_than_its_torque_and_its_speed_limit_drive_it() {
        for name in sim::scenarios::names() {
            let way = of(name, 0.0);
            println!("{name}: {way:?}");
            assert!(
                (0.03..0.6).contains(&way.joint_rad)
                    && way.hand_mm > 0.0
                    && way.hand_mm.is_finite(),
                "{name}: {way:?}"
            );
        }
        // Neither torque nor speed has a limit there: 0.03 rad, and 55 ms of the speed before.
        let [rest, moving] = [0.0, 3.0].map(|speed| of("fig1-pseudo-inverse", speed).joint_rad);
        assert!(
            (rest - MARGIN * 0.03).abs() < 1e-12
                && (moving - MARGIN * (0.03 + 3.0 * 0.055)).abs() < 1e-12,
            "{rest} {moving}"
        );
    }
}
