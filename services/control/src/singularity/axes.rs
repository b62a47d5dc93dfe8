//! Geometry of an arm's axes: where they meet, and the frames along singular directions.

use crate::linear::{Joints, Matrix3, Vector3};
use model::{JointKind, Model, Robot, Terms};

/// Sine of an angle, or distance in m, that counts as none.
pub(super) const EXACT: f64 = 1e-6;

/// The same where a description rounds a right angle to 1.5708; far below encoder noise times an arm's length.
pub(super) const ROUNDED: f64 = 3e-5;

/// Sine of the angle above which axes cross.
const CROSS: f64 = 0.1;

/// The shoulder's centre S, where the waist axis meets the shoulder axis, base axes, m: fixed in the base.
pub(super) fn shoulder<const N: usize>(terms: &Terms<N>) -> Vector3 {
    terms.p[0] + terms.z[0] * (terms.p[1] - terms.p[0]).dot(&terms.z[0])
}

/// The place at which the last two axes meet within `tolerance` (m), as a distance along the last one, m; and whether the third last passes there too (six joints or
/// more).
pub(super) fn meeting<const N: usize>(terms: &Terms<N>, tolerance: f64) -> (Option<f64>, bool) {
    if N < 2 {
        return (None, false);
    }
    let (z, p) = (terms.z, terms.p);
    let normal = z[N - 2].cross(&z[N - 1]);
    let between = p[N - 2] - p[N - 1];
    let size = normal.norm_squared();
    if size < CROSS * CROSS || (between.dot(&normal) / size.sqrt()).abs() > tolerance {
        return (None, false);
    }
    let offset = between.cross(&z[N - 2]).dot(&-normal) / size;
    let C = p[N - 1] + z[N - 1] * offset;
    let spherical = N >= 6
        && (C - p[N - 3]).cross(&z[N - 3]).norm() < tolerance
        && z[N - 3].cross(&z[N - 2]).norm() > CROSS;
    (Some(offset), spherical)
}

/// Where axes 1, 2, 3 meet, base axes, m: fixed in the base. `None` where they do not, within `tolerance` (m).
pub(super) fn three_meet<const N: usize>(terms: &Terms<N>, tolerance: f64) -> Option<Vector3> {
    if N < 3 {
        return None;
    }
    let (z, p) = (&terms.z, &terms.p);
    let across = z[0].cross(&z[1]);
    let along = (p[1] - p[0]).cross(&z[1]).dot(&across) / across.norm_squared().max(EXACT);
    let S = p[0] + z[0] * along;
    let passes = |i: usize| (S - p[i]).cross(&z[i]).norm() < tolerance;
    (passes(1) && passes(2)).then_some(S)
}

/// The result of `recognise` for an arm of revolute joints with a full task, if it is the same in three postures in general position: a property that
/// holds there holds everywhere.
pub(super) fn in_general_position<const N: usize, T: Copy>(
    robot: &Robot,
    recognise: impl Fn(&Terms<N>) -> Option<T>,
    same: impl Fn(&T, &T) -> bool,
) -> Option<T> {
    if robot
        .joints
        .iter()
        .any(|joint| joint.kind == JointKind::Prismatic)
        || !robot.task.is_full()
    {
        return None;
    }
    let model = Model::<N>::new(robot, None).ok()?;
    let mut found = None;
    for k in 0..3 {
        let q = Joints::from_fn(|i, _| 0.3 + (0.37 + 0.21 * f64::from(k)) * i as f64);
        let one = recognise(&model.evaluate(&q, &Joints::zeros()))?;
        if !same(&one, found.get_or_insert(one)) {
            return None;
        }
    }
    found
}

/// A right-handed frame with x along `zeta`, a unit vector, and y as near `towards` as it can be.
pub(super) fn frame(zeta: &Vector3, towards: &Vector3) -> Matrix3 {
    let y = towards - zeta * zeta.dot(towards);
    let y = if y.norm() > 1e-9 {
        y.normalize()
    } else {
        let farthest = Vector3::ith(zeta.iamin(), 1.0);
        zeta.cross(&farthest).normalize()
    };
    Matrix3::from_columns(&[*zeta, y, zeta.cross(&y)])
}
