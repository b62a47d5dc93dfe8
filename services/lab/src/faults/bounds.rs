//! How far a fault may carry the arm off its path: absolute bounds, whatever a scenario allows itself. While a drive or an encoder fails the arm may go
//! as far as its own data say, if that is more, in the worst of many postures within the joint limits.
//!
//! * **A drive.** A joint without torque falls, A_jj(q) q̈_j = −g_j(q), while the other drives hold theirs; when its drive is back, that brakes it with
//!   its effort limit. The fall begins at the highest speed that the joint has without a fault. Friction is left out: it would only shorten the fall.
//! * **An encoder.** The drives refuse torque as soon as a reading is further from their own sensors than the encoders' tolerance e. Until then the
//!   controller may push the joint with all its torque, v² = v₀² + 2 e τ_max / A_jj(q), but not beyond its speed limit. The last torque is held for at
//!   most 5 ms; then the stop law lets the speed fall as exp(−k t): the way is e + v (5 ms + 1/k). Where a joint has no limit of torque, v₀ stands for
//!   v. The other joints are stopped with it, each v₀ (5 ms + 1/k) off the path at most.
//!
//! Most faults stay far below: on `fig5-wrist-rotation` a killed process moves no joint by more than 2 mrad, and a drifting encoder by 25 mrad.

use model::{JointKind, Model, Refused, Robot};
use nalgebra::SVector;
use runtime::random;
use shared_types::MAX_DOF;
use shared_types::fault::{Fault, Kind};
use shared_types::scenario::Scenario;
use sim::{Encoders, STOP_GAIN};

/// One size for every arm: no time is measured here.
type Arm = Model<MAX_DOF>;
type Joints = SVector<f64, MAX_DOF>;

/// Age of a torque in force; ms.
pub(super) const STALE_MS: f64 = 5.0;

/// From the fault until the drives follow the controller again, or the arm is at rest; ms.
pub(super) const REST_MS: f64 = 1_500.0;

/// Under an ordinary fault: of a joint, rad; of the end-effector, mm.
pub(super) const ORDINARY: [f64; 2] = [0.2, 100.0];

/// The bound over the computed way: other joints give way a little, and a torque that is stuck may push the joint where gravity would pull it back.
const MARGIN: f64 = 1.1;

/// How many postures.
const POSTURES: u64 = 400;

/// Steps of the integration during the fault.
const STEPS: u32 = 50;

/// A drive that is weaker than gravity never stops its joint: the fall ends after so many times the length of the fault.
const LONGEST: u32 = 3;

/// Where a joint has no limits, its postures are within a turn.
const TURN: f64 = std::f64::consts::PI;

/// How far a fault may carry a joint, rad, and the end-effector, mm, of an arm whose joints are at most so fast without it, rad/s.
///
/// # Errors
/// [`Refused`] where the arm has no model.
pub(super) fn allowed(
    robot: &Robot,
    scenario: &Scenario,
    speed: &[f64],
    fault: &Fault,
) -> Result<[f64; 2], Refused> {
    let model = Model::new(robot, scenario.frame()).map_err(Refused::because)?;
    let mut most = ORDINARY;
    let mut take = |joint: usize, along: f64, hand_m: f64| {
        if robot.joints[joint].kind != JointKind::Prismatic {
            most[0] = most[0].max(MARGIN * along);
        }
        most[1] = most[1].max(1e3 * MARGIN * hand_m);
    };
    match fault.kind {
        Kind::Drive => {
            let length = fault
                .for_ticks
                .map(|ticks| ticks as f64 / f64::from(scenario.rate_hz));
            let seconds = length.unwrap_or(fault.kind.usual_length_s());
            for (q, A, levers) in postures(&model, robot) {
                for joint in 0..robot.dof() {
                    let along = fall(&model, &q, joint, A[joint], speed[joint], seconds);
                    take(joint, along, along * levers[joint]);
                }
            }
        }
        Kind::Sensor => misled(&model, robot, scenario, speed, &mut take),
        _ => {}
    }
    Ok(most)
}

/// The ways of joint and end-effector while an encoder reads wrong, joint by joint.
fn misled(
    model: &Arm,
    robot: &Robot,
    scenario: &Scenario,
    speed: &[f64],
    take: &mut impl FnMut(usize, f64, f64),
) {
    let plant = &scenario.plant;
    let encoders = Encoders::<MAX_DOF>::new(
        robot,
        plant.encoder_bits,
        plant.encoder_noise_counts,
        scenario.seed,
    );
    let start = (SVector::repeat(f64::INFINITY), SVector::zeros());
    let (inertia, levers): (Joints, Joints) = postures(model, robot)
        .fold(start, |(least, most), (_, A, levers)| {
            (least.inf(&A), most.sup(&levers))
        });
    let stop_s = 1e-3 * STALE_MS + 1.0 / STOP_GAIN;
    let stopped_m: f64 = (0..MAX_DOF)
        .map(|joint| speed[joint] * stop_s * levers[joint])
        .sum();
    for joint in 0..robot.dof() {
        let (before, error) = (speed[joint], encoders.tolerance()[joint]);
        let push = model.effort()[joint] / inertia[joint];
        let pushed = if push.is_finite() {
            (before.powi(2) + 2.0 * error * push).sqrt()
        } else {
            before
        };
        let way = error + pushed.min(model.velocity()[joint]).max(before) * stop_s;
        take(
            joint,
            way,
            stopped_m + (way - before * stop_s) * levers[joint],
        );
    }
}

/// Postures within the joint limits, each with the joints' inertias and the end-effector's levers on them.
fn postures(model: &Arm, robot: &Robot) -> impl Iterator<Item = (Joints, Joints, Joints)> {
    let at = |posture: u64, joint: usize| {
        // The model is filled up with joints that do not exist.
        let Some(limits) = robot.joints.get(joint) else {
            return 0.0;
        };
        let (lower, upper) = (limits.lower.max(-TURN), limits.upper.min(TURN));
        let share = (random(posture, joint as u64) >> 11) as f64 / (1_u64 << 53) as f64;
        lower + (upper - lower) * share
    };
    (0..POSTURES).map(move |posture| {
        let q = SVector::from_fn(|joint, _| at(posture, joint));
        let J = model.jacobian(&q);
        let levers = SVector::from_fn(|joint, _| J.fixed_view::<3, 1>(0, joint).norm());
        (q, model.mass_matrix(&q).diagonal(), levers)
    })
}

/// The way of one joint of inertia `A_jj` from a posture, in the direction in which gravity pulls it; rad or m.
fn fall(model: &Arm, from: &Joints, joint: usize, A_jj: f64, speed: f64, seconds: f64) -> f64 {
    let h = seconds / f64::from(STEPS);
    let direction = if model.gravity(from)[joint] > 0.0 {
        -1.0
    } else {
        1.0
    };
    let (mut q, mut v) = (*from, speed);
    for step in 0..LONGEST * STEPS {
        let brake = if step < STEPS {
            0.0
        } else {
            model.effort()[joint]
        };
        v += h * (-direction * model.gravity(&q)[joint] - brake) / A_jj;
        // It hangs, or has been stopped.
        if v <= 0.0 {
            break;
        }
        q[joint] += direction * h * v;
    }
    (q[joint] - from[joint]).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, kind: Kind, speed: f64, change: impl Fn(&mut Robot)) -> [f64; 2] {
        let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap();
        let mut robot = Robot::builtin(&scenario.robot).unwrap();
        change(&mut robot);
        let fault = Fault {
            for_ticks: Some(500),
            ..Fault::new("plant", kind)
        };
        allowed(&robot, &scenario, &[speed; 8], &fault).unwrap()
    }

    #[test]
    fn an_arm_falls_as_its_own_weight_and_inertia_say() {
        let name = "fig5-wrist-rotation";
        // At the shoulder gravity is at most 46 N·m on 4.7 kg·m²: 1.2 rad in 0.5 s if it pulled with all of that all the way, and 1 m at the arm's reach.
        let [joint, hand] = of(name, Kind::Drive, 0.0, |_| ());
        assert!(
            (0.6..1.5).contains(&joint) && (400.0..1_200.0).contains(&hand),
            "{joint} {hand}"
        );
        assert!(of(name, Kind::Drive, 1.0, |_| ())[0] > joint + 0.3);
        // Without weight it goes on as it was, for half a second.
        let weightless =
            |robot: &mut Robot| robot.joints.iter_mut().for_each(|joint| joint.mass = 0.0);
        assert_eq!(of(name, Kind::Drive, 0.0, weightless)[0], ORDINARY[0]);
        assert!((0.5..0.6).contains(&of(name, Kind::Drive, 1.0, weightless)[0]));
    }

    #[test]
    fn a_misled_joint_goes_no_further_than_its_torque_and_its_speed_limit_drive_it() {
        for name in sim::scenarios::names() {
            for kind in [Kind::Drive, Kind::Sensor, Kind::Kill] {
                let [joint, hand] = of(name, kind, 0.0, |_| ());
                assert!(
                    joint.is_finite() && hand.is_finite() && (kind != Kind::Sensor || joint < 0.6),
                    "{name} {kind}"
                );
            }
        }
        // Neither torque nor speed has a limit there: 0.03 rad, and 55 ms of the speed before.
        let moving = of("fig1-pseudo-inverse", Kind::Sensor, 6.0, |_| ())[0];
        assert!(
            (moving - MARGIN * (0.03 + 6.0 * 0.055)).abs() < 1e-12,
            "{moving}"
        );
    }
}
