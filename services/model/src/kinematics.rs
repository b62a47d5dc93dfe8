//! Kinematics of the links and of the end-effector frame.

use crate::arm::Model;
use crate::body::Frames;
use crate::lanes::{Pair, PerJoint, Vectors, pairs};
use crate::pose::Pose;
use crate::spatial::{Motion, Motions};
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

impl<const N: usize> Model<N> {
    /// The links' frames.
    #[inline(always)]
    pub(crate) fn frames(&self, q: &SVector<f64, N>) -> Frames {
        let mut frames = Frames::ZERO;
        self.bodies.outwards(q, &mut frames);
        frames
    }

    /// The pose of the end-effector frame.
    #[inline(always)]
    pub(crate) fn end(&self, frames: &Frames) -> Pose {
        match self.ee_body {
            Some(i) => frames.pose(i) * self.X_LE,
            None => self.X_LE,
        }
    }

    /// The joints' motion axes: a turn about z through the link's origin, or a slide along z.
    #[inline(always)]
    pub(crate) fn axes(&self, frames: &Frames, S: &mut Motions) {
        for k in pairs::<N>() {
            let (z, p) = (frames.z.pair(k), frames.p.pair(k));
            let (turns, slides) = self.bodies.kinds(k);
            let w = z * turns;
            S.w.put(k, &w);
            S.v.put(k, &(p.cross(&w) + z * slides));
        }
    }

    /// Pose of the end-effector frame in the base, `X_BE`.
    pub fn forward_kinematics(&self, q: &SVector<f64, N>) -> Pose {
        self.end(&self.frames(q))
    }

    /// Poses of the links' URDF frames in the base, `X_BL`.
    pub fn link_poses(&self, q: &SVector<f64, N>) -> [Pose; N] {
        let frames = self.frames(q);
        std::array::from_fn(|i| frames.pose(i) * Pose::rotation(self.bodies.R_urdf[i]))
    }

    /// Geometric Jacobian: [v; ω] = J·q̇ of the end-effector frame's origin, base axes, 6×N.
    pub fn jacobian(&self, q: &SVector<f64, N>) -> SMatrix<f64, 6, N> {
        let (frames, mut S) = (self.frames(q), Motions::ZERO);
        self.axes(&frames, &mut S);
        self.jacobian_at(&S, &self.end(&frames).p)
    }

    #[inline(always)]
    pub(crate) fn jacobian_at(&self, S: &Motions, p_E: &Vector3<f64>) -> SMatrix<f64, 6, N> {
        let p_E = p_E.map(Pair::splat);
        let mut linear = Vectors::ZERO;
        for k in pairs::<N>() {
            let S: Motion = S.pair(k);
            linear.put(k, &S.at(&p_E));
        }
        let moving = self.ee_body.map_or(0, |i| i + 1);
        let rows: [&PerJoint; 6] = [&linear.x, &linear.y, &linear.z, &S.w.x, &S.w.y, &S.w.z];
        SMatrix::from_fn(|row, joint| if joint < moving { rows[row].0[joint] } else { 0.0 })
    }
}

#[inline(always)]
pub(crate) fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}
