//! The rigid-body algorithms of a serial chain.

use crate::arm::Model;
use crate::body::Frames;
use crate::kinematics::stack;
use crate::lanes::{Pair, PerJoint, Vectors, pairs, widest};
use crate::pose::Pose;
use crate::spatial::{Force, Forces, Motions, ORIGIN, RigidInertias, Sym3, dot};
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
        solve(self.A, tau - self.bias)
    }
}

impl<const N: usize> Terms<N> {
    /// q̈ under the joint torques `tau`: A⁻¹(τ − C·q̇ − g). Requires A positive definite.
    pub fn qddot(&self, tau: &SVector<f64, N>) -> SVector<f64, N> {
        solve(self.A, tau - self.bias())
    }
}

/// The links in one state, base axes: joint axes, motion, inertias, and the forces that their motion takes.
struct Links {
    frames: Frames,
    S: Motions,
    rates: Rates,
    I: RigidInertias,
    f: Forces,
}

impl Links {
    const ZERO: Self = Self { frames: Frames::ZERO, S: Motions::ZERO, rates: Rates::ZERO, I: RigidInertias::ZERO, f: Forces::ZERO };
}

/// The links' angular velocities and accelerations, and velocities and accelerations of their origins.
struct Rates {
    w: Vectors,
    alpha: Vectors,
    v: Vectors,
    a: Vectors,
}

impl Rates {
    const ZERO: Self = Self { w: Vectors::ZERO, alpha: Vectors::ZERO, v: Vectors::ZERO, a: Vectors::ZERO };
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
    pub(crate) fn evaluate_anywhere(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, t: &mut Terms<N>) {
        let mut links = Links::ZERO;
        self.links(q, qdot, None, Vector3::zeros(), &mut links);
        let rates = &links.rates;
        for i in 0..N {
            (t.z[i], t.p[i]) = (links.frames.z.get(i), links.frames.p.get(i));
            (t.omega[i], t.alpha_bias[i]) = (rates.w.get(i), rates.alpha.get(i));
            (t.pdot[i], t.pddot_bias[i]) = (rates.v.get(i), rates.a.get(i));
        }
        t.X_BE = self.end(&links.frames);
        t.J = self.jacobian_at(&links.S, &t.X_BE.p);
        t.Jdot_qdot = self.ee_body.map_or_else(Vector6::zeros, |i| {
            let (w, alpha, r) = (t.omega[i], t.alpha_bias[i], t.X_BE.p - t.p[i]);
            stack(&(t.pddot_bias[i] + alpha.cross(&r) + w.cross(&w.cross(&r))), &alpha)
        });

        links.I.summed_inwards::<N>();
        links.f.summed_inwards::<N>();
        let (mut coriolis, mut gravity) = (PerJoint::ZERO, PerJoint::ZERO);
        let g = self.gravity.map(Pair::splat);
        t.A = self.composite(&links.S, &links.I, |k, F| {
            coriolis.put(k, links.S.pair(k).dot(&links.f.pair(k)));
            gravity.put(k, -dot(&F.f, &g));
        });
        t.coriolis = SVector::from_fn(|i, _| coriolis.0[i]);
        t.gravity = SVector::from_fn(|i, _| gravity.0[i]);
    }

    /// Outwards [RBDA Ch. 5]: each link's joint axis, motion and inertia, and the force that its motion takes at the joint accelerations `qddot` (zero
    /// for `None`), with the base accelerated by `a_B`.
    #[inline(always)]
    fn links(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, qddot: Option<&SVector<f64, N>>, a_B: Vector3<f64>, links: &mut Links) {
        let Links { frames, S, rates, I, f } = links;
        self.bodies.outwards(q, frames);
        self.axes(frames, S);
        self.rates(frames, &PerJoint::of(qdot), qddot.map(PerJoint::of), &a_B, rates);
        self.inertias(frames, I, |k, m, c_L, c, inertia| {
            // Newton and Euler at the centre of mass c; the moment is then taken about the base origin.
            let (w, alpha) = (rates.w.pair(k), rates.alpha.pair(k));
            let force = (rates.a.pair(k) + alpha.cross(c_L) + w.cross(&w.cross(c_L))) * m;
            let moment = inertia.times(&alpha) + w.cross(&inertia.times(&w));
            f.put(k, &Force { n: moment + c.cross(&force), f: force });
        });
    }

    /// The links' motion: what each joint adds to its parent's, then the sums from the base on.
    #[inline(always)]
    fn rates(&self, frames: &Frames, qdot: &PerJoint, qddot: Option<PerJoint>, a_B: &Vector3<f64>, added: &mut Rates) {
        let along = |k: usize, values: &PerJoint| {
            let ((turns, slides), z, values) = (self.bodies.kinds(k), frames.z.pair(k), values.pair(k));
            (z * (turns * values), z * (slides * values))
        };
        for k in pairs::<N>() {
            added.w.put(k, &along(k, qdot).0);
        }
        let w_parent = added.w.summed_outwards::<N>(&ORIGIN);
        for k in pairs::<N>() {
            let mut alpha = w_parent.pair(k).cross(&added.w.pair(k));
            if let Some(qddot) = &qddot {
                alpha += along(k, qddot).0;
            }
            added.alpha.put(k, &alpha);
        }
        let alpha_parent = added.alpha.summed_outwards::<N>(&ORIGIN);
        for k in pairs::<N>() {
            let (w, r, sliding) = (w_parent.pair(k), frames.r.pair(k), along(k, qdot).1);
            let v = w.cross(&r) + sliding;
            let mut a = alpha_parent.pair(k).cross(&r) + w.cross(&(v + sliding));
            if let Some(qddot) = &qddot {
                a += along(k, qddot).1;
            }
            added.v.put(k, &v);
            added.a.put(k, &a);
        }
        let (v_parent, a_parent) = (added.v.summed_outwards::<N>(&ORIGIN), added.a.summed_outwards::<N>(a_B));
        for k in pairs::<N>() {
            added.w.put(k, &(w_parent.pair(k) + added.w.pair(k)));
            added.alpha.put(k, &(alpha_parent.pair(k) + added.alpha.pair(k)));
            added.v.put(k, &(v_parent.pair(k) + added.v.pair(k)));
            added.a.put(k, &(a_parent.pair(k) + added.a.pair(k)));
        }
    }

    /// The links' inertias about the base origin. Passed to `visit`, pair by pair: mass, centre of mass from the link's origin and from the base's, and
    /// inertia about it.
    #[inline(always)]
    fn inertias(&self, frames: &Frames, I: &mut RigidInertias, mut visit: impl FnMut(usize, Pair, &Vector3<Pair>, &Vector3<Pair>, &Sym3)) {
        for k in pairs::<N>() {
            let (R, m) = (frames.axes(k), self.bodies.mass.pair(k));
            let c_L = R.turn(&self.bodies.com.pair(k));
            let c = frames.p.pair(k) + c_L;
            let inertia = self.bodies.inertia.rotated(k, &R);
            let h = c * m;
            I.put(k, m, &h, &inertia.shifted(&h, &c));
            visit(k, m, &c_L, &c, &inertia);
        }
    }

    /// Mass matrix A(q), armature included: composite-rigid-body algorithm [RBDA Ch. 6].
    pub fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let (frames, mut S) = (self.frames(q), Motions::ZERO);
        self.axes(&frames, &mut S);
        self.composite(&S, &self.composites(&frames), |_, _| {})
    }

    /// Of each link the inertia of the rigid body of it and all beyond it.
    #[inline(always)]
    fn composites(&self, frames: &Frames) -> RigidInertias {
        let mut I = RigidInertias::ZERO;
        self.inertias(frames, &mut I, |_, _, _, _, _| {});
        I.summed_inwards::<N>();
        I
    }

    /// A(q) of links with the joint axes `S`, each link's inertia in `I` with all beyond it. The momenta at unit speed of each joint are passed to `visit`.
    #[inline(always)]
    fn composite(&self, S: &Motions, I: &RigidInertias, mut visit: impl FnMut(usize, &Force)) -> SMatrix<f64, N, N> {
        let mut A = SMatrix::<f64, N, N>::zeros();
        let mut set = |i: usize, j: usize, A_ij: f64| {
            if i < N && j < N {
                A[(i, j)] = A_ij;
                A[(j, i)] = A_ij;
            }
        };
        for k in pairs::<N>() {
            let F = I.times(k, &S.pair(k));
            visit(k, &F);
            let (first, second) = (2 * k, 2 * k + 1);
            for l in 0..k {
                let [same, other] = [S.pair(l).dot(&F).to_array(), S.swapped(l).dot(&F).to_array()];
                set(2 * l, first, same[0]);
                set(2 * l + 1, second, same[1]);
                set(2 * l + 1, first, other[0]);
                set(2 * l, second, other[1]);
            }
            let [same, other] = [S.pair(k).dot(&F).to_array(), S.swapped(k).dot(&F).to_array()];
            set(first, first, same[0]);
            set(second, second, same[1]);
            set(first, second, other[1]);
        }
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
    pub(crate) fn motion_anywhere(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> ArmMotion<N> {
        let mut links = Links::ZERO;
        self.links(q, qdot, None, -self.gravity, &mut links);
        links.I.summed_inwards::<N>();
        let A = self.composite(&links.S, &links.I, |_, _| {});
        let bias = self.carried(&links.S, &mut links.f);
        let energy = 0.5 * qdot.dot(&(A * qdot)) + self.potential(&links.I);
        let X_BE = self.end(&links.frames);
        ArmMotion { X_BE, V_BE: self.jacobian_at(&links.S, &X_BE.p) * qdot, energy, A, bias }
    }

    /// Inverse dynamics τ = A·q̈ + C·q̇ + g, armature included: recursive Newton–Euler algorithm [RBDA Ch. 5].
    pub fn inverse_dynamics(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, qddot: &SVector<f64, N>) -> SVector<f64, N> {
        // Gravity as an upward acceleration of the base.
        let mut links = Links::ZERO;
        self.links(q, qdot, Some(qddot), -self.gravity, &mut links);
        self.carried(&links.S, &mut links.f) + self.armature.component_mul(qddot)
    }

    /// The joint torques of forces `f` on the links; each link's is then that with all beyond it.
    #[inline(always)]
    fn carried(&self, S: &Motions, f: &mut Forces) -> SVector<f64, N> {
        f.summed_inwards::<N>();
        let mut tau = PerJoint::ZERO;
        for k in pairs::<N>() {
            tau.put(k, S.pair(k).dot(&f.pair(k)));
        }
        SVector::from_fn(|i, _| tau.0[i])
    }

    /// Gravity torques g(q): the torques that hold the arm still, N·m (N for a sliding joint).
    pub fn gravity(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        let (frames, mut S) = (self.frames(q), Motions::ZERO);
        self.axes(&frames, &mut S);
        let (I, g) = (self.composites(&frames), self.gravity.map(Pair::splat));
        let mut tau = PerJoint::ZERO;
        for k in pairs::<N>() {
            tau.put(k, -dot(&I.times(k, &S.pair(k)).f, &g));
        }
        SVector::from_fn(|i, _| tau.0[i])
    }

    /// Bias torques C(q, q̇)·q̇ + g(q).
    pub fn bias(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> SVector<f64, N> {
        let mut links = Links::ZERO;
        self.links(q, qdot, None, -self.gravity, &mut links);
        self.carried(&links.S, &mut links.f)
    }

    /// Forward dynamics q̈ = A⁻¹(τ − C·q̇ − g), armature included: A by composite inertias, bias torques by Newton and Euler, A = L·D·Lᵀ [RBDA §6.2, 6.5].
    ///
    /// For six or seven joints this takes fewer operations than the articulated-body algorithm. Requires A positive definite.
    pub fn forward_dynamics(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N> {
        let arm = self;
        widest!(qddot_anywhere(arm: &Model<N>, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N>)
    }

    #[inline(always)]
    pub(crate) fn qddot_anywhere(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, tau: &SVector<f64, N>) -> SVector<f64, N> {
        // Gravity as an upward acceleration of the base.
        let mut links = Links::ZERO;
        self.links(q, qdot, None, -self.gravity, &mut links);
        links.I.summed_inwards::<N>();
        let A = self.composite(&links.S, &links.I, |_, _| {});
        solve(A, tau - self.carried(&links.S, &mut links.f))
    }

    /// Kinetic energy ½·q̇ᵀ·A·q̇, the rotors' included, J.
    pub fn kinetic_energy(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> f64 {
        0.5 * qdot.dot(&(self.mass_matrix(q) * qdot))
    }

    /// Potential energy −Σ m·gᵀ·c, zero with every centre of mass at the base origin, J.
    pub fn potential_energy(&self, q: &SVector<f64, N>) -> f64 {
        self.potential(&self.composites(&self.frames(q)))
    }

    /// The potential energy of links with the composite inertias `I`: all masses are in the first.
    #[inline(always)]
    fn potential(&self, I: &RigidInertias) -> f64 {
        -self.gravity.dot(&I.h.get(0))
    }
}

/// Solves A·x = b for a positive definite A: A = L·D·Lᵀ, in place.
// One joint's index runs through several arrays at once.
#[allow(clippy::needless_range_loop)]
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
