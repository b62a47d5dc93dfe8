//! Spatial vectors, all in base axes and about the base origin.
//!
//! R. Featherstone, *Rigid Body Dynamics Algorithms* (2008), cited as RBDA. With every link in the same coordinates,
//! nothing is ever transformed from link to link: sums along the chain are plain sums.

use crate::lanes::{Pair, PerJoint, Vectors};
use nalgebra::{Matrix3, Vector3};

pub(crate) const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A·u, written out: nalgebra's general product is a call with loops, and this one is most of the work.
#[inline(always)]
pub(crate) fn times(A: &Matrix3<f64>, u: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(A.m11 * u.x + A.m12 * u.y + A.m13 * u.z, A.m21 * u.x + A.m22 * u.y + A.m23 * u.z, A.m31 * u.x + A.m32 * u.y + A.m33 * u.z)
}

#[inline(always)]
pub(crate) fn dot(u: &Vector3<Pair>, v: &Vector3<Pair>) -> Pair {
    u.x * v.x + u.y * v.y + u.z * v.z
}

/// Axes of two links in the base, which turn a link's vectors into the base's.
#[derive(Clone, Copy)]
pub(crate) struct Axes {
    pub(crate) x: Vector3<Pair>,
    pub(crate) y: Vector3<Pair>,
    pub(crate) z: Vector3<Pair>,
}

impl Axes {
    /// R·u.
    #[inline(always)]
    pub(crate) fn turn(&self, u: &Vector3<Pair>) -> Vector3<Pair> {
        self.x * u.x + self.y * u.y + self.z * u.z
    }
}

/// Symmetric 3×3 matrices of two links: six numbers each.
#[derive(Clone, Copy)]
pub(crate) struct Sym3 {
    pub(crate) xx: Pair,
    pub(crate) xy: Pair,
    pub(crate) xz: Pair,
    pub(crate) yy: Pair,
    pub(crate) yz: Pair,
    pub(crate) zz: Pair,
}

impl Sym3 {
    /// S + m(cᵀc·1 − ccᵀ): the parallel-axis theorem, h = m·c.
    #[inline(always)]
    pub(crate) fn shifted(&self, h: &Vector3<Pair>, c: &Vector3<Pair>) -> Self {
        let (x, y, z) = (h.x * c.x, h.y * c.y, h.z * c.z);
        Self {
            xx: self.xx + (y + z),
            xy: self.xy - h.x * c.y,
            xz: self.xz - h.x * c.z,
            yy: self.yy + (x + z),
            yz: self.yz - h.y * c.z,
            zz: self.zz + (x + y),
        }
    }

    #[inline(always)]
    pub(crate) fn times(&self, u: &Vector3<Pair>) -> Vector3<Pair> {
        Vector3::new(
            self.xx * u.x + self.xy * u.y + self.xz * u.z,
            self.xy * u.x + self.yy * u.y + self.yz * u.z,
            self.xz * u.x + self.yz * u.y + self.zz * u.z,
        )
    }
}

/// The inertias of links about their centres of mass, in link axes.
///
/// I = I_yy·1 + x·kᵀ + k·xᵀ + z·uᵀ + u·zᵀ with k = ((I_xx − I_yy)/2, I_xy, 0) and u = (I_xz, I_yz, (I_zz − I_yy)/2), which rotates at two thirds
/// of the cost of R·I·Rᵀ.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkInertias {
    I_yy: PerJoint,
    k_x: PerJoint,
    k_y: PerJoint,
    u: Vectors,
}

impl LinkInertias {
    pub(crate) const ZERO: Self = Self { I_yy: PerJoint::ZERO, k_x: PerJoint::ZERO, k_y: PerJoint::ZERO, u: Vectors::ZERO };

    pub(crate) fn set(&mut self, i: usize, I: &Matrix3<f64>) {
        self.I_yy.0[i] = I.m22;
        (self.k_x.0[i], self.k_y.0[i]) = (0.5 * (I.m11 - I.m22), I.m12);
        self.u.set(i, &Vector3::new(I.m13, I.m23, 0.5 * (I.m33 - I.m22)));
    }

    /// Those of pair `k`, with the links' axes at `R`.
    #[inline(always)]
    pub(crate) fn rotated(&self, k: usize, R: &Axes) -> Sym3 {
        let (Axes { x, y, z }, I_yy) = (R, self.I_yy.pair(k));
        let k_B = x * self.k_x.pair(k) + y * self.k_y.pair(k);
        let u = R.turn(&self.u.pair(k));
        let (xx, yy, zz) = (x.x * k_B.x + z.x * u.x, x.y * k_B.y + z.y * u.y, x.z * k_B.z + z.z * u.z);
        Sym3 {
            xx: I_yy + (xx + xx),
            xy: (x.x * k_B.y + k_B.x * x.y) + (u.x * z.y + u.y * z.x),
            xz: (x.x * k_B.z + k_B.x * x.z) + (u.x * z.z + u.z * z.x),
            yy: I_yy + (yy + yy),
            yz: (x.y * k_B.z + k_B.y * x.z) + (u.y * z.z + u.z * z.y),
            zz: I_yy + (zz + zz),
        }
    }
}

/// Motion vectors of two joints: angular part, and linear part of the body-fixed point that is now at the base origin.
#[derive(Clone, Copy)]
pub(crate) struct Motion {
    pub(crate) w: Vector3<Pair>,
    pub(crate) v: Vector3<Pair>,
}

impl Motion {
    /// Linear part at the point `p`: v + ω × p.
    #[inline(always)]
    pub(crate) fn at(&self, p: &Vector3<Pair>) -> Vector3<Pair> {
        self.v + self.w.cross(p)
    }

    /// Power s·f.
    #[inline(always)]
    pub(crate) fn dot(&self, f: &Force) -> Pair {
        dot(&self.w, &f.n) + dot(&self.v, &f.f)
    }
}

/// A motion vector per joint.
pub(crate) struct Motions {
    pub(crate) w: Vectors,
    pub(crate) v: Vectors,
}

impl Motions {
    pub(crate) const ZERO: Self = Self { w: Vectors::ZERO, v: Vectors::ZERO };

    #[inline(always)]
    pub(crate) fn pair(&self, k: usize) -> Motion {
        Motion { w: self.w.pair(k), v: self.v.pair(k) }
    }

    /// The same with its joints exchanged.
    #[inline(always)]
    pub(crate) fn swapped(&self, k: usize) -> Motion {
        Motion { w: self.w.swapped(k), v: self.v.swapped(k) }
    }
}

/// Force vectors on two links: moment about the base origin, and force.
#[derive(Clone, Copy)]
pub(crate) struct Force {
    pub(crate) n: Vector3<Pair>,
    pub(crate) f: Vector3<Pair>,
}

/// A force vector per link.
pub(crate) struct Forces {
    n: Vectors,
    f: Vectors,
}

impl Forces {
    pub(crate) const ZERO: Self = Self { n: Vectors::ZERO, f: Vectors::ZERO };

    #[inline(always)]
    pub(crate) fn pair(&self, k: usize) -> Force {
        Force { n: self.n.pair(k), f: self.f.pair(k) }
    }

    #[inline(always)]
    pub(crate) fn put(&mut self, k: usize, force: &Force) {
        self.n.put(k, &force.n);
        self.f.put(k, &force.f);
    }

    /// Of each link that on it and on all beyond it.
    #[inline(always)]
    pub(crate) fn summed_inwards<const N: usize>(&mut self) {
        self.n.summed_inwards::<N>();
        self.f.summed_inwards::<N>();
    }
}

/// The inertia of each link: mass, first moment h = m·c, and second moment about the base origin.
pub(crate) struct RigidInertias {
    m: PerJoint,
    pub(crate) h: Vectors,
    xx: PerJoint,
    xy: PerJoint,
    xz: PerJoint,
    yy: PerJoint,
    yz: PerJoint,
    zz: PerJoint,
}

impl RigidInertias {
    pub(crate) const ZERO: Self = Self {
        m: PerJoint::ZERO,
        h: Vectors::ZERO,
        xx: PerJoint::ZERO,
        xy: PerJoint::ZERO,
        xz: PerJoint::ZERO,
        yy: PerJoint::ZERO,
        yz: PerJoint::ZERO,
        zz: PerJoint::ZERO,
    };

    #[inline(always)]
    pub(crate) fn put(&mut self, k: usize, m: Pair, h: &Vector3<Pair>, I: &Sym3) {
        self.m.put(k, m);
        self.h.put(k, h);
        self.xx.put(k, I.xx);
        self.xy.put(k, I.xy);
        self.xz.put(k, I.xz);
        self.yy.put(k, I.yy);
        self.yz.put(k, I.yz);
        self.zz.put(k, I.zz);
    }

    /// Of each link that of the rigid body of it and all beyond it.
    #[inline(always)]
    pub(crate) fn summed_inwards<const N: usize>(&mut self) {
        self.m.summed_inwards::<N>();
        self.h.summed_inwards::<N>();
        for one in [&mut self.xx, &mut self.xy, &mut self.xz, &mut self.yy, &mut self.yz, &mut self.zz] {
            one.summed_inwards::<N>();
        }
    }

    /// Momentum I·v of pair `k` (RBDA Eq. 2.63).
    #[inline(always)]
    pub(crate) fn times(&self, k: usize, s: &Motion) -> Force {
        let (m, h) = (self.m.pair(k), self.h.pair(k));
        let I = Sym3 {
            xx: self.xx.pair(k),
            xy: self.xy.pair(k),
            xz: self.xz.pair(k),
            yy: self.yy.pair(k),
            yz: self.yz.pair(k),
            zz: self.zz.pair(k),
        };
        Force { n: I.times(&s.w) + h.cross(&s.v), f: s.v * m - h.cross(&s.w) }
    }
}
