//! The moving links, in axes that make the recursions short.

use crate::joint::{Joint, JointKind};
use crate::lanes::{Pair, PerJoint, Vectors, pairs, sincos};
use crate::pose::Pose;
use crate::robot::Robot;
use crate::spatial::{Axes, LinkInertias, ORIGIN};
use nalgebra::{Matrix3, SVector, Vector3};
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
    twist: [(f64, f64); N],
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
pub(crate) struct Frames {
    x: Vectors,
    y: Vectors,
    pub(crate) z: Vectors,
    pub(crate) p: Vectors,
    /// Of a link's origin, from the parent's.
    pub(crate) r: Vectors,
}

impl Frames {
    pub(crate) const ZERO: Self = Self { x: Vectors::ZERO, y: Vectors::ZERO, z: Vectors::ZERO, p: Vectors::ZERO, r: Vectors::ZERO };

    /// A link's pose in the base.
    #[inline(always)]
    pub(crate) fn pose(&self, i: usize) -> Pose {
        Pose { R: Matrix3::from_columns(&[self.x.get(i), self.y.get(i), self.z.get(i)]), p: self.p.get(i) }
    }

    #[inline(always)]
    pub(crate) fn axes(&self, k: usize) -> Axes {
        Axes { x: self.x.pair(k), y: self.y.pair(k), z: self.z.pair(k) }
    }
}

/// One link's axes and origin in the base, and its origin from the parent's.
#[derive(Clone, Copy)]
struct Link {
    x: Vector3<f64>,
    y: Vector3<f64>,
    z: Vector3<f64>,
    p: Vector3<f64>,
    r: Vector3<f64>,
}

impl Link {
    const NONE: Self = Self { x: ORIGIN, y: ORIGIN, z: ORIGIN, p: ORIGIN, r: ORIGIN };

    /// The next link: turned about x, moved by `offset` along x and the new y and z, then turned about z. Turns are cosine and sine, and sine and cosine.
    #[inline(always)]
    fn next(&self, (cos_twist, sin_twist): (f64, f64), offset: [f64; 3], (s, c): (f64, f64)) -> Self {
        let Self { x, y, z, p, .. } = self;
        let (y, z) = (y * cos_twist + z * sin_twist, z * cos_twist - y * sin_twist);
        let r = x * offset[0] + y * offset[1] + z * offset[2];
        Self { x: x * c + y * s, y: y * c - x * s, z, p: p + r, r }
    }
}

/// −1, 0 and 1 where rounding keeps a cosine or a sine from them.
fn exact(x: f64) -> f64 {
    if (x - x.round()).abs() < 1e-15 { x.round() } else { x }
}

impl<const N: usize> Bodies<N> {
    /// Requires 1 to `N` joints.
    pub(crate) fn new(robot: &Robot) -> Self {
        let joints = &robot.joints;
        // Our axes in the URDF's, link by link; an absent joint carries the last link's.
        let own: Vec<Matrix3<f64>> = (0..joints.len()).map(|i| link_axes(&joints[i], joints.get(i + 1))).collect();
        let first = joints[0].X_PJ.R * own[0];
        let mut bodies = Self {
            base: first,
            twist: [(1.0, 0.0); N],
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
            bodies.twist[i] = (cos, sin);
            (bodies.cos_0.0[i], bodies.sin_0.0[i]) = (exact(R.m11), exact(-R.m12));
            let p = to_parent * joint.X_PJ.p;
            bodies.p_0.set(i, &Vector3::new(p.x, cos * p.y + sin * p.z, cos * p.z - sin * p.y));
            let slides = joint.kind == JointKind::Prismatic;
            (bodies.turns.0[i], bodies.slides.0[i]) = if slides { (0.0, 1.0) } else { (1.0, 0.0) };
            bodies.mass.0[i] = joint.mass;
            bodies.com.set(i, &(own[i].transpose() * joint.com));
            bodies.inertia.set(i, &(own[i].transpose() * joint.inertia * own[i]));
            parent = own[i];
        }
        bodies
    }

    /// Whether the joints of pair `k` turn, as 1 or 0, and whether they slide.
    #[inline(always)]
    pub(crate) fn kinds(&self, k: usize) -> (Pair, Pair) {
        (self.turns.pair(k), self.slides.pair(k))
    }

    /// Link i, from the one before it, with the joints turned (sine and cosine) and origins moved along z.
    #[inline(always)]
    fn beyond(&self, link: &Link, i: usize, (sin, cos): &(PerJoint, PerJoint), along: &PerJoint) -> Link {
        link.next(self.twist[i], [self.p_0.x.0[i], self.p_0.y.0[i], along.0[i]], (sin.0[i], cos.0[i]))
    }

    /// The links' frames at `q`, from the base outwards.
    #[inline(always)]
    pub(crate) fn outwards(&self, q: &SVector<f64, N>, frames: &mut Frames) {
        let q = PerJoint::of(q);
        let (mut turned, mut along) = ((PerJoint::ZERO, PerJoint::ZERO), PerJoint::ZERO);
        for k in pairs::<N>() {
            let (s, c) = sincos(q.pair(k) * self.turns.pair(k));
            let (s_0, c_0) = (self.sin_0.pair(k), self.cos_0.pair(k));
            turned.0.put(k, s * c_0 + c * s_0);
            turned.1.put(k, c * c_0 - s * s_0);
            along.put(k, self.p_0.z.pair(k) + q.pair(k) * self.slides.pair(k));
        }
        let mut link = Link { x: column(&self.base, 0), y: column(&self.base, 1), z: column(&self.base, 2), p: ORIGIN, r: ORIGIN };
        for k in pairs::<N>() {
            let first = self.beyond(&link, 2 * k, &turned, &along);
            let second = if 2 * k + 1 < N { self.beyond(&first, 2 * k + 1, &turned, &along) } else { Link::NONE };
            frames.x.put_each(k, [&first.x, &second.x]);
            frames.y.put_each(k, [&first.y, &second.y]);
            frames.z.put_each(k, [&first.z, &second.z]);
            frames.p.put_each(k, [&first.p, &second.p]);
            frames.r.put_each(k, [&first.r, &second.r]);
            link = second;
        }
    }
}

#[inline(always)]
pub(crate) fn column(A: &Matrix3<f64>, k: usize) -> Vector3<f64> {
    Vector3::new(A[(0, k)], A[(1, k)], A[(2, k)])
}

/// Our axes for a link, in the URDF's: z along its joint's axis, x orthogonal to the next joint's too.
fn link_axes(joint: &Joint, next: Option<&Joint>) -> Matrix3<f64> {
    let z = joint.axis;
    let across = next.map_or_else(Vector3::zeros, |next| z.cross(&(next.X_PJ.R * next.axis)));
    // Parallel to rounding: any x will do, and the coordinate axis farthest from z is taken.
    let across = if across.norm() < 1e-15 { coordinate_axis_across(&z) } else { across };
    let x = across.normalize();
    let x = (x - z * z.dot(&x)).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

fn coordinate_axis_across(z: &Vector3<f64>) -> Vector3<f64> {
    let mut e = Vector3::zeros();
    e[z.iamin()] = 1.0;
    e - z * z.dot(&e)
}
