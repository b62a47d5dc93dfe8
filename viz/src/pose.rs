//! Places of what is drawn, in single precision: for eyes. PURE.

use glam::{Mat3, Quat, Vec3};
use model::Pose;
use nalgebra::Vector3;

/// sRGB bytes and opacity, `0xrrggbbaa`, as Rerun stores colours.
pub(crate) type Rgba = u32;

/// The pose of something in the frame it is drawn in: `x ↦ R·x + p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub(crate) R: Mat3,
    pub(crate) p: Vec3,
}

impl Placement {
    pub(crate) const IDENTITY: Self = Self {
        R: Mat3::IDENTITY,
        p: Vec3::ZERO,
    };

    /// At `p`, not turned.
    pub(crate) const fn at(p: Vec3) -> Self {
        Self {
            p,
            ..Self::IDENTITY
        }
    }

    /// At `p`, with the z axis along `axis`.
    pub(crate) fn along(p: Vec3, axis: Vec3) -> Self {
        let R = Mat3::from_quat(Quat::from_rotation_arc(Vec3::Z, axis.normalize_or(Vec3::Z)));
        Self { R, p }
    }

    /// A place in the frame it is drawn in.
    pub(crate) fn of(&self, place: Vec3) -> Vec3 {
        self.R * place + self.p
    }

    pub(crate) fn then(&self, inner: &Self) -> Self {
        Self {
            R: self.R * inner.R,
            p: self.of(inner.p),
        }
    }

    pub(crate) fn rotation(&self) -> Quat {
        Quat::from_mat3(&self.R).normalize()
    }
}

/// Two corners of the box about places.
pub(crate) fn span(mut places: impl Iterator<Item = Vec3>) -> Option<[Vec3; 2]> {
    let first = places.next()?;
    Some(places.fold([first; 2], |[low, high], p| [low.min(p), high.max(p)]))
}

pub(crate) fn vec3(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}

pub(crate) fn placement(X: &Pose) -> Placement {
    Placement {
        R: Mat3::from_cols_slice(X.R.map(|x| x as f32).as_slice()),
        p: vec3(&X.p),
    }
}

/// The pose of a message: position and rotation matrix, column-major.
pub(crate) fn pose(p: &[f64; 3], R: &[f64; 9]) -> Placement {
    Placement {
        R: Mat3::from_cols_array(&R.map(|x| x as f32)),
        p: vec3(&(*p).into()),
    }
}
