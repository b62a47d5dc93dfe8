//! A run without a control plane, for tests and for looking at pictures: a PUMA 560 moved kinematically through wrist lock (null-space
//! motion of joints 4 and 6, then a turn about the direction that was lost) and in and out of elbow lock. PURE.

use model::{Factors, Model, Robot};
use nalgebra::{Matrix3, Rotation3, SVector, Vector3};
use shared_types::codes::*;
use shared_types::messages::{SingularityReport, SingularityState};
use shared_types::topics::{self, ByTopic, Each, Topic, Whole};
use shared_types::wire::Stamps;

/// The scenario that would describe it.
pub(crate) const SCENARIO: &str = r#"
name = "synthetic"
title = "Wrist lock, then elbow lock (moved kinematically)"
robot = "puma560"
[start]
q_deg = [20, -60, 170, 0, 0, 0]
[[segment]]
duration_s = 9.0
"#;

/// The messages of a tick.
pub(crate) type Messages = ByTopic<Whole>;

/// The moving arm.
pub(crate) struct Run {
    arm: Model<6>,
    effort: SVector<f64, 6>,
    lengths: [f64; 3],
    inside: [bool; 3],
    tick: u64,
}

/// Gives every message of a tick the same header.
struct Begin<'a>(&'a mut Messages, shared_types::Header);

impl Each for Begin<'_> {
    type Output = ();
    fn each<M: Topic>(&mut self) {
        *M::of_mut(self.0).header_mut() = self.1;
    }
}

/// A quintic from 0 to 1 over [from, to] and its rate.
fn smooth_step(t: f64, from: f64, to: f64) -> (f64, f64) {
    let x = ((t - from) / (to - from)).clamp(0.0, 1.0);
    (
        x * x * x * (10.0 + x * (6.0 * x - 15.0)),
        30.0 * x * x * (1.0 - x) * (1.0 - x) / (to - from),
    )
}

fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Deterministic noise in ±1, from a counter.
fn noise(tick: u64, channel: u64) -> f64 {
    let x = shared_types::random::mix(shared_types::random::mix(tick) ^ channel);
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

impl Run {
    /// How long it takes; s.
    pub(crate) const DURATION_S: f64 = 9.0;

    /// At its start.
    ///
    /// # Panics
    /// For a robot that is no PUMA.
    pub(crate) fn new(robot: &Robot) -> Self {
        let Factors::Puma { a2, a3, d4 } = robot.factors else {
            panic!("the synthetic run is a PUMA's")
        };
        let arm = Model::<6>::new(robot, None).expect("six joints");
        let effort = *arm.effort();
        Self {
            arm,
            effort,
            lengths: [a2, a3, d4],
            inside: [false; 3],
            tick: 0,
        }
    }

    /// Joint positions and velocities at a time.
    fn motion(t: f64) -> (SVector<f64, 6>, SVector<f64, 6>) {
        let mut q = SVector::from([20.0, -60.0, 170.0, 0.0, 0.0, 0.0].map(f64::to_radians));
        let mut qdot = SVector::zeros();
        let mut move_by = |joint: usize, by_deg: f64, from: f64, to: f64| {
            let (x, rate) = smooth_step(t, from, to);
            q[joint] += by_deg.to_radians() * x;
            qdot[joint] += by_deg.to_radians() * rate;
        };
        // ζ of the wrist turned by 90° with the hand still, then 45° about where ζ was.
        (move_by)(3, -90.0, 0.4, 2.4);
        (move_by)(5, 90.0, 0.4, 2.4);
        (move_by)(4, 45.0, 2.6, 4.2);
        // Out to the stretched elbow and back.
        (move_by)(2, -77.3, 4.4, 6.6);
        (move_by)(1, 35.0, 4.4, 6.6);
        (move_by)(2, 60.0, 6.9, 8.8);
        (move_by)(1, -30.0, 6.9, 8.8);
        (q, qdot)
    }

    /// The next tick's messages.
    pub(crate) fn step(&mut self) -> Messages {
        let tick = self.tick;
        self.tick += 1;
        let t = tick as f64 * 1e-3;
        let (q, qdot) = Self::motion(t);
        let terms = self.arm.evaluate(&q, &qdot);
        let (_, ahead) = Self::motion(t + 1e-3);
        let qddot = (ahead - qdot) / 1e-3;
        let V = terms.J * qdot;
        let X = terms.X_BE;
        let mut m = Messages::default();
        let stamp = |hop: u64| {
            1_000_000_000
                + tick * 1_000_000
                + hop * 14_000
                + (3_000.0 * (1.0 + noise(tick, hop))) as u64
        };
        let stamps = Stamps {
            received_ns: std::array::from_fn(|i| stamp(2 * i as u64)),
            sent_ns: std::array::from_fn(|i| stamp(2 * i as u64 + 1)),
            due_ns: 0,
        };
        topics::each(&mut Begin(
            &mut m,
            shared_types::Header {
                stamps,
                tick,
                incarnation: 1,
                flags: 0,
            },
        ));
        let pad = |v: &SVector<f64, 6>| {
            std::array::from_fn(|i| v.as_slice().get(i).copied().unwrap_or(0.0))
        };
        m.sensor.q_encoder = pad(&q);
        m.plant_state.q = pad(&q);
        m.plant_state.qdot = pad(&qdot);
        m.plant_state.p_BE = X.p.into();
        m.plant_state.R_BE = *X.R.as_slice().first_chunk().expect("nine");
        m.plant_state.V_BE = *V.as_slice().first_chunk().expect("six");
        m.estimate.q = pad(&q);
        m.estimate.qdot = pad(&qdot);
        self.report(&q, &terms, &mut m.singularity);
        self.command(t, tick, &q, &qdot, &qddot, &mut m);
        m
    }

    fn report(
        &mut self,
        q: &SVector<f64, 6>,
        terms: &model::Terms<6>,
        report: &mut SingularityReport,
    ) {
        let [a2, a3, d4] = self.lengths;
        let forearm = a3.hypot(d4);
        let theta = q[2] - d4.atan2(a3);
        let radius = a2 * q[1].cos() + a3 * (q[1] + q[2]).cos() + d4 * (q[1] + q[2]).sin();
        let (shoulder, wrist) = (terms.p[1], terms.p[3]);
        let out = wrist - shoulder;
        let towards = (out - terms.z[1] * terms.z[1].dot(&out)).normalize();
        let cases = [
            (
                KIND_ELBOW,
                TYPE_1,
                theta.sin(),
                towards,
                false,
                theta,
                (0.10, 0.20),
            ),
            (
                KIND_WRIST,
                TYPE_2,
                q[4].sin(),
                terms.z[3].cross(&terms.z[4]),
                true,
                q[3],
                (0.10, 0.20),
            ),
            (
                KIND_OVERHEAD,
                TYPE_MIXED,
                radius / (a2 + forearm),
                -terms.z[1],
                false,
                q[0],
                (0.08, 0.16),
            ),
        ];
        report.count = 3;
        report.rank = 6;
        report.length_m = 0.43;
        report.p_BC = wrist.into();
        for (i, (kind, class, s, zeta, angular, aux, (eta_in, eta_out))) in
            cases.into_iter().enumerate()
        {
            self.inside[i] = s.abs() < if self.inside[i] { eta_out } else { eta_in };
            let other = zeta
                .cross(&terms.z[0])
                .try_normalize(1e-3)
                .unwrap_or_else(|| zeta.cross(&terms.z[5]).normalize());
            let R = Matrix3::from_columns(&[zeta, other, zeta.cross(&other)]);
            let mut zeta_B = [0.0; 6];
            let half = if angular { 3 } else { 0 };
            zeta_B[half..half + 3].copy_from_slice(zeta.as_slice());
            report.singularities[i] = SingularityState {
                kind,
                class,
                inside: u32::from(self.inside[i]),
                angular: u32::from(angular),
                s,
                eta_in,
                eta_out,
                zeta_B,
                R_BS: *R.as_slice().first_chunk().expect("nine"),
                aux,
                ..SingularityState::default()
            };
        }
    }

    fn command(
        &self,
        t: f64,
        tick: u64,
        q: &SVector<f64, 6>,
        qdot: &SVector<f64, 6>,
        qddot: &SVector<f64, 6>,
        m: &mut Messages,
    ) {
        let tau = self.arm.mass_matrix(q) * qddot + self.arm.bias(q, qdot);
        let null = t < 2.5;
        let (p, R) = (
            Vector3::from(m.plant_state.p_BE),
            Matrix3::from_column_slice(&m.plant_state.R_BE),
        );
        let wobble = 2e-5 * noise(tick, 40);
        let command = &mut m.control_state;
        for i in 0..6 {
            let null_part = if null && i >= 3 { tau[i] } else { 0.0 }
                + 2e-4 * self.effort[i] * noise(tick, 20 + i as u64);
            command.tau_null[i] = null_part;
            command.tau_task[i] = tau[i] - null_part;
            m.torque.tau[i] = tau[i];
        }
        command.p_BE_d =
            (p + Vector3::new(3e-5, -1e-5, 2e-5) * (1.0 + V_norm(qdot)) + Vector3::repeat(wobble))
                .into();
        command.R_BE_d =
            *(Rotation3::from_scaled_axis(Vector3::new(4e-4, 1e-4, -2e-4) * V_norm(qdot)).matrix()
                * R)
                .as_slice()
                .first_chunk()
                .expect("nine");
        (command.time_scale, command.null_scale, command.task_scale) = (
            1.0 - 0.2 * smooth_step(t, 4.6, 5.2).0 * (1.0 - smooth_step(t, 5.8, 6.4).0),
            1.0,
            1.0,
        );
        command.path_time_s = t;
        m.torque.phase = if t > 8.85 {
            PHASE_SETTLING
        } else {
            PHASE_RUNNING
        };
        command.segment = u32::from(t > 2.5) + u32::from(t > 4.3);
        for (i, one) in m.singularity.singularities.iter().take(3).enumerate() {
            let blend = smoothstep((one.s.abs() - one.eta_in) / (one.eta_out - one.eta_in));
            command.beta[i] = blend;
            command.aux_d[i] = one.aux + 0.01 * noise(tick / 50, 60);
            command.mode[i] = match one.inside {
                1 if one.kind == KIND_WRIST && null => MODE_REORIENT,
                1 if blend > 0.0 => MODE_BLEND,
                1 if one.kind == KIND_ELBOW => MODE_TRACK,
                1 => MODE_HOLD,
                _ => MODE_REGULAR,
            };
        }
    }
}

fn V_norm(qdot: &SVector<f64, 6>) -> f64 {
    qdot.norm()
}
