//! Poses.

use crate::spatial::times;
use nalgebra::{Matrix3, Matrix4, Vector3};
use std::ops::Mul;

/// The pose `X_AB` of frame B in frame A: a point p_B has coordinates `R·p_B + p` in A.
///
/// Monogram notation: adjacent letters cancel, `X_AC = X_AB * X_BC`. Units m. Requires `R` to be a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation `R_AB`: its columns are B's axes in A.
    pub R: Matrix3<f64>,
    /// Position of B's origin in A, m.
    pub p: Vector3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

impl Pose {
    /// The identity: B coincides with A.
    #[inline(always)]
    pub fn identity() -> Self {
        Self {
            R: Matrix3::identity(),
            p: Vector3::zeros(),
        }
    }

    /// A pure translation.
    #[inline(always)]
    pub fn translation(p: Vector3<f64>) -> Self {
        Self {
            R: Matrix3::identity(),
            p,
        }
    }

    /// A pure rotation.
    #[inline(always)]
    pub fn rotation(R: Matrix3<f64>) -> Self {
        Self {
            R,
            p: Vector3::zeros(),
        }
    }

    /// URDF's origin: translation, then fixed-axis roll, pitch, yaw: R = Rz(yaw)·Ry(pitch)·Rx(roll), rad.
    ///
    /// A multiple of π/2 written to full precision gives the exact rotation: its entries below 1e-15, which are the
    /// rounding of π alone, are taken as the zeros they stand for.
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let [(sr, cr), (sp, cp), (sy, cy)] = rpy.map(|angle| {
            let (s, c) = libm::sincos(angle);
            let exact = |x: f64| if x.abs() < 1e-15 { 0.0 } else { x };
            (exact(s), exact(c))
        });
        #[rustfmt::skip]
        let R = Matrix3::new(
            cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
            sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
            -sp,     cp * sr,                cp * cr,
        );
        Self { R, p: xyz.into() }
    }

    /// The inverse pose `X_BA` = (Rᵀ, −Rᵀp).
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let R = self.R.transpose();
        Self {
            R,
            p: -(R * self.p),
        }
    }

    /// A point of B in A: R·p_B + p.
    #[inline(always)]
    pub fn transform_point(&self, p_B: &Vector3<f64>) -> Vector3<f64> {
        times(&self.R, p_B) + self.p
    }

    /// The homogeneous 4×4 matrix.
    pub fn to_homogeneous(&self) -> Matrix4<f64> {
        let mut T = Matrix4::identity();
        T.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.R);
        T.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.p);
        T
    }
}

impl Mul for Pose {
    type Output = Pose;
    #[inline(always)]
    fn mul(self, X_BC: Pose) -> Pose {
        let column = |k: usize| times(&self.R, &X_BC.R.column(k).into_owned());
        Pose {
            R: Matrix3::from_columns(&[column(0), column(1), column(2)]),
            p: self.transform_point(&X_BC.p),
        }
    }
}
