//! One tick of a steered run: the target becomes the leg that the law sees, the law moves the reference arm, and the arm follows it.

use super::intake::{self, Wish};
use super::lead::Lead;
use super::rest;
use super::state::{Refused, Stops, TargetState};
use super::{gives_up, goes_on};
use crate::command;
use crate::controller::{Controller, Setup};
use crate::law::auxiliary::Loop;
use crate::law::force::{self, Forces, Pressing};
use crate::limits::Parts;
use crate::limits::range::{self, Fastest};
use crate::limits::torque::Limited;
use crate::linear::{
    Joints, Matrix3, Vector3, Vector6, angular, is_finite, linear, rotation_log, served,
    smoothstep, stack,
};
use crate::paper::operational_space::Cholesky;
use crate::reference::path::{HORIZON_S, Progress};
use crate::state::State;
use crate::tick::{self, Inputs};
use crate::types::{Command, Phase, Refusal, Report};
use model::{Pose, Terms};
use shared_types::codes::{
    REASON_AXES, REASON_EFFORT, REASON_FAST, REASON_FOLLOWING, REASON_HELD, REASON_LIMIT,
    REASON_LOST, REASON_OVER, REASON_REACH, REASON_RESTING, REASON_SINGULARITY, REASON_STALE,
    REASON_STOPPED, TARGET_END, TARGET_POSTURE, TARGET_REFUSAL_FORCE, TARGET_TWIST,
};
use shared_types::scenario::Servo;
use shared_types::{ServoState, TargetContent};

/// Share of the speed asked for below which a reason is given.
const FULL: f64 = 0.95;
/// Joint speed below which an arm that was stopped goes on, rad/s.
const AT_REST: f64 = 0.01;
/// Distance of a joint from a posture at which it has arrived there, rad.
const ARRIVED: f64 = 0.02;
/// |s|/η_out of the nearest singularity below which it is the reason for a slower clock.
const NEAR: f64 = 2.0;
/// Rate of an auxiliary coordinate above which it moves, rad/s.
const TURNING: f64 = 0.02;
/// Share of a twist that the task does not serve and that is none, m/s and rad/s.
const UNSERVED: f64 = 1e-6;
/// Saturation of the lead that counts as the boundary of reach.
const SATURATED: f64 = 0.02;
/// Distance between a joint and that of the reference arm from which the two have parted, rad.
const PARTED: f64 = 0.05;
/// Distance of the hand from that of the reference arm from which it is held back; at which the reference goes no further; and at which the two have
/// parted, m.
const BEHIND_M: (f64, f64) = (0.004, 0.008);
const PARTED_M: f64 = 0.012;
/// Distance from the pose asked for beyond which the arm does not follow it, m and rad: an acceleration of 1 m/s² makes 10 mm.
const OFF: (f64, f64) = (0.010, 0.05);
/// No arm is faster than this: a checkpoint that says so is not one of a reference arm, rad/s.
const ABSURD: f64 = 1e3;

/// What is asked of the reference at a tick, and what of it the arm can follow.
struct Asked {
    wish: Wish,
    lead: Lead,
    age_s: f64,
    /// Whether its twist has a share in axes that the task does not serve.
    leaves_out: bool,
    /// How far the hand is behind that of the reference arm, m.
    behind: Vector3,
    /// Speed of the clock.
    clock: f64,
    /// Whether an auxiliary coordinate moves: ζ turns, or a fold opens.
    turns: bool,
}

impl<const N: usize> Controller<N> {
    /// One tick of a steered run on a plausible state whose terms are `terms`, towards the target of this tick.
    ///
    /// A motion that the law refuses for a moment (in a direction that no listed singularity explains) brings the reference arm to rest, and from there
    /// it goes on.
    pub(crate) fn steer(&mut self, inputs: &Inputs<'_, N>, terms: &Terms<N>) -> Command<N> {
        self.join(inputs, &terms.X_BE);
        let (q_r, qdot_r) = (self.state.targets.q, self.state.targets.qdot);
        let reference = self.setup.model.evaluate(&q_r, &qdot_r);
        let (Some(session), Some(targets)) = (&self.setup.scenario.servo, &mut self.targets) else {
            return self.refuse(inputs.q, inputs.qdot, Refusal::State);
        };
        // The rank is that of the arm.
        let listed = Report {
            rank: inputs.report.rank,
            ..targets.analyzer.listed(&q_r, &qdot_r, &reference)
        };
        let dt = self.setup.scenario.dt_s();
        let ends = inputs.tick as f64 * dt >= session.duration_s;
        let (forces, effort) = (&self.setup.forces, self.setup.model.effort());
        let check = |target: &TargetContent| {
            intake::check(target, inputs.tick, targets.dof)?;
            let is_pressed = target.force == [0.0; 3]
                || target.kind != TARGET_POSTURE
                    && forces.can_press(target, &reference, effort, dt);
            is_pressed.then_some(()).ok_or(TARGET_REFUSAL_FORCE)
        };
        (self.state.targets).take(inputs.target, &check, inputs.tick, ends);
        let behind = reference.X_BE.p - terms.X_BE.p;
        let asked = self
            .state
            .intake(&self.setup, session, &reference, &listed, behind);
        if !self.feel(inputs, terms) {
            return self.refuse(inputs.q, inputs.qdot, Refusal::Singular);
        }
        let at_reference = Inputs {
            q: &q_r,
            qdot: &qdot_r,
            tau_disturbance: &Joints::zeros(),
            wrist: None,
            report: &listed,
            ..*inputs
        };
        let mut command = self.move_reference(&at_reference, &asked.wish, &reference);
        if self.state.refusal != Refusal::None && !goes_on(self.state.refusal) {
            return self.refuse(inputs.q, inputs.qdot, self.state.refusal);
        }
        let qddot_r = self.state.targets.accelerate(&self.setup, &reference);
        let sent = self.state.sent;
        self.follow(inputs, terms, [&q_r, &qdot_r, &qddot_r], &mut command);
        if !is_finite(&command.tau) {
            // The torque to rest begins at the last one that was sent.
            self.state.sent = sent;
            return self.refuse(inputs.q, inputs.qdot, Refusal::Torque);
        }
        self.proceed(asked.clock, command.clipped);
        self.state.targets.count_rest(&rest::Motion {
            asked: &asked.wish.V,
            V: &(reference.J * qdot_r),
            setup: &self.setup,
        });
        if self.state.targets.stops.now {
            (command.phase, command.refusal) = (Phase::Running, Refusal::None);
        }
        if let (Some(over), Phase::Running) = (self.state.targets.over, command.phase) {
            let passed_s = inputs.tick.saturating_sub(over) as f64 * dt;
            command.phase = if passed_s >= self.setup.scenario.settle_s {
                Phase::Done
            } else {
                Phase::Settling
            };
        }
        let targets = &self.state.targets;
        command.session = Some(targets.explain(&asked, &listed, self.setup.length_m));
        command
    }

    /// The torque of the reference arm: by the law, or joint by joint.
    fn move_reference(
        &mut self,
        inputs: &Inputs<'_, N>,
        wish: &Wish,
        reference: &Terms<N>,
    ) -> Command<N> {
        // The law's state of the reference arm, whose torque is its own.
        let mut law = State {
            sent: self.state.targets.sent,
            ..self.state
        };
        let command = if law.targets.goes_by_joints() {
            let limited = law.move_joints(&self.setup, wish, reference);
            Command {
                phase: Phase::Running,
                V_BE_d: law.targets.V,
                time_scale: 1.0,
                limited: Limited {
                    null_scale: 0.0,
                    ..limited
                },
                ..command::resting(&law, &limited)
            }
        } else {
            tick::act(&self.setup, &mut law, inputs, reference)
        };
        law.targets.sent = law.sent;
        self.state = State {
            sent: self.state.sent,
            ..law
        };
        command
    }

    /// Takes up the force on the hand, which the reference arm does not feel; false where it cannot be told from the torques.
    fn feel(&mut self, inputs: &Inputs<'_, N>, terms: &Terms<N>) -> bool {
        let State { force, targets, .. } = &mut self.state;
        if targets.goes_by_joints() || targets.stops.now {
            *force = Pressing::touching(force.wrist);
        }
        let press = self.setup.forces.of_target(&targets.held, &terms.X_BE.R);
        let felt = match (inputs.wrist, press) {
            (Some(wrist), _) => Ok(*wrist),
            (None, Some(press)) if targets.presses => {
                force::observed(&press, terms, inputs.tau_disturbance)
            }
            _ => Ok(Vector6::zeros()),
        };
        felt.map(|felt| force.wrist = felt).is_ok()
    }

    /// Begins the reference arm anew at the arm, where the two have parted: an estimate was set aside, the arm was held or thrown.
    fn join(&mut self, inputs: &Inputs<'_, N>, X: &Pose) {
        let State {
            targets,
            sent,
            refusal,
            ..
        } = &mut self.state;
        let (q, qdot) = (inputs.q, inputs.qdot);
        let behind_m = (self.setup.model.forward_kinematics(&targets.q).p - X.p).norm();
        let is_near =
            behind_m <= PARTED_M && (targets.q - q).iter().all(|apart| apart.abs() <= PARTED);
        let is_an_arms = targets.qdot.iter().all(|speed| speed.abs() <= ABSURD);
        if targets.parted || !is_near || !is_an_arms {
            (targets.q, targets.qdot, targets.sent, targets.parted) = (*q, *qdot, *sent, false);
            targets.stop(Refusal::Parted, *X);
            targets.stops.why = Refusal::Parted;
            *refusal = Refusal::Parted;
        }
    }

    /// The torque with which the arm follows the reference arm: Γ = A(q)(q̈_r + k_v(q̇_r − q̇) + k_p(q_r − q)) + bias − disturbance, within limits and rates.
    fn follow(
        &mut self,
        inputs: &Inputs<'_, N>,
        terms: &Terms<N>,
        [q_r, qdot_r, qddot_r]: [&Joints<N>; 3],
        command: &mut Command<N>,
    ) {
        let Some(targets) = &self.targets else { return };
        let control = &self.setup.scenario.control;
        let feedback = (q_r - inputs.q) * control.k_p + (qdot_r - inputs.qdot) * control.k_v;
        // Without a sensor the contact is part of the disturbance.
        let bearing = (self.state.force.bearing(terms)).filter(|_| inputs.wrist.is_some());
        let disturbance = control
            .compensate_disturbance
            .then_some(inputs.tau_disturbance);
        let bias = targets.drives.bias(terms, bearing, disturbance);
        let null = self.state.targets.sent.null;
        let parts = Parts {
            null,
            path: terms.A * qddot_r - null,
            rest: terms.A * feedback,
        };
        let limited = targets.drives.send(&mut self.state.sent, &bias, &parts);
        (command.tau, command.tau_null) = (self.state.sent.tau, self.state.sent.null);
        command.tau_task = command.tau - command.tau_null;
        command.limited.saturation_mask |= limited.saturation_mask;
        command.limited.rate_mask |= limited.rate_mask;
        let desired = &command.X_BE_d;
        let turn = rotation_log(&(desired.R * terms.X_BE.R.transpose()));
        command.error = stack(&(desired.p - terms.X_BE.p), &turn);
    }

    /// After the law: the reference moves on with the clock, or is stopped by what the law refuses for a moment.
    fn proceed(&mut self, clock: f64, clipped: bool) {
        let targets = &mut self.state.targets;
        targets.clipped = clipped;
        if gives_up(self.state.refusal) {
            targets.given_up = targets.held.force;
        }
        if self.state.refusal != Refusal::None {
            let X = self.setup.model.forward_kinematics(&targets.q);
            targets.stop(self.state.refusal, X);
        } else if !targets.goes_by_joints() {
            targets.advance(clock, self.setup.scenario.dt_s());
        }
    }
}

impl<const N: usize> State<N> {
    /// Makes the reference's motion of this tick of the target in force: the leg of constant twist that the law sees.
    fn intake(
        &mut self,
        setup: &Setup<N>,
        session: &Servo,
        reference: &Terms<N>,
        report: &Report<N>,
        behind: Vector3,
    ) -> Asked {
        let (arm, dt, clock) = (&reference.X_BE, setup.scenario.dt_s(), self.clock.rate);
        let targets = &mut self.targets;
        if targets.stops.now && targets.qdot.amax() < AT_REST {
            (targets.stops.now, self.refusal) = (false, Refusal::None);
            targets.rest_at(*arm);
            self.clock.begin_anew();
            (self.loops, self.qdot_planned) = (Default::default(), Joints::zeros());
        }
        let age_s = targets.tick.saturating_sub(targets.held.given_tick) as f64 * dt;
        let press = targets.press(age_s, &setup.forces, &arm.R);
        if let Some(press) = &press {
            // Along its axis, the hand is where the force leads it.
            targets.X.p += press.along(&(arm.p - targets.X.p));
            (targets.V, targets.a) = (press.across(&targets.V), press.across(&targets.a));
        }
        let lead = Lead::between(&targets.X, arm, report, &setup.task);
        let mut wish = match targets.over {
            Some(_) => Wish::rest(&targets.X),
            None => intake::wish(&targets.held, age_s, &targets.X, report, session),
        };
        if let Some(press) = &press {
            for V in [&mut wish.V, &mut wish.asked, &mut wish.off] {
                *V = press.across(V);
            }
        }
        let V_arm = reference.J * targets.qdot;
        targets.decide_rest(&rest::Motion {
            asked: &wish.V,
            V: &V_arm,
            setup,
        });
        if targets.goes_by_joints() {
            // The pose that the reference arm passes, and from which the law would go on.
            (targets.X, targets.V, targets.a) = (*arm, V_arm, Vector6::zeros());
            self.clock.begin_anew();
            self.qdot_planned = targets.qdot;
            // At rest the strategies keep their memory: the side of a fold above all.
            let is_resting = targets.resting;
            let next = |one: Loop| match is_resting {
                true => one.at_rest(),
                false => Loop::default(),
            };
            self.loops = self.loops.map(next);
        } else if !targets.stops.now {
            targets.lead_on(&lead, &wish.V, arm, &behind, session, dt);
        }
        self.progress = Progress {
            begun: true,
            by: linear(&targets.V) * HORIZON_S,
            turn: angular(&targets.V) * HORIZON_S,
            ..Progress::at(targets.X)
        };
        let unserved = wish.asked - served(&setup.task, &wish.asked);
        Asked {
            wish,
            leaves_out: targets.held.kind == TARGET_TWIST && unserved.amax() > UNSERVED,
            lead,
            age_s,
            behind,
            clock,
            turns: (self.loops.iter()).any(|one| one.engaged() && one.rate.abs() > TURNING),
        }
    }

    /// The torque of the reference arm towards a posture or to rest, joint by joint: no direction of the hand counts, so none can be lost.
    fn move_joints(&mut self, setup: &Setup<N>, wish: &Wish, reference: &Terms<N>) -> Limited {
        let (targets, model) = (&mut self.targets, &setup.model);
        let (goal, beyond) = targets.goal(model.lower(), model.upper());
        let is_held = wish.stale || targets.over.is_some();
        let (qddot, joint) = match targets.resting {
            true => (targets.braking(), targets.ended.map(|ended| ended.joint)),
            false if is_held => (targets.towards(&targets.q, model.velocity()), None),
            false => {
                let arrived = beyond.filter(|(i, _)| (targets.q[*i] - goal[*i]).abs() < ARRIVED);
                (targets.towards(&goal, model.velocity()), arrived)
            }
        };
        targets.fastest = Fastest {
            clock: if joint.is_some() { 0.0 } else { 1.0 },
            joint,
        };
        let parts = Parts {
            path: reference.A * qddot,
            ..Parts::zero()
        };
        setup.drives.send(&mut self.sent, &reference.bias(), &parts)
    }
}

impl<const N: usize> TargetState<N> {
    /// The reference's step towards the twist `V`: no further ahead of the reference arm in `arm` than it can follow, and yielding to what holds the hand back.
    fn lead_on(
        &mut self,
        lead: &Lead,
        V: &Vector6,
        arm: &Pose,
        behind: &Vector3,
        session: &Servo,
        dt: f64,
    ) {
        let back;
        (self.X, back) = lead.hold(&self.X, arm);
        // A target 1e300 m away is one, too: what leaves stays finite.
        self.behind_m = (self.behind_m + back).min(f64::MAX);
        if self.clipped || lead.saturation > SATURATED {
            self.X = lead.relax(&self.X, V, dt);
        }
        let V = lead.without_increase(V);
        let V = stack(&yielding(linear(&V), behind), &angular(&V));
        self.turn_to(&V, session, dt);
    }

    /// The reference arm's acceleration by its torque, within its stops; it moves on by a tick.
    fn accelerate(&mut self, setup: &Setup<N>, reference: &Terms<N>) -> Joints<N> {
        let Ok(A) = Cholesky::new(reference.A) else {
            return Joints::zeros();
        };
        let [whole, path, null] = [
            &(self.sent.tau - reference.bias()),
            &self.sent.path,
            &self.sent.null,
        ]
        .map(|torque| A.solve(torque));
        let parts = Parts {
            null,
            path,
            rest: whole - path - null,
        };
        let inertia = reference.A.diagonal();
        let (qddot, joint) = range::stopped((&self.q, &self.qdot), &parts, &inertia, &setup.model);
        self.accelerate_arm(&qddot, setup.scenario.dt_s());
        if joint.is_some() {
            self.fastest = Fastest { clock: 0.0, joint };
        }
        qddot
    }

    /// Begins to bring the arm to rest, unless it is being so; the reference rests in `X`.
    fn stop(&mut self, why: Refusal, X: Pose) {
        if !self.stops.now {
            self.stops = Stops {
                now: true,
                count: self.stops.count.saturating_add(1),
                why,
            };
        }
        self.rest_at(X);
    }

    /// The force of the target in force, which is `age_s` old, for a hand that is turned by `R_BE`; `None`: it has none, or none any more.
    fn press<'a>(
        &mut self,
        age_s: f64,
        forces: &'a Forces,
        R_BE: &Matrix3,
    ) -> Option<force::Press<'a>> {
        let held = &self.held;
        let is_over = age_s > held.valid_s || self.over.is_some() || self.stops.now;
        let press = forces.of_target(held, R_BE);
        let press = press.filter(|_| !is_over && held.force != self.given_up && !self.is_posture());
        self.presses = press.is_some();
        press
    }

    /// Takes a target in, or refuses and counts it: once for each time at which one was given.
    fn take(
        &mut self,
        target: Option<&TargetContent>,
        check: &dyn Fn(&TargetContent) -> Result<(), u32>,
        tick: u64,
        ends: bool,
    ) {
        (self.tick, self.withheld) = (tick, None);
        if let Some(target) = target.filter(|target| **target != self.held) {
            // A checkpoint has room for all ticks but the last.
            let given = Some(target.given_tick.min(u64::MAX - 1));
            match check(target) {
                Ok(()) => {
                    if target.twist != self.held.twist || target.kind != self.held.kind {
                        self.behind_m = 0.0;
                    }
                    if target.kind != self.held.kind || target.side != self.held.side {
                        self.ended = None;
                    }
                    if target.force != self.held.force {
                        self.given_up = [0.0; 3];
                    }
                    self.held = *target;
                }
                Err(why) if self.refused.tick != given => {
                    self.refused = Refused {
                        tick: given,
                        count: self.refused.count.saturating_add(1),
                        why,
                    };
                }
                Err(_) => {}
            }
        }
        let is_over = self.held.kind == TARGET_END || ends;
        self.over = self.over.or(is_over.then_some(tick));
    }

    /// The state of the session, for people: what is asked, how much of it is done, and why not more.
    fn explain(&self, asked: &Asked, report: &Report<N>, length_m: f64) -> ServoState {
        let (wish, clock) = (&asked.wish, asked.clock);
        let nearest = intake::nearest(report);
        let fastest = &self.fastest;
        let is_posture = self.is_posture();
        // Near a singularity the fold itself tells what is beyond reach. A reference that leads waits for ζ to turn out of its way, or has no way on.
        let is_near = nearest.is_some_and(|(_, openness)| openness < NEAR);
        let leads = asked.lead.saturation > SATURATED;
        let is_bounded = self.clipped || leads && !is_near;
        let is_off = linear(&wish.off).norm() > OFF.0 || angular(&wish.off).norm() > OFF.1;
        let is_slow = clock < FULL || leads || is_off;
        let limit = fastest
            .joint
            .filter(|_| fastest.clock < FULL && fastest.clock <= 1.2 * clock + 0.05)
            .or(self.withheld.filter(|_| is_slow));
        // The first that holds.
        let reasons = [
            (self.over.is_some(), REASON_OVER),
            (self.stops.now, REASON_STOPPED),
            (wish.stale, REASON_STALE),
            (
                wish.asked == Vector6::zeros() && !is_posture && !self.presses,
                REASON_RESTING,
            ),
            (asked.behind.norm() > BEHIND_M.0, REASON_HELD),
            (limit.is_some(), REASON_LIMIT),
            (!is_posture && is_bounded, REASON_REACH),
            (!is_posture && leads && !asked.turns, REASON_LOST),
            (is_slow && is_near, REASON_SINGULARITY),
            (clock < FULL, REASON_EFFORT),
            (asked.leaves_out, REASON_AXES),
            (is_off || (wish.V - wish.asked).amax() > 1e-9, REASON_FAST),
        ];
        let reason = reasons.iter().find(|(holds, _)| *holds);
        let reason = reason.map_or(REASON_FOLLOWING, |(_, reason)| *reason);
        let joint = limit.filter(|_| reason == REASON_LIMIT);
        ServoState {
            V_target: wish.asked.into(),
            p_target: wish.p.into(),
            speed_scale: self.speed_scale(&wish.asked, clock, length_m),
            behind_m: self.behind_m,
            nearest: nearest.map_or(1e9, |(_, openness)| openness),
            age_s: asked.age_s,
            reason,
            joint: joint.map_or(0, |(i, _)| i as u32 + 1),
            upper: joint.map_or(0, |(_, is_upper)| u32::from(is_upper)),
            singularity: nearest.map_or(0, |(place, _)| place as u32 + 1),
            refused: self.refused.count,
            refusal: self.refused.why,
            stop: self.stops.why.code(),
            stops: self.stops.count,
            ..ServoState::default()
        }
    }

    /// The share of the twist asked for that the reference moves with, 0 to 1; metres are made radians by the arm's length.
    fn speed_scale(&self, asked: &Vector6, clock: f64, length_m: f64) -> f64 {
        let scaled = |V: &Vector6| stack(&(linear(V) / length_m), &angular(V));
        let (asked, moved) = (scaled(asked), scaled(&(self.V * clock)));
        let size = asked.norm_squared();
        if size < 1e-12 {
            1.0
        } else {
            (asked.dot(&moved) / size).clamp(0.0, 1.0)
        }
    }
}

/// A velocity without what would press the arm further against what holds it back: `behind` is how far the hand is behind that of the reference arm, m.
fn yielding(v: Vector3, behind: &Vector3) -> Vector3 {
    let size = behind.norm();
    if size <= BEHIND_M.0 {
        return v;
    }
    let share = smoothstep((size - BEHIND_M.0) / (BEHIND_M.1 - BEHIND_M.0));
    v - behind * (v.dot(behind).max(0.0) * share / (size * size))
}
