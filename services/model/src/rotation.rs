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
    use nalgebra::{Rotation3, Unit};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// Angles in all magnitudes from both ends of [0, π].
    fn angle() -> impl Strategy<Value = f64> {
        (0.0..=PI, -18.0..0.5_f64, any::<bool>(), any::<bool>()).prop_map(
            |(plain, power, small, from_pi)| {
                let near = libm::exp10(power).min(PI);
                match (small, from_pi) {
                    (false, _) => plain,
                    (true, false) => near,
                    (true, true) => PI - near,
                }
            },
        )
    }

    fn axis() -> impl Strategy<Value = Unit<Vector3<f64>>> {
        prop_oneof![
            prop::array::uniform3(-1.0..1.0_f64)
                .prop_map(Vector3::from)
                .prop_filter("a direction", |v| v.norm() > 1e-3)
                .prop_map(Unit::new_normalize),
            (0..3usize, any::<bool>()).prop_map(|(i, minus)| {
                let mut axis = Vector3::zeros();
                axis[i] = if minus { -1.0 } else { 1.0 };
                Unit::new_unchecked(axis)
            }),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 2000, ..ProptestConfig::default() })]

        /// The error between two rotations is finite and has the angle between them, whatever rounding has done to either.
        #[test]
        fn the_error_of_two_rotations_is_finite_and_right(
            (axis, first, angle) in (axis(), prop::array::uniform3(-PI..PI), angle()),
            noise in prop::array::uniform9(-1e-12..1e-12_f64),
        ) {
            let first = Rotation3::from_euler_angles(first[0], first[1], first[2]).into_inner();
            let second = Rotation3::from_axis_angle(&axis, angle).into_inner() * first;
            let error = rotation_log(&((second + Matrix3::from_column_slice(&noise)) * first.transpose()));
            prop_assert!(error.iter().all(|x| x.is_finite()), "{error}");
            prop_assert!((error.norm() - angle).abs() < 1e-9, "{} against {angle}", error.norm());
            let along = error.dot(&axis) - angle;
            // Near a half turn both axes are right.
            prop_assert!(along.abs() < 1e-9 || (PI - angle < 1e-9 && (error.dot(&axis) + angle).abs() < 1e-9), "{error} about {axis:?}");
        }
    }

    proptest! {
        #[test]
        fn a_twist_is_taken_off_a_swing(swing in axis(), by in -3.0..3.0_f64, twist in -3.0..3.0_f64, k in axis()) {
            let across = swing.into_inner() - k.into_inner() * k.dot(&swing);
            prop_assume!(across.norm() > 1e-3);
            let S = rotation_exp(&(across.normalize() * by));
            let R = rotation_exp(&(k.into_inner() * twist)) * S;
            prop_assert!((rotation_twist(&R, &k) - twist).abs() < 1e-9, "{} of {twist}", rotation_twist(&R, &k));
        }
    }

    #[test]
    fn the_ends_are_exact() {
        assert_eq!(rotation_log(&Matrix3::identity()), Vector3::zeros());
        // A trace above 3 by rounding: the arc cosine of (tr R − 1)/2 is NaN here.
        let above = Matrix3::new(
            1.0 + 3e-16,
            -4e-15,
            0.0,
            4e-15,
            1.0 + 3e-16,
            0.0,
            0.0,
            0.0,
            1.0,
        );
        assert!((rotation_log(&above) - Vector3::new(0.0, 0.0, 4e-15)).norm() < 1e-20);
        for half in [
            Vector3::new(1.0, -1.0, -1.0),
            Vector3::new(-1.0, 1.0, -1.0),
            Vector3::new(-1.0, -1.0, 1.0),
        ] {
            assert_eq!(rotation_log(&Matrix3::from_diagonal(&half)).norm(), PI);
        }
        assert!(
            rotation_log(&Matrix3::from_element(f64::NAN))
                .norm()
                .is_nan()
        );
    }
}
