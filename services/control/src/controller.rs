//! The controller: one tick from state and singularity report to torque.

use crate::MAX_SINGULARITIES;
use crate::auxiliary::{Demand, Gains, Loop};
use crate::centre::{AtCentre, PoseMotion};
use crate::governor::{Governor, Load, MARGIN};
use crate::law::baselines::{self, Inverse, JointMemory};
use crate::law::{Active, Actives, LawError, Torques, Wanted, blended, chang_khatib, hold_and_blend, null_space};
use crate::linear::{angular, clamp_norm, linear, rotation_log, stack};
use crate::reference::{Charts, Foresight, Memory, Situation, Target};
use crate::saturation::limit;
use crate::singular::{Analyzer, GeometricFactors, PumaFactors};
use crate::trajectory::{FORESEEN_STEP_S, Foreseen, Path, PathError, Progress, quintic};
use crate::types::{Command, Mode, Phase, Plan, Refusal, Report, Singularity};
use model::{Factors, Model, ModelError, Pose, Robot, StartError, Terms};
use nalgebra::{Matrix3, SVector, Vector3, Vector6};
use shared_types::scenario::{Control, Scenario, Start, Strategy};

/// Largest position error that feedback answers to, m: the goal may be farther away than the arm can be asked to hurry.
const POSITION_ERROR_MAX: f64 = 0.05;
/// Largest orientation error that feedback answers to, rad.
const ORIENTATION_ERROR_MAX: f64 = 0.25;
/// Distance that a planned null-space motion keeps from joint limits, rad.
const LIMIT_MARGIN: f64 = 0.03;

/// Share of a joint's speed, at full clock speed, beyond which the path is refused: twice the limit even at the slowest clock.
const HOPELESS: f64 = 40.0;
/// Turning rate of ζ per null motion below which it cannot be turned.
const TURNS: f64 = 0.05;

/// Why a scenario cannot be controlled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// No model of this size, or no such frame.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The task is not a path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The start posture does not fit the arm.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A posture goal does not fit the arm.
    #[error("segment {segment}: {error}")]
    Posture {
        /// Index of the segment.
        segment: usize,
        /// What is wrong with it.
        error: StartError,
    },
}

/// The start posture of a scenario, rad.
///
/// # Errors
/// [`SetupError::Start`] if it does not fit the robot or lies outside its limits.
pub fn start_posture<const N: usize>(robot: &Robot, scenario: &Scenario) -> Result<SVector<f64, N>, SetupError> {
    let q = robot.start_posture(&scenario.start)?;
    // `Model::new` refuses a robot of another size, so the lengths agree wherever a controller can exist.
    Ok(SVector::from_fn(|i, _| q.get(i).copied().unwrap_or_default()))
}

/// A null-space turn of ζ that is under way.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turn<const N: usize> {
    /// ζ when it began.
    from: Vector3<f64>,
    /// The whole angle, rad.
    angle: f64,
    /// How far each joint will move, rad.
    by: SVector<f64, N>,
    /// How long it will take, s; 0 before it begins.
    duration_s: f64,
}

impl<const N: usize> Turn<N> {
    fn none() -> Self {
        Self { from: Vector3::zeros(), angle: 0.0, by: SVector::zeros(), duration_s: 0.0 }
    }
}

/// What the controller remembers from tick to tick: all of it travels in `resume`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct State<const N: usize> {
    progress: Progress,
    governor: Governor,
    loops: [Loop; MAX_SINGULARITIES],
    turn: Turn<N>,
    refusal: Refusal,
    path_time_s: f64,
    joint_memory: JointMemory<N>,
}

/// The control law of one arm and one task.
#[derive(Clone, Debug)]
pub struct Controller<const N: usize> {
    model: Model<N>,
    path: Path,
    charts: Charts,
    control: Control,
    task: [bool; 6],
    length_m: f64,
    dt: f64,
    settle_s: f64,
    q_start: SVector<f64, N>,
    /// Posture goal of each leg.
    postures: Vec<SVector<f64, N>>,
    state: State<N>,
}

impl<const N: usize> Controller<N> {
    /// A controller at the start of its task.
    ///
    /// # Errors
    /// [`SetupError`] if the scenario does not fit the robot.
    pub fn new(model: Model<N>, robot: &Robot, scenario: &Scenario, q_start: SVector<f64, N>) -> Result<Self, SetupError> {
        let rest = model.evaluate(&q_start, &SVector::zeros());
        let report = Analyzer::new(robot, &scenario.analysis).step(&q_start, &SVector::zeros(), &rest);
        let mut postures = Vec::with_capacity(scenario.segment.len());
        for (segment, goal) in scenario.segment.iter().enumerate() {
            postures.push(match &goal.posture_deg {
                None => q_start,
                Some(q) => {
                    let start = Start { q_deg: Some(q.clone()), ..Start::default() };
                    let q = robot.start_posture(&start).map_err(|error| SetupError::Posture { segment, error })?;
                    SVector::from_fn(|i, _| q.get(i).copied().unwrap_or_default())
                }
            });
        }
        let charts = match robot.factors {
            Factors::Puma { a2, a3, d4 } if !scenario.analysis.numeric => Charts::Puma(PumaFactors::new(a2, a3, d4)),
            _ if scenario.analysis.numeric => Charts::Numeric,
            _ => GeometricFactors::of::<N>(robot).map_or(Charts::Numeric, |factors| Charts::Geometric(factors.geometry)),
        };
        Ok(Self {
            path: Path::new(scenario, &report)?,
            charts,
            control: scenario.control.clone(),
            task: robot.task.0,
            length_m: robot.length_m,
            dt: scenario.dt_s(),
            settle_s: scenario.settle_s,
            q_start,
            postures,
            state: State {
                progress: Progress::at(rest.X_BE),
                governor: Governor::default(),
                loops: [Loop::default(); MAX_SINGULARITIES],
                turn: Turn::none(),
                refusal: Refusal::None,
                path_time_s: 0.0,
                joint_memory: JointMemory::at(q_start),
            },
            model,
        })
    }

    /// One tick: the torque for this state.
    ///
    /// `tau_disturbance` is the torque on the joints that the model does not explain; it is compensated where the scenario says so.
    /// Requires `report` to be the analysis of this very state. Ensures finite torques within the limits for any data: where the law has no answer
    /// it refuses, and the torque brings the arm to rest from then on. Cost about 3 µs for six joints, no allocation.
    pub fn step(
        &mut self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
    ) -> Command<N> {
        if self.state.refusal != Refusal::None {
            return self.refuse(q, qdot, self.state.refusal);
        }
        if !q.iter().chain(qdot).chain(tau_disturbance).all(|x| x.is_finite()) {
            return self.refuse(q, qdot, Refusal::State);
        }
        let terms = self.model.evaluate(q, qdot);
        // On a copy: a tick that is refused half-way leaves no half-made state.
        let mut state = self.state;
        match self.tick(&mut state, q, qdot, &terms, tau_disturbance, report) {
            Ok(command) if command.tau.iter().all(|x| x.is_finite()) => {
                self.state = state;
                command
            }
            Ok(_) => self.refuse(q, qdot, Refusal::Torque),
            Err(error) => self.refuse(q, qdot, error.refusal()),
        }
    }

    /// Refuses to go on, from now on: for what is wrong before the law is asked.
    pub fn refuse(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, why: Refusal) -> Command<N> {
        self.state.refusal = why;
        if q.iter().chain(qdot).all(|x| x.is_finite()) {
            self.refusal(Some((&self.model.evaluate(q, qdot), qdot)))
        } else {
            self.refusal(None)
        }
    }

    fn tick(
        &self,
        state: &mut State<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        terms: &Terms<N>,
        tau_disturbance: &SVector<f64, N>,
        report: &Report<N>,
    ) -> Result<Command<N>, LawError> {
        // The desired motion, at E and at C.
        let before = state.progress.leg;
        self.path.advance(&mut state.progress, 0.0, report);
        if state.progress.leg != before {
            state.turn = Turn::none();
        }
        let rate = state.governor.rate;
        let desired_E = self.path.desired(&state.progress, rate, state.governor.rate_dot);
        let nominal_E = self.path.desired(&state.progress, 1.0, 0.0);
        let p_EC = terms.X_BE.R.transpose() * (report.p_BC - terms.X_BE.p);
        let (desired, nominal) = (desired_E.at(&p_EC), nominal_E.at(&p_EC));
        let steady = self.path.desired(&state.progress, rate, 0.0).at(&p_EC);
        let at = AtCentre::new(terms, &report.p_BC, &terms.omega[N - 1]);

        let turn_error = rotation_log(&(desired.R * terms.X_BE.R.transpose()));
        let error = stack(&(desired.p - at.p), &turn_error);
        let V = at.J * qdot;
        let feedback = stack(&clamp_norm(linear(&error), POSITION_ERROR_MAX), &clamp_norm(turn_error, ORIENTATION_ERROR_MAX));
        let a = desired.a + (desired.V - V) * self.control.k_v + feedback * self.control.k_p;

        // The auxiliary coordinates.
        let leg = self.path.leg(state.progress.leg).copied();
        let ahead = self.path.ahead(&state.progress, p_EC);
        let mut actives = Actives::none();
        let mut telemetry = Telemetry::default();
        let mut load = 0.0_f64;
        for (i, singularity) in report.meant().iter().enumerate() {
            let situation = Situation {
                q,
                terms,
                at: &at,
                desired: &desired,
                V_nominal: &nominal.V,
                ahead: &ahead,
                error: &error,
                lower: self.model.lower(),
                upper: self.model.upper(),
                branch: leg.map_or(0, |leg| leg.branch),
                rate_max: self.rate_max(i),
                governed: self.control.governor,
            };
            let mut target = self.charts.target(singularity, &situation, &mut state.loops[i].memory);
            if let Some((place, angle)) = leg.and_then(|leg| leg.reorient)
                && place == i
            {
                target = self.reorient(state, singularity, q, (terms, &report.p_BC), (angle, leg.map_or(0.0, |leg| leg.duration_s)))?;
            }
            let gains = Gains { k: self.control.k_aux, k_v: self.control.k_v, rate_max: self.rate_max(i), slew: self.slew(i) };
            let demand = match self.control.strategy {
                Strategy::ChangKhatib => hard_switch(&mut state.loops[i], singularity, &target, &gains, rate, self.dt),
                _ => state.loops[i].step(singularity, &target, &gains, rate, self.dt),
            };
            if self.is_ours() {
                load = load.max(demand.load);
            }
            telemetry.note(i, &state.loops[i], singularity, &target, &demand);
            if state.loops[i].engaged() {
                actives.push(Active {
                    zeta_B: singularity.zeta_B,
                    gain: singularity.gain,
                    beta: demand.beta,
                    aux_row: singularity.aux_row,
                    aux_acceleration: demand.acceleration - singularity.aux_bias,
                    aux_rate: demand.nominal,
                });
            }
        }

        // The torque.
        let wanted = Wanted {
            A: &terms.A,
            at: &at,
            task: self.task,
            a,
            p_EC: &p_EC,
            a_path: self.along_path(&nominal.V, &a),
            V: nominal.V,
            a_feed: steady.a,
            posture: (self.posture(state) - q) * (0.25 * self.control.k_p) - qdot * self.control.k_v,
        };
        let torques = self.torques(state, q, qdot, terms, &desired, &error, &wanted, &actives)?;
        let share = (0..N).fold(0.0_f64, |share, i| share.max(torques.qdot_nominal[i].abs() / self.model.velocity()[i]));
        if self.is_ours() && self.control.governor && share > HOPELESS {
            return Err(LawError::Speed { share });
        }
        let mut bias = terms.bias();
        if self.control.compensate_disturbance {
            bias -= tau_disturbance;
        }
        let limited = limit(&bias, &torques, self.model.effort());

        // The clock for the next tick.
        if self.control.governor {
            let load = Load {
                speed: load.max(share),
                holding: terms.gravity,
                following: (terms.A * torques.qddot_path + terms.coriolis) / (rate * rate),
                braking: terms.A * torques.qdot_nominal,
                foreseen: self.foresee(state, q, terms, report, &p_EC),
            };
            state.governor.step(&load, self.model.effort(), self.dt);
        }
        let phase = match (leg, state.progress.time_s < self.settle_s) {
            (Some(_), _) => Phase::Running,
            (None, true) => Phase::Settling,
            (None, false) => Phase::Done,
        };
        let command = Command {
            tau: limited.tau,
            tau_task: limited.task,
            tau_null: limited.null,
            R_BE_d: desired_E.R,
            p_BE_d: desired_E.p,
            V_BE_d: desired_E.V,
            error: stack(&(desired_E.p - terms.X_BE.p), &turn_error),
            path_time_s: state.path_time_s,
            time_scale: rate,
            null_scale: limited.null_scale,
            task_scale: limited.task_scale,
            beta: telemetry.beta,
            aux_d: telemetry.aux_d,
            aux_rate_d: telemetry.aux_rate_d,
            plan: leg.and_then(|leg| leg.reorient).filter(|_| state.turn.duration_s > 0.0).map(|(place, _)| Plan {
                place,
                by: state.turn.by,
                duration_s: state.turn.duration_s,
            }),
            mode: telemetry.mode,
            segment: state.progress.leg as u32,
            phase,
            saturation_mask: limited.mask,
            clipped: telemetry.clipped,
            refusal: Refusal::None,
        };
        state.progress.time_s += rate * self.dt;
        state.path_time_s += rate * self.dt;
        Ok(command)
    }

    #[allow(clippy::too_many_arguments, reason = "the inputs of a tick; a struct for one call would only rename them")]
    fn torques(
        &self,
        state: &mut State<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        terms: &Terms<N>,
        desired: &PoseMotion,
        error: &Vector6<f64>,
        wanted: &Wanted<'_, N>,
        actives: &Actives<N>,
    ) -> Result<Torques<N>, LawError> {
        let arm = baselines::Arm { q, qdot, terms, desired, error, k_p: self.control.k_p, k_v: self.control.k_v, length_m: self.length_m };
        let tuned = &self.control.baseline;
        match self.control.strategy {
            Strategy::Blended => blended::torques(wanted, actives),
            Strategy::ChangKhatib if actives.is_empty() => blended::torques(wanted, actives),
            Strategy::ChangKhatib => chang_khatib::torques(wanted, actives),
            Strategy::OperationalSpace => blended::torques(wanted, &Actives::none()),
            Strategy::PseudoInverse => null_space::torques(wanted, null_space::Projector::PseudoInverse),
            Strategy::DynamicallyConsistent => null_space::torques(wanted, null_space::Projector::DynamicallyConsistent),
            Strategy::DampedLeastSquares => baselines::resolved(&arm, wanted, Inverse::Damped(tuned.damped_least_squares)),
            Strategy::TruncatedSvd => baselines::resolved(&arm, wanted, Inverse::Truncated { floor: tuned.truncated_svd_floor }),
            Strategy::HoldAndBlend => hold_and_blend::torques(&arm, wanted, &mut state.joint_memory, &tuned.hold_and_blend, &self.model),
            Strategy::JointPd => {
                let at = |q: &SVector<f64, N>| (self.model.forward_kinematics(q), self.model.jacobian(q));
                baselines::joint_pd(&arm, wanted, &mut state.joint_memory, Inverse::Damped(tuned.joint_pd), self.dt, at)
            }
        }
    }

    /// The posture that the null space is driven to, reached by the leg's own time law.
    fn posture(&self, state: &State<N>) -> SVector<f64, N> {
        let Some(goal) = self.postures.get(state.progress.leg) else {
            return *self.postures.last().unwrap_or(&self.q_start);
        };
        let from = state.progress.leg.checked_sub(1).map_or(&self.q_start, |i| &self.postures[i]);
        from + (goal - from) * self.path.ramp(&state.progress)
    }

    /// Whether the auxiliary coordinates drive the arm: their demand slows the clock, and foresight comes from their formulas. Not what others do.
    fn is_ours(&self) -> bool {
        matches!(self.control.strategy, Strategy::Blended | Strategy::ChangKhatib)
    }

    /// What the path ahead takes of the arm.
    fn foresee(&self, state: &State<N>, q: &SVector<f64, N>, terms: &Terms<N>, report: &Report<N>, p_EC: &Vector3<f64>) -> Foreseen {
        let mut foreseen = Foreseen::default();
        if !self.is_ours() || self.path.leg(state.progress.leg).is_none_or(|leg| leg.reorient.is_some()) {
            return foreseen;
        }
        let at = Foresight {
            q,
            terms,
            p_C: report.p_BC,
            poses: &self.path.preview(&state.progress, p_EC),
            step_s: FORESEEN_STEP_S,
            velocity: self.model.velocity(),
            rate_max: self.control.aux_rate_max,
            eta_out: std::array::from_fn(|i| report.singularities[i].eta_out),
        };
        self.charts.foresee(&at, &state.loops[1].memory, &mut foreseen);
        foreseen
    }

    /// The share of `a` along the path's twist, metres made radians by the arm's length.
    fn along_path(&self, V: &Vector6<f64>, a: &Vector6<f64>) -> Vector6<f64> {
        let L2 = self.length_m * self.length_m;
        let dot = |x: &Vector6<f64>, y: &Vector6<f64>| linear(x).dot(&linear(y)) / L2 + angular(x).dot(&angular(y));
        let size = dot(V, V);
        if size < 1e-8 { Vector6::zeros() } else { V * (dot(V, a) / size) }
    }

    /// Turning ζ by a commanded profile; the other way round where joint limits force it and the goal is the same line.
    ///
    /// The joint motion is predicted, and said, before anything moves.
    fn reorient(
        &self,
        state: &mut State<N>,
        s: &Singularity<N>,
        q: &SVector<f64, N>,
        (terms, p_BC): (&Terms<N>, &Vector3<f64>),
        (angle, duration_s): (f64, f64),
    ) -> Result<Target, LawError> {
        if state.turn.duration_s == 0.0 {
            let plan = |angle: f64| {
                let by = self.charts.turning(s, terms, p_BC, angle).filter(|by| self.has_room(q, by))?;
                Some(Turn { from: s.axis(), angle, by, duration_s: self.turn_takes(angle, &by, duration_s) })
            };
            let other = angle - std::f64::consts::PI.copysign(angle);
            state.turn = plan(angle).or_else(|| plan(other)).ok_or(LawError::Room { angle_deg: angle.to_degrees() })?;
        }
        let [x, v, _] = self.path.fraction(&state.progress);
        let turned = turned(s, &state.turn.from);
        let wanted = state.turn.angle * x;
        // `turned` is known up to whole turns: the one nearest to what is wanted.
        let error = crate::linear::wrap_angle(wanted - turned);
        // From angles of ζ to the auxiliary coordinate.
        let per_aux = if s.kappa_2.abs() > TURNS { s.kappa_2 } else { 1.0 };
        let rate = state.turn.angle * v * state.governor.rate;
        Ok(Target { error: error / per_aux, rate: rate / per_aux, weight: 1.0, mode: Mode::Reorient, clipped: false })
    }

    /// Whether every joint stays within its limits.
    fn has_room(&self, q: &SVector<f64, N>, by: &SVector<f64, N>) -> bool {
        let inside = |i: usize| {
            let end = q[i] + by[i];
            by[i] == 0.0 || end > self.model.lower()[i] + LIMIT_MARGIN && end < self.model.upper()[i] - LIMIT_MARGIN
        };
        (0..N).all(inside)
    }

    /// How long a turn takes whose time law the governor slows down where a rate would be beyond its limit: ∫ max(1, demand/0.95) dt.
    fn turn_takes(&self, angle: f64, by: &SVector<f64, N>, planned_s: f64) -> f64 {
        const SLICES: u32 = 64;
        let mut share = angle.abs() / self.control.aux_rate_max.iter().fold(0.0, |max: f64, x| max.max(*x));
        for i in 0..N {
            share = share.max(by[i].abs() / self.model.velocity()[i]);
        }
        if !self.control.governor {
            return planned_s;
        }
        let slice = planned_s / f64::from(SLICES);
        (0..SLICES).map(|k| slice * (share * quintic(slice * (f64::from(k) + 0.5), planned_s)[1] / MARGIN).max(1.0)).sum()
    }

    /// Thresholds and bounds are given for elbow, wrist and overhead; any further singularity takes the last.
    fn rate_max(&self, i: usize) -> f64 {
        self.control.aux_rate_max[i.min(2)]
    }

    fn slew(&self, i: usize) -> f64 {
        self.control.aux_slew[i.min(2)]
    }

    /// Gravity held and motion damped, within the limits; nothing at all where the state itself is not known.
    fn refusal(&self, known: Option<(&Terms<N>, &SVector<f64, N>)>) -> Command<N> {
        let limits = self.model.effort();
        let mut tau = known.map_or_else(SVector::zeros, |(terms, qdot)| {
            terms.gravity - SVector::<f64, N>::from_fn(|i, _| terms.A[(i, i)] * 0.5 * self.control.k_v * qdot[i])
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
        let start = self.state.progress.start;
        Command {
            tau,
            tau_task: tau,
            tau_null: SVector::zeros(),
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
            clipped: false,
            refusal: self.state.refusal,
        }
    }

    /// What must survive a restart, for the message's `resume`.
    #[must_use]
    pub fn state(&self) -> [f64; 80] {
        let mut out = Packer { values: [0.0; 80], at: 0 };
        let State { progress, governor, loops, turn, refusal, path_time_s, joint_memory } = &self.state;
        out.put(progress.leg as f64);
        out.put(progress.time_s);
        out.put(flag(progress.begun));
        progress.start.R.iter().chain(progress.start.p.iter()).for_each(|x| out.put(*x));
        progress.by.iter().chain(progress.turn.iter()).for_each(|x| out.put(*x));
        out.put(governor.rate);
        out.put(governor.rate_dot);
        out.put(governor.demand);
        turn.from.iter().for_each(|x| out.put(*x));
        out.put(turn.angle);
        turn.by.iter().for_each(|x| out.put(*x));
        out.put(turn.duration_s);
        out.put(f64::from(refusal.code()));
        out.put(*path_time_s);
        out.put(flag(joint_memory.holding));
        out.put(joint_memory.votes);
        out.put(f64::from(joint_memory.reversed));
        joint_memory.q.iter().for_each(|x| out.put(*x));
        for one in loops {
            let flags = flag(one.memory.passing) + 2.0 * flag(one.memory.holding) + 4.0 * (one.memory.side + 1.0);
            out.put(f64::from(one.mode.code()) + 32.0 * flags);
            out.put(one.rate);
            out.put(one.feed_forward);
            out.put(one.trust);
            out.put(one.memory.passage);
        }
        out.values
    }

    /// Takes [`state`](Self::state) back: the next tick continues as if nothing had happened.
    pub fn restore(&mut self, state: &[f64; 80]) {
        let mut from = state.iter().copied();
        let mut get = || from.next().unwrap_or(0.0);
        let (leg, time_s, begun) = (get() as usize, get(), get() != 0.0);
        let R = Matrix3::from_iterator((0..9).map(|_| get()));
        let mut vector = || Vector3::from_fn(|_, _| get());
        let (p, by, turn) = (vector(), vector(), vector());
        self.state.progress = Progress { leg, time_s, begun, start: Pose { R, p }, by, turn };
        self.state.governor = Governor { rate: get(), rate_dot: get(), demand: get() };
        self.state.turn =
            Turn { from: Vector3::from_fn(|_, _| get()), angle: get(), by: SVector::from_fn(|_, _| get()), duration_s: get() };
        self.state.refusal = Refusal::from_code(get() as u32).unwrap_or_default();
        self.state.path_time_s = get();
        self.state.joint_memory =
            JointMemory { holding: get() != 0.0, votes: get(), reversed: get() as u32, q: SVector::from_fn(|_, _| get()) };
        for one in &mut self.state.loops {
            let packed = get() as u32;
            let flags = packed / 32;
            let mode = Mode::from_code(packed % 32).unwrap_or_default();
            let [rate, feed_forward, trust, passage] = [get(), get(), get(), get()];
            let memory = Memory { passing: flags & 1 != 0, holding: flags & 2 != 0, side: f64::from(flags / 4) - 1.0, passage };
            *one = Loop { mode, rate, feed_forward, trust, memory };
        }
    }
}

/// The paper's hard switching: the singular direction is given up whole inside |s| ≤ η, and taken back whole outside.
fn hard_switch<const N: usize>(state: &mut Loop, s: &Singularity<N>, target: &Target, gains: &Gains, clock: f64, dt: f64) -> Demand {
    let inside = s.s.abs() <= s.eta_in;
    let exact = Singularity { inside, eta_out: s.eta_in, ..*s };
    if !inside {
        *state = Loop { memory: state.memory, rate: s.aux_rate, ..Loop::default() };
        return Demand::none();
    }
    let demand = state.step(&exact, target, gains, clock, dt);
    Demand { beta: 0.0, ..demand }
}

/// Angle through which ζ has turned since `from`, in (−π, π], about the axis that the singular frame's second vector is.
fn turned<const N: usize>(s: &Singularity<N>, from: &Vector3<f64>) -> f64 {
    let (zeta, axis) = (s.axis(), s.R_BS.column(1).into_owned());
    libm::atan2(axis.dot(&from.cross(&zeta)), from.dot(&zeta))
}

fn flag(x: bool) -> f64 {
    f64::from(u8::from(x))
}

struct Packer {
    values: [f64; 80],
    at: usize,
}

impl Packer {
    fn put(&mut self, x: f64) {
        self.values[self.at] = x;
        self.at += 1;
    }
}

/// What the message says per singularity.
#[derive(Clone, Copy, Debug)]
struct Telemetry {
    beta: [f64; MAX_SINGULARITIES],
    aux_d: [f64; MAX_SINGULARITIES],
    aux_rate_d: [f64; MAX_SINGULARITIES],
    mode: [Mode; MAX_SINGULARITIES],
    clipped: bool,
}

impl Default for Telemetry {
    fn default() -> Self {
        Self {
            beta: [1.0; MAX_SINGULARITIES],
            aux_d: [0.0; MAX_SINGULARITIES],
            aux_rate_d: [0.0; MAX_SINGULARITIES],
            mode: [Mode::Regular; MAX_SINGULARITIES],
            clipped: false,
        }
    }
}

impl Telemetry {
    fn note<const N: usize>(&mut self, i: usize, state: &Loop, s: &Singularity<N>, target: &Target, demand: &Demand) {
        self.beta[i] = demand.beta;
        self.aux_d[i] = s.aux + target.error * target.weight;
        self.aux_rate_d[i] = state.rate;
        self.mode[i] = state.mode;
        self.clipped |= state.engaged() && target.clipped;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{puma, rk4, robot, scenario};

    fn figure_5() -> (Scenario, Controller<6>, Analyzer<6>, SVector<f64, 6>) {
        let scenario = scenario(include_str!("../../../sim/scenarios/fig5-wrist-rotation.toml"), &[]);
        let q = start_posture::<6>(robot("puma560"), &scenario).unwrap();
        let controller = Controller::new(puma().clone(), robot("puma560"), &scenario, q).unwrap();
        let analyzer = Analyzer::new(robot("puma560"), &scenario.analysis);
        (scenario, controller, analyzer, q)
    }

    #[test]
    fn a_restarted_controller_and_analyzer_continue_bit_for_bit() {
        let (scenario, mut controller, mut analyzer, mut q) = figure_5();
        let mut qdot = SVector::zeros();
        let mut twins: Option<(Controller<6>, Analyzer<6>)> = None;
        for k in 0..2600 {
            if k % 333 == 0 {
                let (_, mut other, mut eyes, _) = figure_5();
                other.restore(&controller.state());
                eyes.restore(&analyzer.state());
                twins = Some((other, eyes));
            }
            let terms = puma().evaluate(&q, &qdot);
            let report = analyzer.step(&q, &qdot, &terms);
            let command = controller.step(&q, &qdot, &SVector::zeros(), &report);
            let (other, eyes) = twins.as_mut().unwrap();
            assert_eq!(eyes.step(&q, &qdot, &terms), report, "tick {k}");
            assert_eq!(other.step(&q, &qdot, &SVector::zeros(), &report), command, "tick {k}");
            (q, qdot) = rk4(puma(), &q, &qdot, &command.tau, scenario.dt_s());
        }
    }

    #[test]
    fn what_is_not_a_number_is_refused_for_good_and_the_arm_held() {
        let (_, mut controller, mut analyzer, q) = figure_5();
        let zero = SVector::zeros();
        let report = analyzer.step(&q, &zero, &puma().evaluate(&q, &zero));
        let mut bad = q;
        bad[3] = f64::NAN;
        let command = controller.step(&bad, &zero, &zero, &report);
        assert!(command.refusal == Refusal::State && command.phase == Phase::Refused && command.tau.iter().all(|x| x.is_finite()));
        let command = controller.step(&q, &zero, &zero, &report);
        assert_eq!((command.phase, command.refusal), (Phase::Refused, Refusal::State), "and stays so");
        assert!((command.tau - puma().gravity(&q)).amax() < 1e-9, "gravity is held");
    }

    #[test]
    fn a_report_that_makes_no_sense_is_refused() {
        let (_, mut controller, mut analyzer, q) = figure_5();
        let zero = SVector::zeros();
        let mut report = analyzer.step(&q, &zero, &puma().evaluate(&q, &zero));
        report.singularities[1].aux_row = SVector::zeros();
        let command = controller.step(&q, &zero, &zero, &report);
        assert!(command.refusal == Refusal::Singular && command.phase == Phase::Refused && command.tau.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn scenarios_that_do_not_fit_say_why() {
        let (mut scenario, ..) = figure_5();
        scenario.segment[0].posture_deg = Some(vec![0.0]);
        let q = start_posture::<6>(robot("puma560"), &scenario).unwrap();
        let error = Controller::new(puma().clone(), robot("puma560"), &scenario, q).unwrap_err();
        assert!(error.to_string().starts_with("segment 0: "), "{error}");
    }
}
