//! Spatial vectors, all in base axes and about the base origin.
//!
//! R. Featherstone, *Rigid Body Dynamics Algorithms* (2008), cited as RBDA. With every link in the same coordinates,
//! nothing is ever transformed from link to link: sums along the chain are plain sums.

use nalgebra::{Matrix3, Vector3};

pub(crate) const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A·u, written out: nalgebra's general product is a call with loops, and this one is most of the work.
#[inline(always)]
pub(crate) fn times(A: &Matrix3<f64>, u: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(A.m11 * u.x + A.m12 * u.y + A.m13 * u.z, A.m21 * u.x + A.m22 * u.y + A.m23 * u.z, A.m31 * u.x + A.m32 * u.y + A.m33 * u.z)
}

/// A symmetric 3×3 matrix: six numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sym3 {
    pub(crate) xx: f64,
    pub(crate) xy: f64,
    pub(crate) xz: f64,
    pub(crate) yy: f64,
    pub(crate) yz: f64,
    pub(crate) zz: f64,
}

impl Sym3 {
    pub(crate) const ZERO: Self = Self { xx: 0.0, xy: 0.0, xz: 0.0, yy: 0.0, yz: 0.0, zz: 0.0 };

    /// S + m(cᵀc·1 − ccᵀ): the parallel-axis theorem.
    #[inline(always)]
    pub(crate) fn shifted(&self, m: f64, c: &Vector3<f64>) -> Self {
        let h = m * c;
        Self {
            xx: self.xx + h.y * c.y + h.z * c.z,
            xy: self.xy - h.x * c.y,
            xz: self.xz - h.x * c.z,
            yy: self.yy + h.x * c.x + h.z * c.z,
            yz: self.yz - h.y * c.z,
            zz: self.zz + h.x * c.x + h.y * c.y,
        }
    }
}

/// The inertia of a link about its centre of mass, in link axes turned about z until I_xy = 0.
///
/// Then I = I_yy·1 + (I_xx − I_yy)·x·xᵀ + z·uᵀ + u·zᵀ with u = (I_xz, I_yz, (I_zz − I_yy)/2), which rotates at two thirds
/// of the cost of R·I·Rᵀ.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkInertia {
    I_yy: f64,
    I_xx_yy: f64,
    u: Vector3<f64>,
}

impl LinkInertia {
    /// Requires I_xy = 0.
    pub(crate) fn new(I: &Matrix3<f64>) -> Self {
        Self { I_yy: I.m22, I_xx_yy: I.m11 - I.m22, u: Vector3::new(I.m13, I.m23, 0.5 * (I.m33 - I.m22)) }
    }

    /// The same inertia in the axes that `R` turns the link's into.
    #[inline(always)]
    pub(crate) fn rotated(&self, R: &Matrix3<f64>) -> Sym3 {
        let (x, z) = (Vector3::new(R.m11, R.m21, R.m31), Vector3::new(R.m13, R.m23, R.m33));
        let kx = self.I_xx_yy * x;
        let u = times(R, &self.u);
        Sym3 {
            xx: self.I_yy + kx.x * x.x + 2.0 * (u.x * z.x),
            xy: kx.x * x.y + u.x * z.y + u.y * z.x,
            xz: kx.x * x.z + u.x * z.z + u.z * z.x,
            yy: self.I_yy + kx.y * x.y + 2.0 * (u.y * z.y),
            yz: kx.y * x.z + u.y * z.z + u.z * z.y,
            zz: self.I_yy + kx.z * x.z + 2.0 * (u.z * z.z),
        }
    }
}

impl std::ops::AddAssign for Sym3 {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        self.xx += o.xx;
        self.xy += o.xy;
        self.xz += o.xz;
        self.yy += o.yy;
        self.yz += o.yz;
        self.zz += o.zz;
    }
}

impl std::ops::Mul<Vector3<f64>> for Sym3 {
    type Output = Vector3<f64>;
    #[inline(always)]
    fn mul(self, u: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.xx * u.x + self.xy * u.y + self.xz * u.z,
            self.xy * u.x + self.yy * u.y + self.yz * u.z,
            self.xz * u.x + self.yz * u.y + self.zz * u.z,
        )
    }
}

/// A motion vector: angular part, and linear part of the body-fixed point that is now at the base origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub(crate) w: Vector3<f64>,
    pub(crate) v: Vector3<f64>,
}

impl Motion {
    pub(crate) const ZERO: Self = Self { w: ORIGIN, v: ORIGIN };

    /// A turn about `axis` through the point `p`.
    #[inline(always)]
    pub(crate) fn about(axis: Vector3<f64>, p: &Vector3<f64>) -> Self {
        Self { w: axis, v: p.cross(&axis) }
    }

    /// A slide along `axis`.
    #[inline(always)]
    pub(crate) fn along(axis: Vector3<f64>) -> Self {
        Self { w: Vector3::zeros(), v: axis }
    }

    /// Linear part at the point `p`: v + ω × p.
    #[inline(always)]
    pub(crate) fn at(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.v + self.w.cross(p)
    }

    /// Spatial cross product v × s (RBDA Eq. 2.31).
    #[inline(always)]
    pub(crate) fn cross(&self, s: &Motion) -> Motion {
        Motion { w: self.w.cross(&s.w), v: self.w.cross(&s.v) + self.v.cross(&s.w) }
    }

    /// Spatial cross product v ×* f (RBDA Eq. 2.32).
    #[inline(always)]
    pub(crate) fn cross_force(&self, f: &Force) -> Force {
        Force { n: self.w.cross(&f.n) + self.v.cross(&f.f), f: self.w.cross(&f.f) }
    }

    /// Power s·f.
    #[inline(always)]
    pub(crate) fn dot(&self, f: &Force) -> f64 {
        self.w.dot(&f.n) + self.v.dot(&f.f)
    }
}

impl std::ops::Add for Motion {
    type Output = Motion;
    #[inline(always)]
    fn add(self, o: Motion) -> Motion {
        Motion { w: self.w + o.w, v: self.v + o.v }
    }
}

impl std::ops::Mul<f64> for Motion {
    type Output = Motion;
    #[inline(always)]
    fn mul(self, k: f64) -> Motion {
        Motion { w: self.w * k, v: self.v * k }
    }
}

/// A force vector: moment about the base origin, and force.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Force {
    pub(crate) n: Vector3<f64>,
    pub(crate) f: Vector3<f64>,
}

impl Force {
    pub(crate) const ZERO: Self = Self { n: ORIGIN, f: ORIGIN };
}

impl std::ops::Add for Force {
    type Output = Force;
    #[inline(always)]
    fn add(self, o: Force) -> Force {
        Force { n: self.n + o.n, f: self.f + o.f }
    }
}

impl std::ops::Mul<f64> for Force {
    type Output = Force;
    #[inline(always)]
    fn mul(self, k: f64) -> Force {
        Force { n: self.n * k, f: self.f * k }
    }
}

impl std::ops::AddAssign for Force {
    #[inline(always)]
    fn add_assign(&mut self, o: Force) {
        self.n += o.n;
        self.f += o.f;
    }
}

/// A rigid body's inertia: mass, first moment h = m·c, and second moment about the base origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RigidInertia {
    pub(crate) m: f64,
    pub(crate) h: Vector3<f64>,
    pub(crate) I: Sym3,
}

impl RigidInertia {
    pub(crate) const ZERO: Self = Self { m: 0.0, h: ORIGIN, I: Sym3::ZERO };

    /// Momentum I·v (RBDA Eq. 2.63).
    #[inline(always)]
    pub(crate) fn times(&self, s: &Motion) -> Force {
        Force { n: self.I * s.w + self.h.cross(&s.v), f: self.m * s.v - self.h.cross(&s.w) }
    }
}

impl std::ops::AddAssign for RigidInertia {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        self.m += o.m;
        self.h += o.h;
        self.I += o.I;
    }
}
