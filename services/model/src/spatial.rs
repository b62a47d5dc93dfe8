//! Spatial vectors, all in base axes and about the base origin.
//!
//! R. Featherstone, *Rigid Body Dynamics Algorithms* (2008), cited as RBDA. With every link in the same coordinates,
//! nothing is ever transformed from link to link: sums along the chain are plain sums.

use crate::lanes::{Number, PerJoint, Row, V3, Vectors};
use nalgebra::{Matrix3, Vector3};

pub(crate) const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A·u, written out: nalgebra's general product is a call with loops, and this one is most of the work.
#[inline(always)]
pub(crate) fn times(A: &Matrix3<f64>, u: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        A.m11 * u.x + A.m12 * u.y + A.m13 * u.z,
        A.m21 * u.x + A.m22 * u.y + A.m23 * u.z,
        A.m31 * u.x + A.m32 * u.y + A.m33 * u.z,
    )
}

/// Axes of the links in the base, which turn a link's vectors into the base's.
#[derive(Clone, Copy)]
pub(crate) struct Axes<R> {
    pub(crate) x: V3<R>,
    pub(crate) y: V3<R>,
    pub(crate) z: V3<R>,
}

impl<R: Number> Axes<R> {
    /// R·u.
    #[inline(always)]
    pub(crate) fn turn(&self, u: V3<R>) -> V3<R> {
        self.x * u.x + self.y * u.y + self.z * u.z
    }
}

/// Symmetric 3×3 matrices of the links: six numbers each.
#[derive(Clone, Copy)]
pub(crate) struct Sym3<R> {
    pub(crate) xx: R,
    pub(crate) xy: R,
    pub(crate) xz: R,
    pub(crate) yy: R,
    pub(crate) yz: R,
    pub(crate) zz: R,
}

impl<R: Number> Sym3<R> {
    /// S + m(cᵀc·1 − ccᵀ): the parallel-axis theorem, h = m·c.
    #[inline(always)]
    pub(crate) fn shifted(&self, h: V3<R>, c: V3<R>) -> Self {
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
    pub(crate) fn times(&self, u: V3<R>) -> V3<R> {
        V3 {
            x: self.xx * u.x + self.xy * u.y + self.xz * u.z,
            y: self.xy * u.x + self.yy * u.y + self.yz * u.z,
            z: self.xz * u.x + self.yz * u.y + self.zz * u.z,
        }
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
    pub(crate) const ZERO: Self = Self {
        I_yy: PerJoint::ZERO,
        k_x: PerJoint::ZERO,
        k_y: PerJoint::ZERO,
        u: Vectors::ZERO,
    };

    pub(crate) fn set(&mut self, i: usize, I: &Matrix3<f64>) {
        self.I_yy.0[i] = I.m22;
        (self.k_x.0[i], self.k_y.0[i]) = (0.5 * (I.m11 - I.m22), I.m12);
        self.u
            .set(i, &Vector3::new(I.m13, I.m23, 0.5 * (I.m33 - I.m22)));
    }

    /// Those with the links' axes at `axes`.
    #[inline(always)]
    pub(crate) fn rotated<R: Row<N>, const N: usize>(&self, axes: &Axes<R>) -> Sym3<R> {
        let (Axes { x, y, z }, I_yy) = (axes, R::load(&self.I_yy));
        let k = *x * R::load(&self.k_x) + *y * R::load(&self.k_y);
        let u = axes.turn(V3::load(&self.u));
        let (xx, yy, zz) = (
            x.x * k.x + z.x * u.x,
            x.y * k.y + z.y * u.y,
            x.z * k.z + z.z * u.z,
        );
        Sym3 {
            xx: I_yy + (xx + xx),
            xy: (x.x * k.y + k.x * x.y) + (u.x * z.y + u.y * z.x),
            xz: (x.x * k.z + k.x * x.z) + (u.x * z.z + u.z * z.x),
            yy: I_yy + (yy + yy),
            yz: (x.y * k.z + k.y * x.z) + (u.y * z.z + u.z * z.y),
            zz: I_yy + (zz + zz),
        }
    }
}

/// Motion vectors of the joints: angular part, and linear part of the body-fixed point that is now at the base origin.
#[derive(Clone, Copy)]
pub(crate) struct Motions<R> {
    pub(crate) w: V3<R>,
    pub(crate) v: V3<R>,
}

impl<R: Number> Motions<R> {
    /// Linear part at the point `p`: v + ω × p.
    #[inline(always)]
    pub(crate) fn at(&self, p: V3<R>) -> V3<R> {
        self.v + self.w.cross(p)
    }

    /// Power s·f.
    #[inline(always)]
    pub(crate) fn dot(&self, f: &Forces<R>) -> R {
        self.w.dot(f.n) + self.v.dot(f.f)
    }
}

/// Force vectors on the links: moment about the base origin, and force.
#[derive(Clone, Copy)]
pub(crate) struct Forces<R> {
    pub(crate) n: V3<R>,
    pub(crate) f: V3<R>,
}

impl<R> Forces<R> {
    /// Of each link that on it and on all beyond it.
    #[inline(always)]
    pub(crate) fn inwards<const N: usize>(self) -> Self
    where
        R: Row<N>,
    {
        Self {
            n: self.n.inwards(),
            f: self.f.inwards(),
        }
    }
}

/// The inertia of each link: mass, first moment h = m·c, and second moment about the base origin.
#[derive(Clone, Copy)]
pub(crate) struct RigidInertias<R> {
    pub(crate) m: R,
    pub(crate) h: V3<R>,
    pub(crate) I: Sym3<R>,
}

impl<R: Number> RigidInertias<R> {
    /// Of each link that of the rigid body of it and all beyond it.
    #[inline(always)]
    pub(crate) fn inwards<const N: usize>(self) -> Self
    where
        R: Row<N>,
    {
        let I = self.I;
        Self {
            m: self.m.inwards(),
            h: self.h.inwards(),
            I: Sym3 {
                xx: I.xx.inwards(),
                xy: I.xy.inwards(),
                xz: I.xz.inwards(),
                yy: I.yy.inwards(),
                yz: I.yz.inwards(),
                zz: I.zz.inwards(),
            },
        }
    }

    /// Momenta I·v (RBDA Eq. 2.63).
    #[inline(always)]
    pub(crate) fn times(&self, s: &Motions<R>) -> Forces<R> {
        Forces {
            n: self.I.times(s.w) + self.h.cross(s.v),
            f: s.v * self.m - self.h.cross(s.w),
        }
    }
}
