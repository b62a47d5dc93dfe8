//! Limits (+): the filters of a tick, in the order in which they act.
//!
//! | filter | keeps | gives up, in this order | file |
//! |---|---|---|---|
//! | plausibility | the law from estimates that no arm can have moved to | the path: the arm is brought to rest meanwhile | [`plausible`] |
//! | lead (targets) | the reference near the arm | what the target asks for beyond reach | [`lead`](crate::reference::targets::lead) |
//! | feedback | accelerations that an arm has | the answer to an error beyond 50 mm, 0.25 rad | [`reference`](crate::reference) |
//! | auxiliary rate | null motion that a joint can follow; of a reference arm, with which it can stop before its limits | the rate of the auxiliary coordinate | [`auxiliary`](crate::law::auxiliary) |
//! | range | a joint before its limit | the run: it is refused, and the arm brakes | [`range`] |
//! | speed | every joint's speed | null-space torque, path torque, the rest | [`speed`] |
//! | torque | every joint's torque | null-space torque, path torque, the rest, what a joint lacks | [`torque`] |
//! | torque rate | the change that a drive accepts | null-space torque, path torque, what a joint lacks | [`torque`] |
//! | stops (targets) | the range of the reference arm's joints | null motion, motion along the path, what a joint lacks | [`range`] |
//! | clock | all of the above ahead of time | time: the path's clock slows down | [`clock`] |
//!
//! Each passes on what respects its limit unchanged, so that on a feasible path the law is the paper's. Four of them are one rule, [`shares`]: of three
//! parts within a box, the null space is scaled down first, then the path.

pub mod clock;
pub mod plausible;
pub mod range;
pub mod speed;
pub mod torque;

use crate::controller::Setup;
use crate::law::Torques;
use crate::linear::Joints;
use crate::reference::error::clock_beside;
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::Refusal;
use clock::Load;
use speed::largest_share;
use torque::Limited;

/// Joint speed over its limit, at full clock speed, beyond which the path is refused: twice the limit even at the slowest clock.
const SPEED_RATIO_MAX: f64 = 40.0;

/// Step 4's result.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kept<const N: usize> {
    /// The torque as the drives left it.
    pub(crate) limited: Limited,
    /// The path's demand on the limits, for the clock.
    pub(crate) load: Load<N>,
}

/// Step 4: the torque that is sent, gravity, Coriolis and the disturbance compensated: range, speed, torque and torque rate of the table above.
///
/// `auxiliary_load` is the largest share of an auxiliary rate at full clock speed.
///
/// # Errors
/// [`Refusal::Speed`] where no clock is slow enough for the joint speeds, [`Refusal::Limit`] where a joint is about to reach its limit.
pub(crate) fn apply<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
    motion: &Motion<N>,
    torques: &Torques<N>,
    auxiliary_load: f64,
) -> Result<Kept<N>, Refusal> {
    let (model, control) = (&setup.model, &setup.scenario.control);
    let (terms, nominal) = (now.terms, &torques.qdot_nominal);
    // A reference arm stops before its joints' limits, so its motion is not refused there: its clock slows down.
    let is_path = setup.scenario.servo.is_none();
    let is_nearing = is_path
        && control.strategy.is_ours()
        && range::is_nearing(motion.planned.as_ref(), (now.q, now.qdot), terms, model);
    if !is_path {
        state.targets.fastest = range::fastest(now.q, nominal, model);
    }
    let share = largest_share(nominal, model.velocity());
    let has_floor = motion.planned.is_none() && !motion.clips && is_path;
    if control.governs() && has_floor && share > SPEED_RATIO_MAX {
        return Err(Refusal::Speed);
    }
    if is_nearing {
        return Err(Refusal::Limit);
    }
    let clock = state.clock.rate;
    let present = speed::demand(now.qdot, model.velocity()) / clock;
    let mut parts = torques.parts;
    if control.governs() {
        let (velocity, rate) = (model.velocity(), model.torque_rate());
        parts = speed::held(&parts, &terms.A, now.qdot, velocity, rate)?;
    }
    let beside = match motion.clips {
        true => clock_beside(&setup.task, &motion.error, now.report),
        false => 1.0,
    };
    let is_planned = motion.planned.is_some();
    let load = Load {
        speed: auxiliary_load.max(share).max(present),
        holding: terms.gravity,
        following: (terms.A * torques.qddot_path + terms.coriolis) / (clock * clock),
        braking: terms.A * nominal,
        planned: (setup.guide)
            .speed(is_planned, state.clock.plan_s, clock)
            .min(state.targets.fastest.clock)
            .min(beside),
        is_planned,
    };
    // A reference arm touches nothing.
    let bearing = state.force.bearing(terms).filter(|_| is_path);
    let disturbance = control
        .compensate_disturbance
        .then_some(now.tau_disturbance);
    let bias = setup.drives.bias(terms, bearing, disturbance);
    let limited = setup.drives.send(&mut state.sent, &bias, &parts);
    Ok(Kept { limited, load })
}

/// A torque or an acceleration in the parts in which limits give it up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts<const N: usize> {
    /// In the null space of the kept rows: given up first.
    pub null: Joints<N>,
    /// Along the path.
    pub path: Joints<N>,
    /// Feedback, and the motion orthogonal to the path.
    pub rest: Joints<N>,
}

impl<const N: usize> Parts<N> {
    /// Nothing.
    pub fn zero() -> Self {
        let zero = Joints::zeros();
        Self {
            null: zero,
            path: zero,
            rest: zero,
        }
    }

    /// Their sum.
    #[must_use]
    #[inline]
    pub fn sum(&self) -> Joints<N> {
        self.rest + self.path + self.null
    }

    /// Each part by its share: of the null space, of the path, and of the rest.
    #[must_use]
    #[inline]
    pub fn scaled(&self, [null, path, rest]: [f64; 3]) -> Self {
        Self {
            null: self.null * null,
            path: self.path * path,
            rest: self.rest * rest,
        }
    }
}

/// The largest k in [0, 1] with low ≤ fixed + k·part ≤ high at each joint; 0 where the part leads further out at a joint that is out.
#[inline]
fn largest<const N: usize>(
    fixed: &Joints<N>,
    part: &Joints<N>,
    [low, high]: [&Joints<N>; 2],
) -> f64 {
    (0..N).fold(1.0_f64, |share, i| {
        let room = if part[i] > 0.0 {
            high[i] - fixed[i]
        } else {
            fixed[i] - low[i]
        };
        // Rounding is not a violation: the cut at the joint makes up for it.
        let rounding = 1e-12 * (fixed[i].abs() + part[i].abs());
        if part[i].abs() > room + rounding {
            share.min(room.max(0.0) / part[i].abs())
        } else {
            share
        }
    })
}

/// The shares of null space, path and rest that keep low ≤ fixed + Σ ≤ high: the largest of the first, then the largest of the second, then of the third.
///
/// Shapes N · Units those of the parts · Ensures shares in [0, 1]; what the rest alone has beyond the box stays there, and is the caller's to cut ·
/// Cost O(N), no allocation
#[inline]
pub fn shares<const N: usize>(
    fixed: &Joints<N>,
    parts: &Parts<N>,
    limits: [&Joints<N>; 2],
) -> [f64; 3] {
    let Parts { null, path, rest } = parts;
    let k_n = largest(&(fixed + rest + path), null, limits);
    let k_p = largest(&(fixed + rest + null * k_n), path, limits);
    let k_r = largest(&(fixed + null * k_n + path * k_p), rest, limits);
    [k_n, k_p, k_r]
}
