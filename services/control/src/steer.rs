//! The controller of a steered run: the target becomes the reference, and the law of a path follows it (+).

use crate::command;
use crate::continuous::auxiliary::Loop;
use crate::continuous::governor::Governor;
use crate::continuous::saturation::{compensated, limit};
use crate::controller::Controller;
use crate::law::Torques;
use crate::linear::{Lu, angular, linear, rotation_log, smoothstep, stack};
use crate::plausibility::Bounds;
use crate::servo::Reference;
use crate::servo::anti_windup::Lead;
use crate::servo::intake::{self, Wish};
use crate::servo::limits::Fastest;
use crate::servo::rest;
use crate::servo::stops::{self, Limits, Parts};
use crate::state::State;
use crate::trajectory::{HORIZON_S, Progress};
use crate::types::{Command, Phase, Refusal, Report};
use model::{Model, Pose, Terms};
use nalgebra::{SVector, Vector3, Vector6};
use shared_types::codes::{
    REASON_EFFORT, REASON_FAST, REASON_FOLLOWING, REASON_HELD, REASON_LIMIT, REASON_OVER,
    REASON_REACH, REASON_RESTING, REASON_SINGULARITY, REASON_STALE, REASON_STOPPED, TARGET_END,
};
use shared_types::scenario::{Control, Servo};
use shared_types::{ServoState, TargetContent};

/// Share of the speed asked for below which a reason is given.
const FULL: f64 = 0.95;
/// Joint speed below which an arm that was stopped goes on, rad/s.
const AT_REST: f64 = 0.01;
/// Distance of a joint from a posture at which it has arrived there, rad.
const ARRIVED: f64 = 0.02;
/// |s|/η_out of the nearest singularity below which it is the reason for a slower clock.
const NEAR: f64 = 2.0;
/// Saturation of the lead that counts as the boundary of reach.
const SATURATED: f64 = 0.02;
/// Distance between a joint and that of the reference arm from which the two have parted, rad.
const PARTED: f64 = 0.05;
/// Distance of the hand from that of the reference arm from which it is held back; at which the reference goes no further; and at which the two have
/// parted, m.
const BEHIND_M: (f64, f64) = (0.004, 0.008);
const PARTED_M: f64 = 0.012;

/// No arm is faster than this: a checkpoint that says so is not one of a reference arm, rad/s.
const ABSURD: f64 = 1e3;

impl<const N: usize> Controller<N> {
    /// One tick of a steered run: the torque for this state, towards the target of this tick (`None`: none has come).
    ///
    /// The law acts on the reference arm, and the arm follows it. A motion that the law refuses for a moment (in a direction that no listed
    /// singularity explains) brings the reference arm to rest, and from there it goes on. Fills `out` but for its header · Requires a scenario that
    /// is steered · Ensures, errors as [`step`](Self::step) · Cost that of `step` and about 2 µs, no allocation
    pub fn steer(
        &mut self,
        (tick, target): (u64, Option<&TargetContent>),
        (q, qdot): (&SVector<f64, N>, &SVector<f64, N>),
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
        out: &mut ServoState,
    ) -> Command<N> {
        let is_final = self.state.refusal != Refusal::None && !goes_on(self.state.refusal);
        let is_finite = q
            .iter()
            .chain(qdot)
            .chain(tau_disturbance)
            .all(|x| x.is_finite());
        if is_final || !is_finite {
            return self.step(q, qdot, tau_disturbance, report);
        }
        let terms = self.model.evaluate(q, qdot);
        if !self.state.plausible.take(
            q,
            qdot,
            &Bounds::of(&self.model, &terms, self.scenario.dt_s()),
        ) {
            self.state.servo.parted = true;
            let rest = self.reject();
            let goes_on = goes_on(rest.refusal);
            return if goes_on {
                Command {
                    phase: Phase::Running,
                    refusal: Refusal::None,
                    ..rest
                }
            } else {
                rest
            };
        }
        self.join(q, qdot, &terms.X_BE);
        let (q_r, qdot_r) = (self.state.servo.q, self.state.servo.qdot);
        let reference = self.model.evaluate(&q_r, &qdot_r);
        let behind = reference.X_BE.p - terms.X_BE.p;
        let (Some(session), Some(steered)) = (&self.scenario.servo, &mut self.steered) else {
            return self.step(q, qdot, tau_disturbance, report);
        };
        // The rank is that of the arm.
        let listed = Report {
            rank: report.rank,
            ..steered.analyzer.listed(&q_r, &qdot_r, &reference)
        };
        self.state.servo.take(
            (target, steered.dof),
            tick,
            session.duration_s,
            self.scenario.dt_s(),
        );
        let (wish, lead, age_s) = self.state.intake(
            (session, self.scenario.dt_s()),
            (&self.model, self.length_m),
            &reference,
            &listed,
            &behind,
        );
        let clock = self.state.governor.rate;
        // From here to the exchange back, the torque sent is that of the reference arm.
        std::mem::swap(&mut self.state.sent, &mut self.state.servo.sent);
        let mut command = match self.state.servo.goes_by_joints() {
            true => self.move_joints(&wish, &reference),
            false => self.act((&q_r, &qdot_r), &SVector::zeros(), &listed, &reference),
        };
        std::mem::swap(&mut self.state.sent, &mut self.state.servo.sent);
        if self.state.refusal != Refusal::None && !goes_on(self.state.refusal) {
            return self.refuse(q, qdot, self.state.refusal);
        }
        let qddot_r = self.accelerate(&reference);
        let sent = self.state.sent;
        self.follow(
            (q, qdot),
            (&q_r, &qdot_r, &qddot_r),
            (&terms, tau_disturbance),
            &mut command,
        );
        if !command.tau.iter().all(|x| x.is_finite()) {
            // The torque to rest begins at the last one that was sent.
            self.state.sent = sent;
            return self.refuse(q, qdot, Refusal::Torque);
        }
        self.proceed(clock, command.clipped);
        let (limits, dt) = (limits(&self.model), self.scenario.dt_s());
        let V = reference.J * qdot_r;
        self.state.servo.count_rest(&rest::Motion {
            asked: &wish.V,
            V: &V,
            limits: &limits,
            length_m: self.length_m,
            dt,
        });
        if self.state.servo.stopping {
            (command.phase, command.refusal) = (Phase::Running, Refusal::None);
        }
        if let Some(over) = self.state.servo.over
            && command.phase == Phase::Running
        {
            let settled =
                tick.saturating_sub(over) as f64 * self.scenario.dt_s() >= self.scenario.settle_s;
            command.phase = if settled {
                Phase::Done
            } else {
                Phase::Settling
            };
        }
        let is_held = behind.norm() > BEHIND_M.0;
        self.explain(&wish, &lead, (age_s, clock, is_held), &listed, out);
        command
    }

    /// Begins the reference arm anew at the arm, where the two have parted: an estimate was set aside, the arm was held or thrown.
    fn join(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, X: &Pose) {
        let behind_m = (self.model.forward_kinematics(&self.state.servo.q).p - X.p).norm();
        let State {
            servo,
            sent,
            refusal,
            ..
        } = &mut self.state;
        let is_near =
            behind_m <= PARTED_M && (servo.q - q).iter().all(|apart| apart.abs() <= PARTED);
        let is_an_arms = servo.qdot.iter().all(|speed| speed.abs() <= ABSURD);
        if servo.parted || !is_near || !is_an_arms {
            (servo.q, servo.qdot, servo.sent, servo.parted) = (*q, *qdot, *sent, false);
            servo.rest_at(*X);
            servo.stops = servo.stops.saturating_add(u32::from(!servo.stopping));
            (servo.stopping, servo.stop) = (true, Refusal::Parted);
            *refusal = Refusal::Parted;
        }
    }

    /// The torque of the reference arm towards a posture or to rest, joint by joint: no direction of the hand counts, so none can be lost.
    fn move_joints(&mut self, wish: &Wish, reference: &Terms<N>) -> Command<N> {
        let servo = &mut self.state.servo;
        let (goal, beyond) = servo.goal(self.model.lower(), self.model.upper());
        let is_held = wish.stale || servo.over.is_some();
        let (qddot, joint) = match servo.resting {
            true => (servo.braking(), servo.ended.map(|ended| ended.joint)),
            false if is_held => (servo.towards(&servo.q, self.model.velocity()), None),
            false => {
                let arrived = beyond.filter(|(i, _)| (servo.q[*i] - goal[*i]).abs() < ARRIVED);
                (servo.towards(&goal, self.model.velocity()), arrived)
            }
        };
        servo.fastest = Fastest {
            clock: if joint.is_some() { 0.0 } else { 1.0 },
            joint,
        };
        let path = reference.A * qddot;
        let torques = Torques {
            path,
            rest: SVector::zeros(),
            null: SVector::zeros(),
            qdot_nominal: servo.qdot,
            qddot_path: SVector::zeros(),
        };
        let limited = limit(&reference.bias(), &torques, self.model.effort());
        let step = self.model.torque_rate() * self.scenario.dt_s();
        let rate_mask;
        (self.state.sent, rate_mask) = self.state.sent.next(
            &limited,
            &(path * limited.task_scale),
            &step,
            self.model.effort(),
        );
        let rest = command::resting(&self.state, limited.mask, rate_mask);
        Command {
            phase: Phase::Running,
            V_BE_d: self.state.servo.V,
            time_scale: 1.0,
            task_scale: limited.task_scale,
            ..rest
        }
    }

    /// The reference arm's acceleration by its torque, within its stops; it moves on by a tick.
    fn accelerate(&mut self, reference: &Terms<N>) -> SVector<f64, N> {
        let servo = &mut self.state.servo;
        let Ok(lu) = Lu::new(reference.A) else {
            return SVector::zeros();
        };
        let [whole, path, null] = [
            &(servo.sent.tau - reference.bias()),
            &servo.sent.path,
            &servo.sent.null,
        ]
        .map(|torque| lu.solve(torque));
        let bounded = stops::bounded(
            (&servo.q, &servo.qdot),
            &Parts { whole, path, null },
            &reference.A.diagonal(),
            &limits(&self.model),
        );
        servo.accelerate_arm(&bounded.qddot, self.scenario.dt_s());
        if bounded.joint.is_some() {
            servo.fastest = Fastest {
                clock: 0.0,
                joint: bounded.joint,
            };
        }
        bounded.qddot
    }

    /// The torque with which the arm follows the reference arm: Γ = A(q)(q̈_r + k_v(q̇_r − q̇) + k_p(q_r − q)) + bias − disturbance, within limits and rates.
    fn follow(
        &mut self,
        (q, qdot): (&SVector<f64, N>, &SVector<f64, N>),
        (q_r, qdot_r, qddot_r): (&SVector<f64, N>, &SVector<f64, N>, &SVector<f64, N>),
        (terms, tau_disturbance): (&Terms<N>, &SVector<f64, N>),
        command: &mut Command<N>,
    ) {
        let Some(steered) = &self.steered else { return };
        let Control {
            k_p,
            k_v,
            compensate_disturbance,
            ..
        } = self.scenario.control;
        let feedback = (q_r - q) * k_p + (qdot_r - qdot) * k_v;
        let mut bias = terms.bias();
        if compensate_disturbance {
            bias -= compensated(tau_disturbance, &steered.effort);
        }
        let torques = Torques {
            path: terms.A * qddot_r,
            rest: terms.A * feedback,
            null: SVector::zeros(),
            qdot_nominal: *qdot_r,
            qddot_path: *qddot_r,
        };
        let mut limited = limit(&bias, &torques, &steered.effort);
        limited.null = self.state.servo.sent.null;
        let rate_mask;
        (self.state.sent, rate_mask) = self.state.sent.next(
            &limited,
            &(torques.path * limited.task_scale),
            &steered.torque_step,
            &steered.effort,
        );
        (command.tau, command.tau_null) = (self.state.sent.tau, self.state.sent.null);
        command.tau_task = command.tau - command.tau_null;
        command.saturation_mask |= limited.mask;
        command.rate_mask |= rate_mask;
        let turn = rotation_log(&(command.R_BE_d * terms.X_BE.R.transpose()));
        command.error = stack(&(command.p_BE_d - terms.X_BE.p), &turn);
    }

    /// After the law: the reference moves on with the clock, or is stopped by what the law refuses for a moment.
    fn proceed(&mut self, clock: f64, clipped: bool) {
        let (refusal, dt) = (self.state.refusal, self.scenario.dt_s());
        let servo = &mut self.state.servo;
        servo.clipped = clipped;
        if refusal == Refusal::None {
            if !servo.goes_by_joints() {
                servo.advance(clock, dt);
            }
            return;
        }
        if !servo.stopping {
            servo.stops = servo.stops.saturating_add(1);
            (servo.stopping, servo.stop) = (true, refusal);
        }
        servo.rest_at(self.model.forward_kinematics(&servo.q));
    }

    /// The share of the twist asked for that the reference moves with, 0 to 1; metres are made radians by the arm's length.
    fn speed_scale(&self, asked: &Vector6<f64>, clock: f64) -> f64 {
        let L = self.length_m;
        let scaled = |V: &Vector6<f64>| stack(&(linear(V) / L), &angular(V));
        let (asked, moved) = (scaled(asked), scaled(&(self.state.servo.V * clock)));
        let size = asked.norm_squared();
        if size < 1e-12 {
            1.0
        } else {
            (asked.dot(&moved) / size).clamp(0.0, 1.0)
        }
    }

    /// The state of the session, for people: what is asked, how much of it is done, and why not more.
    fn explain(
        &self,
        wish: &Wish,
        lead: &Lead,
        (age_s, clock, is_held): (f64, f64, bool),
        report: &Report<N>,
        out: &mut ServoState,
    ) {
        let servo = &self.state.servo;
        let nearest = intake::nearest(report);
        let speed_scale = self.speed_scale(&wish.asked, clock);
        let limit = servo
            .fastest
            .joint
            .filter(|_| servo.fastest.clock < FULL && servo.fastest.clock <= 1.2 * clock + 0.05);
        let is_near = nearest.is_some_and(|(_, openness)| openness < NEAR);
        let reason = if servo.over.is_some() {
            REASON_OVER
        } else if servo.stopping {
            REASON_STOPPED
        } else if wish.stale {
            REASON_STALE
        } else if wish.asked == Vector6::zeros() && !servo.is_posture() {
            REASON_RESTING
        } else if is_held {
            REASON_HELD
        } else if limit.is_some() {
            REASON_LIMIT
        } else if !servo.is_posture() && (servo.clipped || lead.saturation > SATURATED) {
            REASON_REACH
        } else if clock < FULL {
            if is_near {
                REASON_SINGULARITY
            } else {
                REASON_EFFORT
            }
        } else if (wish.V - wish.asked).amax() > 1e-9 {
            REASON_FAST
        } else {
            REASON_FOLLOWING
        };
        let joint = limit.filter(|_| reason == REASON_LIMIT);
        *out = ServoState {
            header: out.header,
            V_target: wish.asked.into(),
            p_target: wish.p.into(),
            speed_scale,
            behind_m: servo.behind_m,
            nearest: nearest.map_or(1e9, |(_, openness)| openness),
            age_s,
            reason,
            joint: joint.map_or(0, |(i, _)| i as u32 + 1),
            upper: joint.map_or(0, |(_, is_upper)| u32::from(is_upper)),
            singularity: nearest.map_or(0, |(place, _)| place as u32 + 1),
            refused: servo.refused,
            refusal: servo.refusal,
            stop: servo.stop.code(),
            stops: servo.stops,
        };
    }
}

impl<const N: usize> State<N> {
    /// Makes the reference's motion of this tick of the target in force: the leg of constant twist that the law sees.
    fn intake(
        &mut self,
        (session, dt): (&Servo, f64),
        (model, length_m): (&Model<N>, f64),
        reference: &Terms<N>,
        report: &Report<N>,
        behind: &Vector3<f64>,
    ) -> (Wish, Lead, f64) {
        let arm = &reference.X_BE;
        let State {
            servo,
            governor,
            refusal,
            loops,
            qdot_planned,
            progress,
            ..
        } = self;
        if servo.stopping && servo.qdot.amax() < AT_REST {
            (servo.stopping, *refusal) = (false, Refusal::None);
            servo.rest_at(*arm);
            (*governor, *loops, *qdot_planned) =
                (Governor::default(), Default::default(), SVector::zeros());
        }
        let age_s = servo.tick.saturating_sub(servo.held.given_tick) as f64 * dt;
        let lead = Lead::between(&servo.X, arm, report, loops);
        let wish = match servo.over {
            Some(_) => Wish {
                V: Vector6::zeros(),
                asked: Vector6::zeros(),
                p: servo.X.p,
                stale: false,
            },
            None => intake::wish(&servo.held, age_s, &servo.X, report, session),
        };
        let V_arm = reference.J * servo.qdot;
        servo.decide_rest(&rest::Motion {
            asked: &wish.V,
            V: &V_arm,
            limits: &limits(model),
            length_m,
            dt,
        });
        if servo.goes_by_joints() {
            // The pose that the reference arm passes, and from which the law would go on.
            (servo.X, servo.V, servo.a) = (*arm, V_arm, Vector6::zeros());
            (*governor, *qdot_planned) = (Governor::default(), servo.qdot);
            // At rest the strategies keep their memory: the side of a fold above all.
            *loops = if servo.resting {
                loops.map(|one| Loop {
                    rate: 0.0,
                    feed_forward: 0.0,
                    ..one
                })
            } else {
                Default::default()
            };
        } else if !servo.stopping {
            let back;
            (servo.X, back) = lead.hold(&servo.X, arm);
            // A target 1e300 m away is one, too: what leaves stays finite.
            servo.behind_m = (servo.behind_m + back).min(f64::MAX);
            if servo.clipped || lead.saturation > SATURATED {
                servo.X = lead.relax(&servo.X, &wish.V, dt);
            }
            let V = lead.without_increase(&wish.V);
            servo.accelerate(
                &stack(&yielding(linear(&V), behind), &angular(&V)),
                session,
                dt,
            );
        }
        *progress = Progress {
            begun: true,
            by: linear(&servo.V) * HORIZON_S,
            turn: angular(&servo.V) * HORIZON_S,
            ..Progress::at(servo.X)
        };
        (wish, lead, age_s)
    }
}

impl<const N: usize> Reference<N> {
    /// Takes a target in, or refuses and counts it: once for each time at which one was given.
    fn take(
        &mut self,
        (target, dof): (Option<&TargetContent>, usize),
        tick: u64,
        duration_s: f64,
        dt: f64,
    ) {
        self.tick = tick;
        if let Some(target) = target.filter(|target| **target != self.held) {
            match intake::check(target, tick, dof) {
                Ok(()) => {
                    if target.twist != self.held.twist || target.kind != self.held.kind {
                        self.behind_m = 0.0;
                    }
                    if target.kind != self.held.kind || target.side != self.held.side {
                        self.ended = None;
                    }
                    self.held = *target;
                }
                // A checkpoint has room for all ticks but the last.
                Err(refusal) if self.refused_tick != Some(target.given_tick.min(u64::MAX - 1)) => {
                    self.refused = self.refused.saturating_add(1);
                    (self.refusal, self.refused_tick) =
                        (refusal, Some(target.given_tick.min(u64::MAX - 1)));
                }
                Err(_) => {}
            }
        }
        let is_over = self.held.kind == TARGET_END || tick as f64 * dt >= duration_s;
        self.over = self.over.or(is_over.then_some(tick));
    }
}

/// The limits of an arm's joints.
fn limits<const N: usize>(model: &Model<N>) -> Limits<'_, N> {
    Limits {
        lower: model.lower(),
        upper: model.upper(),
        velocity: model.velocity(),
        effort: model.effort(),
    }
}

/// A velocity without what would press the arm further against what holds it back: `behind` is how far the hand is behind that of the reference arm, m.
fn yielding(v: Vector3<f64>, behind: &Vector3<f64>) -> Vector3<f64> {
    let size = behind.norm();
    if size <= BEHIND_M.0 {
        return v;
    }
    let share = smoothstep((size - BEHIND_M.0) / (BEHIND_M.1 - BEHIND_M.0));
    v - behind * (v.dot(behind).max(0.0) * share / (size * size))
}

/// Whether a steered arm goes on after this refusal, once at rest.
fn goes_on(refusal: Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Limit
            | Refusal::Singular
            | Refusal::Speed
            | Refusal::Room
            | Refusal::Unlisted
            | Refusal::Parted
    )
}
