//! One run under one law, in numbers.

use chain::Sink;
use model::{Model, Refused, Robot, with_dof};
use nalgebra::{Cholesky, SVector};
use recorder::{Assembler, HORIZON, Judge, PATIENCE, Set, TaskError, Verdict};
use serde::Serialize;
use shared_types::bounds::{larger, within};
use shared_types::codes::DRIVE_ACTIVE;
use shared_types::scenario::{Goal, Scenario};
use shared_types::topics::{self, ByTopic, Each, Lent, STEERED, Topic};

/// Change of torque in one tick, as a share of the limit, from which on it is a jump.
const JUMP: f64 = 0.1;
/// Ticks within which a jump back is chatter, at 1 kHz; s.
const BACK_WITHIN_S: f64 = 0.010;
/// How long torques may be at their limit; s.
const SATURATED_S: f64 = 0.010;

/// Bounds on the error while the arm moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Orthogonal to the singular directions, mm.
    pub(super) orthogonal_mm: f64,
    /// Orthogonal to the singular directions, °.
    pub(super) orthogonal_deg: f64,
    /// Along the singular directions, mm.
    pub(super) along_mm: f64,
    /// Along the singular directions, °.
    pub(super) along_deg: f64,
}

impl Bounds {
    /// S1: those of a scenario that states none, and nothing along the singular directions.
    pub(super) fn s1() -> Self {
        let Goal {
            orthogonal_mm,
            orthogonal_deg,
            ..
        } = Goal::default();
        Self {
            orthogonal_mm,
            orthogonal_deg,
            along_mm: f64::INFINITY,
            along_deg: f64::INFINITY,
        }
    }

    /// S2: for lines that are not along ζ.
    pub(super) fn s2() -> Self {
        Self {
            orthogonal_deg: 3.0,
            along_mm: 10.0,
            along_deg: 5.0,
            ..Self::s1()
        }
    }
}

/// The result of a run, judged on the simulator's truth. Ratios are shares of the robot's own limits.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Score {
    /// The control law.
    pub law: String,
    /// Whether the task ran to its end.
    pub completed: bool,
    /// `"goal reached"`, `"goal missed"` or `"stopped"`, by the scenario's own goal.
    pub outcome: String,
    /// Why, in one sentence.
    pub reason: String,
    /// Largest error along the singular directions, mm.
    pub along_max_mm: f64,
    /// Largest error along the singular directions, °.
    pub along_max_deg: f64,
    /// Largest error orthogonal to the singular directions, mm.
    pub orthogonal_max_mm: f64,
    /// Largest error orthogonal to the singular directions, °.
    pub orthogonal_max_deg: f64,
    /// Position error at the end, mm.
    pub final_mm: f64,
    /// Orientation error at the end, °.
    pub final_deg: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest change of a torque between two ticks over its limit.
    pub torque_step_max_ratio: f64,
    /// 95th percentile of the change of a torque between two ticks over its limit.
    pub torque_step_p95_ratio: f64,
    /// Time with any torque at its limit; s.
    pub saturated_s: f64,
    /// Jumps back: see [`JUMP`], [`BACK_WITHIN_S`].
    pub chatter: u64,
    /// Σ ½ΔΓᵀA⁻¹ΔΓ/k_v² over the jumps: what each would put in until the loop has answered; J.
    pub jump_energy_j: f64,
    /// Ticks done over ticks planned.
    pub time_stretch: f64,
    /// Whether a joint ran against its stop, or the drive stopped the arm.
    pub stopped_by_plant: bool,
    /// Success by the strict bar.
    pub s1: bool,
    /// Success by the bar for lines that are not along ζ.
    pub s2: bool,
    /// The conditions of S2 that failed.
    pub missed: Vec<&'static str>,
}

impl Score {
    /// S1, S2, or the bars of S2 that were missed.
    #[must_use]
    pub fn success(&self) -> String {
        match (self.s1, self.s2) {
            (true, _) => "S1".to_owned(),
            (_, true) => "S2".to_owned(),
            _ => format!("no: {}", self.missed.join(", ")),
        }
    }

    /// Whether the goal pose was reached, by the bounds of a scenario that states none.
    pub fn ended(&self) -> bool {
        let goal = Goal::default();
        self.completed && self.final_mm < goal.position_mm && self.final_deg < goal.orientation_deg
    }
}

/// Runs a scenario on one thread and scores it.
///
/// # Errors
/// [`Refused`] where a cycle does not accept the robot or the scenario.
pub(super) fn score(robot: &Robot, scenario: &Scenario) -> Result<Score, Refused> {
    struct Unheard;
    impl Sink for Unheard {
        fn take<M: Topic>(&mut self, _: &M) {}
    }
    scored(robot, scenario, &mut Unheard).map(|(score, _)| score)
}

/// Runs a scenario on one thread, scores and judges the ticks that are whole, and hands each message that counts to `sink`.
///
/// # Errors
/// As [`score`], and where one thread cannot have a fault.
pub(crate) fn scored<O: Sink>(
    robot: &Robot,
    scenario: &Scenario,
    sink: &mut O,
) -> Result<(Score, Verdict), Refused> {
    with_dof!(robot.dof(), N => sized::<N, O>(robot, scenario, sink))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

fn sized<const N: usize, O: Sink>(
    robot: &Robot,
    scenario: &Scenario,
    sink: &mut O,
) -> Result<(Score, Verdict), Refused> {
    let mut bench = Bench {
        judge: Judge::new(robot, scenario)?,
        meter: Meter::<N>::new(robot, scenario)?,
    };
    let is_sent = |topic: &str| scenario.servo.is_some() || !STEERED.contains(&topic);
    let mut ended = None;
    if chain::plans_faults_of_processes(scenario) {
        let assembler = Assembler::new(Set::of(is_sent), PATIENCE, HORIZON);
        let mut assembled = Assembled {
            sink,
            assembler,
            newest: 0,
            bench: &mut bench,
        };
        ended = chain::run_under_faults(robot, scenario, &mut assembled)?;
        assembled.take_rows(true);
    } else {
        // Each tick is whole: nothing is to be assembled.
        chain::run(robot, scenario, |tick| {
            topics::each(&mut Pass {
                sink: &mut *sink,
                tick,
                is_sent,
            });
            bench.tick(&tick.lent());
        })?;
    }
    let mut verdict = bench.judge.verdict();
    if let Some(sentence) = ended {
        (verdict.completed, verdict.outcome) = (false, "failed".to_owned());
        verdict.reason = format!("{sentence}; {}", verdict.reason);
    }
    Ok((bench.meter.score(&verdict, scenario), verdict))
}

/// The judgement of whole ticks.
struct Bench<const N: usize> {
    judge: Judge,
    meter: Meter<N>,
}

impl<const N: usize> Bench<N> {
    fn tick(&mut self, messages: &ByTopic<Lent<'_>>) {
        if let Some(tick) = recorder::Tick::of(messages) {
            let error = self.judge.tick(tick);
            self.meter.tick(&tick, &error);
        }
    }
}

/// Hands the messages of a tick on, those of the topics that the run has.
struct Pass<'a, O, S> {
    sink: &'a mut O,
    tick: &'a chain::Tick,
    is_sent: S,
}

impl<O: Sink, S: Fn(&str) -> bool> Each for Pass<'_, O, S> {
    type Output = ();
    fn each<M: Topic>(&mut self) {
        if (self.is_sent)(M::TOPIC) {
            self.sink.take(M::of(self.tick));
        }
    }
}

/// Judges the ticks that messages make, as the recorder does.
struct Assembled<'a, O, const N: usize> {
    sink: &'a mut O,
    assembler: Assembler,
    /// The newest tick of which a message has come.
    newest: u64,
    bench: &'a mut Bench<N>,
}

impl<O, const N: usize> Assembled<'_, O, N> {
    fn take_rows(&mut self, flush: bool) {
        while let Some(row) = self.assembler.pop(self.newest, flush) {
            self.bench.tick(&row.messages().lent());
        }
    }
}

impl<O: Sink, const N: usize> Sink for Assembled<'_, O, N> {
    fn take<M: Topic>(&mut self, message: &M) {
        self.sink.take(message);
        let tick = message.header().tick;
        self.assembler
            .row(tick)
            .into_iter()
            .for_each(|row| row.put(message));
        self.newest = self.newest.max(tick);
        self.take_rows(false);
    }
}

/// Measures beyond those of the recorder's judge.
struct Meter<const N: usize> {
    model: Model<N>,
    ticks: u64,
    k_v: f64,
    back_within: u64,
    along: [f64; 2],
    chatter: u64,
    jump_energy_j: f64,
    stopped_by_plant: bool,
    last_tau: Option<SVector<f64, N>>,
    /// Per joint: when it jumped last, and which way.
    last_jump: [Option<(u64, f64)>; N],
}

impl<const N: usize> Meter<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        Ok(Self {
            model: Model::new(robot, None).map_err(Refused::because)?,
            ticks: 0,
            k_v: scenario.control.k_v,
            back_within: (BACK_WITHIN_S * f64::from(scenario.rate_hz)).ceil() as u64,
            along: [0.0; 2],
            chatter: 0,
            jump_energy_j: 0.0,
            stopped_by_plant: false,
            last_tau: None,
            last_jump: [None; N],
        })
    }

    fn tick(&mut self, tick: &recorder::Tick<'_>, error: &TaskError) {
        self.ticks += 1;
        self.along = [
            larger(self.along[0], error.position[2]),
            larger(self.along[1], error.orientation[2]),
        ];
        self.stopped_by_plant |= tick.truth.limit_mask != 0
            || tick.truth.drive != DRIVE_ACTIVE && tick.truth.header.tick > 0;
        let tau = SVector::<f64, N>::from_fn(|i, _| tick.torque.tau[i]);
        if let Some(last) = self.last_tau.replace(tau) {
            self.jumps(tick, &(tau - last));
        }
    }

    fn jumps(&mut self, tick: &recorder::Tick<'_>, step: &SVector<f64, N>) {
        let k = tick.torque.header.tick;
        let mut any = false;
        for i in 0..N {
            if step[i].abs() <= JUMP * self.model.effort()[i] {
                continue;
            }
            any = true;
            let back = self.last_jump[i]
                .is_some_and(|(when, way)| k - when <= self.back_within && way * step[i] < 0.0);
            self.chatter += u64::from(back);
            self.last_jump[i] = Some((k, step[i].signum()));
        }
        let q = SVector::<f64, N>::from_fn(|i, _| tick.truth.q[i]);
        if any && let Some(A) = Cholesky::new(self.model.mass_matrix(&q)) {
            self.jump_energy_j += 0.5 * step.dot(&A.solve(step)) / (self.k_v * self.k_v);
        }
    }

    /// S1 and S2 of the specification.
    fn score(self, verdict: &Verdict, scenario: &Scenario) -> Score {
        let (task, joints) = (&verdict.task, &verdict.joints);
        let saturated_s = joints.saturated_ticks as f64 * scenario.dt_s();
        let [along_mm, along_deg] = self.along;
        let (orthogonal_mm, orthogonal_deg) = (task.orthogonal_max_mm, task.orthogonal_max_deg);
        // The repetition of an interrupted session is over with its last tick.
        let completed = verdict.completed
            || self.ticks > 0
                && scenario
                    .servo
                    .as_ref()
                    .is_some_and(|session| session.ticks == self.ticks);
        let (goal, s1, s2) = (Goal::default(), Bounds::s1(), Bounds::s2());
        let at_goal = within(task.final_position_mm, goal.position_mm)
            && within(task.final_orientation_deg, goal.orientation_deg);
        let missed: Vec<&'static str> = [
            ("stopped", !completed),
            ("joint stop", self.stopped_by_plant),
            ("end", !at_goal),
            ("speed", !within(joints.speed_max_ratio, 1.0)),
            ("torque", saturated_s > SATURATED_S + 1e-9),
            (
                "orthogonal",
                !(within(orthogonal_mm, s2.orthogonal_mm)
                    && within(orthogonal_deg, s2.orthogonal_deg)),
            ),
            (
                "along",
                !(within(along_mm, s2.along_mm) && within(along_deg, s2.along_deg)),
            ),
        ]
        .into_iter()
        .filter_map(|(what, is_so)| is_so.then_some(what))
        .collect();
        let clean = missed
            .iter()
            .all(|what| ["orthogonal", "along"].contains(what));
        Score {
            law: scenario.control.strategy.name().to_owned(),
            completed,
            outcome: verdict.outcome.clone(),
            reason: verdict.reason.clone(),
            along_max_mm: along_mm,
            along_max_deg: along_deg,
            orthogonal_max_mm: orthogonal_mm,
            orthogonal_max_deg: orthogonal_deg,
            final_mm: task.final_position_mm,
            final_deg: task.final_orientation_deg,
            speed_max_ratio: joints.speed_max_ratio,
            torque_max_ratio: joints.torque_max_ratio,
            torque_step_max_ratio: joints.torque_step_max_ratio,
            torque_step_p95_ratio: joints.torque_step_p95_ratio,
            saturated_s,
            chatter: self.chatter,
            jump_energy_j: self.jump_energy_j,
            time_stretch: task.time_stretch,
            stopped_by_plant: self.stopped_by_plant,
            s1: clean && orthogonal_mm < s1.orthogonal_mm && orthogonal_deg < s1.orthogonal_deg,
            s2: missed.is_empty(),
            missed,
        }
    }
}
