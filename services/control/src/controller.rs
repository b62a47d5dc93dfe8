//! The controller: one tick from state and singularity report to torque, in five steps.

use crate::analyzer::Analyzer;
use crate::arm_family::choice::Family;
use crate::auxiliary_coordinates::Coordinates;
use crate::baselines::hold_and_blend;
use crate::baselines::resolved_rate::{self, Inverse};
use crate::beyond_reach;
use crate::centre::AtCentre;
use crate::command;
use crate::continuous::blended;
use crate::continuous::foresight::Foreseen;
use crate::continuous::governor::Load;
use crate::continuous::guide::Guide;
use crate::continuous::saturation::{compensated, limit};
use crate::continuous::speed_limit;
use crate::demand_ahead::demand_ahead;
use crate::desired_motion::{Followed, desired_motion};
use crate::law::{Actives, LawError, Torques, Wanted};
use crate::linear::is_finite;
use crate::paper::{chang_khatib, null_space};
use crate::plausibility::{self, Bounds, Plausible};
use crate::posture::Postures;
use crate::route_ahead::route_ahead;
use crate::servo::{limits, reference};
use crate::setup::SetupError;
use crate::state::State;
use crate::steered::{self, Steered};
use crate::tick::{Auxiliary, Inputs, LimitedTorque, Motion};
use crate::trajectory::Path;
use crate::types::{Command, Mode, Phase, Refusal, Report};
use model::{Model, Robot, Terms};
use nalgebra::{SVector, Vector6};
use shared_types::scenario::{Control, Scenario, Strategy};
use shared_types::{ControllerCheckpoint, MAX_SINGULARITIES};

/// Joint speed over its limit, at full clock speed, beyond which the path is refused: twice the limit even at the slowest clock.
const SPEED_RATIO_MAX: f64 = 40.0;

/// The control law of one arm and one task.
#[derive(Clone, Debug)]
pub struct Controller<const N: usize> {
    pub(crate) model: Model<N>,
    path: Path,
    family: Family<N>,
    pub(crate) scenario: Scenario,
    pub(crate) task: [bool; 6],
    pub(crate) length_m: f64,
    postures: Postures<N>,
    /// The plan of the whole path.
    pub(crate) guide: Guide<N>,
    /// Why the path cannot be followed.
    obstacle: Option<String>,
    pub(crate) state: State<N>,
    /// Of a steered run.
    pub(crate) steered: Option<Steered<N>>,
}

impl<const N: usize> Controller<N> {
    /// A controller at the start of its task, with the plan of the whole path where the law uses one.
    ///
    /// Shapes `q_start` N · Units rad · Requires `model` to be that of `robot`, at the scenario's frame, and `q_start` the scenario's start posture ·
    /// Ensures a controller that refuses from its first tick on where the path cannot be followed: see [`obstacle`](Self::obstacle) · Cost up to some
    /// seconds for the plan; allocates
    ///
    /// # Errors
    /// [`SetupError`] if the scenario does not fit the robot.
    pub fn new(
        model: Model<N>,
        robot: &Robot,
        scenario: &Scenario,
        q_start: SVector<f64, N>,
    ) -> Result<Self, SetupError> {
        let rest = model.evaluate(&q_start, &SVector::zeros());
        let mut analyzer = Analyzer::new(robot, &scenario.analysis);
        let report = analyzer.step(&q_start, &SVector::zeros(), &rest);
        let family = analyzer.family().clone();
        let path = Path::new(scenario, &report)?;
        if scenario.servo.is_none() {
            path.check(&robot.task.0, rest.X_BE, &report)?;
        }
        let mut postures = Postures::new(robot, scenario, q_start)?;
        let fresh = Analyzer::new(robot, &scenario.analysis);
        let (plan, obstacle) = match route_ahead(
            &model,
            robot,
            scenario,
            &path,
            &fresh,
            &q_start,
            postures.goals(),
        ) {
            Ok(plan) => (plan, None),
            Err(obstacle) => (None, Some(obstacle)),
        };
        let guide = Guide::new(plan, (0..).take_while(|i| path.leg(*i).is_some()).count());
        postures.stay(guide.beyond_reach());
        let (model, steered) = steered::of(model, robot, scenario);
        Ok(Self {
            path,
            family,
            scenario: reference::without_text(scenario),
            task: robot.task.0,
            length_m: robot.length_m,
            postures,
            guide,
            state: State::begin(
                &rest,
                q_start,
                model.effort(),
                if obstacle.is_some() {
                    Refusal::Route
                } else {
                    Refusal::None
                },
            ),
            obstacle,
            model,
            steered,
        })
    }

    /// Why the path cannot be followed, found before the first tick: the controller then refuses from the first tick on.
    #[must_use]
    pub fn obstacle(&self) -> Option<&str> {
        self.obstacle.as_deref()
    }

    /// A goal that no posture of the arm has, found before the first tick, in words.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        beyond_reach::warning(&self.guide)
    }

    /// One tick: the torque for this state.
    ///
    /// `tau_disturbance` is the torque on the joints that the model does not explain; it is compensated where the scenario asks for it.
    /// Shapes N · Units rad, rad/s, N·m · Requires `report` to be the analysis of this very state · Ensures finite torques within the limits for any
    /// data, each within the torque rate of the tick before: where the law's equations are singular it refuses, and the torque brings the arm to rest
    /// from then on; an estimate that no arm can have moved to is set aside, and the arm is brought to rest meanwhile · Errors none: a refusal is in
    /// the command · Cost about 3 µs for six joints, no allocation
    pub fn step(
        &mut self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
    ) -> Command<N> {
        self.step_knowing(None, q, qdot, tau_disturbance, report)
    }

    /// [`step`](Self::step) with the arm's terms, where they have been computed already; with `None` it computes them.
    ///
    /// Requires `terms` to be those of this very state at the scenario's frame · Ensures, errors, cost as `step`, less the model's evaluation
    pub fn step_knowing(
        &mut self,
        terms: Option<&Terms<N>>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
    ) -> Command<N> {
        if self.state.refusal != Refusal::None {
            return self.refuse(q, qdot, self.state.refusal);
        }
        if ![q, qdot, tau_disturbance].into_iter().all(is_finite) {
            return self.refuse(q, qdot, Refusal::State);
        }
        let evaluated;
        let terms = match terms {
            Some(terms) => terms,
            None => {
                evaluated = self.model.evaluate(q, qdot);
                &evaluated
            }
        };
        if !self.state.plausible.take(
            q,
            qdot,
            &Bounds::of(&self.model, terms, self.scenario.dt_s()),
        ) {
            return self.reject();
        }
        self.act((q, qdot), tau_disturbance, report, terms)
    }

    /// One tick of the law on a state that is plausible, whose terms are `terms`; while the law has refused, the arm is brought to rest.
    ///
    /// Shapes N · Units rad, rad/s, N·m · Frame `terms` and `report` in base axes · Requires `terms` and `report` of this very state · Ensures finite
    /// torques within the limits, and a state of before the tick where the tick is refused · Errors none: a refusal is in the command · Cost as
    /// [`step`](Self::step)
    pub(crate) fn act(
        &mut self,
        (q, qdot): (&SVector<f64, N>, &SVector<f64, N>),
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
        terms: &Terms<N>,
    ) -> Command<N> {
        if self.state.refusal != Refusal::None {
            return self.refuse(q, qdot, self.state.refusal);
        }
        let at = &AtCentre::new(terms, &report.p_BC, &terms.omega[N - 1]);
        let p_EC = &(terms.X_BE.R.transpose() * (report.p_BC - terms.X_BE.p));
        // On a copy: a tick that is refused half-way leaves no half-made state.
        let mut state = self.state;
        match self.tick(
            &mut state,
            &Inputs {
                q,
                qdot,
                tau_disturbance,
                report,
                terms,
                at,
                p_EC,
            },
        ) {
            Ok(command) if is_finite(&command.tau) => {
                self.state = state;
                command
            }
            Ok(_) => self.refuse(q, qdot, Refusal::Torque),
            Err(error) => self.refuse(q, qdot, error.refusal()),
        }
    }

    /// Refuses to go on, from now on: for errors found before the law is evaluated.
    ///
    /// Shapes N · Units rad, rad/s · Ensures a torque that brings the arm to rest: gravity compensated and joints damped where `q` and `qdot` are finite,
    /// else zero · Errors none: the reason is in the command · Cost that of the model's terms, no allocation
    pub fn refuse(
        &mut self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        why: Refusal,
    ) -> Command<N> {
        self.state.refusal = why;
        if is_finite(q) && is_finite(qdot) {
            self.refusal(Some((&self.model.evaluate(q, qdot), qdot)))
        } else {
            self.refusal(None)
        }
    }

    /// Brings the arm to rest from where it plausibly is, its path's clock with it; after too long it refuses to go on.
    pub(crate) fn reject(&mut self) -> Command<N> {
        let (dt, damping) = (self.scenario.dt_s(), 0.5 * self.scenario.control.k_v);
        let ticks = self.state.plausible.rejected_ticks;
        if f64::from(ticks) * dt > plausibility::REJECTION_S {
            self.state.refusal = Refusal::Estimate;
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
        let desired = self.path.desired(&self.state.progress, clock, 0.0);
        let path_time_s = self.state.path_time_s;
        let running = self.path.leg(self.state.progress.leg).is_some();
        // As in a tick that is not rejected, the clock moves on once the command stands.
        if running {
            let on_path = self.guide.path_time(self.state.route_time_s, clock * dt);
            self.state.route_time_s += clock * dt;
            self.state.progress.time_s += on_path;
            self.state.path_time_s += on_path;
        }
        Command {
            R_BE_d: desired.R,
            p_BE_d: desired.p,
            V_BE_d: desired.V,
            path_time_s,
            time_scale: clock,
            mode: self.state.loops.map(|one| one.mode),
            phase: if running {
                Phase::Running
            } else {
                Phase::Settling
            },
            refusal: Refusal::None,
            ..rest
        }
    }

    /// Largest change of each torque in a tick, N·m.
    fn torque_step(&self) -> SVector<f64, N> {
        self.model.torque_rate() * self.scenario.dt_s()
    }

    /// The five steps of the table in the crate's documentation.
    fn tick(&self, state: &mut State<N>, now: &Inputs<'_, N>) -> Result<Command<N>, LawError> {
        let motion = desired_motion(&self.followed(), state, now);
        let auxiliary = self.coordinates().step(state, now, &motion)?;
        let torques = self.torques(state, now, &motion, &auxiliary)?;
        let torque = self.limits(state, now, &motion, &torques)?;
        let command = command::running(
            state,
            now,
            &motion,
            &auxiliary,
            &torque,
            self.scenario.settle_s,
        );
        let command = beyond_reach::marked(command, &self.guide, &self.task, &self.scenario.goal);
        self.clock(state, now, &motion, &torques, auxiliary.load);
        Ok(command)
    }

    /// The arm, the path and the terms of the auxiliary coordinates.
    fn coordinates(&self) -> Coordinates<'_, N> {
        let Self {
            model,
            family,
            path,
            guide,
            task,
            scenario,
            ..
        } = self;
        Coordinates {
            model,
            family,
            path,
            guide,
            task: *task,
            control: &scenario.control,
            dt_s: scenario.dt_s(),
        }
    }

    /// The path, and the terms on which it is followed.
    fn followed(&self) -> Followed<'_, N> {
        Followed {
            path: &self.path,
            guide: &self.guide,
            task: self.task,
            control: &self.scenario.control,
        }
    }

    /// Step 3: torques by the scenario's law.
    fn torques(
        &self,
        state: &mut State<N>,
        now: &Inputs<'_, N>,
        motion: &Motion<N>,
        auxiliary: &Auxiliary<N>,
    ) -> Result<Torques<N>, LawError> {
        let actives = &auxiliary.actives;
        let a = self.bounded_return(now.report, &auxiliary.telemetry.mode, motion);
        let Control {
            k_p,
            k_v,
            baseline: tuned,
            ..
        } = &self.scenario.control;
        let avoided = (
            self.family
                .get()
                .first_of_higher_codimension()
                .filter(|_| self.scenario.control.strategy.is_ours()),
            &self.task,
        );
        let wanted = &Wanted {
            A: &now.terms.A,
            at: now.at,
            task: self.task,
            a,
            p_EC: now.p_EC,
            a_path: motion.along_path(&a, self.length_m),
            V: motion.V_nominal,
            a_feed: motion.a_feed,
            posture: self.postures.acceleration(
                &self.scenario.control,
                (&self.path, &state.progress),
                now,
                motion,
                avoided,
            ),
        };
        let arm = &resolved_rate::Arm {
            q: now.q,
            qdot: now.qdot,
            terms: now.terms,
            desired: &motion.desired,
            error: &motion.error,
            k_p: *k_p,
            k_v: *k_v,
            length_m: self.length_m,
        };
        let memory = &mut state.joint_memory;
        match self.scenario.control.strategy {
            Strategy::Blended => blended::torques(wanted, actives),
            Strategy::ChangKhatib if actives.is_empty() => blended::torques(wanted, actives),
            Strategy::ChangKhatib => chang_khatib::torques(wanted, actives),
            Strategy::OperationalSpace => blended::torques(wanted, &Actives::none()),
            Strategy::PseudoInverse => {
                null_space::torques(wanted, null_space::Projector::PseudoInverse)
            }
            Strategy::DynamicallyConsistent => {
                null_space::torques(wanted, null_space::Projector::DynamicallyConsistent)
            }
            Strategy::DampedLeastSquares => {
                resolved_rate::resolved(arm, wanted, Inverse::Damped(tuned.damped_least_squares))
            }
            Strategy::TruncatedSvd => resolved_rate::resolved(
                arm,
                wanted,
                Inverse::Truncated {
                    floor: tuned.truncated_svd_floor,
                },
            ),
            Strategy::HoldAndBlend => {
                hold_and_blend::torques(arm, wanted, memory, &tuned.hold_and_blend, &self.model)
            }
            Strategy::JointPd => {
                let at = |q: &SVector<f64, N>| {
                    (self.model.forward_kinematics(q), self.model.jacobian(q))
                };
                resolved_rate::joint_pd(
                    arm,
                    wanted,
                    memory,
                    Inverse::Damped(tuned.joint_pd),
                    self.scenario.dt_s(),
                    at,
                )
            }
        }
    }

    /// a* whose feedback along a lost direction asks no auxiliary coordinate for more than its largest rate: a hold is left without a leap.
    fn bounded_return(
        &self,
        report: &Report<N>,
        modes: &[Mode; MAX_SINGULARITIES],
        motion: &Motion<N>,
    ) -> Vector6<f64> {
        let (mut a, k_v) = (motion.a, self.scenario.control.k_v);
        let Some(first) = self.family.get().first_of_higher_codimension() else {
            return a;
        };
        for (place, s) in report
            .listed()
            .iter()
            .enumerate()
            .skip(first)
            .filter(|(place, _)| modes[*place] != Mode::Regular)
        {
            let (along, most) = (
                s.zeta_B.dot(&motion.feedback),
                k_v * s.gain.abs() * self.coordinates().rate_max(place, s),
            );
            // Of finite numbers it is a NaN only where one overflows beside a zero: the check of the torque finds it, and a bound of NaN would be a panic.
            a -= s.zeta_B
                * if most.is_nan() {
                    f64::NAN
                } else {
                    along - along.clamp(-most, most)
                };
        }
        a
    }

    /// Step 4: speeds kept, gravity, Coriolis and the disturbance compensated, the null-space torque scaled down first where a limit is met, every
    /// torque within its rate of the tick before.
    ///
    /// # Errors
    /// [`LawError::Speed`] where no clock is slow enough for the joint speeds, [`LawError::Limit`] where a joint is about to reach its limit.
    fn limits(
        &self,
        state: &mut State<N>,
        now: &Inputs<'_, N>,
        motion: &Motion<N>,
        torques: &Torques<N>,
    ) -> Result<LimitedTorque<N>, LawError> {
        let share = torques.speed_share(self.model.velocity());
        let has_floor = motion.planned.is_none() && !motion.clips && self.scenario.servo.is_none();
        if self.scenario.control.governs() && has_floor && share > SPEED_RATIO_MAX {
            return Err(LawError::Speed { share });
        }
        let range = (self.model.lower(), self.model.upper());
        let nearing = || Guide::nears_limit(motion.planned.as_ref(), (now.q, now.qdot), range);
        // The reference of a steered arm stops before its joints' limits, so its motion is not refused there.
        let plans = self.scenario.control.strategy.is_ours() && self.scenario.servo.is_none();
        if let Some(joint) = plans.then(nearing).flatten() {
            return Err(LawError::Limit { joint });
        }
        let mut bias = now.terms.bias();
        if self.scenario.control.compensate_disturbance {
            bias -= compensated(now.tau_disturbance, self.model.effort());
        }
        let torques = if self.scenario.control.governs() {
            speed_limit::held(
                torques,
                &now.terms.A,
                now.qdot,
                self.model.velocity(),
                self.model.torque_rate(),
            )?
        } else {
            *torques
        };
        let limited = limit(&bias, &torques, self.model.effort());
        let rate_mask;
        (state.sent, rate_mask) = state.sent.next(
            &limited,
            &(torques.path * limited.task_scale),
            &self.torque_step(),
            self.model.effort(),
        );
        Ok(LimitedTorque { limited, rate_mask })
    }

    /// Step 5: the path's clock moves on, at the speed that the governor gives it for the next tick.
    fn clock(
        &self,
        state: &mut State<N>,
        now: &Inputs<'_, N>,
        motion: &Motion<N>,
        torques: &Torques<N>,
        auxiliary_load: f64,
    ) {
        let clock = motion.clock;
        state.qdot_planned = torques.qdot_nominal * clock;
        if self.scenario.servo.is_some() {
            let range = (self.model.lower(), self.model.upper());
            state.servo.fastest =
                limits::fastest(now.q, &torques.qdot_nominal, range, self.model.velocity());
        }
        if self.scenario.control.governor {
            let A = &now.terms.A;
            let load = Load {
                speed: auxiliary_load
                    .max(torques.speed_share(self.model.velocity()))
                    .max(speed_limit::demand(now.qdot, self.model.velocity()) / clock),
                holding: now.terms.gravity,
                following: (A * torques.qddot_path + now.terms.coriolis) / (clock * clock),
                braking: A * torques.qdot_nominal,
                foreseen: if motion.planned.is_none()
                    && !motion.clips
                    && self.scenario.control.strategy.is_ours()
                {
                    demand_ahead(
                        &self.family,
                        (&self.path, state),
                        now,
                        self.model.velocity(),
                        &self.scenario,
                    )
                } else {
                    Foreseen::default()
                },
                planned: self
                    .guide
                    .speed(motion.planned.as_ref(), state.route_time_s, clock)
                    .min(state.servo.fastest.clock),
            };
            state
                .governor
                .step(&load, self.model.effort(), self.scenario.dt_s());
        }
        let step = clock * self.scenario.dt_s();
        let on_path = self.guide.path_time(state.route_time_s, step);
        state.route_time_s += step;
        state.progress.time_s += on_path;
        state.path_time_s += on_path;
    }

    /// The arm brought to rest, within the limits and the torque rates.
    fn refusal(&mut self, known: Option<(&Terms<N>, &SVector<f64, N>)>) -> Command<N> {
        let limits = self.model.effort();
        // Before a limit an arm has the shortest way to stop in.
        let damping = self.scenario.control.k_v
            * if self.state.refusal == Refusal::Limit {
                1.0
            } else {
                0.5
            };
        let wanted = command::braking(known, damping, limits);
        let rate_mask;
        (self.state.sent, rate_mask) =
            self.state
                .sent
                .next(&wanted, &SVector::zeros(), &self.torque_step(), limits);
        command::resting(&self.state, wanted.mask, rate_mask)
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    pub fn save(&self, out: &mut ControllerCheckpoint) {
        self.state.save(out);
        if let Some(steered) = &self.steered {
            steered.analyzer.save(&mut out.servo.analysis);
        }
    }

    /// Takes up what [`save`](Self::save) has written: the next tick continues bit for bit. A damaged checkpoint is refused, and the arm brought to rest.
    pub fn restore(&mut self, from: &ControllerCheckpoint) {
        self.state = State::from_checkpoint(from, self.model.effort());
        if let Some(steered) = &mut self.steered {
            steered.analyzer.restore(&from.servo.analysis);
        }
    }
}
