//! The ways in which MJCF states a pose.

use super::Element;
use crate::error::Defect;
use crate::pose::Pose;
use crate::rotation::rotation_exp;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// How angles are stated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Angles<'a> {
    pub(super) in_degrees: bool,
    /// The axes of Euler angles; lower case: of the moving frame, upper case: of the fixed one.
    pub(super) sequence: &'a str,
}

impl Angles<'_> {
    /// One unit of angle, rad.
    pub(super) fn unit(&self) -> f64 {
        if self.in_degrees {
            1f64.to_radians()
        } else {
            1.0
        }
    }

    /// Position and orientation of an element in the frame around it.
    pub(super) fn pose(&self, element: &Element<'_, '_>) -> Result<Pose, Defect> {
        Ok(Pose {
            R: self.rotation(element)?,
            p: element.vector("pos")?.unwrap_or_default(),
        })
    }

    fn rotation(&self, element: &Element<'_, '_>) -> Result<Matrix3<f64>, Defect> {
        let wrong = |what: &str| {
            Defect::Mjcf(format!(
                "{what} has another number of values than MJCF gives it"
            ))
        };
        if let Some(text) = element.text("quat") {
            let [w, x, y, z] = super::numbers(Some(text), "quat")?[..] else {
                return Err(wrong("quat"));
            };
            return Ok(
                *UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
                    .to_rotation_matrix()
                    .matrix(),
            );
        }
        if let Some(text) = element.text("axisangle") {
            let [x, y, z, angle] = super::numbers(Some(text), "axisangle")?[..] else {
                return Err(wrong("axisangle"));
            };
            return Ok(rotation_exp(
                &(Vector3::new(x, y, z).normalize() * (angle * self.unit())),
            ));
        }
        if let Some(angles) = element.vector("euler")? {
            let mut R = Matrix3::identity();
            for (axis, angle) in self.sequence.chars().zip(&angles) {
                let unit = match axis.to_ascii_lowercase() {
                    'x' => Vector3::x(),
                    'y' => Vector3::y(),
                    _ => Vector3::z(),
                };
                let turn = rotation_exp(&(unit * (angle * self.unit())));
                R = if axis.is_ascii_lowercase() {
                    R * turn
                } else {
                    turn * R
                };
            }
            return Ok(R);
        }
        if let Some(text) = element.text("xyaxes") {
            let [a, b, c, d, e, f] = super::numbers(Some(text), "xyaxes")?[..] else {
                return Err(wrong("xyaxes"));
            };
            let x = Vector3::new(a, b, c).normalize();
            let y = Vector3::new(d, e, f);
            let y = (y - x * x.dot(&y)).normalize();
            return Ok(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        }
        match element.vector("zaxis")? {
            Some(z) => Ok(along(&z)),
            None => Ok(Matrix3::identity()),
        }
    }
}

/// The least rotation that takes z to a direction.
pub(super) fn along(direction: &Vector3<f64>) -> Matrix3<f64> {
    let (axis, cos) = (Vector3::z().cross(direction), direction.z);
    let angle = libm::atan2(axis.norm(), cos);
    // Down is a half turn about any axis across.
    rotation_exp(&(axis.try_normalize(0.0).unwrap_or(Vector3::x()) * angle))
}

/// As an origin of a URDF: R = Rz(yaw)·Ry(pitch)·Rx(roll). Any yaw serves where the pitch is a right angle: the roll is that of what it leaves.
pub(super) fn to_urdf(X: &Pose) -> urdf_rs::Pose {
    let yaw = libm::atan2(X.R.m21, X.R.m11);
    let rest = rotation_exp(&Vector3::new(0.0, 0.0, -yaw)) * X.R;
    let pitch = libm::atan2(-rest.m31, rest.m11);
    let roll = libm::atan2(-rest.m23, rest.m22);
    urdf_rs::Pose {
        xyz: urdf_rs::Vec3(X.p.into()),
        rpy: urdf_rs::Vec3([roll, pitch, yaw]),
    }
}
