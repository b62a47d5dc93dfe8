//! One run under one law, in numbers.

use chain::Sink;
use model::{Refused, Robot};
pub(super) use recorder::Bounds;
use recorder::{Assembler, HORIZON, Judge, PATIENCE, Set, Verdict};
use serde::Serialize;
use shared_types::scenario::{Goal, Scenario};
use shared_types::topics::{self, ByTopic, Each, Lent, STEERED, Topic};

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
    /// Largest commanded torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest change of a torque between two ticks over its limit.
    pub torque_step_max_ratio: f64,
    /// 95th percentile of the change of a torque between two ticks over its limit.
    pub torque_step_p95_ratio: f64,
    /// Time with any torque at its limit; s.
    pub saturated_s: f64,
    /// Jumps back of a torque within 10 ms.
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
    pub missed: Vec<String>,
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
    let mut judge = Judge::new(robot, scenario)?;
    let is_sent = |topic: &str| scenario.servo.is_some() || !STEERED.contains(&topic);
    let mut ended = None;
    if chain::plans_faults_of_processes(scenario) {
        let assembler = Assembler::new(Set::of(is_sent), PATIENCE, HORIZON);
        let mut assembled = Assembled {
            sink,
            assembler,
            newest: 0,
            judge: &mut judge,
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
            judged(&mut judge, &tick.lent());
        })?;
    }
    let mut verdict = judge.verdict();
    if let Some(sentence) = ended {
        (verdict.completed, verdict.outcome) = (false, "failed".to_owned());
        verdict.reason = format!("{sentence}; {}", verdict.reason);
    }
    Ok((Score::of(&verdict, scenario), verdict))
}

fn judged(judge: &mut Judge, messages: &ByTopic<Lent<'_>>) {
    if let Some(tick) = recorder::Tick::of(messages) {
        judge.tick(tick);
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
struct Assembled<'a, O> {
    sink: &'a mut O,
    assembler: Assembler,
    /// The newest tick of which a message has come.
    newest: u64,
    judge: &'a mut Judge,
}

impl<O> Assembled<'_, O> {
    fn take_rows(&mut self, flush: bool) {
        while let Some(row) = self.assembler.pop(self.newest, flush) {
            judged(self.judge, &row.messages().lent());
        }
    }
}

impl<O: Sink> Sink for Assembled<'_, O> {
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

impl Score {
    fn of(verdict: &Verdict, scenario: &Scenario) -> Self {
        let (task, joints) = (&verdict.task, &verdict.joints);
        Self {
            law: scenario.control.strategy.name().to_owned(),
            completed: verdict.completed,
            outcome: verdict.outcome.clone(),
            reason: verdict.reason.clone(),
            along_max_mm: task.along_max_mm,
            along_max_deg: task.along_max_deg,
            orthogonal_max_mm: task.orthogonal_max_mm,
            orthogonal_max_deg: task.orthogonal_max_deg,
            final_mm: task.final_position_mm,
            final_deg: task.final_orientation_deg,
            speed_max_ratio: joints.speed_max_ratio,
            torque_max_ratio: joints.torque_commanded_max_ratio,
            torque_step_max_ratio: joints.torque_step_max_ratio,
            torque_step_p95_ratio: joints.torque_step_p95_ratio,
            saturated_s: joints.saturated_ticks as f64 * scenario.dt_s(),
            chatter: joints.chatter,
            jump_energy_j: joints.jump_energy_j,
            time_stretch: task.time_stretch,
            stopped_by_plant: joints.stopped_ticks > 0,
            s1: task.s1,
            s2: task.s2,
            missed: task.missed.clone(),
        }
    }
}
