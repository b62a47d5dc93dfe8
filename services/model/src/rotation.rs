//! Rotation vectors of rotation matrices.

use nalgebra::{Matrix3, Vector3};

/// Rotation by the rotation vector `rho` (axis times angle, rad): Rodrigues' formula.
#[must_use]
pub fn rotation_exp(rho: &Vector3<f64>) -> Matrix3<f64> {
    let angle = rho.norm();
    if angle < 1e-12 {
        return Matrix3::identity() + rho.cross_matrix();
    }
    let K = (rho / angle).cross_matrix();
    let (sin, cos) = libm::sincos(angle);
    Matrix3::identity() + K * sin + K * K * (1.0 - cos)
}

/// The rotation vector of `R` (axis times angle, rad), angle in [0, π].
///
/// Near 0 from the antisymmetric part, near π from the symmetric one: exact to rounding at both ends. A matrix that is a rotation up to
/// rounding gives a finite vector, the identity and every half turn included; a NaN in gives a NaN out. Errors none.
#[must_use]
pub fn rotation_log(R: &Matrix3<f64>) -> Vector3<f64> {
    let w = Vector3::new(R.m32 - R.m23, R.m13 - R.m31, R.m21 - R.m12) * 0.5;
    let (sin, cos) = (w.norm(), 0.5 * (R.trace() - 1.0));
    let angle = libm::atan2(sin, cos);
    if sin > 1e-6 {
        return w * (angle / sin);
    }
    if cos > 0.0 {
        return w;
    }
    // (R + Rᵀ)/2 − cos·1 = (1 − cos)·u·uᵀ: the largest column gives the axis, w its sign.
    let S = 0.5 * (R + R.transpose()) - Matrix3::from_diagonal_element(cos);
    let column = (0..3)
        .max_by(|i, j| S[(*i, *i)].total_cmp(&S[(*j, *j)]))
        .unwrap_or(0);
    let axis = S.column(column).normalize();
    axis * if axis.dot(&w) < 0.0 { -angle } else { angle }
}

/// The angle α about the unit axis `k` by which `R` twists: R = exp(α k)·S with S about an axis orthogonal to k; rad, in (−π, π].
///
/// tan(α/2) = k·v/w for the quaternion (w, v) of R. Where both vanish (a half turn about an axis orthogonal to k) every α does, and 0 is returned.
#[must_use]
pub fn rotation_twist(R: &Matrix3<f64>, k: &Vector3<f64>) -> f64 {
    let v = Vector3::new(R.m32 - R.m23, R.m13 - R.m31, R.m21 - R.m12);
    2.0 * libm::atan2(k.dot(&v), 1.0 + R.trace())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::vector;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// Angles in all magnitudes from both ends of [0, π].
    fn angle() -> impl Strategy<Value = f64> {
        let near = (-18.0..0.5_f64).prop_map(|power| libm::exp10(power).min(PI));
        (0.0..=PI, near, 0..3usize).prop_map(|(plain, near, kind)| [plain, near, PI - near][kind])
    }

    /// Directions, the coordinate axes among them.
    fn axis() -> impl Strategy<Value = Vector3<f64>> {
        let some = prop::array::uniform3(-1.0..1.0_f64).prop_map(Vector3::from);
        let unit = prop::array::uniform3(-1..=1).prop_map(|v| Vector3::from(v.map(f64::from)));
        prop_oneof![some, unit]
            .prop_filter("a direction", |v| v.norm() > 1e-3)
            .prop_map(|v| v.normalize())
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 2000, ..ProptestConfig::default() })]

        /// The error between two rotations is finite and has the angle between them, whatever rounding has done to either.
        #[test]
        fn the_error_of_two_rotations_is_finite_and_right(
            axis in axis(),
            first in prop::array::uniform3(-PI..PI),
            angle in angle(),
            noise in prop::array::uniform9(-1e-12..1e-12_f64),
        ) {
            let first = rotation_exp(&Vector3::from(first));
            let second = rotation_exp(&(axis * angle)) * first + Matrix3::from_column_slice(&noise);
            let error = rotation_log(&(second * first.transpose()));
            prop_assert!((error.norm() - angle).abs() < 1e-9, "{} against {angle}", error.norm());
            // Near a half turn both axes are right.
            let along = error.dot(&axis);
            let is_other = PI - angle < 1e-9 && (along + angle).abs() < 1e-9;
            prop_assert!((along - angle).abs() < 1e-9 || is_other, "{error} about {axis:?}");
        }

        #[test]
        fn a_twist_is_taken_off_a_swing(swing in axis(), by in -3.0..3.0_f64, twist in -3.0..3.0_f64, k in axis()) {
            let across = swing - k * k.dot(&swing);
            prop_assume!(across.norm() > 1e-3);
            let R = rotation_exp(&(k * twist)) * rotation_exp(&(across.normalize() * by));
            let found = rotation_twist(&R, &k);
            prop_assert!((found - twist).abs() < 1e-9, "{found} of {twist}");
        }
    }

    #[test]
    fn the_ends_are_exact() {
        assert_eq!(rotation_log(&Matrix3::identity()), Vector3::zeros());
        // A trace above 3 by rounding: the arc cosine of (tr R − 1)/2 is NaN here.
        let above = Matrix3::from_diagonal(&vector![1.0 + 3e-16, 1.0 + 3e-16, 1.0]);
        let small = vector![0.0, 0.0, 4e-15];
        assert!((rotation_log(&(above + small.cross_matrix())) - small).norm() < 1e-20);
        for half in [[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let half = Matrix3::from_diagonal(&half.into());
            assert_eq!(rotation_log(&half).norm(), PI);
        }
        let none = Matrix3::repeat(f64::NAN);
        assert!(rotation_log(&none).norm().is_nan());
    }
}
