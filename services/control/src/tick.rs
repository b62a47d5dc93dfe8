//! One tick: state in, state out.
//!
//! [`Controller::step`] checks the inputs; [`tick`] is the law on a state that can be trusted, in seven calls; [`rest`] brings the arm to rest
//! where there is no law to follow.

use crate::centre::{AtCentre, PoseMotion};
use crate::command;
use crate::controller::{Controller, Setup};
use crate::law::{self, force, singular_rows};
use crate::limits::plausible::{self, Plausible};
use crate::limits::{self, Kept, Parts, clock};
use crate::linear::{Joints, Vector3, Vector6, is_finite};
use crate::plan::beyond_reach;
use crate::reference::guide::Planned;
use crate::reference::path::Leg;
use crate::reference::{self, targets};
use crate::state::State;
use crate::types::{Command, Phase, Refusal, Report};
use model::Terms;
use shared_types::TargetContent;

/// The inputs of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a, const N: usize> {
    /// Its number.
    pub tick: u64,
    /// Joint positions, rad.
    pub q: &'a Joints<N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a Joints<N>,
    /// Torque on the joints that the model does not explain, N·m; compensated where the scenario asks for it.
    pub tau_disturbance: &'a Joints<N>,
    /// Wrench of the surroundings on the hand about E by a sensor at its wrist, base axes, N, N·m; `None`: there is none.
    pub wrist: Option<&'a Vector6>,
    /// The analysis of this very state.
    pub report: &'a Report<N>,
    /// The model's terms of this very state at the scenario's frame, where they have been computed already.
    pub terms: Option<&'a Terms<N>>,
    /// The target of a steered run; `None`: none has come.
    pub target: Option<&'a TargetContent>,
}

/// The arm on which the law acts at this tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now<'a, const N: usize> {
    pub(crate) q: &'a Joints<N>,
    pub(crate) qdot: &'a Joints<N>,
    pub(crate) tau_disturbance: &'a Joints<N>,
    /// Wrench of the surroundings on the hand about E, base axes, N, N·m; `None`: it is not measured.
    pub(crate) wrist: Option<&'a Vector6>,
    pub(crate) report: &'a Report<N>,
    pub(crate) terms: &'a Terms<N>,
    /// Kinematics at C.
    pub(crate) at: &'a AtCentre<N>,
    /// C in the end-effector's axes, m.
    pub(crate) p_EC: &'a Vector3,
}

/// Step 1's result: the desired motion and the acceleration that follows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<const N: usize> {
    /// The leg of the path, while it lasts.
    pub(crate) leg: Option<Leg>,
    /// The planned posture, where the leg is planned.
    pub(crate) planned: Option<Planned<N>>,
    /// From a goal on that is beyond reach.
    pub(crate) clips: bool,
    /// Speed of the clock; the path's own runs at it, or waits.
    pub(crate) clock: f64,
    /// Desired motion of E.
    pub(crate) desired_E: PoseMotion,
    /// Desired motion of C.
    pub(crate) desired: PoseMotion,
    /// Twist of C at full clock speed.
    pub(crate) V_nominal: Vector6,
    /// Acceleration of C at the clock's present speed.
    pub(crate) a_feed: Vector6,
    /// Pose error at C.
    pub(crate) error: Vector6,
    /// The share of a* that answers to the pose error, k_p·e bounded.
    pub(crate) feedback: Vector6,
    /// Operational acceleration a* at C.
    pub(crate) a: Vector6,
    /// Along a force's axis: how far beyond the path the force leads the hand, base axes, m and rad.
    pub(crate) off_path: Vector6,
}

/// The tick. Each step is the file or folder that it names; what it finds on its way it leaves in the state of the next tick.
///
/// # Errors
/// [`Refusal`] where the law has no torque: the state given stays as it was.
#[inline(always)]
fn tick<const N: usize>(
    setup: &Setup<N>,
    before: &State<N>,
    now: &Now<'_, N>,
) -> Result<(State<N>, Command<N>), Refusal> {
    let mut state = *before;
    let mut motion = reference::motion(setup, &mut state, now);
    if !setup.forces.are_none() {
        force::control(setup, &mut state, now, &mut motion)?;
    }
    let rows = singular_rows::engaged(setup, &mut state, now, &motion)?;
    let torques = law::torques(setup, &mut state, now, &motion, &rows)?;
    let Kept { limited, load } =
        limits::apply(setup, &mut state, now, &motion, &torques, rows.load)?;
    let command = command::running(setup, &state, now, &motion, &rows, &limited);
    clock::step(setup, &mut state, &load, &limited);
    Ok((state, command))
}

impl<const N: usize> Controller<N> {
    /// One tick: the torque for this state.
    ///
    /// Shapes N · Units rad, rad/s, N·m · Requires `report` to be the analysis of this very state · Ensures finite torques within the limits for any
    /// data, each within the torque rate of the tick before: where the law's equations are singular it refuses, and the torque brings the arm to rest
    /// from then on; an estimate that no arm can have moved to is set aside, and the arm is brought to rest meanwhile. A steered arm goes on from rest
    /// after a refusal that concerns the motion asked for · Errors none: a refusal is in the command · Cost about 3 µs for six joints, 2 µs more where
    /// it is steered; no allocation
    pub fn step(&mut self, inputs: &Inputs<'_, N>) -> Command<N> {
        let Inputs {
            q,
            qdot,
            tau_disturbance,
            wrist,
            ..
        } = *inputs;
        let is_steered = self.targets.is_some();
        if self.state.refusal != Refusal::None
            && !(is_steered && targets::goes_on(self.state.refusal))
        {
            return self.brake(q, qdot, tau_disturbance, self.state.refusal);
        }
        let is_felt = wrist.is_none_or(|wrench| wrench.iter().all(|x| x.is_finite()));
        if ![q, qdot, tau_disturbance].into_iter().all(is_finite) || !is_felt {
            return self.refuse(q, qdot, Refusal::State);
        }
        let evaluated;
        let terms = match inputs.terms {
            Some(terms) => terms,
            None => {
                evaluated = self.setup.model.evaluate(q, qdot);
                &evaluated
            }
        };
        let (model, dt) = (&self.setup.model, self.setup.scenario.dt_s());
        if !self.state.plausible.take(q, qdot, terms, model, dt) {
            return self.reject();
        }
        if is_steered {
            self.steer(inputs, terms)
        } else {
            act(&self.setup, &mut self.state, inputs, terms)
        }
    }

    /// Refuses to go on, from now on: for errors found before the law is evaluated.
    ///
    /// Shapes N · Units rad, rad/s · Ensures a torque that brings the arm to rest: gravity compensated and joints damped where `q` and `qdot` are finite,
    /// else zero · Errors none: the reason is in the command · Cost that of the model's terms, no allocation
    pub fn refuse(&mut self, q: &Joints<N>, qdot: &Joints<N>, why: Refusal) -> Command<N> {
        self.brake(q, qdot, &Joints::zeros(), why)
    }

    /// As [`refuse`](Self::refuse), on an arm that also carries what the model does not explain.
    fn brake(
        &mut self,
        q: &Joints<N>,
        qdot: &Joints<N>,
        tau_disturbance: &Joints<N>,
        why: Refusal,
    ) -> Command<N> {
        self.state.refusal = why;
        let known = is_finite(q) && is_finite(qdot);
        let terms = known.then(|| self.setup.model.evaluate(q, qdot));
        let moving = terms.as_ref().map(|terms| Moving {
            terms,
            qdot,
            tau_disturbance,
        });
        rest(&self.setup, &mut self.state, moving)
    }

    /// Sets an estimate aside: brings the arm to rest from where it plausibly is, its path's clock with it; after too long it refuses to go on.
    fn reject(&mut self) -> Command<N> {
        let control = &self.setup.scenario.control;
        let (dt, damping) = (self.setup.scenario.dt_s(), 0.5 * control.k_v);
        let ticks = self.state.plausible.rejected_ticks;
        if f64::from(ticks) * dt > plausible::REJECTION_S {
            self.state.refusal = Refusal::Estimate;
        }
        self.state.targets.parted = true;
        self.state.plausible.come_to_rest(damping, dt);
        if control.governor {
            self.state.clock.slow_down(damping, dt);
        }
        let Plausible { q, qdot, .. } = self.state.plausible;
        let moving = Moving {
            terms: &self.setup.model.evaluate(&q, &qdot),
            qdot: &qdot,
            tau_disturbance: &Joints::zeros(),
        };
        let rest = rest(&self.setup, &mut self.state, Some(moving));
        let goes_on = self.targets.is_some() && targets::goes_on(self.state.refusal);
        if self.state.refusal != Refusal::None && !goes_on {
            return rest;
        }
        let rate = self.state.clock.rate;
        let desired = self
            .setup
            .path
            .place(&self.state.progress)
            .moving(rate, 0.0);
        let is_running = self.setup.path.leg(self.state.progress.leg).is_some();
        if is_running {
            clock::pass(&self.setup, &mut self.state, rate);
        }
        Command {
            X_BE_d: desired.pose(),
            V_BE_d: desired.V,
            time_scale: rate,
            mode: command::modes(&self.setup, &self.state),
            phase: if is_running {
                Phase::Running
            } else {
                Phase::Settling
            },
            refusal: Refusal::None,
            ..rest
        }
    }
}

/// The tick on an arm in a state that is plausible; while the law has refused, the arm is brought to rest.
pub(crate) fn act<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    inputs: &Inputs<'_, N>,
    terms: &Terms<N>,
) -> Command<N> {
    let Inputs {
        q,
        qdot,
        tau_disturbance,
        wrist,
        report,
        ..
    } = *inputs;
    let moving = Moving {
        terms,
        qdot,
        tau_disturbance,
    };
    if state.refusal != Refusal::None {
        return rest(setup, state, Some(moving));
    }
    let now = Now {
        q,
        qdot,
        tau_disturbance,
        wrist,
        report,
        terms,
        at: &AtCentre::new(terms, &report.p_BC),
        p_EC: &(terms.X_BE.R.transpose() * (report.p_BC - terms.X_BE.p)),
    };
    if state.clock.path_s == 0.0 && !state.progress.begun {
        state.sent.carry(tau_disturbance, &setup.drives.effort);
    }
    let refusal = match tick(setup, state, &now) {
        Ok((next, command)) if is_finite(&command.tau) => {
            *state = next;
            return beyond_reach::marked(command, setup);
        }
        Ok(_) => Refusal::Torque,
        Err(refusal) => refusal,
    };
    state.refusal = refusal;
    rest(setup, state, Some(moving))
}

/// The motion of an arm that is brought to rest, and the torque on it that the model does not explain, N·m.
#[derive(Clone, Copy)]
struct Moving<'a, const N: usize> {
    terms: &'a Terms<N>,
    qdot: &'a Joints<N>,
    tau_disturbance: &'a Joints<N>,
}

/// The arm brought to rest, within the limits and the torque rates: gravity, Coriolis and an unknown load held, each joint's speed damped through the
/// whole mass matrix, so that no joint is thrown by the braking of another; zero torque where the state is not known.
fn rest<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    moving: Option<Moving<'_, N>>,
) -> Command<N> {
    // Before a limit an arm has the shortest way to stop in.
    let damping = setup.scenario.control.k_v
        * if state.refusal == Refusal::Limit {
            1.0
        } else {
            0.5
        };
    let zero = Joints::zeros();
    // An estimate that is not to be trusted knows no load.
    let is_loaded = setup.scenario.control.compensate_disturbance
        && !matches!(state.refusal, Refusal::State | Refusal::Estimate);
    let (bias, rest) = moving
        .map(|moving| {
            let load = is_loaded.then_some(moving.tau_disturbance);
            let bias = setup.drives.bias(moving.terms, None, load);
            (bias, moving.terms.A * moving.qdot * -damping)
        })
        .filter(|(bias, rest)| is_finite(bias) && is_finite(rest))
        .unwrap_or((zero, zero));
    let parts = Parts {
        rest,
        ..Parts::zero()
    };
    let limited = setup.drives.send(&mut state.sent, &bias, &parts);
    let desired = setup.path.place(&state.progress).moving(0.0, 0.0);
    Command {
        // The pose at which the path stopped, against which the arm is judged.
        X_BE_d: desired.pose(),
        ..command::resting(state, &limited)
    }
}
