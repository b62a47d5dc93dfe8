//! The moving links, in axes that make the recursions short.

use crate::joint::{Joint, JointKind};
use crate::lanes::{PerJoint, Row, Space, V3, Vectors};
use crate::pose::Pose;
use crate::robot::Robot;
use crate::sines::sincos;
use crate::spatial::{Axes, LinkInertias};
use nalgebra::{Matrix3, Vector3};
use shared_types::MAX_DOF;

/// An arm's moving links and their joints. Places beyond the arm's own joints have links without mass that do not move.
///
/// A link's z axis is its joint's, its x axis is orthogonal to the next joint's, and its origin is the URDF's. From the parent's axes to a link's it takes a
/// constant turn about x, which makes z the joint's axis, and one about z by θ_0 + q: the rotations of Denavit and Hartenberg. Origins need not lie on
/// common normals, so that axes which are nearly parallel are no special case.
#[derive(Clone, Debug)]
pub(crate) struct Bodies<const N: usize> {
    /// The first joint's axes in the base, before it moves.
    base: Matrix3<f64>,
    /// Cosine and sine of the turn about the parent's x.
    cos_twist: PerJoint,
    sin_twist: PerJoint,
    /// A link's origin in the parent's x, and in y and z after the turn about x; at q = 0; m.
    p_0: Vectors,
    cos_0: PerJoint,
    sin_0: PerJoint,
    /// 1 where a joint turns, 0 where it does not.
    turns: PerJoint,
    /// 1 where a joint slides, 0 where it does not.
    slides: PerJoint,
    pub(crate) mass: PerJoint,
    /// Centre of mass, link axes, m.
    pub(crate) com: Vectors,
    /// Inertia about the centre of mass, link axes, kg·m².
    pub(crate) inertia: LinkInertias,
    /// The URDF's link axes in these.
    pub(crate) R_urdf: [Matrix3<f64>; N],
}

/// The links' axes and origins in one posture, in the base.
pub(crate) struct Frames<R: Row<N>, const N: usize> {
    pub(crate) axes: Axes<R>,
    pub(crate) p: V3<R>,
    /// The same, link by link.
    pub(crate) links: [Link<R::Space>; MAX_DOF],
}

/// One link's axes and origin in the base.
#[derive(Clone, Copy)]
pub(crate) struct Link<X> {
    pub(crate) x: X,
    pub(crate) y: X,
    pub(crate) z: X,
    pub(crate) p: X,
}

impl<X: Space> Link<X> {
    #[inline(always)]
    fn at(R: &Matrix3<f64>) -> Self {
        let axis = |k: usize| X::of([R[(0, k)], R[(1, k)], R[(2, k)]]);
        Self {
            x: axis(0),
            y: axis(1),
            z: axis(2),
            p: X::of([0.0; 3]),
        }
    }

    /// A pose in this frame, in the base.
    #[inline(always)]
    pub(crate) fn pose(&self, X_LE: &Pose) -> Pose {
        let turned = |[x, y, z]: [f64; 3]| self.x.times(x) + self.y.times(y) + self.z.times(z);
        let column = |k: usize| turned([X_LE.R[(0, k)], X_LE.R[(1, k)], X_LE.R[(2, k)]]).get();
        let p = turned([X_LE.p.x, X_LE.p.y, X_LE.p.z]) + self.p;
        Pose {
            R: Matrix3::from_columns(&[column(0), column(1), column(2)]),
            p: p.get(),
        }
    }
}

/// −1, 0 and 1 where rounding keeps a cosine or a sine from them.
fn exact(x: f64) -> f64 {
    if (x - x.round()).abs() < 1e-15 {
        x.round()
    } else {
        x
    }
}

impl<const N: usize> Bodies<N> {
    /// Requires 1 to `N` joints.
    pub(crate) fn new(robot: &Robot) -> Self {
        let joints = &robot.joints;
        // Our axes in the URDF's, link by link; an absent joint carries the last link's.
        let own: Vec<Matrix3<f64>> = (0..joints.len())
            .map(|i| link_axes(&joints[i], joints.get(i + 1)))
            .collect();
        let first = joints[0].X_PJ.R * own[0];
        let mut bodies = Self {
            base: first,
            cos_twist: PerJoint([1.0; MAX_DOF]),
            sin_twist: PerJoint::ZERO,
            p_0: Vectors::ZERO,
            cos_0: PerJoint([1.0; MAX_DOF]),
            sin_0: PerJoint::ZERO,
            turns: PerJoint::ZERO,
            slides: PerJoint::ZERO,
            mass: PerJoint::ZERO,
            com: Vectors::ZERO,
            inertia: LinkInertias::ZERO,
            R_urdf: std::array::from_fn(|i| own[i.min(own.len() - 1)].transpose()),
        };
        let mut parent = first;
        for (i, joint) in joints.iter().enumerate() {
            let to_parent = parent.transpose();
            let R = to_parent * joint.X_PJ.R * own[i];
            let (cos, sin) = (exact(R.m33), exact(-R.m23));
            (bodies.cos_twist.0[i], bodies.sin_twist.0[i]) = (cos, sin);
            (bodies.cos_0.0[i], bodies.sin_0.0[i]) = (exact(R.m11), exact(-R.m12));
            let p = to_parent * joint.X_PJ.p;
            bodies.p_0.set(
                i,
                &Vector3::new(p.x, cos * p.y + sin * p.z, cos * p.z - sin * p.y),
            );
            let slides = joint.kind == JointKind::Prismatic;
            (bodies.turns.0[i], bodies.slides.0[i]) = if slides { (0.0, 1.0) } else { (1.0, 0.0) };
            bodies.mass.0[i] = joint.mass;
            bodies.com.set(i, &(own[i].transpose() * joint.com));
            bodies
                .inertia
                .set(i, &(own[i].transpose() * joint.inertia * own[i]));
            parent = own[i];
        }
        bodies
    }

    /// Whether joints turn, as 1 or 0, and whether they slide.
    #[inline(always)]
    pub(crate) fn kinds<R: Row<N>>(&self) -> (R, R) {
        (R::load(&self.turns), R::load(&self.slides))
    }

    /// The links' frames at `q`, from the base outwards.
    ///
    /// With y' = y·cos α + z·sin α and z' = z·cos α − y·sin α after the turn about x, a link's axes are x·cos θ + y'·sin θ, y'·cos θ − x·sin θ and z'.
    /// The products of cosines and sines are those of all joints at once, before.
    #[inline(always)]
    pub(crate) fn outwards<R: Row<N>>(&self, q: R) -> Frames<R, N> {
        let (turns, slides) = self.kinds::<R>();
        let (sin, cos) = sincos(&(q * turns).store().0);
        let (s, c) = (R::load(&PerJoint(sin)), R::load(&PerJoint(cos)));
        let (s_0, c_0) = (R::load(&self.sin_0), R::load(&self.cos_0));
        let (s, c) = (s * c_0 + c * s_0, c * c_0 - s * s_0);
        let (cos_twist, sin_twist) = (R::load(&self.cos_twist), R::load(&self.sin_twist));
        let (p_y, p_z) = (R::load(&self.p_0.y), R::load(&self.p_0.z) + q * slides);
        let (sin, cos) = (s.store(), c.store());
        let [x_y, x_z] = [(s * cos_twist).store(), (s * sin_twist).store()];
        let [y_y, y_z] = [(c * cos_twist).store(), (c * sin_twist).store()];
        let [r_y, r_z] = [
            (p_y * cos_twist - p_z * sin_twist).store(),
            (p_y * sin_twist + p_z * cos_twist).store(),
        ];
        let mut link = Link::<R::Space>::at(&self.base);
        let mut links = [link; MAX_DOF];
        for (i, place) in links.iter_mut().enumerate().take(N) {
            let Link { x, y, z, p } = link;
            link = Link {
                x: (y.times(x_y.0[i]) + z.times(x_z.0[i])) + x.times(cos.0[i]),
                y: (y.times(y_y.0[i]) + z.times(y_z.0[i])) - x.times(sin.0[i]),
                z: z.times(self.cos_twist.0[i]) - y.times(self.sin_twist.0[i]),
                p: p + (x.times(self.p_0.x.0[i]) + (y.times(r_y.0[i]) + z.times(r_z.0[i]))),
            };
            *place = link;
        }
        let axes = Axes {
            x: R::rows(&links.map(|link| link.x)),
            y: R::rows(&links.map(|link| link.y)),
            z: R::rows(&links.map(|link| link.z)),
        };
        Frames {
            axes,
            p: R::rows(&links.map(|link| link.p)),
            links,
        }
    }
}

/// Our axes for a link, in the URDF's: z along its joint's axis, x orthogonal to the next joint's too.
fn link_axes(joint: &Joint, next: Option<&Joint>) -> Matrix3<f64> {
    let z = joint.axis;
    let across = next.map_or_else(Vector3::zeros, |next| z.cross(&(next.X_PJ.R * next.axis)));
    // Parallel to rounding: any x will do, and the coordinate axis farthest from z is taken.
    let across = if across.norm() < 1e-15 {
        coordinate_axis_across(&z)
    } else {
        across
    };
    let x = across.normalize();
    let x = (x - z * z.dot(&x)).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

fn coordinate_axis_across(z: &Vector3<f64>) -> Vector3<f64> {
    let mut e = Vector3::zeros();
    e[z.iamin()] = 1.0;
    e - z * z.dot(&e)
}
