//! The rates that the path ahead demands, from the closed forms of the arm's family, for the governor (+).

use crate::continuous::foresight::{FORESEEN_STEP_S, Foreseen, Foresight};
use crate::controller::Setup;
use crate::state::State;
use crate::tick::Now;
use crate::types::Kind;

/// The demand of the path ahead; none beyond its end, and while a leg turns ζ.
///
/// Errors none · Cost about 2 µs where the family has closed forms, no allocation
pub(crate) fn demand_ahead<const N: usize>(
    setup: &Setup<N>,
    state: &State<N>,
    now: &Now<'_, N>,
) -> Foreseen {
    let (path, scenario) = (&setup.path, &setup.scenario);
    let mut foreseen = Foreseen::default();
    if path
        .leg(state.progress.leg)
        .is_none_or(|leg| leg.reorient.is_some())
    {
        return foreseen;
    }
    let wrist = now
        .report
        .listed()
        .iter()
        .position(|s| s.kind == Kind::Wrist);
    let at = Foresight {
        q: now.q,
        terms: now.terms,
        p_C: now.report.p_BC,
        poses: &path.preview(&state.progress, now.p_EC),
        step_s: FORESEEN_STEP_S,
        velocity: setup.model.velocity(),
        rate_max: &scenario.control.aux_rate_max,
        eta_out: &scenario.analysis.eta_out,
        passing: wrist.is_some_and(|wrist| state.loops[wrist].memory.passing),
    };
    setup.family.get().foresee(&at, &mut foreseen);
    foreseen
}
