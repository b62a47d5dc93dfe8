//! The rigid-body algorithms of a serial chain.

use crate::arm::Model;
use crate::body::Frames;
use crate::kinematics::stack;
use crate::lanes::{Number, PerJoint, Row, V3, Vectors, widest};
use crate::pose::Pose;
use crate::spatial::{Forces, Motions, RigidInertias, Sym3};
use crate::terms::Terms;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};
use shared_types::PlantState;

/// The end-effector's motion, the arm's energy, and what its acceleration follows from, in one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmMotion<const N: usize> {
    /// Pose of E in the base.
    pub X_BE: Pose,
    /// Twist of E, [v; ω], base axes; m/s, rad/s.
    pub V_BE: Vector6<f64>,
    /// Kinetic and potential energy; J.
    pub energy: f64,
    /// Mass matrix, armature included.
    pub A: SMatrix<f64, N, N>,
    /// Bias torques C·q̇ + g.
    pub bias: SVector<f64, N>,
}

impl<const N: usize> ArmMotion<N> {
    /// q̈ under the joint torques `tau`: that of [`Model::forward_dynamics`] in this state, to the last bit.
    pub fn qddot(&self, tau: &SVector<f64, N>) -> SVector<f64, N> {
        Factored::of(self.A).solve(tau - self.bias)
    }

    /// The part of a plant's truth that follows from it.
    #[must_use]
    pub fn truth(&self) -> PlantState {
        let mut truth = PlantState {
            p_BE: self.X_BE.p.into(),
            V_BE: self.V_BE.into(),
            energy_j: self.energy,
            ..PlantState::default()
        };
        truth.R_BE.copy_from_slice(self.X_BE.R.as_slice());
        truth
    }
}

impl<const N: usize> Terms<N> {
    /// q̈ under the joint torques `tau`: A⁻¹(τ − C·q̇ − g). Requires A positive definite.
    pub fn qddot(&self, tau: &SVector<f64, N>) -> SVector<f64, N> {
        Factored::of(self.A).solve(tau - self.bias())
    }
}

/// The arm in one posture, base axes: what its motion follows from at any velocity.
pub(crate) struct Posed<R: Row<N>, const N: usize> {
    frames: Frames<R, N>,
    S: Motions<R>,
    masses: Masses<R>,
}

impl<R: Row<N>, const N: usize> Posed<R, N> {
    /// Of each link the inertia of the rigid body of it and all beyond it.
    #[inline(always)]
    fn composites(&self) -> RigidInertias<R> {
        self.masses.about_base().inwards()
    }

    /// The joint torques that the links' motion takes [RBDA Ch. 5].
    #[inline(always)]
    fn torques(&self, rates: &Rates<R>) -> R {
        self.S.dot(&rates.forces(&self.masses).inwards())
    }
}

/// The links' angular velocities and accelerations, and velocities and accelerations of their origins.
struct Rates<R> {
    w: V3<R>,
    alpha: V3<R>,
    v: V3<R>,
    a: V3<R>,
}

impl<R: Number> Rates<R> {
    /// The forces that the links' motion takes. Newton and Euler at the centre of mass c; the moment is then taken about the base origin.
    #[inline(always)]
    fn forces(&self, masses: &Masses<R>) -> Forces<R> {
        let (
            Masses {
                m, c_L, c, about_c, ..
            },
            Self { w, alpha, a, .. },
        ) = (masses, self);
        let force = (*a + alpha.cross(*c_L) + w.cross(w.cross(*c_L))) * *m;
        let moment = about_c.times(*alpha) + w.cross(about_c.times(*w));
        Forces {
            n: moment + c.cross(force),
            f: force,
        }
    }
}

/// The links' masses.
struct Masses<R> {
    m: R,
    /// Centre of mass from the link's origin, and from the base's.
    c_L: V3<R>,
    c: V3<R>,
    /// First moment about the base's origin, m·c.
    h: V3<R>,
    /// Inertia about the centre of mass.
    about_c: Sym3<R>,
}

impl<R: Number> Masses<R> {
    /// Inertia about the base's origin.
    #[inline(always)]
    fn about_base(&self) -> RigidInertias<R> {
        RigidInertias {
            m: self.m,
            h: self.h,
            I: self.about_c.shifted(self.h, self.c),
        }
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
        let mut t = Terms::zero();
        self.evaluate_into(q, qdot, &mut t);
        t
    }

    widest! {
        /// [`evaluate`](Self::evaluate) into place: `t` is overwritten whole.
        pub fn evaluate_into(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, t: &mut Terms<N>) {
            evaluate_anywhere
        }
    }

    #[inline(always)]
    pub(crate) fn evaluate_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        t: &mut Terms<N>,
    ) {
        let posed = self.posed(R::of(q));
        let rates = self.rates(&posed, R::of(qdot), None, &Vector3::zeros());
        let Posed { frames, S, .. } = &posed;
        put(&mut t.z, frames.axes.z.store());
        put(&mut t.p, frames.p.store());
        put(&mut t.omega, rates.w.store());
        put(&mut t.alpha_bias, rates.alpha.store());
        put(&mut t.pdot, rates.v.store());
        put(&mut t.pddot_bias, rates.a.store());
        t.X_BE = self.end(frames);
        t.J = self.jacobian_at(S, &t.X_BE.p);
        t.Jdot_qdot = self.ee_body.map_or_else(Vector6::zeros, |i| {
            let (w, alpha, r) = (t.omega[i], t.alpha_bias[i], t.X_BE.p - t.p[i]);
            stack(
                &(t.pddot_bias[i] + alpha.cross(&r) + w.cross(&w.cross(&r))),
                &alpha,
            )
        });
        let F = posed.composites().times(S);
        t.A = self.composite(S, &F);
        t.coriolis = posed.torques(&rates).store().first();
        t.gravity = self.weighed(&F);
    }

    /// The arm at `q`.
    #[inline(always)]
    pub(crate) fn posed<R: Row<N>>(&self, q: R) -> Posed<R, N> {
        let frames = self.bodies.outwards::<R>(q);
        let c_L = frames.axes.turn(V3::load(&self.bodies.com));
        let (m, c) = (R::load(&self.bodies.mass), frames.p + c_L);
        Posed {
            S: self.axes(&frames),
            masses: Masses {
                m,
                c_L,
                c,
                h: c * m,
                about_c: self.bodies.inertia.rotated(&frames.axes),
            },
            frames,
        }
    }

    /// The links' motion at the joint accelerations `qddot` (zero for `None`) with the base accelerated by `a_B`: what each joint adds to its parent's,
    /// summed from the base on [RBDA Ch. 5].
    #[inline(always)]
    fn rates<R: Row<N>>(
        &self,
        posed: &Posed<R, N>,
        qdot: R,
        qddot: Option<&SVector<f64, N>>,
        a_B: &Vector3<f64>,
    ) -> Rates<R> {
        let Posed { frames, S, .. } = posed;
        let (_, slides) = self.bodies.kinds::<R>();
        let slide = frames.axes.z * slides;
        let r = frames.p - frames.p.parents();
        let turning = S.w * qdot;
        let w = turning.outwards();
        let w_parent = w.parents();
        let mut added = w_parent.cross(turning);
        if let Some(qddot) = qddot {
            added = added + S.w * R::of(qddot);
        }
        let alpha = added.outwards();
        let sliding = slide * qdot;
        let v = w_parent.cross(r) + sliding;
        let mut a = alpha.parents().cross(r) + w_parent.cross(v + sliding);
        if let Some(qddot) = qddot {
            a = a + slide * R::of(qddot);
        }
        Rates {
            w,
            alpha,
            v: v.outwards(),
            a: a.outwards() + V3::splat(a_B),
        }
    }

    widest! {
        /// Mass matrix A(q), armature included: composite-rigid-body algorithm [RBDA Ch. 6].
        pub fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
            mass_matrix_anywhere
        }
    }

    #[inline(always)]
    fn mass_matrix_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        self.mass_matrix_in(&self.posed(R::of(q)))
    }

    /// A in a posture.
    #[inline(always)]
    fn mass_matrix_in<R: Row<N>>(&self, posed: &Posed<R, N>) -> SMatrix<f64, N, N> {
        self.composite(&posed.S, &posed.composites().times(&posed.S))
    }

    /// A(q) of links with the joint axes `S` and the momenta `F` at unit speed of each joint alone.
    #[inline(always)]
    fn composite<R: Row<N>>(&self, S: &Motions<R>, F: &Forces<R>) -> SMatrix<f64, N, N> {
        let (n, f) = (F.n.store(), F.f.store());
        let mut columns = [PerJoint::ZERO; N];
        for (j, column) in columns.iter_mut().enumerate() {
            let F = Forces {
                n: V3::splat(&n.get(j)),
                f: V3::splat(&f.get(j)),
            };
            *column = S.dot(&F).store();
        }
        // A column is valid up to the diagonal.
        let mut A = SMatrix::from_fn(|i, j| columns[i.max(j)].0[i.min(j)]);
        for i in 0..N {
            A[(i, i)] += self.armature[i];
        }
        A
    }

    widest! {
        /// Pose and twist of the end-effector, mechanical energy, A and bias torques in one pass: those of [`forward_kinematics`](Self::forward_kinematics),
        /// [`jacobian`](Self::jacobian), [`kinetic_energy`](Self::kinetic_energy) and [`potential_energy`](Self::potential_energy), to the last bit.
        pub fn motion(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> ArmMotion<N> {
            motion_anywhere
        }
    }

    #[inline(always)]
    pub(crate) fn motion_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> ArmMotion<N> {
        let posed = self.posed(R::of(q));
        let rates = self.rates(&posed, R::of(qdot), None, &-self.gravity);
        let I = posed.composites();
        let A = self.composite(&posed.S, &I.times(&posed.S));
        let X_BE = self.end(&posed.frames);
        ArmMotion {
            X_BE,
            V_BE: self.jacobian_at(&posed.S, &X_BE.p) * qdot,
            energy: 0.5 * qdot.dot(&(A * qdot)) + self.potential(&I),
            A,
            bias: posed.torques(&rates).store().first(),
        }
    }

    /// Inverse dynamics τ = A·q̈ + C·q̇ + g, armature included: recursive Newton–Euler algorithm [RBDA Ch. 5].
    pub fn inverse_dynamics(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        qddot: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        self.torques(q, qdot, Some(qddot)) + self.armature.component_mul(qddot)
    }

    widest! {
        /// The joint torques that bear the links' motion and weight, at zero joint accelerations for `None`.
        fn torques(
            &self,
            q: &SVector<f64, N>,
            qdot: &SVector<f64, N>,
            qddot: Option<&SVector<f64, N>>
        ) -> SVector<f64, N> {
            torques_anywhere
        }
    }

    #[inline(always)]
    pub(crate) fn torques_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        qddot: Option<&SVector<f64, N>>,
    ) -> SVector<f64, N> {
        let posed = self.posed(R::of(q));
        // Gravity as an upward acceleration of the base.
        let rates = self.rates(&posed, R::of(qdot), qddot, &-self.gravity);
        posed.torques(&rates).store().first()
    }

    widest! {
        /// Gravity torques g(q): the torques that hold the arm still, N·m (N for a sliding joint).
        pub fn gravity(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
            gravity_anywhere
        }
    }

    #[inline(always)]
    fn gravity_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        let posed = self.posed(R::of(q));
        self.weighed(&posed.composites().times(&posed.S))
    }

    /// The gravity torques of links with the momenta `F` at unit speed of each joint alone.
    #[inline(always)]
    fn weighed<R: Row<N>>(&self, F: &Forces<R>) -> SVector<f64, N> {
        F.f.dot(V3::splat(&-self.gravity)).store().first()
    }

    /// Bias torques C(q, q̇)·q̇ + g(q).
    pub fn bias(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> SVector<f64, N> {
        self.torques(q, qdot, None)
    }

    widest! {
        /// Forward dynamics q̈ = A⁻¹(τ − C·q̇ − g), armature included: A by composite inertias, bias torques by Newton and Euler, A = L·D·Lᵀ
        /// [RBDA §6.2, 6.5].
        ///
        /// For six or seven joints this takes fewer operations than the articulated-body algorithm. Requires A positive definite.
        pub fn forward_dynamics(
            &self,
            q: &SVector<f64, N>,
            qdot: &SVector<f64, N>,
            tau: &SVector<f64, N>
        ) -> SVector<f64, N> {
            qddot_anywhere
        }
    }

    #[inline(always)]
    pub(crate) fn qddot_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        let posed = self.posed(R::of(q));
        // Factored first: its divisions wait for one another, and what follows does not wait for them.
        let A = self.factored(&posed);
        self.qddot_in(&posed, &A, R::of(qdot), R::of(tau))
    }

    /// A in a posture, as its factors.
    #[inline(always)]
    pub(crate) fn factored<R: Row<N>>(&self, posed: &Posed<R, N>) -> Factored<N> {
        Factored::of(self.mass_matrix_in(posed))
    }

    /// q̈ in a posture.
    #[inline(always)]
    pub(crate) fn qddot_in<R: Row<N>>(
        &self,
        posed: &Posed<R, N>,
        A: &Factored<N>,
        qdot: R,
        tau: R,
    ) -> SVector<f64, N> {
        let rates = self.rates(posed, qdot, None, &-self.gravity);
        A.solve((tau - posed.torques(&rates)).store().first())
    }

    /// Kinetic energy ½·q̇ᵀ·A·q̇, the rotors' included, J.
    pub fn kinetic_energy(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> f64 {
        0.5 * qdot.dot(&(self.mass_matrix(q) * qdot))
    }

    widest! {
        /// Potential energy −Σ m·gᵀ·c, zero with every centre of mass at the base origin, J.
        pub fn potential_energy(&self, q: &SVector<f64, N>) -> f64 {
            potential_energy_anywhere
        }
    }

    #[inline(always)]
    fn potential_energy_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> f64 {
        self.potential(&self.posed(R::of(q)).composites())
    }

    /// The potential energy of links with the composite inertias `I`: all masses are in the first.
    #[inline(always)]
    fn potential<R: Row<N>>(&self, I: &RigidInertias<R>) -> f64 {
        -self.gravity.dot(&I.h.store().get(0))
    }
}

#[inline(always)]
fn put<const N: usize>(vectors: &mut [Vector3<f64>; N], rows: Vectors) {
    for (i, v) in vectors.iter_mut().enumerate() {
        *v = rows.get(i);
    }
}

/// A positive definite matrix as L·D·Lᵀ.
pub(crate) struct Factored<const N: usize> {
    /// Below the diagonal L·D, on it D.
    LD: SMatrix<f64, N, N>,
    /// Of D.
    reciprocal: [f64; N],
}

// One joint's index runs through several arrays at once.
#[allow(clippy::needless_range_loop)]
impl<const N: usize> Factored<N> {
    #[inline(always)]
    fn of(mut A: SMatrix<f64, N, N>) -> Self {
        let mut reciprocal = [0.0; N];
        for k in 0..N {
            reciprocal[k] = 1.0 / A[(k, k)];
            for j in k + 1..N {
                let l = A[(j, k)] * reciprocal[k];
                for i in j..N {
                    A[(i, j)] -= A[(i, k)] * l;
                }
            }
        }
        Self { LD: A, reciprocal }
    }

    /// A⁻¹·b. In each sum the term that is known last comes last.
    #[inline(always)]
    fn solve(&self, mut b: SVector<f64, N>) -> SVector<f64, N> {
        for k in 0..N {
            b[k] *= self.reciprocal[k];
            for j in k + 1..N {
                b[j] -= self.LD[(j, k)] * b[k];
            }
        }
        for k in (0..N).rev() {
            let mut sum = 0.0;
            for i in (k + 1..N).rev() {
                sum += self.LD[(i, k)] * b[i];
            }
            b[k] -= sum * self.reciprocal[k];
        }
        b
    }
}
