//! The rigid-body algorithms of a serial chain.

// One joint's index runs through several arrays at once.
#![allow(clippy::needless_range_loop)]

use crate::arm::Model;
use crate::body::{Moves, column};
use crate::kinematics::stack;
use crate::pose::Pose;
use crate::spatial::{Force, Motion, ORIGIN, RigidInertia, times};
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

/// The links in one state, base axes: joint axes, inertias, and the forces that their motion takes.
struct Links<const N: usize> {
    S: [Motion; N],
    I: [RigidInertia; N],
    f: [Force; N],
}

impl<const N: usize> Links<N> {
    const ZERO: Self = Self { S: [Motion::ZERO; N], I: [RigidInertia::ZERO; N], f: [Force::ZERO; N] };
}

/// A link's angular velocity and acceleration, and velocity and acceleration of its origin, all at q̈ = 0.
struct Rates {
    w: Vector3<f64>,
    alpha: Vector3<f64>,
    v: Vector3<f64>,
    a: Vector3<f64>,
}

impl Rates {
    const REST: Self = Self { w: ORIGIN, alpha: ORIGIN, v: ORIGIN, a: ORIGIN };

    /// From the parent link's to this one's: origins `r` apart, the joint at the rate `rate`.
    #[inline(always)]
    fn step(&mut self, r: &Vector3<f64>, moves: Moves, rate: &Vector3<f64>) {
        let w_r = self.w.cross(r);
        self.v += w_r;
        self.a += self.alpha.cross(r) + self.w.cross(&w_r);
        match moves {
            Moves::Turns => {
                self.alpha += self.w.cross(rate);
                self.w += rate;
            }
            Moves::Slides => {
                self.v += rate;
                self.a += 2.0 * self.w.cross(rate);
            }
            Moves::Absent => {}
        }
    }

    /// Acceleration of the link's point at `r` from its origin.
    #[inline(always)]
    fn acceleration(&self, r: &Vector3<f64>) -> Vector3<f64> {
        self.a + self.alpha.cross(r) + self.w.cross(&self.w.cross(r))
    }
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
        let mut links = Links::ZERO;
        self.links(q, qdot, Vector3::zeros(), &mut links, |i, X, rates| {
            t.z[i] = column(&X.R, 2);
            t.p[i] = X.p;
            t.omega[i] = rates.w;
            t.alpha_bias[i] = rates.alpha;
            t.pdot[i] = rates.v;
            t.pddot_bias[i] = rates.a;
            if self.ee_body == Some(i) {
                t.X_BE = *X * self.X_LE;
                t.Jdot_qdot = stack(&rates.acceleration(&(t.X_BE.p - X.p)), &rates.alpha);
            }
        });
        if self.ee_body.is_none() {
            t.X_BE = self.X_LE;
            t.Jdot_qdot = Vector6::zeros();
        }

        // Inwards. I, f: composite inertia of, and force on, all links from i on.
        let Links { S, I, f } = &links;
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
        t.J = self.jacobian_at(S, &t.X_BE.p);
    }

    /// Outwards [RBDA Ch. 5]: each link's joint axis, its inertia, and the force that its motion at q̈ = 0 takes, with the base accelerated by `a_B`.
    #[inline(always)]
    fn links(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        a_B: Vector3<f64>,
        links: &mut Links<N>,
        mut visit: impl FnMut(usize, &Pose, &Rates),
    ) {
        let mut X = Pose::identity();
        let mut rates = Rates { a: a_B, ..Rates::REST };
        for i in 0..N {
            let body = &self.bodies[i];
            let p_parent = X.p;
            links.S[i] = body.step(&mut X, q[i]);
            rates.step(&(X.p - p_parent), body.moves, &(column(&X.R, 2) * qdot[i]));
            visit(i, &X, &rates);

            // Newton and Euler at the centre of mass c; the moment is then taken about the base origin.
            let c_L = times(&X.R, &body.com);
            let c = X.p + c_L;
            let inertia = body.inertia.rotated(&X.R);
            let force = body.mass * rates.acceleration(&c_L);
            let moment = inertia * rates.alpha + rates.w.cross(&(inertia * rates.w));
            links.f[i] = Force { n: moment + c.cross(&force), f: force };
            links.I[i] = RigidInertia { m: body.mass, h: body.mass * c, I: inertia.shifted(body.mass, &c) };
        }
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

    /// Forward dynamics q̈ = A⁻¹(τ − C·q̇ − g), armature included: A by composite inertias, bias torques by Newton and Euler, A = L·D·Lᵀ [RBDA §6.2, 6.5].
    ///
    /// For six or seven joints this takes fewer operations than the articulated-body algorithm. Requires A positive definite.
    pub fn forward_dynamics(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N> {
        let mut links = Links::ZERO;
        // Gravity as an upward acceleration of the base.
        self.links(q, qdot, -self.gravity, &mut links, |_, _, _| {});
        let Links { S, I, f } = &links;
        let A = self.composite(S, I);
        let mut x = *tau;
        let mut f_c = Force::ZERO;
        for i in (0..N).rev() {
            f_c += f[i];
            x[i] -= S[i].dot(&f_c);
        }
        solve(A, x)
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

/// Solves A·x = b for a positive definite A: A = L·D·Lᵀ, in place.
#[inline(always)]
fn solve<const N: usize>(mut A: SMatrix<f64, N, N>, mut b: SVector<f64, N>) -> SVector<f64, N> {
    let mut reciprocal = [0.0; N];
    for k in 0..N {
        reciprocal[k] = 1.0 / A[(k, k)];
        for j in k + 1..N {
            let l = A[(j, k)] * reciprocal[k];
            for i in j..N {
                A[(i, j)] -= A[(i, k)] * l;
            }
            b[j] -= b[k] * l;
        }
    }
    for k in (0..N).rev() {
        // The column k of A is that of L, times D.
        let mut sum = b[k];
        for i in k + 1..N {
            sum -= A[(i, k)] * b[i];
        }
        b[k] = sum * reciprocal[k];
    }
    b
}
