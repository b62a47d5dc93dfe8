//! The rehearsal: the law on its model, before the arm moves. Where it keeps to the path in time without a plan, none is made (+).
//!
//! In a lock the law turns ζ while the path begins, and need not wait for it. A route of the search stops there, or takes another way. On which side of a lock
//! an arm that begins in it is, noise would decide: the side that was rehearsed is the one that the law begins with.

use crate::controller::Setup;
use crate::linear::{Joints, Vector6, angular, linear, served, sign};
use crate::paper::type_1::SIDE_CHANGE;
use crate::singularity::analyzer::Analyzer;
use crate::state::State;
use crate::tick::{Inputs, act};
use crate::types::{Phase, Refusal, Report};
use std::iter;

/// Most ticks: about 1 s of computing.
const TICKS: f64 = 60_000.0;
/// Share of the deviation that the task allows, of the speed limits, and of the tolerance at the end that the law may take: the rest is for noise.
const DEVIATION: f64 = 0.6;
const SPEED: f64 = 0.93;
const END: f64 = 0.2;
/// Distance kept from every joint limit, rad (m).
const CLEAR: f64 = 0.02;
/// Most of the path's own time.
const IN_TIME: f64 = 1.005;

/// The state in which the law, without a plan, follows the whole path of `setup` from rest in `q`: the one that has `begun`, on the side of each lock in the
/// `report` of `q` on which it does. `None` where it does on neither.
pub(crate) fn followed<const N: usize>(
    setup: &Setup<N>,
    analyzer: &Analyzer<N>,
    q: Joints<N>,
    report: &Report<N>,
    begun: State<N>,
) -> Option<State<N>> {
    let on_side = |own: f64| {
        let mut state = begun;
        for (one, s) in state.loops.iter_mut().zip(report.listed()) {
            if s.inside && s.across().abs() < SIDE_CHANGE {
                one.memory.side = own * sign(s.across() >= 0.0);
            }
        }
        state
    };
    let (own, other) = (on_side(1.0), on_side(-1.0));
    let sides = iter::once(own).chain((other != own).then_some(other));
    let mut sides = sides.filter(|state| is_followed(setup, analyzer.clone(), q, *state));
    sides.next()
}

/// Whether the law does so from the state that has `begun`.
fn is_followed<const N: usize>(
    setup: &Setup<N>,
    mut analyzer: Analyzer<N>,
    mut q: Joints<N>,
    mut state: State<N>,
) -> bool {
    let (model, scenario) = (&setup.model, &setup.scenario);
    let (dt, goal) = (scenario.dt_s(), &scenario.goal);
    // A side to leave a fold on, or a direction of the arm's own, is for the plan to keep.
    let mut legs = setup.path.legs().iter();
    let is_plain = legs.all(|leg| leg.branch == 0 && !leg.is_relative());
    let duration_s = setup.path.duration_s();
    let ticks = (duration_s * IN_TIME + scenario.settle_s) / dt;
    if !is_plain || !setup.forces.are_none() || ticks > TICKS {
        return false;
    }
    let zero = Joints::zeros();
    let mut qdot = zero;
    let mut error = Vector6::zeros();
    let share = |error: &Vector6, mm: f64, deg: f64| {
        let served = served(&setup.task, error);
        (linear(&served).norm() * 1e3 / mm).max(angular(&served).norm().to_degrees() / deg)
    };
    for tick in 0..ticks.ceil() as u64 + 1 {
        let terms = model.evaluate(&q, &qdot);
        let inputs = Inputs {
            tick,
            q: &q,
            qdot: &qdot,
            tau_disturbance: &zero,
            wrist: None,
            report: &analyzer.step(&q, &qdot, &terms),
            terms: Some(&terms),
            target: None,
        };
        let command = act(setup, &mut state, &inputs, &terms);
        error = command.error;
        let is_late = command.phase == Phase::Running && tick as f64 * dt > duration_s * IN_TIME;
        let is_kept = command.refusal == Refusal::None
            && command.limited.saturation_mask == 0
            && !is_late
            && share(&error, goal.path_mm, goal.path_deg) < DEVIATION;
        if !is_kept {
            return false;
        }
        qdot += terms.qddot(&command.tau) * dt;
        q += qdot * dt;
        let is_within = |i: usize| {
            let room = (q[i] - model.lower()[i]).min(model.upper()[i] - q[i]);
            qdot[i].abs() <= SPEED * model.velocity()[i] && room >= CLEAR
        };
        if !(0..N).all(is_within) {
            return false;
        }
    }
    share(&error, goal.position_mm, goal.orientation_deg) < END
}
