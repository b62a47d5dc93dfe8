//! The posture that the null space of a redundant arm is driven to (+).

use super::avoidance;
use crate::controller::Setup;
use crate::linear::Joints;
use crate::setup::{SetupError, posture_goals};
use crate::state::State;
use crate::tick::{Motion, Now};
use model::Robot;
use shared_types::scenario::Scenario;

/// Distance from the start posture that the null space of a steered arm answers to, rad: it goes back at 0.1 rad/s. A session leads the arm far from
/// there, by postures too, and what it asks for next must not set all joints in motion.
const STEERED: f64 = 0.04;

/// The posture goals of a task.
#[derive(Clone, Debug)]
pub(crate) struct Postures<const N: usize> {
    q_start: Joints<N>,
    /// Posture goal of each leg, rad; `None`: that of the start.
    goals: Vec<Option<Joints<N>>>,
    /// Whether the scenario commands any of them.
    commanded: bool,
    /// Whether the run is steered.
    steered: bool,
    /// Whether a goal attracts from the beginning of its leg on, as in the paper's Figures 1 and 2; else the leg's time law leads to it.
    attracts: bool,
}

impl<const N: usize> Postures<N> {
    /// The scenario's posture goals; the start posture where it has none.
    ///
    /// # Errors
    /// [`SetupError::Posture`] for a posture that does not fit the robot.
    pub(crate) fn new(
        robot: &Robot,
        scenario: &Scenario,
        q_start: Joints<N>,
    ) -> Result<Self, SetupError> {
        let goals = posture_goals(robot, scenario)?;
        Ok(Self {
            q_start,
            commanded: goals.iter().any(Option::is_some),
            goals,
            steered: scenario.servo.is_some(),
            attracts: !scenario.control.strategy.follows_paths(),
        })
    }

    /// Those of a steered run that starts in another posture.
    pub(crate) fn begin(&mut self, q_start: Joints<N>) {
        self.q_start = q_start;
    }

    /// Posture goal of each leg that has one, rad.
    pub(crate) fn goals(&self) -> &[Option<Joints<N>>] {
        &self.goals
    }

    /// Keeps a posture from a leg of this index on, where none is commanded: the one in which a plan ends before the path does.
    pub(crate) fn stay(&mut self, from: Option<(usize, Joints<N>)>) {
        let Some((leg, q)) = from.filter(|_| !self.commanded) else {
            return;
        };
        if leg == 0 {
            self.q_start = q;
        }
        self.goals
            .iter_mut()
            .skip(leg.saturating_sub(1))
            .for_each(|goal| *goal = Some(q));
    }

    /// ∇V₀ of Eq. 5, rad/s²: towards the planned posture, else the commanded one, and near a lost direction around it.
    pub(crate) fn gradient(
        &self,
        setup: &Setup<N>,
        state: &State<N>,
        now: &Now<'_, N>,
        motion: &Motion<N>,
    ) -> Joints<N> {
        let control = &setup.scenario.control;
        let (k_p, k_vq) = (control.k_p, control.k_vq());
        if let Some(plan) = motion.planned.as_ref().filter(|_| !self.commanded) {
            return (now.q - plan.q) * k_p - plan.qdot * k_vq - plan.qddot_spare;
        }
        let off = now.q - self.at(setup, state);
        let off = if self.steered {
            off * (STEERED / off.amax().max(STEERED))
        } else {
            off
        };
        let towards = off * (0.25 * k_p);
        avoidance::away(setup, now).map_or(towards, |(rate, weight)| {
            towards * (1.0 - weight) - rate * (k_vq * weight)
        })
    }

    /// The goal, as far as the leg's own time law has come.
    fn at(&self, setup: &Setup<N>, state: &State<N>) -> Joints<N> {
        let (leg, legs) = (state.progress.leg, self.goals.len());
        let goal = |leg: usize| {
            self.goals
                .get(leg)
                .copied()
                .flatten()
                .unwrap_or(self.q_start)
        };
        if leg >= legs {
            return goal(legs.saturating_sub(1));
        }
        if self.attracts {
            return goal(leg);
        }
        let from = leg.checked_sub(1).map_or(self.q_start, goal);
        from + (goal(leg) - from) * setup.path.ramp(&state.progress)
    }
}
