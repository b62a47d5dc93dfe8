//! An arm in one posture as screws: its joints can be moved without the model.

use crate::linear::{
    Jacobian, Joints, Matrix3, Vector3, Vector6, angular, linear, rotation_exp, stack,
};
use nalgebra::SMatrix;

/// The joints of an arm in one posture as screws [v; ω] at C, base axes: the columns of its Jacobian there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Screws<const N: usize>(pub Jacobian<N>);

impl<const N: usize> Screws<N> {
    pub(super) fn column(&self, j: usize) -> (Vector3, Vector3) {
        let c = self.0.column(j).into_owned();
        (linear(&c), angular(&c))
    }

    /// The arm after its joints have moved by `delta`, and how far C went, m: product of exponentials.
    ///
    /// S_j' = Ad(e^{S_1 δ_1}…e^{S_{j−1} δ_{j−1}})·S_j, then carried to where C has gone.
    #[must_use]
    pub fn moved(&self, delta: &Joints<N>) -> (Self, Vector3) {
        let (mut R, mut p) = (Matrix3::identity(), Vector3::zeros());
        let mut out = *self;
        for j in 0..N {
            let (v, w) = self.column(j);
            let turned = R * w;
            out.0
                .set_column(j, &stack(&(R * v + p.cross(&turned)), &turned));
            if w == Vector3::zeros() {
                p += R * v * delta[j];
            } else {
                // The axis passes through ω×v, for C is the origin here.
                let (a, E) = (w.cross(&v), rotation_exp(&(w * delta[j])));
                p += R * (a - E * a);
                R *= E;
            }
        }
        for mut column in out.0.column_iter_mut() {
            let shift = Vector3::new(column[3], column[4], column[5]).cross(&p);
            for k in 0..3 {
                column[k] += shift[k];
            }
        }
        (out, p)
    }

    /// Q with Q_jk = a·∂J_j/∂q_k, in closed form.
    ///
    /// ∂J_j/∂q_k = [ω_k×v_j; ω_k×ω_j] for k ≤ j, [ω_j×v_k; 0] for k > j. Shape N×N; `a` a covector [linear; angular] at C.
    pub fn hessian(&self, a: &Vector6) -> SMatrix<f64, N, N> {
        let (force, torque) = (linear(a), angular(a));
        let mut axes = [Vector3::zeros(); N];
        let mut inward = [Vector3::zeros(); N];
        let mut turning = [Vector3::zeros(); N];
        for j in 0..N {
            let (v, w) = self.column(j);
            axes[j] = w;
            inward[j] = v.cross(&force);
            turning[j] = inward[j] + w.cross(&torque);
        }
        SMatrix::from_fn(|j, k| {
            if k <= j {
                axes[k].dot(&turning[j])
            } else {
                axes[j].dot(&inward[k])
            }
        })
    }

    /// J̇ along the joint motion `qdot`.
    pub fn rate(&self, qdot: &Joints<N>) -> Jacobian<N> {
        let mut out = Jacobian::<N>::zeros();
        let mut beyond = Vector3::zeros();
        let mut omega: Vector3 = (0..N).map(|k| self.column(k).1 * qdot[k]).sum();
        for j in (0..N).rev() {
            let (v, w) = self.column(j);
            out.set_column(
                j,
                &stack(&(omega.cross(&v) + w.cross(&beyond)), &omega.cross(&w)),
            );
            omega -= w * qdot[j];
            beyond += v * qdot[j];
        }
        out
    }

    /// The Jacobian with its linear rows divided by `length_m`.
    #[must_use]
    pub fn scaled(&self, length_m: f64) -> Jacobian<N> {
        let mut J = self.0;
        J.fixed_rows_mut::<3>(0).scale_mut(1.0 / length_m);
        J
    }
}
