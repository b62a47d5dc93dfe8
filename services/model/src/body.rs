//! A moving link in axes that make the recursions short.

use crate::joint::Joint;
use crate::pose::Pose;
use crate::spatial::{LinkInertia, Motion, RigidInertia, times};
use nalgebra::{Matrix3, Vector3};

/// The motion of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moves {
    /// Turns about its axis.
    Turns,
    /// Slides along its axis.
    Slides,
    /// No motion: the place of a joint that the arm does not have.
    Absent,
}

/// A moving link and its joint, in [axes](body_axes) chosen to make the work short.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    /// This link's axes in the parent link's, at q = 0.
    pub(crate) R_0: Matrix3<f64>,
    /// This link's origin in the parent link's axes, at q = 0, m.
    pub(crate) p_0: Vector3<f64>,
    pub(crate) moves: Moves,
    pub(crate) mass: f64,
    /// Centre of mass, link axes, m.
    pub(crate) com: Vector3<f64>,
    /// Inertia about the centre of mass, link axes, kg·m².
    pub(crate) inertia: LinkInertia,
    /// The URDF's link axes in these.
    pub(crate) R_urdf: Matrix3<f64>,
}

impl Body {
    /// The place of a joint that the arm does not have, beyond a link with the URDF axes `R_urdf`.
    pub(crate) fn absent(R_urdf: Matrix3<f64>) -> Self {
        let (zero, none) = (Vector3::zeros(), Matrix3::zeros());
        let inertia = LinkInertia::new(&none);
        Self { R_0: Matrix3::identity(), p_0: zero, moves: Moves::Absent, mass: 0.0, com: zero, inertia, R_urdf }
    }

    /// From the parent link's pose in the base to this link's, and the joint's motion axis there.
    #[inline(always)]
    pub(crate) fn step(&self, X: &mut Pose, q: f64) -> Motion {
        if self.moves == Moves::Absent {
            return Motion::ZERO;
        }
        X.p += times(&X.R, &self.p_0);
        let x = times(&X.R, &column(&self.R_0, 0));
        let y = times(&X.R, &column(&self.R_0, 1));
        let z = times(&X.R, &column(&self.R_0, 2));
        if self.moves == Moves::Slides {
            X.p += z * q;
            X.R = Matrix3::from_columns(&[x, y, z]);
            Motion::along(z)
        } else {
            let (s, c) = libm::sincos(q);
            X.R = Matrix3::from_columns(&[x * c + y * s, y * c - x * s, z]);
            Motion::about(z, &X.p)
        }
    }

    /// Inertia about the base origin, with the link at `X`.
    #[inline(always)]
    pub(crate) fn inertia_at(&self, X: &Pose) -> RigidInertia {
        let c = X.transform_point(&self.com);
        let I = self.inertia.rotated(&X.R).shifted(self.mass, &c);
        RigidInertia { m: self.mass, h: self.mass * c, I }
    }
}

#[inline(always)]
pub(crate) fn column(A: &Matrix3<f64>, k: usize) -> Vector3<f64> {
    Vector3::new(A[(0, k)], A[(1, k)], A[(2, k)])
}

/// Our axes for a link, in the URDF's: z along the joint's axis, and x, y such that I_xy = 0.
pub(crate) fn body_axes(joint: &Joint) -> Matrix3<f64> {
    let R = z_to(&joint.axis);
    let I = R.transpose() * joint.inertia * R;
    if I.m12 == 0.0 {
        return R;
    }
    let (s, c) = libm::sincos(0.5 * libm::atan2(2.0 * I.m12, I.m11 - I.m22));
    R * Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// A rotation whose z axis is the unit vector `axis`; exact for the coordinate axes.
fn z_to(axis: &Vector3<f64>) -> Matrix3<f64> {
    if axis.x == 0.0 && axis.y == 0.0 && axis.z > 0.0 {
        return Matrix3::identity();
    }
    // x: the coordinate axis farthest from `axis`, made orthogonal to it.
    let mut e = Vector3::zeros();
    e[axis.iamin()] = 1.0;
    let x = (e - axis * axis.dot(&e)).normalize();
    Matrix3::from_columns(&[x, axis.cross(&x), *axis])
}
