//! The rigid-body algorithms of a serial chain.

// One joint's index runs through several arrays at once.
#![allow(clippy::needless_range_loop)]

use crate::arm::Model;
use crate::body::{Moves, column};
use crate::kinematics::stack;
use crate::pose::Pose;
use crate::spatial::{ArticulatedInertia, Force, Motion, RigidInertia, times};
use crate::terms::Terms;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

/// The end-effector's motion and the arm's energy in one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmMotion {
    /// Pose of E in the base.
    pub X_BE: Pose,
    /// Twist of E, [v; ω], base axes; m/s, rad/s.
    pub V_BE: Vector6<f64>,
    /// Kinetic and potential energy; J.
    pub energy: f64,
}

impl<const N: usize> Model<N> {
    /// All terms of the equation of motion and of the end-effector's kinematics, in one pass.
    ///
    /// A·q̈ + C·q̇ + g = τ; v = J·q̇, v̇ = J·q̈ + J̇·q̇.
    ///
    /// Newton–Euler recursion outwards, composite-rigid-body algorithm inwards [RBDA Ch. 5, 6], in base axes.
    /// Requires finite arguments. Cost O(N²), no allocation.
    pub fn evaluate(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> Terms<N> {
        let mut t = Terms::ZERO;
        self.evaluate_into(q, qdot, &mut t);
        t
    }

    /// [`evaluate`](Self::evaluate) into place: `t` is overwritten whole.
    pub fn evaluate_into(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, t: &mut Terms<N>) {
        let mut S = [Motion::ZERO; N];
        let mut I = [RigidInertia::ZERO; N];
        let mut f = [Force::ZERO; N];

        // Outwards. X, ω, α, v, a: pose, angular velocity and acceleration of a link, velocity and acceleration of its
        // origin, all at q̈ = 0; first the parent's, then this link's.
        let mut X = Pose::identity();
        let (mut w, mut alpha) = (Vector3::zeros(), Vector3::zeros());
        let (mut v, mut a) = (Vector3::zeros(), Vector3::zeros());
        for i in 0..N {
            let body = &self.bodies[i];
            let p_parent = X.p;
            S[i] = body.step(&mut X, q[i]);
            let r = X.p - p_parent;
            let w_r = w.cross(&r);
            v += w_r;
            a += alpha.cross(&r) + w.cross(&w_r);
            let z = column(&X.R, 2);
            let rate = z * qdot[i];
            match body.moves {
                Moves::Turns => {
                    alpha += w.cross(&rate);
                    w += rate;
                }
                Moves::Slides => {
                    v += rate;
                    a += 2.0 * w.cross(&rate);
                }
                Moves::Absent => {}
            }
            t.z[i] = z;
            t.p[i] = X.p;
            t.omega[i] = w;
            t.alpha_bias[i] = alpha;
            t.pdot[i] = v;
            t.pddot_bias[i] = a;

            // Newton and Euler at the centre of mass c; the moment is then taken about the base origin.
            let c_L = times(&X.R, &body.com);
            let c = X.p + c_L;
            let inertia = body.inertia.rotated(&X.R);
            let force = body.mass * (a + alpha.cross(&c_L) + w.cross(&w.cross(&c_L)));
            let moment = inertia * alpha + w.cross(&(inertia * w));
            f[i] = Force { n: moment + c.cross(&force), f: force };
            I[i] = RigidInertia { m: body.mass, h: body.mass * c, I: inertia.shifted(body.mass, &c) };

            if self.ee_body == Some(i) {
                t.X_BE = X * self.X_LE;
                let r = t.X_BE.p - X.p;
                t.Jdot_qdot = stack(&(a + alpha.cross(&r) + w.cross(&w.cross(&r))), &alpha);
            }
        }
        if self.ee_body.is_none() {
            t.X_BE = self.X_LE;
            t.Jdot_qdot = Vector6::zeros();
        }

        // Inwards. I, f: composite inertia of, and force on, all links from i on.
        let (mut I_c, mut f_c) = (RigidInertia::ZERO, Force::ZERO);
        for i in (0..N).rev() {
            I_c += I[i];
            f_c += f[i];
            let F = I_c.times(&S[i]);
            for j in 0..=i {
                let A_ji = S[j].dot(&F);
                t.A[(j, i)] = A_ji;
                t.A[(i, j)] = A_ji;
            }
            t.A[(i, i)] += self.armature[i];
            t.coriolis[i] = S[i].dot(&f_c);
            t.gravity[i] = -F.f.dot(&self.gravity);
        }
        t.J = self.jacobian_at(&S, &t.X_BE.p);
    }

    /// Mass matrix A(q), armature included: composite-rigid-body algorithm [RBDA Ch. 6].
    pub fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let mut S = [Motion::ZERO; N];
        let mut I = [RigidInertia::ZERO; N];
        self.outwards(q, |i, body, X, S_i| {
            S[i] = S_i;
            I[i] = body.inertia_at(X);
        });
        self.composite(&S, &I)
    }

    /// A(q) of links with the joint axes `S` and the inertias `I`.
    #[inline(always)]
    fn composite(&self, S: &[Motion; N], I: &[RigidInertia; N]) -> SMatrix<f64, N, N> {
        let mut A = SMatrix::<f64, N, N>::zeros();
        let mut I_c = RigidInertia::ZERO;
        for i in (0..N).rev() {
            I_c += I[i];
            let F = I_c.times(&S[i]);
            for j in 0..=i {
                let A_ji = S[j].dot(&F);
                A[(j, i)] = A_ji;
                A[(i, j)] = A_ji;
            }
            A[(i, i)] += self.armature[i];
        }
        A
    }

    /// Pose and twist of the end-effector and mechanical energy, in one pass: those of [`forward_kinematics`](Self::forward_kinematics),
    /// [`jacobian`](Self::jacobian), [`kinetic_energy`](Self::kinetic_energy) and [`potential_energy`](Self::potential_energy), to the last bit.
    pub fn motion(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> ArmMotion {
        let mut S = [Motion::ZERO; N];
        let mut I = [RigidInertia::ZERO; N];
        let (mut X_BE, mut V) = (self.X_LE, 0.0);
        self.outwards(q, |i, body, X, S_i| {
            S[i] = S_i;
            I[i] = body.inertia_at(X);
            V -= body.mass * self.gravity.dot(&X.transform_point(&body.com));
            if self.ee_body == Some(i) {
                X_BE = *X * self.X_LE;
            }
        });
        let kinetic = 0.5 * qdot.dot(&(self.composite(&S, &I) * qdot));
        ArmMotion { X_BE, V_BE: self.jacobian_at(&S, &X_BE.p) * qdot, energy: kinetic + V }
    }

    /// Inverse dynamics τ = A·q̈ + C·q̇ + g, armature included: recursive Newton–Euler algorithm [RBDA Ch. 5].
    pub fn inverse_dynamics(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, qddot: &SVector<f64, N>) -> SVector<f64, N> {
        let mut S = [Motion::ZERO; N];
        let mut f = [Force::ZERO; N];
        // Gravity as an upward acceleration of the base.
        let (mut v, mut a) = (Motion::ZERO, Motion::along(-self.gravity));
        self.outwards(q, |i, body, X, S_i| {
            let s = S_i * qdot[i];
            v = v + s;
            a = a + v.cross(&s) + S_i * qddot[i];
            let I = body.inertia_at(X);
            f[i] = I.times(&a) + v.cross_force(&I.times(&v));
            S[i] = S_i;
        });
        let mut tau = SVector::<f64, N>::zeros();
        let mut f_c = Force::ZERO;
        for i in (0..N).rev() {
            f_c += f[i];
            tau[i] = S[i].dot(&f_c) + self.armature[i] * qddot[i];
        }
        tau
    }

    /// Gravity torques g(q): the torques that hold the arm still, N·m (N for a sliding joint).
    pub fn gravity(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        let mut S = [Motion::ZERO; N];
        let mut weight = [Force::ZERO; N];
        self.outwards(q, |i, body, X, S_i| {
            let force = body.mass * self.gravity;
            weight[i] = Force { n: X.transform_point(&body.com).cross(&force), f: force };
            S[i] = S_i;
        });
        let mut tau = SVector::<f64, N>::zeros();
        let mut f_c = Force::ZERO;
        for i in (0..N).rev() {
            f_c += weight[i];
            tau[i] = -S[i].dot(&f_c);
        }
        tau
    }

    /// Bias torques C(q, q̇)·q̇ + g(q).
    pub fn bias(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> SVector<f64, N> {
        self.inverse_dynamics(q, qdot, &SVector::zeros())
    }

    /// Forward dynamics q̈ = A⁻¹(τ − C·q̇ − g), armature included: articulated-body algorithm [RBDA Ch. 7].
    pub fn forward_dynamics(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N> {
        let mut S = [Motion::ZERO; N];
        let mut c = [Motion::ZERO; N];
        let mut I = [RigidInertia::ZERO; N];
        let mut p = [Force::ZERO; N];
        let mut v = Motion::ZERO;
        self.outwards(q, |i, body, X, S_i| {
            let s = S_i * qdot[i];
            v = v + s;
            c[i] = v.cross(&s);
            I[i] = body.inertia_at(X);
            p[i] = v.cross_force(&I[i].times(&v));
            S[i] = S_i;
        });

        let mut U = [Force::ZERO; N];
        let mut D = [0.0; N];
        let mut u = [0.0; N];
        let mut I_A = ArticulatedInertia::from(RigidInertia::ZERO);
        let mut p_A = Force::ZERO;
        for i in (0..N).rev() {
            I_A += I[i].into();
            p_A += p[i];
            U[i] = I_A.times(&S[i]);
            D[i] = S[i].dot(&U[i]) + self.armature[i];
            u[i] = tau[i] - S[i].dot(&p_A);
            // Nothing is handed on to the base, which does not move.
            if i > 0 {
                I_A = I_A.without(&U[i], D[i]);
                p_A += I_A.times(&c[i]) + U[i] * (u[i] / D[i]);
            }
        }

        let mut qddot = SVector::<f64, N>::zeros();
        let mut a = Motion::along(-self.gravity);
        for i in 0..N {
            a = a + c[i];
            qddot[i] = (u[i] - a.dot(&U[i])) / D[i];
            a = a + S[i] * qddot[i];
        }
        qddot
    }

    /// Kinetic energy ½·q̇ᵀ·A·q̇, the rotors' included, J.
    pub fn kinetic_energy(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> f64 {
        0.5 * qdot.dot(&(self.mass_matrix(q) * qdot))
    }

    /// Potential energy −Σ m·gᵀ·c, zero with every centre of mass at the base origin, J.
    pub fn potential_energy(&self, q: &SVector<f64, N>) -> f64 {
        let mut V = 0.0;
        self.outwards(q, |_, body, X, _| V -= body.mass * self.gravity.dot(&X.transform_point(&body.com)));
        V
    }
}
