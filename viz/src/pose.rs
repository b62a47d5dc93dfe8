//! Places of what is drawn, in single precision: for eyes. PURE.

use glam::{Affine3, Mat3, Quat, Vec3};
use model::Pose;
use nalgebra::Vector3;

/// sRGB bytes and opacity, `0xrrggbbaa`, as Rerun stores colours.
pub(crate) type Rgba = u32;

/// At `p`, with the z axis along `axis`.
pub(crate) fn along(p: Vec3, axis: Vec3) -> Affine3 {
    let turn = Quat::from_rotation_arc(Vec3::Z, axis.normalize_or(Vec3::Z));
    Affine3::from_rotation_translation(turn, p)
}

pub(crate) fn rotation(X: &Affine3) -> Quat {
    Quat::from_mat3(&X.matrix3).normalize()
}

/// Two corners of the box about places.
pub(crate) fn span(mut places: impl Iterator<Item = Vec3>) -> Option<[Vec3; 2]> {
    let first = places.next()?;
    Some(places.fold([first; 2], |[low, high], p| [low.min(p), high.max(p)]))
}

pub(crate) fn vec3(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}

/// The pose of a part in the frame that it is drawn in.
pub(crate) fn placement(X: &Pose) -> Affine3 {
    let R = Mat3::from_cols_slice(X.R.map(|x| x as f32).as_slice());
    Affine3::from_mat3_translation(R, vec3(&X.p))
}

/// The pose of a message: position and rotation matrix, column-major.
pub(crate) fn pose(p: &[f64; 3], R: &[f64; 9]) -> Affine3 {
    let R = Mat3::from_cols_array(&R.map(|x| x as f32));
    Affine3::from_mat3_translation(R, vec3(&(*p).into()))
}
