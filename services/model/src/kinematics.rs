//! Kinematics of the links and of the end-effector frame.

use crate::arm::Model;
use crate::body::Frames;
use crate::lanes::{PerJoint, Row, V3, widest};
use crate::pose::Pose;
use crate::spatial::Motions;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

impl<const N: usize> Model<N> {
    /// The pose of the end-effector frame.
    #[inline(always)]
    pub(crate) fn end<R: Row<N>>(&self, frames: &Frames<R, N>) -> Pose {
        match self.ee_body {
            Some(i) => frames.links[i].pose(&self.X_LE),
            None => self.X_LE,
        }
    }

    /// The joints' motion axes: a turn about z through the link's origin, or a slide along z.
    #[inline(always)]
    pub(crate) fn axes<R: Row<N>>(&self, frames: &Frames<R, N>) -> Motions<R> {
        let (turns, slides) = self.bodies.kinds::<R>();
        let w = frames.axes.z * turns;
        Motions {
            w,
            v: frames.p.cross(w) + frames.axes.z * slides,
        }
    }

    widest! {
        /// Pose of the end-effector frame in the base, `X_BE`.
        pub fn forward_kinematics(&self, q: &SVector<f64, N>) -> Pose {
            end_anywhere
        }
    }

    #[inline(always)]
    fn end_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> Pose {
        self.end::<R>(&self.bodies.outwards(R::of(q)))
    }

    widest! {
        /// Poses of the links' URDF frames in the base, `X_BL`.
        pub fn link_poses(&self, q: &SVector<f64, N>) -> [Pose; N] {
            link_poses_anywhere
        }
    }

    #[inline(always)]
    fn link_poses_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> [Pose; N] {
        let frames = self.bodies.outwards::<R>(R::of(q));
        let mut poses = [Pose::identity(); N];
        for (i, pose) in poses.iter_mut().enumerate() {
            *pose = frames.links[i].pose(&Pose::rotation(self.bodies.R_urdf[i]));
        }
        poses
    }

    widest! {
        /// Geometric Jacobian: [v; ω] = J·q̇ of the end-effector frame's origin, base axes, 6×N.
        pub fn jacobian(&self, q: &SVector<f64, N>) -> SMatrix<f64, 6, N> {
            jacobian_anywhere
        }
    }

    #[inline(always)]
    fn jacobian_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> SMatrix<f64, 6, N> {
        let frames = self.bodies.outwards::<R>(R::of(q));
        self.jacobian_at(&self.axes(&frames), &self.end(&frames).p)
    }

    #[inline(always)]
    pub(crate) fn jacobian_at<R: Row<N>>(
        &self,
        S: &Motions<R>,
        p_E: &Vector3<f64>,
    ) -> SMatrix<f64, 6, N> {
        let (linear, angular) = (S.at(V3::splat(p_E)).store(), S.w.store());
        let moving = self.ee_body.map_or(0, |i| i + 1);
        let rows: [&PerJoint; 6] = [
            &linear.x, &linear.y, &linear.z, &angular.x, &angular.y, &angular.z,
        ];
        SMatrix::from_fn(|row, joint| {
            if joint < moving {
                rows[row].0[joint]
            } else {
                0.0
            }
        })
    }
}

/// Stacks a linear and an angular part: `[v; ω]`.
#[must_use]
#[inline(always)]
pub fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    )
}
