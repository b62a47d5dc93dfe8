//! The rigid-body algorithms of a serial chain.

// One joint's index runs through several arrays at once.
#![allow(clippy::needless_range_loop)]

use crate::pose::Pose;
use crate::robot::{Joint, JointKind, Robot};
use crate::spatial::{ArticulatedInertia, Force, LinkInertia, Motion, ORIGIN, RigidInertia, times};
use nalgebra::{ArrayStorage, Matrix3, SMatrix, SVector, Vector3, Vector6};

/// Why a robot has no model of this size or at this frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The number of joints in the type is not the robot's.
    #[error("robot '{robot}' has {actual} joints, not {expected}: use Model::<{actual}>")]
    Dof {
        /// The robot's name.
        robot: String,
        /// The type's number of joints.
        expected: usize,
        /// The robot's number of joints.
        actual: usize,
    },
    /// The robot has no such frame.
    #[error("robot '{robot}' has no frame '{frame}'; its frames are {known}")]
    UnknownFrame {
        /// The robot's name.
        robot: String,
        /// The frame asked for.
        frame: String,
        /// The frames there are.
        known: String,
    },
}

/// A moving link and its joint, in [axes](body_axes) chosen to make the work short.
#[derive(Clone, Copy, Debug)]
struct Body {
    /// This link's axes in the parent link's, at q = 0.
    R_0: Matrix3<f64>,
    /// This link's origin in the parent link's axes, at q = 0, m.
    p_0: Vector3<f64>,
    prismatic: bool,
    mass: f64,
    /// Centre of mass, link axes, m.
    com: Vector3<f64>,
    /// Inertia about the centre of mass, link axes, kg·m².
    inertia: LinkInertia,
    /// The URDF's link axes in these.
    R_urdf: Matrix3<f64>,
}

impl Body {
    /// From the parent link's pose in the base to this link's, and the joint's motion axis there.
    #[inline(always)]
    fn step(&self, X: &mut Pose, q: f64) -> Motion {
        X.p += times(&X.R, &self.p_0);
        let x = times(&X.R, &column(&self.R_0, 0));
        let y = times(&X.R, &column(&self.R_0, 1));
        let z = times(&X.R, &column(&self.R_0, 2));
        if self.prismatic {
            X.p += z * q;
            X.R = Matrix3::from_columns(&[x, y, z]);
            Motion::along(z)
        } else {
            let (s, c) = libm::sincos(q);
            X.R = Matrix3::from_columns(&[x * c + y * s, y * c - x * s, z]);
            Motion::about(z, &X.p)
        }
    }

    /// Inertia about the base origin, with the link at `X`.
    #[inline(always)]
    fn inertia_at(&self, X: &Pose) -> RigidInertia {
        let c = X.transform_point(&self.com);
        let I = self.inertia.rotated(&X.R).shifted(self.mass, &c);
        RigidInertia { m: self.mass, h: self.mass * c, I }
    }
}

/// An arm with `N` joints and one end-effector frame, ready to compute.
///
/// Immutable: every function is a pure function of its arguments, allocates nothing, and cannot fail. Finite arguments
/// give finite results; q may be any real posture, inside the limits or not.
#[derive(Clone, Debug)]
pub struct Model<const N: usize> {
    bodies: [Body; N],
    /// The link that carries E; `None` is the base.
    ee_body: Option<usize>,
    /// E in that link's axes (in the base, for the base).
    X_LE: Pose,
    gravity: Vector3<f64>,
    armature: SVector<f64, N>,
    viscous_friction: SVector<f64, N>,
    coulomb_friction: SVector<f64, N>,
    lower: SVector<f64, N>,
    upper: SVector<f64, N>,
    effort: SVector<f64, N>,
    velocity: SVector<f64, N>,
}

/// Everything a controller needs of the arm in one state, from one pass.
///
/// Base axes and SI units throughout. The equation of motion is A·q̈ + coriolis + gravity = τ.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms<const N: usize> {
    /// Mass matrix, armature included, N×N.
    pub A: SMatrix<f64, N, N>,
    /// Coriolis and centrifugal torques C(q, q̇)·q̇.
    pub coriolis: SVector<f64, N>,
    /// Gravity torques g(q): what holds the arm still.
    pub gravity: SVector<f64, N>,
    /// Geometric Jacobian at E's origin, rows [v; ω], 6×N.
    pub J: SMatrix<f64, 6, N>,
    /// J̇·q̇: the acceleration [v̇; ω̇] of E at q̈ = 0.
    pub Jdot_qdot: Vector6<f64>,
    /// Pose of E in the base.
    pub X_BE: Pose,
    /// Joint axes, unit.
    pub z: [Vector3<f64>; N],
    /// Joint (link) origins, m.
    pub p: [Vector3<f64>; N],
    /// Link angular velocities, rad/s.
    pub omega: [Vector3<f64>; N],
    /// Link angular accelerations at q̈ = 0, rad/s².
    pub alpha_bias: [Vector3<f64>; N],
    /// Velocities of the link origins, m/s.
    pub pdot: [Vector3<f64>; N],
    /// Accelerations of the link origins at q̈ = 0, m/s².
    pub pddot_bias: [Vector3<f64>; N],
}

impl<const N: usize> Terms<N> {
    const ZERO: Self = Self {
        A: SMatrix::from_array_storage(ArrayStorage([[0.0; N]; N])),
        coriolis: SMatrix::from_array_storage(ArrayStorage([[0.0; N]])),
        gravity: SMatrix::from_array_storage(ArrayStorage([[0.0; N]])),
        J: SMatrix::from_array_storage(ArrayStorage([[0.0; 6]; N])),
        Jdot_qdot: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        X_BE: Pose { R: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), p: ORIGIN },
        z: [ORIGIN; N],
        p: [ORIGIN; N],
        omega: [ORIGIN; N],
        alpha_bias: [ORIGIN; N],
        pdot: [ORIGIN; N],
        pddot_bias: [ORIGIN; N],
    };

    /// C·q̇ + g.
    pub fn bias(&self) -> SVector<f64, N> {
        self.coriolis + self.gravity
    }
}

impl<const N: usize> Model<N> {
    /// The model of `robot` with its end-effector frame at `frame` (its default frame if `None`).
    ///
    /// # Errors
    /// [`ModelError`] if `robot` does not have `N` joints, or no such frame.
    pub fn new(robot: &Robot, frame: Option<&str>) -> Result<Self, ModelError> {
        if robot.dof() != N {
            return Err(ModelError::Dof { robot: robot.name.clone(), expected: N, actual: robot.dof() });
        }
        let R_urdf: [Matrix3<f64>; N] = std::array::from_fn(|i| body_axes(&robot.joints[i]).transpose());
        let bodies = std::array::from_fn(|i| {
            let joint = &robot.joints[i];
            let to_parent = if i == 0 { Matrix3::identity() } else { R_urdf[i - 1] };
            let to_link = R_urdf[i];
            Body {
                R_0: to_parent * joint.X_PJ.R * to_link.transpose(),
                p_0: to_parent * joint.X_PJ.p,
                prismatic: joint.kind == JointKind::Prismatic,
                mass: joint.mass,
                com: to_link * joint.com,
                inertia: LinkInertia::new(&(to_link * joint.inertia * to_link.transpose())),
                R_urdf: to_link,
            }
        });
        let column = |f: fn(&Joint) -> f64| SVector::from_fn(|i, _| f(&robot.joints[i]));
        let base = Self {
            bodies,
            ee_body: None,
            X_LE: Pose::identity(),
            gravity: robot.gravity,
            armature: column(|j| j.armature),
            viscous_friction: column(|j| j.viscous_friction),
            coulomb_friction: column(|j| j.coulomb_friction),
            lower: column(|j| j.lower),
            upper: column(|j| j.upper),
            effort: column(|j| j.effort),
            velocity: column(|j| j.velocity),
        };
        base.with_frame(robot, frame.unwrap_or(&robot.default_frame))
    }

    /// The same arm with its end-effector frame at `frame`.
    ///
    /// Requires `robot` to be the one this model was made of. Errors: [`ModelError::UnknownFrame`].
    pub fn with_frame(mut self, robot: &Robot, frame: &str) -> Result<Self, ModelError> {
        let found = robot.frame(frame).ok_or_else(|| ModelError::UnknownFrame {
            robot: robot.name.clone(),
            frame: frame.to_owned(),
            known: robot.frame_names(),
        })?;
        self.ee_body = found.joint;
        self.X_LE = match found.joint {
            Some(i) => Pose::rotation(self.bodies[i].R_urdf) * found.X_LF,
            None => found.X_LF,
        };
        Ok(self)
    }

    /// The same arm with its end-effector frame moved by `X_ET`: a tool T fixed in the present frame E.
    ///
    /// Kinematics only; the tool's mass is not added.
    pub fn with_tool(mut self, X_ET: &Pose) -> Self {
        self.X_LE = self.X_LE * *X_ET;
        self
    }

    /// Visits the links from the base outwards: index, body, pose in the base, joint motion axis.
    #[inline(always)]
    fn outwards(&self, q: &SVector<f64, N>, mut visit: impl FnMut(usize, &Body, &Pose, Motion)) {
        let mut X = Pose::identity();
        for i in 0..N {
            let body = &self.bodies[i];
            let S = body.step(&mut X, q[i]);
            visit(i, body, &X, S);
        }
    }

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
            if body.prismatic {
                v += rate;
                a += 2.0 * w.cross(&rate);
            } else {
                alpha += w.cross(&rate);
                w += rate;
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
    fn jacobian_at(&self, S: &[Motion; N], p_E: &Vector3<f64>) -> SMatrix<f64, 6, N> {
        let moving = self.ee_body.map_or(0, |i| i + 1);
        let mut J = SMatrix::<f64, 6, N>::zeros();
        for j in 0..N {
            if j < moving {
                J.set_column(j, &stack(&S[j].at(p_E), &S[j].w));
            }
        }
        J
    }

    /// Mass matrix A(q), armature included: composite-rigid-body algorithm [RBDA Ch. 6].
    pub fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let mut S = [Motion::ZERO; N];
        let mut I = [RigidInertia::ZERO; N];
        self.outwards(q, |i, body, X, S_i| {
            S[i] = S_i;
            I[i] = body.inertia_at(X);
        });
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

    /// Gravity torques g(q): what holds the arm still.
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
            I_A = I_A.without(&U[i], D[i]);
            p_A += I_A.times(&c[i]) + U[i] * (u[i] / D[i]);
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

    /// Acceleration of gravity, base axes, m/s².
    pub fn gravity_vector(&self) -> &Vector3<f64> {
        &self.gravity
    }

    /// Reflected rotor inertias, kg·m² (kg for a sliding joint).
    pub fn armature(&self) -> &SVector<f64, N> {
        &self.armature
    }

    /// Viscous friction, N·m·s/rad.
    pub fn viscous_friction(&self) -> &SVector<f64, N> {
        &self.viscous_friction
    }

    /// Coulomb friction, N·m.
    pub fn coulomb_friction(&self) -> &SVector<f64, N> {
        &self.coulomb_friction
    }

    /// Lower position limits, rad; −∞ for none.
    pub fn lower(&self) -> &SVector<f64, N> {
        &self.lower
    }

    /// Upper position limits, rad; ∞ for none.
    pub fn upper(&self) -> &SVector<f64, N> {
        &self.upper
    }

    /// Torque limits, N·m; ∞ for none.
    pub fn effort(&self) -> &SVector<f64, N> {
        &self.effort
    }

    /// Speed limits, rad/s; ∞ for none.
    pub fn velocity(&self) -> &SVector<f64, N> {
        &self.velocity
    }
}

#[inline(always)]
fn column(A: &Matrix3<f64>, k: usize) -> Vector3<f64> {
    Vector3::new(A[(0, k)], A[(1, k)], A[(2, k)])
}

#[inline(always)]
fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// Our axes for a link, in the URDF's: z along the joint's axis, and x, y such that I_xy = 0.
fn body_axes(joint: &Joint) -> Matrix3<f64> {
    let R = z_to(&joint.axis);
    let I = R.transpose() * joint.inertia * R;
    if I.m12 == 0.0 {
        return R;
    }
    let (s, c) = libm::sincos(0.5 * libm::atan2(2.0 * I.m12, I.m11 - I.m22));
    R * Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// A rotation whose z axis is the unit vector `axis`; exact for the coordinate axes.
fn z_to(axis: &Vector3<f64>) -> Matrix3<f64> {
    if axis.x == 0.0 && axis.y == 0.0 && axis.z > 0.0 {
        return Matrix3::identity();
    }
    // x: the coordinate axis farthest from `axis`, made orthogonal to it.
    let mut e = Vector3::zeros();
    e[axis.iamin()] = 1.0;
    let x = (e - axis * axis.dot(&e)).normalize();
    Matrix3::from_columns(&[x, axis.cross(&x), *axis])
}
