//! The rigid-body algorithms of a serial chain.

use crate::arm::Model;
use crate::body::Frames;
use crate::kinematics::stack;
use crate::lanes::{Number, PerJoint, Row, V3, Vectors, widest};
use crate::pose::Pose;
use crate::spatial::{Forces, Motions, RigidInertias, Sym3};
use crate::terms::Terms;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

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
}

impl<const N: usize> Terms<N> {
    /// q̈ under the joint torques `tau`: A⁻¹(τ − C·q̇ − g). Requires A positive definite.
    pub fn qddot(&self, tau: &SVector<f64, N>) -> SVector<f64, N> {
        Factored::of(self.A).solve(tau - self.bias())
    }
}

/// The links in one state, base axes: joint axes, motion, inertias, and the forces that their motion takes.
struct Links<R: Row<N>, const N: usize> {
    frames: Frames<R, N>,
    S: Motions<R>,
    rates: Rates<R>,
    I: RigidInertias<R>,
    f: Forces<R>,
}

/// The arm in one posture: what its acceleration follows from at any velocity.
pub(crate) struct Posed<R: Row<N>, const N: usize> {
    frames: Frames<R, N>,
    S: Motions<R>,
    masses: Masses<R>,
    A: Factored<N>,
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
        let mut t = Terms::ZERO;
        self.evaluate_into(q, qdot, &mut t);
        t
    }

    /// [`evaluate`](Self::evaluate) into place: `t` is overwritten whole.
    pub fn evaluate_into(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, t: &mut Terms<N>) {
        let arm = self;
        widest!(evaluate_anywhere(arm: &Model<N>, q: &SVector<f64, N>, qdot: &SVector<f64, N>, t: &mut Terms<N>) -> ())
    }

    #[inline(always)]
    pub(crate) fn evaluate_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        t: &mut Terms<N>,
    ) {
        let Links {
            frames,
            S,
            rates,
            I,
            f,
        } = self.links::<R>(q, qdot, None, &Vector3::zeros());
        put(&mut t.z, frames.axes.z.store());
        put(&mut t.p, frames.p.store());
        put(&mut t.omega, rates.w.store());
        put(&mut t.alpha_bias, rates.alpha.store());
        put(&mut t.pdot, rates.v.store());
        put(&mut t.pddot_bias, rates.a.store());
        t.X_BE = self.end(&frames);
        t.J = self.jacobian_at(&S, &t.X_BE.p);
        t.Jdot_qdot = self.ee_body.map_or_else(Vector6::zeros, |i| {
            let (w, alpha, r) = (t.omega[i], t.alpha_bias[i], t.X_BE.p - t.p[i]);
            stack(
                &(t.pddot_bias[i] + alpha.cross(&r) + w.cross(&w.cross(&r))),
                &alpha,
            )
        });
        let F = I.times(&S);
        t.A = self.composite(&S, &F);
        t.coriolis = S.dot(&f.inwards()).store().first();
        t.gravity = F.f.dot(V3::splat(&-self.gravity)).store().first();
    }

    /// Outwards [RBDA Ch. 5]: each link's joint axis and motion, the force that its motion takes at the joint accelerations `qddot` (zero for `None`)
    /// with the base accelerated by `a_B`, and the inertia of the rigid body of it and all beyond it.
    #[inline(always)]
    fn links<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        qddot: Option<&SVector<f64, N>>,
        a_B: &Vector3<f64>,
    ) -> Links<R, N> {
        let frames = self.bodies.outwards::<R>(R::of(q));
        let S = self.axes(&frames);
        let rates = self.rates(&frames, &S, R::of(qdot), qddot, a_B);
        let masses = self.masses(&frames);
        Links {
            I: masses.about_base().inwards(),
            f: rates.forces(&masses),
            frames,
            S,
            rates,
        }
    }

    /// The links' motion: what each joint adds to its parent's, summed from the base on.
    #[inline(always)]
    fn rates<R: Row<N>>(
        &self,
        frames: &Frames<R, N>,
        S: &Motions<R>,
        qdot: R,
        qddot: Option<&SVector<f64, N>>,
        a_B: &Vector3<f64>,
    ) -> Rates<R> {
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

    #[inline(always)]
    fn masses<R: Row<N>>(&self, frames: &Frames<R, N>) -> Masses<R> {
        let m = R::load(&self.bodies.mass);
        let c_L = frames.axes.turn(V3::load(&self.bodies.com));
        let c = frames.p + c_L;
        Masses {
            m,
            c_L,
            c,
            h: c * m,
            about_c: self.bodies.inertia.rotated(&frames.axes),
        }
    }

    /// Mass matrix A(q), armature included: composite-rigid-body algorithm [RBDA Ch. 6].
    pub fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let arm = self;
        widest!(mass_matrix_anywhere(arm: &Model<N>, q: &SVector<f64, N>) -> SMatrix<f64, N, N>)
    }

    #[inline(always)]
    pub(crate) fn mass_matrix_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
    ) -> SMatrix<f64, N, N> {
        let (S, I) = self.composites::<R>(q);
        self.composite(&S, &I.times(&S))
    }

    /// The joint axes, and of each link the inertia of the rigid body of it and all beyond it.
    #[inline(always)]
    fn composites<R: Row<N>>(&self, q: &SVector<f64, N>) -> (Motions<R>, RigidInertias<R>) {
        let frames = self.bodies.outwards::<R>(R::of(q));
        (
            self.axes(&frames),
            self.masses(&frames).about_base().inwards(),
        )
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

    /// Pose and twist of the end-effector, mechanical energy, A and bias torques in one pass: those of [`forward_kinematics`](Self::forward_kinematics),
    /// [`jacobian`](Self::jacobian), [`kinetic_energy`](Self::kinetic_energy) and [`potential_energy`](Self::potential_energy), to the last bit.
    pub fn motion(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> ArmMotion<N> {
        let arm = self;
        widest!(motion_anywhere(arm: &Model<N>, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> ArmMotion<N>)
    }

    #[inline(always)]
    pub(crate) fn motion_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> ArmMotion<N> {
        let Links {
            frames, S, I, f, ..
        } = self.links::<R>(q, qdot, None, &-self.gravity);
        let A = self.composite(&S, &I.times(&S));
        let bias = S.dot(&f.inwards()).store().first();
        let energy = 0.5 * qdot.dot(&(A * qdot)) + self.potential(&I);
        let X_BE = self.end(&frames);
        ArmMotion {
            X_BE,
            V_BE: self.jacobian_at(&S, &X_BE.p) * qdot,
            energy,
            A,
            bias,
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

    /// The joint torques that bear the links' motion and weight, at zero joint accelerations for `None`.
    fn torques(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        qddot: Option<&SVector<f64, N>>,
    ) -> SVector<f64, N> {
        let arm = self;
        widest!(torques_anywhere(arm: &Model<N>, q: &SVector<f64, N>, qdot: &SVector<f64, N>, qddot: Option<&SVector<f64, N>>) -> SVector<f64, N>)
    }

    #[inline(always)]
    pub(crate) fn torques_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        qddot: Option<&SVector<f64, N>>,
    ) -> SVector<f64, N> {
        // Gravity as an upward acceleration of the base.
        let Links { S, f, .. } = self.links::<R>(q, qdot, qddot, &-self.gravity);
        S.dot(&f.inwards()).store().first()
    }

    /// Gravity torques g(q): the torques that hold the arm still, N·m (N for a sliding joint).
    pub fn gravity(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        let arm = self;
        widest!(gravity_anywhere(arm: &Model<N>, q: &SVector<f64, N>) -> SVector<f64, N>)
    }

    #[inline(always)]
    fn gravity_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        let (S, I) = self.composites::<R>(q);
        I.times(&S).f.dot(V3::splat(&-self.gravity)).store().first()
    }

    /// Bias torques C(q, q̇)·q̇ + g(q).
    pub fn bias(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> SVector<f64, N> {
        self.torques(q, qdot, None)
    }

    /// Forward dynamics q̈ = A⁻¹(τ − C·q̇ − g), armature included: A by composite inertias, bias torques by Newton and Euler, A = L·D·Lᵀ [RBDA §6.2, 6.5].
    ///
    /// For six or seven joints this takes fewer operations than the articulated-body algorithm. Requires A positive definite.
    pub fn forward_dynamics(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        let arm = self;
        widest!(qddot_anywhere(arm: &Model<N>, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N>)
    }

    #[inline(always)]
    pub(crate) fn qddot_anywhere<R: Row<N>>(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        self.qddot_in(&self.posed(R::of(q)), R::of(qdot), R::of(tau))
    }

    /// The arm at `q`.
    #[inline(always)]
    pub(crate) fn posed<R: Row<N>>(&self, q: R) -> Posed<R, N> {
        let frames = self.bodies.outwards::<R>(q);
        let (S, masses) = (self.axes(&frames), self.masses(&frames));
        // Factored first: its divisions wait for one another, and what follows does not wait for them.
        let A = Factored::of(self.composite(&S, &masses.about_base().inwards().times(&S)));
        Posed {
            frames,
            S,
            masses,
            A,
        }
    }

    /// q̈ in a posture.
    #[inline(always)]
    pub(crate) fn qddot_in<R: Row<N>>(
        &self,
        posed: &Posed<R, N>,
        qdot: R,
        tau: R,
    ) -> SVector<f64, N> {
        let Posed {
            frames,
            S,
            masses,
            A,
        } = posed;
        // Gravity as an upward acceleration of the base.
        let f = self
            .rates(frames, S, qdot, None, &-self.gravity)
            .forces(masses);
        A.solve((tau - S.dot(&f.inwards())).store().first())
    }

    /// Kinetic energy ½·q̇ᵀ·A·q̇, the rotors' included, J.
    pub fn kinetic_energy(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> f64 {
        0.5 * qdot.dot(&(self.mass_matrix(q) * qdot))
    }

    /// Potential energy −Σ m·gᵀ·c, zero with every centre of mass at the base origin, J.
    pub fn potential_energy(&self, q: &SVector<f64, N>) -> f64 {
        let arm = self;
        widest!(potential_energy_anywhere(arm: &Model<N>, q: &SVector<f64, N>) -> f64)
    }

    #[inline(always)]
    fn potential_energy_anywhere<R: Row<N>>(&self, q: &SVector<f64, N>) -> f64 {
        self.potential::<R>(&self.composites(q).1)
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
struct Factored<const N: usize> {
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
