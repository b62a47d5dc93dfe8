//! The hand's mobility at a posture, as ellipsoids that go flat along a lost direction. PURE.

use glam::{Mat3, Vec3};
use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};

use shared_types::MAX_DOF;

use crate::pose::vec3;

/// One size for every arm: the columns of absent joints are zero.
pub(crate) type Jacobian = SMatrix<f64, 6, MAX_DOF>;

/// The shape of an ellipsoid of velocities of C, or, where it is angular, of rotations, C held, which for a spherical wrist are its own: principal axes
/// as columns, and half axes over the longest.
pub(crate) struct Ellipsoid {
    pub(crate) axes: Mat3,
    pub(crate) half_axes: Vec3,
}

impl Ellipsoid {
    /// {J q̇ : |q̇_i| bounded in the ellipsoidal norm of the joints' speed limits}: half axes √λ(J diag(q̇_max²) Jᵀ). Where a joint has no limit,
    /// all count as equally fast.
    pub(crate) fn velocity(
        J: &Jacobian,
        qdot_max: &SVector<f64, MAX_DOF>,
        is_angular: bool,
    ) -> Self {
        // A joint that does not move the frame, an absent one among them, does not count.
        let limited = qdot_max
            .iter()
            .enumerate()
            .all(|(i, limit)| limit.is_finite() || J.column(i).iter().all(|x| *x == 0.0));
        let scaled = Jacobian::from_fn(|row, column| {
            let limit = qdot_max[column];
            J[(row, column)]
                * if limited && limit.is_finite() {
                    limit
                } else {
                    1.0
                }
        });
        Self::of(
            &block(&(scaled * scaled.transpose()), is_angular),
            f64::sqrt,
        )
    }

    /// {Λ⁻¹ F : |F| = 1}, accelerations for unit forces: half axes λ(J A⁻¹ Jᵀ); along a lost direction Λ is infinite. `None` without A⁻¹.
    pub(crate) fn mobility(
        J: &Jacobian,
        A: &SMatrix<f64, MAX_DOF, MAX_DOF>,
        is_angular: bool,
    ) -> Option<Self> {
        let W = block(&(J * A.try_inverse()? * J.transpose()), is_angular);
        Some(Self::of(&W, |lambda| lambda))
    }

    fn of(W: &Matrix3<f64>, half_axis: impl Fn(f64) -> f64) -> Self {
        let SymmetricEigen {
            eigenvalues,
            eigenvectors,
        } = SymmetricEigen::new(*W);
        let lengths = eigenvalues.map(|lambda| half_axis(lambda.max(0.0)));
        let longest = lengths.max().max(f64::MIN_POSITIVE);
        let axis = |i: usize| vec3(&Vector3::from(eigenvectors.column(i)));
        let (x, y) = (axis(0), axis(1));
        Self {
            axes: Mat3::from_cols(x, y, x.cross(y)),
            half_axes: vec3(&(lengths / longest)),
        }
    }
}

/// The Jacobian at C from that at E: v_C = v_E + ω × (p_C − p_E).
pub(crate) fn at_point(mut J: Jacobian, r_EC: &Vector3<f64>) -> Jacobian {
    let lever = -r_EC.cross_matrix() * J.fixed_rows::<3>(3).into_owned();
    let mut linear = J.fixed_rows_mut::<3>(0);
    linear += lever;
    J
}

/// The linear block of W, or the angular one's section where nothing moves linearly: W_ωω − W_ωv W_vv⁺ W_vω.
fn block(W: &SMatrix<f64, 6, 6>, is_angular: bool) -> Matrix3<f64> {
    let part = |row: usize, column: usize| W.fixed_view::<3, 3>(row, column).into_owned();
    if is_angular {
        part(3, 3) - part(3, 0) * pseudo_inverse(&part(0, 0)) * part(0, 3)
    } else {
        part(0, 0)
    }
}

fn pseudo_inverse(W: &Matrix3<f64>) -> Matrix3<f64> {
    let SymmetricEigen {
        eigenvalues,
        eigenvectors: V,
    } = SymmetricEigen::new(*W);
    let floor = 1e-9 * eigenvalues.max();
    let inverse = eigenvalues.map(|lambda| if lambda > floor { 1.0 / lambda } else { 0.0 });
    V * Matrix3::from_diagonal(&inverse) * V.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{Model, Robot, unit_scaled};

    /// At each lock the ellipsoids are flat along a direction that no joint moves at C, and a singular value vanishes; elsewhere none does.
    #[test]
    fn ellipsoids_go_flat_along_the_lost_direction() {
        let robot = Robot::builtin("puma560").expect("built in");
        let arm = Model::new(&robot, None).expect("six joints");
        let elbow = [0.3, -0.9, 1.617_633_433_908_135_6, 0.2, 0.8, 0.1];
        let wrist = [0.35, -1.05, 2.97, 0.4, 0.0, 0.2];
        let free = [0.3, -0.9, 2.9, 0.2, 0.8, 0.1];
        for (q, is_angular, is_locked) in [
            (elbow, false, true),
            (wrist, true, true),
            (free, false, false),
            (free, true, false),
        ] {
            let q = model::embedded(&q);
            // C, the wrist centre: where the axes of joints 4 to 6 meet.
            let r_EC = arm.link_poses(&q)[5].p - arm.forward_kinematics(&q).p;
            let J = at_point(arm.jacobian(&q), &r_EC);
            let sigma = unit_scaled(&J, robot.length_m, &[true; 6]).singular_values();
            assert_eq!(sigma[5] < 1e-6, is_locked, "{sigma:?}");
            let velocity = Ellipsoid::velocity(&J, arm.velocity(), is_angular);
            let mobility = Ellipsoid::mobility(&J, &arm.mass_matrix(&q), is_angular);
            for Ellipsoid { axes, half_axes } in [Some(velocity), mobility].into_iter().flatten() {
                assert!((half_axes.max_element() - 1.0).abs() < 1e-6);
                assert_eq!(half_axes.min_element() < 1e-3, is_locked, "{half_axes}");
                let zeta = axes.col(half_axes.min_position()).to_array().map(f64::from);
                // Only the wrist's joints turn the hand while C stands.
                let first = if is_angular { 3 } else { 0 };
                let column = |i| J.fixed_view::<3, 1>(first, i).into_owned();
                let is_still = |i| column(i).dot(&Vector3::from(zeta)).abs() < 1e-4;
                assert!(!is_locked || (first..6).all(is_still));
            }
        }
    }
}
