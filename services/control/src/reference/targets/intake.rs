//! The check of a target, and the twist that it asks for.

use crate::linear::{
    Matrix3, Vector3, Vector6, angular, linear, rotation_exp, rotation_log, rotation_of, stack,
};
use crate::types::Report;
use model::Pose;
use shared_types::TargetContent;
use shared_types::codes::{
    FRAME_BASE, FRAME_HAND, FRAME_SINGULAR, SIDE_POSITIVE, TARGET_END, TARGET_NONE, TARGET_POSE,
    TARGET_POSTURE, TARGET_REFUSAL_FRAME, TARGET_REFUSAL_JOINTS, TARGET_REFUSAL_KIND,
    TARGET_REFUSAL_NUMBER, TARGET_REFUSAL_RANGE, TARGET_REFUSAL_ROTATION, TARGET_REFUSAL_TIME,
    TARGET_TWIST, TARGET_UNREADABLE,
};
use shared_types::scenario::Servo;
use shared_types::target_file::NORM;
use shared_types::wire::Part;

/// Largest number in a target.
const LARGEST: f64 = 1000.0;
/// Farthest position, m: one in millimetres is farther.
const FARTHEST_M: f64 = 100.0;
/// Gain from a pose error to a twist, 1/s.
const GAIN: f64 = 5.0;
/// Share of the acceleration with which the reference is planned to stop at a pose.
const BRAKE: f64 = 0.5;

/// Whether a target can be followed by an arm of `dof` joints.
///
/// # Errors
/// One of `codes::TARGET_REFUSALS`.
pub fn check(target: &TargetContent, tick: u64, dof: usize) -> Result<(), u32> {
    let TargetContent {
        given_tick,
        valid_s,
        twist,
        position,
        quaternion,
        q,
        force,
        force_frame,
        kind,
        frame,
        side,
        joints,
        ..
    } = target;
    if *kind == TARGET_UNREADABLE || !target.is_finite() {
        return Err(TARGET_REFUSAL_NUMBER);
    }
    if *kind > TARGET_END || *side > SIDE_POSITIVE {
        return Err(TARGET_REFUSAL_KIND);
    }
    if *given_tick > tick || *valid_s < 0.0 {
        return Err(TARGET_REFUSAL_TIME);
    }
    let is_pressed_in = [FRAME_BASE, FRAME_HAND].contains(force_frame);
    if *frame > FRAME_SINGULAR || *kind == TARGET_POSE && *frame != FRAME_BASE || !is_pressed_in {
        return Err(TARGET_REFUSAL_FRAME);
    }
    if twist
        .iter()
        .chain(position)
        .chain(quaternion)
        .chain(q)
        .chain(force)
        .any(|x| x.abs() > LARGEST)
        || position.iter().any(|x| x.abs() > FARTHEST_M)
    {
        return Err(TARGET_REFUSAL_RANGE);
    }
    if *kind == TARGET_POSTURE && *joints as usize != dof {
        return Err(TARGET_REFUSAL_JOINTS);
    }
    let norm = quaternion.iter().map(|x| x * x).sum::<f64>();
    if *kind == TARGET_POSE && (norm - 1.0).abs() > NORM {
        Err(TARGET_REFUSAL_ROTATION)
    } else {
        Ok(())
    }
}

/// The motion that a target asks for at this moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// Twist of E within the session's speed, base axes; m/s, rad/s.
    pub V: Vector6,
    /// The same before that.
    pub asked: Vector6,
    /// Position of E that is asked for, m.
    pub p: Vector3,
    /// The pose asked for is this far from the reference; rotation vector, m and rad.
    pub off: Vector6,
    /// The target is older than its validity.
    pub stale: bool,
}

impl Wish {
    /// Nothing, in the pose `X`.
    pub fn rest(X: &Pose) -> Self {
        Self {
            p: X.p,
            ..Self::default()
        }
    }
}

/// The wish of a target at `tick`; a target of kind posture has no twist, the reference follows it joint by joint.
///
/// Frames: `X` is the reference's pose in B; the singular frame is that of the singularity nearest to its neighbourhood. Requires a target that
/// [`check`] accepts.
pub fn wish<const N: usize>(
    target: &TargetContent,
    age_s: f64,
    X: &Pose,
    report: &Report<N>,
    session: &Servo,
) -> Wish {
    let rest = Wish::rest(X);
    if age_s > target.valid_s {
        return Wish {
            stale: ![TARGET_NONE, TARGET_END].contains(&target.kind),
            ..rest
        };
    }
    let given = Vector6::from(target.twist);
    match target.kind {
        TARGET_TWIST => {
            let R = axes(target.frame, X, report);
            let asked = stack(&(R * linear(&given)), &(R * angular(&given)));
            Wish {
                V: bounded(&asked, session),
                asked,
                ..rest
            }
        }
        TARGET_POSE => {
            // It has moved on with its twist since it was given.
            let R = rotation_exp(&(angular(&given) * age_s)) * rotation_of(target.quaternion);
            let p = Vector3::from(target.position) + linear(&given) * age_s;
            let off = stack(&(p - X.p), &rotation_log(&(R * X.R.transpose())));
            let way = towards(&linear(&off), session.acceleration_m_s2);
            let turn = towards(&angular(&off), session.acceleration_rad_s2);
            let asked = given + stack(&way, &turn);
            Wish {
                V: bounded(&asked, session),
                asked,
                p,
                off,
                stale: false,
            }
        }
        TARGET_NONE | TARGET_END | TARGET_POSTURE => rest,
        _ => rest,
    }
}

/// The place of the singularity nearest to its neighbourhood, and |s|/η_out there.
pub fn nearest<const N: usize>(report: &Report<N>) -> Option<(usize, f64)> {
    let openness = report
        .listed()
        .iter()
        .map(|s| s.s.abs() / s.eta_out)
        .enumerate();
    openness.min_by(|a, b| a.1.total_cmp(&b.1))
}

fn axes<const N: usize>(frame: u32, X: &Pose, report: &Report<N>) -> Matrix3 {
    match (frame, nearest(report)) {
        (FRAME_HAND, _) => X.R,
        (FRAME_SINGULAR, Some((place, _))) => report.singularities[place].R_BS,
        _ => Matrix3::identity(),
    }
}

/// The speed at which an error is removed: proportional when small, and so that `acceleration` can stop it.
fn towards(error: &Vector3, acceleration: f64) -> Vector3 {
    let size = error.norm();
    if size < 1e-12 {
        Vector3::zeros()
    } else {
        error * (GAIN * size).min((2.0 * BRAKE * acceleration * size).sqrt()) / size
    }
}

/// A twist within the session's speed, its direction kept.
fn bounded(V: &Vector6, session: &Servo) -> Vector6 {
    let share = (linear(V).norm() / session.speed_m_s).max(angular(V).norm() / session.speed_rad_s);
    V / share.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::empty_report;

    fn pose() -> TargetContent {
        TargetContent {
            kind: TARGET_POSE,
            valid_s: 1.0,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            ..Default::default()
        }
    }

    #[test]
    fn a_target_that_cannot_be_followed_is_refused_by_its_reason() {
        type Spoil = fn(&mut TargetContent);
        assert_eq!(check(&pose(), 0, 6), Ok(()));
        let cases: [(Spoil, u32); 13] = [
            (
                |target| target.position[0] = f64::NAN,
                TARGET_REFUSAL_NUMBER,
            ),
            (
                |target| target.valid_s = f64::INFINITY,
                TARGET_REFUSAL_NUMBER,
            ),
            (|target| target.frame = FRAME_HAND, TARGET_REFUSAL_FRAME),
            (
                |target| (target.kind, target.frame) = (TARGET_TWIST, 7),
                TARGET_REFUSAL_FRAME,
            ),
            (
                |target| (target.kind, target.joints) = (TARGET_POSTURE, 5),
                TARGET_REFUSAL_JOINTS,
            ),
            (|target| target.force_frame = 2, TARGET_REFUSAL_FRAME),
            (|target| target.force[2] = 1e4, TARGET_REFUSAL_RANGE),
            (|target| target.kind = 77, TARGET_REFUSAL_KIND),
            (|target| target.side = 3, TARGET_REFUSAL_KIND),
            (|target| target.quaternion[1] = 1.0, TARGET_REFUSAL_ROTATION),
            (|target| target.given_tick = 4, TARGET_REFUSAL_TIME),
            (|target| target.valid_s = -1.0, TARGET_REFUSAL_TIME),
            (|target| target.twist = [1e6; 6], TARGET_REFUSAL_RANGE),
        ];
        for (spoil, refusal) in cases {
            let mut target = pose();
            spoil(&mut target);
            assert_eq!(check(&target, 3, 6), Err(refusal), "{target:?}");
        }
    }

    #[test]
    fn a_twist_keeps_its_direction_and_an_old_one_is_rest() {
        let session = Servo {
            speed_m_s: 0.5,
            speed_rad_s: 1.0,
            ..Servo::default()
        };
        let target = TargetContent {
            kind: TARGET_TWIST,
            valid_s: 0.2,
            twist: [3.0, 0.0, 4.0, 0.0, 0.0, 1.0],
            ..Default::default()
        };
        let wish = |age_s: f64| {
            wish(
                &target,
                age_s,
                &Pose::identity(),
                &empty_report::<6>(),
                &session,
            )
        };
        assert!((wish(0.1).V - Vector6::from(target.twist) * 0.1).amax() < 1e-12);
        assert!(wish(0.3).stale && wish(0.3).V == Vector6::zeros());
    }
}
