//! The command of a tick: torque, desired motion and telemetry, under the law and while the arm is brought to rest.

use crate::controller::Setup;
use crate::law::singular_rows::SingularRows;
use crate::limits::torque::Limited;
use crate::linear::{Vector6, angular, stack};
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::{Command, Mode, Phase, Plan, Refusal};
use shared_types::MAX_SINGULARITIES;

/// The command of a tick under the law.
#[inline]
pub(crate) fn running<const N: usize>(
    setup: &Setup<N>,
    state: &State<N>,
    now: &Now<'_, N>,
    motion: &Motion<N>,
    rows: &SingularRows<N>,
    limited: &Limited,
) -> Command<N> {
    let Motion { leg, desired_E, .. } = motion;
    let turned = leg
        .and_then(|leg| leg.reorient)
        .filter(|_| state.turn.duration_s > 0.0);
    Command {
        X_BE_d: desired_E.pose(),
        V_BE_d: desired_E.V,
        error: stack(&(desired_E.p - now.terms.X_BE.p), &angular(&motion.error)),
        time_scale: motion.clock * motion.planned.map_or(1.0, |plan| plan.time_rate),
        limited: *limited,
        beta: rows.beta,
        aux_d: rows.aux_d,
        aux_rate_d: rows.aux_rate_d,
        plan: turned.map(|(place, _)| Plan {
            place,
            by: state.turn.by,
            duration_s: state.turn.duration_s,
        }),
        mode: modes(setup, state),
        phase: match leg {
            Some(_) => Phase::Running,
            None if state.progress.time_s < setup.scenario.settle_s => Phase::Settling,
            None => Phase::Done,
        },
        rejected_ticks: 0,
        clipped: rows.clipped,
        refusal: Refusal::None,
        ..resting(state, limited)
    }
}

/// The law's action at each singularity. The laws of others have none there, but a path beyond reach is moved onto the boundary for them, too.
pub(crate) fn modes<const N: usize>(
    setup: &Setup<N>,
    state: &State<N>,
) -> [Mode; MAX_SINGULARITIES] {
    let is_ours = setup.scenario.control.strategy.is_ours();
    state.loops.map(|one| match one.mode {
        Mode::Slide => Mode::Slide,
        mode if is_ours => mode,
        _ => Mode::Regular,
    })
}

/// The command of a tick in which the arm is brought to rest, its torque already in `state`.
pub(crate) fn resting<const N: usize>(state: &State<N>, limited: &Limited) -> Command<N> {
    Command {
        tau: state.sent.tau,
        tau_task: state.sent.tau - state.sent.null,
        tau_null: state.sent.null,
        X_BE_d: state.progress.start,
        V_BE_d: Vector6::zeros(),
        error: Vector6::zeros(),
        path_time_s: state.clock.path_s,
        time_scale: 0.0,
        limited: Limited {
            null_scale: 0.0,
            task_scale: 0.0,
            ..*limited
        },
        beta: [1.0; MAX_SINGULARITIES],
        aux_d: [0.0; MAX_SINGULARITIES],
        aux_rate_d: [0.0; MAX_SINGULARITIES],
        plan: None,
        mode: [Mode::Regular; MAX_SINGULARITIES],
        segment: state.progress.leg as u32,
        phase: Phase::Refused,
        rejected_ticks: state.plausible.rejected_ticks,
        clipped: false,
        refusal: state.refusal,
        session: None,
    }
}
