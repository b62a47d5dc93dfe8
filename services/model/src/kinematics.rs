//! Kinematics of the links and of the end-effector frame.

use crate::arm::Model;
use crate::body::Body;
use crate::pose::Pose;
use crate::spatial::Motion;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

impl<const N: usize> Model<N> {
    /// Visits the links from the base outwards: index, body, pose in the base, joint motion axis.
    #[inline(always)]
    pub(crate) fn outwards(&self, q: &SVector<f64, N>, mut visit: impl FnMut(usize, &Body, &Pose, Motion)) {
        let mut X = Pose::identity();
        for i in 0..N {
            let body = &self.bodies[i];
            let S = body.step(&mut X, q[i]);
            visit(i, body, &X, S);
        }
    }

    /// Pose of the end-effector frame in the base, `X_BE`.
    pub fn forward_kinematics(&self, q: &SVector<f64, N>) -> Pose {
        let mut X_BE = self.X_LE;
        self.outwards(q, |i, _, X, _| {
            if self.ee_body == Some(i) {
                X_BE = *X * self.X_LE;
            }
        });
        X_BE
    }

    /// Poses of the links' URDF frames in the base, `X_BL`.
    pub fn link_poses(&self, q: &SVector<f64, N>) -> [Pose; N] {
        let mut poses = [Pose::identity(); N];
        self.outwards(q, |i, body, X, _| poses[i] = *X * Pose::rotation(body.R_urdf));
        poses
    }

    /// Geometric Jacobian: [v; ω] = J·q̇ of the end-effector frame's origin, base axes, 6×N.
    pub fn jacobian(&self, q: &SVector<f64, N>) -> SMatrix<f64, 6, N> {
        let mut S = [Motion::ZERO; N];
        let mut p_E = self.X_LE.p;
        self.outwards(q, |i, _, X, S_i| {
            S[i] = S_i;
            if self.ee_body == Some(i) {
                p_E = X.transform_point(&self.X_LE.p);
            }
        });
        self.jacobian_at(&S, &p_E)
    }

    #[inline(always)]
    pub(crate) fn jacobian_at(&self, S: &[Motion; N], p_E: &Vector3<f64>) -> SMatrix<f64, 6, N> {
        let moving = self.ee_body.map_or(0, |i| i + 1);
        let mut J = SMatrix::<f64, 6, N>::zeros();
        for (j, S_j) in S.iter().enumerate() {
            if j < moving {
                J.set_column(j, &stack(&S_j.at(p_E), &S_j.w));
            }
        }
        J
    }
}

#[inline(always)]
pub(crate) fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}
