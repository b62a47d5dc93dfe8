//! The path plan in use: auxiliary coordinates, posture and clock at each tick (+).
//!
//! Reduces to the paper's law: without a plan nothing changes, and on a feasible path the planned coordinate is the one that the path needs.

use crate::linear::Joints;
use crate::paper::reference::Target;
use crate::plan::{PathPlan, Sample};
use crate::types::{Mode, Singularity};

/// Error of a planned auxiliary coordinate from which, and at which, the clock waits for it, rad.
const WAIT_FROM: f64 = 0.05;
const WAIT_TO: f64 = 0.25;
/// Demand on the clock that makes it wait.
pub const WAIT: f64 = 20.0;
/// Half of the time over which the planned acceleration is taken, s, and that of spare joints.
const RISE_S: f64 = 0.015;
const SPARE_RISE_S: f64 = 0.03;
/// Lag of the clock behind its target, s.
const LAG_S: f64 = 0.04;

/// The planned motion at a moment, at the clock's present speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned<const N: usize> {
    /// Posture, rad.
    pub q: Joints<N>,
    /// Its rate, rad/s.
    pub qdot: Joints<N>,
    /// Its acceleration, rad/s²: the mean over a time in which a torque can rise.
    pub qddot: Joints<N>,
    /// The same for spare joints: the mean over a longer time, for their plan is no smoother than it need be, and leaves the torque rates to the path.
    pub qddot_spare: Joints<N>,
    /// Speed of the path's clock against the route's: 1, or 0 while the path waits.
    pub time_rate: f64,
}

/// The plan of a task, where there is one.
#[derive(Clone, Debug, PartialEq)]
pub struct Guide<const N: usize> {
    plan: Option<PathPlan<N>>,
    /// Legs of the path, planned or not.
    legs: usize,
}

impl<const N: usize> Guide<N> {
    /// By a plan, or by none, for a path of so many `legs`.
    pub fn new(plan: Option<PathPlan<N>>, legs: usize) -> Self {
        Self { plan, legs }
    }

    /// The planned posture at the route's time `route_s` in the leg of this index; `None` where the leg is not planned.
    ///
    /// After the last leg it is the posture in which the plan ends. A plan that ends earlier, before a leg whose goal is beyond reach, says nothing
    /// about that leg.
    pub fn at(&self, leg: usize, route_s: f64) -> Option<Sample<N>> {
        let plan = self.plan.as_ref()?;
        let after = leg == self.legs && leg == plan.legs() && route_s >= plan.duration_s();
        (leg < plan.legs() || after).then(|| plan.at(route_s))
    }

    /// The leg whose goal is beyond reach, before which the plan ends, and the posture in which it does, rad.
    pub fn beyond_reach(&self) -> Option<(usize, Joints<N>)> {
        let plan = self.plan.as_ref()?;
        plan.is_short()
            .then(|| (plan.legs(), plan.at(plan.duration_s()).q))
    }

    /// The planned motion there, where the clock runs at `rate` and changes at `rate_dot`, 1/s.
    pub fn motion(&self, leg: usize, route_s: f64, rate: f64, rate_dot: f64) -> Option<Planned<N>> {
        let plan = self.plan.as_ref()?;
        let now = self.at(leg, route_s)?;
        // Beside a wait the clock's speed changes by a hundred in a moment: what lies behind was passed at the speed of then.
        let qdot = |by_s: f64| {
            let then = (rate + rate_dot * by_s).clamp(0.0, 1.0);
            plan.at(route_s + 0.5 * (rate + then) * by_s).dq * then
        };
        let mean = |rise_s: f64| (qdot(rise_s) - qdot(-rise_s)) / (2.0 * rise_s);
        Some(Planned {
            q: now.q,
            qdot: now.dq * rate,
            qddot: mean(RISE_S),
            qddot_spare: mean(SPARE_RISE_S),
            time_rate: now.time_rate,
        })
    }

    /// Fastest clock to begin with, 1 without a plan.
    pub fn first_speed(&self) -> f64 {
        self.speed(self.at(0, 0.0).is_some(), 0.0, 1.0)
    }

    /// Whether the leg of this index is one whose goal is beyond reach, or comes after it.
    pub fn ends_before(&self, leg: usize) -> bool {
        self.beyond_reach().is_some_and(|(first, _)| leg >= first)
    }

    /// The target of an auxiliary coordinate: its gradient times the way to the planned posture.
    pub fn target(&self, s: &Singularity<N>, planned: &Planned<N>, q: &Joints<N>) -> Target {
        let mode = if planned.time_rate == 0.0 {
            Mode::Reorient
        } else {
            Mode::Track
        };
        Target {
            error: s.aux_row.dot(&(planned.q - q)),
            rate: s.aux_row.dot(&planned.qdot),
            change: Some(s.aux_row.dot(&planned.qddot) + s.aux_bias),
            weight: 1.0,
            mode,
            clipped: false,
        }
    }

    /// Demand on the clock by a coordinate that is not where it is planned.
    #[inline]
    pub fn waiting(error: f64, beta: f64) -> f64 {
        (1.0 - beta) * ((error.abs() - WAIT_FROM) / (WAIT_TO - WAIT_FROM)).clamp(0.0, 1.0) * WAIT
    }

    /// Fastest clock that the plan allows from now until the clock's lag has passed.
    #[inline]
    pub fn speed(&self, is_planned: bool, route_s: f64, clock: f64) -> f64 {
        let plan = self.plan.as_ref().filter(|_| is_planned);
        plan.map_or(1.0, |plan| plan.speed(route_s, route_s + clock * LAG_S))
    }

    /// Path time that passes while the route's clock goes on by `step_s`, s.
    #[inline]
    pub fn path_time(&self, route_s: f64, step_s: f64) -> f64 {
        self.plan.as_ref().map_or(step_s, |plan| {
            plan.path_time(route_s + step_s) - plan.path_time(route_s)
        })
    }
}
