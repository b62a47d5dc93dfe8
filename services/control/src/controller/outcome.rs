//! What a tick leaves: the command and the checkpoint, also where the law refuses or the estimate is in doubt.

use super::Controller;
use crate::continuous::avoidance;
use crate::continuous::saturation::Limited;
use crate::continuous::torque_rate::Sent;
use crate::linear::{angular, stack};
use crate::plausibility::{self, Plausible};
use crate::state::State;
use crate::tick::{Auxiliary, Inputs, Motion};
use crate::types::{Command, Mode, Phase, Plan, Refusal};
use model::Terms;
use nalgebra::{SVector, Vector6};
use shared_types::scenario::Control;
use shared_types::{ControllerCheckpoint, MAX_SINGULARITIES};

impl<const N: usize> Controller<N> {
    /// Brings the arm to rest from where it plausibly is, its path's clock with it; after too long it refuses to go on.
    pub(super) fn doubt(&mut self) -> Command<N> {
        let (dt, damping) = (self.scenario.dt_s(), 0.5 * self.scenario.control.k_v);
        let ticks = self.state.plausible.doubt_ticks;
        if f64::from(ticks) * dt > plausibility::DOUBT_S {
            self.state.refusal = Refusal::Doubt;
        }
        self.state.plausible.come_to_rest(damping, dt);
        if self.scenario.control.governor {
            self.state.governor.slow_down(damping, dt);
        }
        let Plausible { q, qdot, .. } = self.state.plausible;
        let terms = self.model.evaluate(&q, &qdot);
        let rest = self.refusal(Some((&terms, &qdot)));
        if self.state.refusal != Refusal::None {
            return rest;
        }
        let clock = self.state.governor.rate;
        if self.path.leg(self.state.progress.leg).is_some() {
            let on_path = self.guide.path_time(self.state.route_time_s, clock * dt);
            self.state.route_time_s += clock * dt;
            self.state.progress.time_s += on_path;
            self.state.path_time_s += on_path;
        }
        let desired = self.path.desired(&self.state.progress, clock, 0.0);
        let running = self.path.leg(self.state.progress.leg).is_some();
        Command {
            R_BE_d: desired.R,
            p_BE_d: desired.p,
            V_BE_d: desired.V,
            path_time_s: self.state.path_time_s,
            time_scale: clock,
            mode: self.state.loops.map(|one| one.mode),
            phase: if running { Phase::Running } else { Phase::Settling },
            refusal: Refusal::None,
            ..rest
        }
    }

    /// The command and the telemetry of the tick.
    pub(super) fn command(
        &self,
        state: &State<N>,
        now: &Inputs<'_, N>,
        motion: &Motion<N>,
        auxiliary: &Auxiliary<N>,
        limited: &Limited<N>,
    ) -> Command<N> {
        let Motion { leg, desired_E, error, .. } = motion;
        let telemetry = &auxiliary.telemetry;
        let planned = leg.and_then(|leg| leg.reorient).filter(|_| state.turn.duration_s > 0.0);
        Command {
            tau: state.sent.tau,
            tau_task: state.sent.tau - state.sent.null,
            tau_null: state.sent.null,
            R_BE_d: desired_E.R,
            p_BE_d: desired_E.p,
            V_BE_d: desired_E.V,
            error: stack(&(desired_E.p - now.terms.X_BE.p), &angular(error)),
            path_time_s: state.path_time_s,
            time_scale: motion.clock * motion.planned.map_or(1.0, |plan| plan.pace),
            null_scale: limited.null_scale,
            task_scale: limited.task_scale,
            beta: telemetry.beta,
            aux_d: telemetry.aux_d,
            aux_rate_d: telemetry.aux_rate_d,
            plan: planned.map(|(place, _)| Plan { place, by: state.turn.by, duration_s: state.turn.duration_s }),
            mode: telemetry.mode,
            segment: state.progress.leg as u32,
            phase: match (leg, state.progress.time_s < self.scenario.settle_s) {
                (Some(_), _) => Phase::Running,
                (None, true) => Phase::Settling,
                (None, false) => Phase::Done,
            },
            saturation_mask: limited.mask,
            rate_mask: 0,
            doubt_ticks: 0,
            clipped: telemetry.clipped,
            refusal: Refusal::None,
        }
    }

    /// Gravity held and motion damped, within the limits and the torque rates; towards zero torque where the state is not finite.
    pub(super) fn refusal(&mut self, known: Option<(&Terms<N>, &SVector<f64, N>)>) -> Command<N> {
        let limits = *self.model.effort();
        let mut tau = known.map_or_else(SVector::zeros, |(terms, qdot)| {
            terms.gravity - SVector::<f64, N>::from_fn(|i, _| terms.A[(i, i)] * 0.5 * self.scenario.control.k_v * qdot[i])
        });
        if !tau.iter().all(|x| x.is_finite()) {
            tau = SVector::zeros();
        }
        let mut mask = 0;
        for i in 0..N {
            if tau[i].abs() >= limits[i] {
                mask |= 1 << i;
                tau[i] = tau[i].clamp(-limits[i], limits[i]);
            }
        }
        let wanted = Limited { tau, task: tau, null: SVector::zeros(), null_scale: 0.0, task_scale: 0.0, mask, load: 0.0 };
        let rate_mask;
        (self.state.sent, rate_mask) = self.state.sent.next(&wanted, &SVector::zeros(), &self.torque_step());
        let Sent { tau, null, .. } = self.state.sent;
        let start = self.state.progress.start;
        Command {
            tau,
            tau_task: tau - null,
            tau_null: null,
            R_BE_d: start.R,
            p_BE_d: start.p,
            V_BE_d: Vector6::zeros(),
            error: Vector6::zeros(),
            path_time_s: self.state.path_time_s,
            time_scale: 0.0,
            null_scale: 0.0,
            task_scale: 0.0,
            beta: [1.0; MAX_SINGULARITIES],
            aux_d: [0.0; MAX_SINGULARITIES],
            aux_rate_d: [0.0; MAX_SINGULARITIES],
            plan: None,
            mode: [Mode::Regular; MAX_SINGULARITIES],
            segment: self.state.progress.leg as u32,
            phase: Phase::Refused,
            saturation_mask: mask,
            rate_mask,
            doubt_ticks: self.state.plausible.doubt_ticks,
            clipped: false,
            refusal: self.state.refusal,
        }
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    pub fn save(&self, out: &mut ControllerCheckpoint) {
        self.state.save(out);
    }

    /// Takes up what [`save`](Self::save) has written: the next tick continues bit for bit.
    pub fn restore(&mut self, from: &ControllerCheckpoint) {
        self.state = State::from_checkpoint(from, self.model.effort());
    }

    /// Acceleration wanted in the null space, rad/s²: towards the planned posture, else the commanded one, and near a lost direction around it.
    pub(super) fn posture_acceleration(&self, state: &State<N>, now: &Inputs<'_, N>, motion: &Motion<N>) -> SVector<f64, N> {
        let Control { k_p, k_v, .. } = self.scenario.control;
        let commanded = self.scenario.segment.iter().any(|segment| segment.posture_deg.is_some());
        if let Some(plan) = motion.planned.as_ref().filter(|_| !commanded) {
            return (plan.q - now.q) * (0.25 * k_p) + (plan.dq * motion.clock - now.qdot) * k_v;
        }
        let towards = (self.posture(state) - now.q) * (0.25 * k_p);
        let first = self.family.get().goes_around().filter(|_| self.is_ours());
        let around = first.and_then(|first| avoidance::around(&now.at.J, &self.task, now.report, first));
        around.map_or(towards, |(rate, weight)| towards * (1.0 - weight) + rate * (k_v * weight)) - now.qdot * k_v
    }

    /// The posture that the null space is driven to, reached by the leg's own time law.
    pub(super) fn posture(&self, state: &State<N>) -> SVector<f64, N> {
        let Some(goal) = self.postures.get(state.progress.leg) else {
            return *self.postures.last().unwrap_or(&self.q_start);
        };
        let from = state.progress.leg.checked_sub(1).map_or(&self.q_start, |i| &self.postures[i]);
        from + (goal - from) * self.path.ramp(&state.progress)
    }
}
