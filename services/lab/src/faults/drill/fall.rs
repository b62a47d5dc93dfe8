//! How far an arm goes while one of its drives fails: the bound of the drill for such a fault, from the arm's own data.
//!
//! A joint without torque falls, A_jj(q) q̈_j = −g_j(q), while the other drives hold theirs; when its drive is back, that brakes it with its effort limit.
//! The fall begins at the highest speed that the joint has without a fault, in the worst of many postures within the joint limits. Friction is left
//! out: it would only shorten the fall.

use model::{JointKind, Model, Refused, Robot, with_dof};
use nalgebra::SVector;
use runtime::random;

use super::limits::Excursion;

/// The bound over the fall: other joints give way a little, and a torque that is stuck may push the joint where gravity would pull it back.
pub(super) const MARGIN: f64 = 1.1;

/// How many postures.
const POSTURES: u64 = 400;

/// Steps of the integration during the fault.
const STEPS: u32 = 50;

/// A drive that is weaker than gravity never stops its joint: the fall ends after so many times the length of the fault.
const LONGEST: u32 = 3;

/// Where a joint has no limits, its postures are within a turn.
const TURN: f64 = std::f64::consts::PI;

/// The fall of an arm whose drive of any one joint fails for `seconds`, and whose joints are at most so fast before; `frame` is its end-effector, the
/// robot's own where there is none.
///
/// # Errors
/// [`Refused`] where the arm has no model.
pub(super) fn fall(
    robot: &Robot,
    frame: Option<&str>,
    speed: &[f64],
    seconds: f64,
) -> Result<Excursion, Refused> {
    with_dof!(robot.dof(), N => sized::<N>(robot, frame, speed, seconds))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

fn sized<const N: usize>(
    robot: &Robot,
    frame: Option<&str>,
    speed: &[f64],
    seconds: f64,
) -> Result<Excursion, Refused> {
    let model = Model::<N>::new(robot, frame).map_err(Refused::because)?;
    let mut most = Excursion::NONE;
    for q in postures::<N>(robot) {
        let A = model.mass_matrix(&q);
        let J = model.jacobian(&q);
        for (joint, description) in robot.joints.iter().enumerate() {
            let along = dropped(
                &model,
                &q,
                joint,
                A[(joint, joint)],
                speed.get(joint).copied().unwrap_or_default(),
                seconds,
            );
            let hand = along * J.fixed_view::<3, 1>(0, joint).norm();
            most.hand_mm = most.hand_mm.max(1e3 * MARGIN * hand);
            if description.kind != JointKind::Prismatic {
                most.joint_rad = most.joint_rad.max(MARGIN * along);
            }
        }
    }
    Ok(most)
}

/// Postures within the joint limits, of which the worst counts.
pub(super) fn postures<const N: usize>(robot: &Robot) -> impl Iterator<Item = SVector<f64, N>> {
    let at = |posture: u64, joint: usize| {
        let Some(limits) = robot.joints.get(joint) else {
            return 0.0;
        };
        let (lower, upper) = (limits.lower.max(-TURN), limits.upper.min(TURN));
        let share = (random(posture, joint as u64) >> 11) as f64 / (1_u64 << 53) as f64;
        lower + (upper - lower) * share
    };
    (0..POSTURES).map(move |posture| SVector::from_fn(|joint, _| at(posture, joint)))
}

/// The way of one joint of inertia `A_jj` from a posture, in the direction in which gravity pulls it; rad or m.
fn dropped<const N: usize>(
    model: &Model<N>,
    from: &SVector<f64, N>,
    joint: usize,
    A_jj: f64,
    speed: f64,
    seconds: f64,
) -> f64 {
    let h = seconds / f64::from(STEPS);
    let pull = -model.gravity(from)[joint];
    let direction = if pull < 0.0 { -1.0 } else { 1.0 };
    let (mut q, mut v) = (*from, speed);
    for step in 0..LONGEST * STEPS {
        let along = -direction * model.gravity(&q)[joint];
        let brake = if step < STEPS {
            0.0
        } else {
            model.effort()[joint]
        };
        let a = (along - brake) / A_jj;
        let next = v + h * a;
        // It hangs, or has been stopped.
        if next <= 0.0 {
            break;
        }
        v = next;
        q[joint] += direction * h * v;
    }
    (q[joint] - from[joint]).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, speed: f64, seconds: f64) -> Excursion {
        let robot = Robot::builtin(name).unwrap();
        fall(&robot, None, &[speed; 8], seconds).unwrap()
    }

    #[test]
    fn an_arm_falls_as_its_own_weight_and_inertia_say() {
        let puma = of("puma560", 0.0, 0.5);
        // At the shoulder gravity is at most 46 N·m on 4.7 kg·m²: 1.2 rad in 0.5 s if it pulled with all of that all the way, and 1 m at the arm's reach.
        assert!(
            (0.6..1.5).contains(&puma.joint_rad) && (400.0..1_200.0).contains(&puma.hand_mm),
            "{puma:?}"
        );
        let [short, quick] = [of("puma560", 0.0, 0.1), of("puma560", 1.0, 0.5)];
        assert!(
            short.joint_rad < 0.2 * puma.joint_rad && quick.joint_rad > puma.joint_rad + 0.3,
            "{short:?} {quick:?}"
        );
        for name in Robot::builtin_names() {
            let fall = of(name, 0.0, 0.5);
            println!("{name}: {fall:?}");
            assert!(
                fall.joint_rad.is_finite() && fall.hand_mm.is_finite(),
                "{name}: {fall:?}"
            );
        }
    }

    #[test]
    fn without_weight_an_arm_only_goes_on_as_it_was() {
        let mut robot = Robot::builtin("puma560").unwrap();
        robot.joints.iter_mut().for_each(|joint| joint.mass = 0.0);
        let still = fall(&robot, None, &[0.0; 6], 0.5).unwrap();
        assert!(still.joint_rad < 1e-9, "{still:?}");
        let moving = fall(&robot, None, &[0.2; 6], 0.5).unwrap();
        assert!((0.1..0.2).contains(&moving.joint_rad), "{moving:?}");
    }
}
