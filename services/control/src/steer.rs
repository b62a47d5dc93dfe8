//! The controller of a steered run: the target becomes the reference, and the law of a path follows it.

use crate::controller::Controller;
use crate::linear::{angular, linear, stack};
use crate::servo::Reference;
use crate::servo::intake::{self, Wish};
use crate::servo::leash::Pull;
use crate::state::State;
use crate::trajectory::{HORIZON_S, Progress};
use crate::types::{Command, Phase, Refusal, Report};
use nalgebra::{SVector, Vector6};
use shared_types::codes::{
    REASON_EFFORT, REASON_FAST, REASON_FOLLOWING, REASON_LIMIT, REASON_OVER, REASON_REACH, REASON_RESTING, REASON_SINGULARITY,
    REASON_STALE, REASON_STOPPED, TARGET_END, TARGET_POSTURE,
};
use shared_types::{ServoState, TargetContent};

/// Share of the speed asked for below which a reason is given.
const FULL: f64 = 0.95;
/// Joint speed below which an arm that was stopped goes on, rad/s.
const AT_REST: f64 = 0.01;
/// Clock below which it tells nothing about full speed.
const SLOW: f64 = 0.1;
/// |s|/η_out of the nearest singularity below which it is the reason for a slower clock.
const NEAR: f64 = 2.0;
/// Tension of the leash that counts as the boundary of reach.
const TENSION: f64 = 0.02;

impl<const N: usize> Controller<N> {
    /// One tick of a steered run: the torque for this state, towards the target of this tick (`None`: none has come).
    ///
    /// As [`step`](Self::step), but what the law refuses for a moment (a joint about to reach its limit, a direction that no listed singularity
    /// explains) brings the arm to rest, and from there it goes on. Fills `out` but for its header · Requires a scenario that is steered ·
    /// Cost that of `step` and about 1 µs, no allocation
    pub fn steer(
        &mut self,
        (tick, target): (u64, Option<&TargetContent>),
        (q, qdot): (&SVector<f64, N>, &SVector<f64, N>),
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
        out: &mut ServoState,
    ) -> Command<N> {
        let (Some(session), dt) = (&self.scenario.servo, self.scenario.dt_s()) else {
            return self.step(q, qdot, tau_disturbance, report);
        };
        if !q.iter().chain(qdot).all(|x| x.is_finite()) {
            return self.step(q, qdot, tau_disturbance, report);
        }
        let arm = self.model.forward_kinematics(q);
        let State { servo, governor, refusal, loops, qdot_planned, .. } = &mut self.state;
        servo.take(target, tick, session.duration_s, dt);
        if servo.stopping && qdot.amax() < AT_REST {
            servo.stopping = false;
            *refusal = Refusal::None;
            servo.rest_at(arm, *q);
            *governor = Default::default();
            *loops = Default::default();
            *qdot_planned = SVector::zeros();
        }
        let age_s = tick.saturating_sub(servo.held.given_tick) as f64 * dt;
        let pull = Pull::between(&servo.X, &arm);
        let wish = match servo.over {
            Some(_) => Wish { V: Vector6::zeros(), asked: Vector6::zeros(), p: servo.X.p, stale: false },
            None => intake::wish(&servo.held, age_s, &servo.X, report, session),
        };
        let clock = governor.rate;
        if servo.is_posture() && !servo.stopping {
            let goal = if wish.stale || servo.over.is_some() { servo.q } else { model::joints(&servo.held.q) };
            let qddot = servo.accelerate_joints(&goal, self.model.velocity());
            // The pose that the joint reference passes, its twist and acceleration.
            let at = self.model.evaluate(&servo.q, &servo.qdot);
            (servo.X, servo.V, servo.a) = (at.X_BE, at.J * servo.qdot, at.J * qddot + at.Jdot_qdot * clock);
            servo.q += servo.qdot * (clock * dt);
            servo.qdot += qddot * dt;
        } else if !servo.stopping {
            let back;
            (servo.X, back) = pull.hold(&servo.X, &arm);
            servo.behind_m += back;
            if servo.clipped || pull.tension > TENSION {
                servo.X = pull.relax(&servo.X, &wish.V, dt);
            }
            // Where a posture target would begin.
            (servo.q, servo.qdot) = (*q, *qdot_planned / clock.max(SLOW));
            servo.accelerate(&pull.slacken(&wish.V), session, dt);
        }
        self.state.progress =
            Progress { begun: true, by: linear(&servo.V) * HORIZON_S, turn: angular(&servo.V) * HORIZON_S, ..Progress::at(servo.X) };
        let mut command = self.step(q, qdot, tau_disturbance, report);
        self.state.servo.follow(self.state.refusal, clock, dt, command.clipped);
        if self.state.servo.stopping {
            (command.phase, command.refusal) = (Phase::Running, Refusal::None);
        }
        if let Some(over) = self.state.servo.over
            && command.phase == Phase::Running
        {
            let settled = tick.saturating_sub(over) as f64 * dt >= self.scenario.settle_s;
            command.phase = if settled { Phase::Done } else { Phase::Settling };
        }
        self.explain(&wish, &pull, (age_s, clock), report, out);
        command
    }

    /// The share of the twist asked for that the reference moves with, 0 to 1; metres are made radians by the arm's length.
    fn speed_scale(&self, asked: &Vector6<f64>, clock: f64) -> f64 {
        let L = self.length_m;
        let scaled = |V: &Vector6<f64>| stack(&(linear(V) / L), &angular(V));
        let (asked, moved) = (scaled(asked), scaled(&(self.state.servo.V * clock)));
        let size = asked.norm_squared();
        if size < 1e-12 { 1.0 } else { (asked.dot(&moved) / size).clamp(0.0, 1.0) }
    }

    /// The state of the session, for people: what is asked, how much of it is done, and why not more.
    fn explain(&self, wish: &Wish, pull: &Pull, (age_s, clock): (f64, f64), report: &Report<N>, out: &mut ServoState) {
        let servo = &self.state.servo;
        let nearest = intake::nearest(report);
        let speed_scale = self.speed_scale(&wish.asked, clock);
        let limit = servo.fastest.joint.filter(|_| servo.fastest.clock < FULL && servo.fastest.clock <= 1.2 * clock + 0.05);
        let is_near = nearest.is_some_and(|(_, openness)| openness < NEAR);
        let reason = if servo.over.is_some() {
            REASON_OVER
        } else if servo.stopping {
            REASON_STOPPED
        } else if wish.stale {
            REASON_STALE
        } else if wish.asked == Vector6::zeros() && !servo.is_posture() {
            REASON_RESTING
        } else if limit.is_some() {
            REASON_LIMIT
        } else if servo.clipped || pull.tension > TENSION {
            REASON_REACH
        } else if clock < FULL {
            if is_near { REASON_SINGULARITY } else { REASON_EFFORT }
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

impl<const N: usize> Reference<N> {
    /// Takes a target in, or refuses and counts it: once for each time at which one was given.
    fn take(&mut self, target: Option<&TargetContent>, tick: u64, duration_s: f64, dt: f64) {
        self.tick = tick;
        if let Some(target) = target.filter(|target| **target != self.held) {
            match intake::check(target, tick) {
                Ok(()) => {
                    if target.twist != self.held.twist || target.kind != self.held.kind {
                        self.behind_m = 0.0;
                    }
                    self.held = *target;
                }
                Err(refusal) if self.refused_tick != Some(target.given_tick) => {
                    self.refused = self.refused.saturating_add(1);
                    (self.refusal, self.refused_tick) = (refusal, Some(target.given_tick));
                }
                Err(_) => {}
            }
        }
        let is_over = self.held.kind == TARGET_END || tick as f64 * dt >= duration_s;
        self.over = self.over.or(is_over.then_some(tick));
    }

    /// After the law: moves on with the clock, or is stopped by what the law refuses for a moment.
    fn follow(&mut self, refusal: Refusal, clock: f64, dt: f64, clipped: bool) {
        self.clipped = clipped;
        if goes_on(refusal) {
            if !self.stopping {
                self.stops = self.stops.saturating_add(1);
            }
            (self.stopping, self.stop) = (true, refusal);
            self.rest_at(self.X, self.q);
        } else if refusal == Refusal::None && self.held.kind != TARGET_POSTURE {
            self.advance(clock, dt);
        }
    }
}

/// Whether a steered arm goes on after this refusal, once at rest.
fn goes_on(refusal: Refusal) -> bool {
    matches!(refusal, Refusal::Limit | Refusal::Singular | Refusal::Speed | Refusal::Room | Refusal::Unlisted | Refusal::Torque)
}
