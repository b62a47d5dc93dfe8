//! The processes of armplane as a table of steps, and all of them on one thread, without shared memory. The thread gives the same bytes as the processes,
//! but faster. Tests, comparisons and sweeps use it, and `armplane run` tries the first tick here before it starts any process.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod faults;

use model::{Refused, Robot};
use process::{Member, NamedSaved, Step, Thread};
use shared_types::codes::{PHASE_REFUSED, REFUSALS, name_of};
use shared_types::fault::ScheduledFault;
use shared_types::graph::Graph;
use shared_types::process::{Process, Program};
use shared_types::scenario::Scenario;
use shared_types::topics::{ByTopic, Whole};

pub use faults::{graph, planned_faults, plans_faults_of_processes, run_under_faults};

/// One tick of the whole chain: the messages that the processes would have published.
pub type Tick = ByTopic<Whole>;

/// The step of a program before its first tick; `None` for the recorder, which only collects.
///
/// # Errors
/// [`Refused`] if the step does not accept the robot or the scenario.
pub fn step_of(
    program: Program,
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Option<Box<dyn Step>>, Refused> {
    Ok(Some(match program {
        Program::Plant => plant::process(robot, scenario)?,
        Program::Estimator => estimator::process(robot, scenario)?,
        Program::Analyzer => analyzer::process(robot, scenario)?,
        Program::Controller => controller::process(robot, scenario)?,
        Program::Operator => operator::process(scenario),
        Program::Recorder => return Ok(None),
    }))
}

/// The processes of a scenario on one thread, in the order of the data, those that are wanted; a `controller` of others stands in the place of ours.
fn thread(
    robot: &Robot,
    scenario: &Scenario,
    faults: Vec<ScheduledFault>,
    mut controller: Option<Box<dyn Step>>,
    is_wanted: impl Fn(Program) -> bool,
) -> Result<Thread, Refused> {
    let graph = graph(scenario)?;
    let mut members = Vec::new();
    for process in graph.hops() {
        let place = graph
            .process
            .iter()
            .position(|one| one.name == process.name);
        let step = match process.program().filter(|program| is_wanted(*program)) {
            Some(Program::Controller) if controller.is_some() => controller.take(),
            Some(program) => step_of(program, robot, scenario)?,
            None => None,
        };
        members.extend(
            place
                .zip(step)
                .map(|(place, step)| Member::new(place, process, step)),
        );
    }
    Ok(Thread::new(members, faults))
}

/// One process of a scenario on a thread of its own, without faults: it computes all itself, as in a process.
///
/// # Errors
/// [`Refused`] if the step does not accept the robot or the scenario.
pub fn alone(program: Program, robot: &Robot, scenario: &Scenario) -> Result<Thread, Refused> {
    thread(robot, scenario, Vec::new(), None, |one| one == program)
}

/// The processes of a scenario without faults of processes and messages.
pub struct Chain(Thread);

impl Chain {
    /// Before the first tick.
    ///
    /// # Errors
    /// [`Refused`] by the first step that does not accept the robot or the scenario, or if the
    /// scenario plans faults other than those of the arm's sensors and drives: [`run_under_faults`]
    /// has them, and [`without_faults`] takes all of them out.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        let faults = hardware_faults(scenario)?;
        thread(robot, scenario, faults, None, |_| true).map(Self)
    }

    /// One tick: move, sample, estimate, analyse, control. Fills the messages of the chain; those of other processes stay as they are. `false`: the task is
    /// over, and nothing of the tick is filled.
    #[must_use]
    pub fn step(&mut self, tick: &mut Tick) -> bool {
        self.0.tick(tick, &mut |_, _| ()).unwrap_or(false)
    }

    /// Refuses a path that cannot be followed, as is found before the first tick.
    ///
    /// # Errors
    /// [`Refused`] with the reason in words.
    pub fn possible(&self) -> Result<(), Refused> {
        possible(&self.0)
    }

    /// A goal beyond reach, found before the first tick, in words.
    pub fn warning(&self) -> Option<String> {
        self.0.warning()
    }
}

/// The planned faults, which must be those of sensors and drives: then each process sends one message of each of its topics a tick.
fn hardware_faults(scenario: &Scenario) -> Result<Vec<ScheduledFault>, Refused> {
    if let Some(fault) = scenario
        .fault
        .iter()
        .find(|fault| !fault.kind.concerns_joint())
    {
        let (name, kind, process) = (&scenario.name, fault.kind.name(), &fault.process);
        let what = format_args!(
            "{name} plans the `{kind}` of the {process}, and this is computed without one: take it out, or see it with `armplane run`"
        );
        return Err(Refused::because(what));
    }
    planned_faults(scenario)
}

/// A scenario as one thread can compute it: nothing goes wrong in it.
pub fn without_faults(scenario: &Scenario) -> Scenario {
    Scenario {
        fault: Vec::new(),
        ..scenario.clone()
    }
}

/// See [`Chain::possible`].
fn possible(thread: &Thread) -> Result<(), Refused> {
    let obstacle = thread.obstacle().map(Refused::because);
    obstacle.map_or(Ok(()), Err)
}

/// Runs a scenario to its end, handing each tick to `each`.
///
/// # Errors
/// See [`Chain::new`], and [`Refused`] where its path cannot be followed.
pub fn run(robot: &Robot, scenario: &Scenario, mut each: impl FnMut(&Tick)) -> Result<(), Refused> {
    let (mut chain, mut tick) = (Chain::new(robot, scenario)?, Tick::default());
    chain.possible()?;
    while chain.step(&mut tick) {
        each(&tick);
    }
    Ok(())
}

/// Goes on from what the processes of a scenario have saved, or from its beginning, to a tick: what they save there, and the messages of that tick. Without
/// faults of processes and messages on the way. `None` if the run does not come so far.
///
/// # Errors
/// [`Refused`] if a step does not accept robot or scenario, or what was saved.
pub fn advance(
    robot: &Robot,
    scenario: &Scenario,
    from: &[NamedSaved],
    to: u64,
) -> Result<Option<(Vec<NamedSaved>, Tick)>, Refused> {
    let (mut thread, mut tick) = (
        thread(robot, scenario, hardware_faults_of(scenario)?, None, |_| {
            true
        })?,
        Tick::default(),
    );
    if !from.is_empty() {
        thread.restore(from, &mut tick).map_err(Refused::because)?;
    }
    while thread.next_tick() < to {
        if !thread.tick(&mut tick, &mut |_, _| ()).unwrap_or(false) {
            return Ok(None);
        }
    }
    let saved = thread.save(&mut tick);
    let goes_on = thread.tick(&mut tick, &mut |_, _| ()).unwrap_or(false);
    Ok(goes_on.then_some((saved, tick)))
}

/// The planned faults of sensors and drives alone.
fn hardware_faults_of(scenario: &Scenario) -> Result<Vec<ScheduledFault>, Refused> {
    let mut faults = planned_faults(scenario)?;
    faults.retain(|fault| fault.kind().is_some_and(|kind| kind.concerns_joint()));
    Ok(faults)
}

/// A scenario's first tick, nothing gone wrong, as far as the analysis: nobody controls.
///
/// # Errors
/// [`Refused`] if a step does not accept the robot or the scenario.
pub fn first_tick(robot: &Robot, scenario: &Scenario) -> Result<Tick, Refused> {
    let is_wanted = |program| program != Program::Controller;
    let mut first = Tick::default();
    let mut thread = thread(robot, scenario, Vec::new(), None, is_wanted)?;
    let _ = thread.tick(&mut first, &mut |_, _| ());
    Ok(first)
}

/// Tries a scenario's first tick without faults, so that a scenario that the control law refuses at
/// once is refused before any process starts. Returns what it warns of, in words. Where the graph's controller is of others, our law is not asked.
///
/// # Errors
/// [`Refused`] if a step does not accept the robot or the scenario, or the control law refuses the first tick.
pub fn try_first_tick(
    robot: &Robot,
    scenario: &Scenario,
    graph: &Graph,
) -> Result<Option<String>, Refused> {
    let is_ours = |one: &Process| one.program() == Some(Program::Controller);
    if !graph.process.iter().any(is_ours) {
        // The path must be one, for the judge too.
        control::ground_truth(robot, scenario)?;
        return first_tick(robot, scenario).map(|_| None);
    }
    let mut chain = Chain::new(robot, &without_faults(scenario))?;
    chain.possible()?;
    let mut first = Tick::default();
    let _ = chain.step(&mut first);
    match first.torque.phase {
        PHASE_REFUSED => {
            let why = name_of(REFUSALS, first.control_state.refusal);
            Err(Refused::because(format_args!(
                "the control law refuses the start: {why}"
            )))
        }
        _ => Ok(chain.warning()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Torques of a session whose target at 0.1 s is `target`.
    fn torques(target: &str) -> Vec<[f64; shared_types::MAX_DOF]> {
        let text = format!(
            "name = \"t\"\nrobot = \"ur5\"\n[start]\nposture = \"bent\"\n[servo]\ntargets = \"\"\"\n# armplane targets 1, length m\n\
             0, twist, base, 1, 0.01 0 0 0 0 0\n0.1, {target}\n0.2, end\n\"\"\"\n"
        );
        let scenario = Scenario::parse("t.toml", &text, &[]).unwrap();
        let mut torques = Vec::new();
        run(&Robot::builtin("ur5").unwrap(), &scenario, |tick| {
            torques.push(tick.torque.tau)
        })
        .unwrap();
        torques
    }

    /// The ticks of a scenario at which a thread that goes on from the snapshots of another's processes sends another message than that one, soon after.
    fn strays(name: &str, settings: &[String], ticks: &[u64]) -> Vec<u64> {
        let text = sim::scenarios::text(name).unwrap();
        let scenario = Scenario::parse(name, text, settings).unwrap();
        let robot = Robot::builtin(&scenario.robot).unwrap();
        let begin = || {
            thread(
                &robot,
                &scenario,
                planned_faults(&scenario).unwrap(),
                None,
                |_| true,
            )
        };
        let (mut whole, mut tick) = (begin().unwrap(), Tick::default());
        let (mut done, mut strays) = (0, Vec::new());
        for at in ticks {
            while done < *at {
                assert!(whole.tick(&mut tick, &mut |_, _| ()).unwrap());
                done += 1;
            }
            let (mut second, mut same) = (begin().unwrap(), Tick::default());
            let saved = whole.save(&mut tick);
            second.restore(&saved, &mut same).unwrap();
            for _ in 0..50 {
                let mut sent: [Vec<u8>; 2] = Default::default();
                let (mut boards, mut both) = ([&mut tick, &mut same], [&mut whole, &mut second]);
                for ((thread, board), sent) in both.iter_mut().zip(&mut boards).zip(&mut sent) {
                    let mut keep = |_: usize, message: &[u8]| sent.extend_from_slice(message);
                    assert!(thread.tick(board, &mut keep).unwrap());
                }
                if sent[0] != sent[1] {
                    strays.push(*at);
                    break;
                }
            }
            done += 50;
        }
        strays
    }

    #[test]
    fn all_processes_go_on_from_their_snapshots_bit_for_bit() {
        let ticks: Vec<u64> = (0..30).map(|i| 1 + 97 * i).collect();
        let drive = "fault=[{process = \"plant\", kind = \"drive\", as = \"friction\", joint = 2, amount = 0.02, at_tick = 300, for_ticks = 900}, \
                     {process = \"plant\", kind = \"sensor\", as = \"stuck\", joint = 1, at_tick = 1500, for_ticks = 20}]";
        for (name, settings) in [
            ("fig5-wrist-rotation", vec![]),
            ("elbow-in-and-out", vec![drive.to_owned()]),
            ("servo-panda", vec![]),
        ] {
            assert_eq!(strays(name, &settings, &ticks), [0; 0], "{name}");
        }
    }

    #[test]
    fn the_laws_of_others_do_not_tell_the_modes_of_ours() {
        let modes = |law: &str| {
            let text = sim::scenarios::text("fig5-wrist-rotation").unwrap();
            let law = format!("control.strategy={law}");
            let scenario = Scenario::parse("fig5", text, &[law]).unwrap();
            let mut acts = 0;
            run(&Robot::builtin("puma560").unwrap(), &scenario, |tick| {
                acts += usize::from(tick.control_state.mode[1] != 0);
            })
            .unwrap();
            acts
        };
        assert!(modes("blended") > 1000);
        assert_eq!(modes("damped-least-squares"), 0);
    }

    #[test]
    fn our_law_is_not_asked_where_another_controls() {
        // Too near to a joint limit for it.
        let text = sim::scenarios::text("ur5-wrist").unwrap();
        let limit = ["start={q_deg=[0, -60, 60, 0, 0, 359.99]}".to_owned()];
        let scenario = Scenario::parse("ur5-wrist", text, &limit).unwrap();
        let (robot, mut graph) = (Robot::builtin("ur5").unwrap(), graph(&scenario).unwrap());
        assert!(try_first_tick(&robot, &scenario, &graph).is_err());
        let controls = |one: &&mut Process| one.program() == Some(Program::Controller);
        graph.process.iter_mut().find(controls).unwrap().external = true;
        assert!(try_first_tick(&robot, &scenario, &graph).is_ok());
    }

    #[test]
    fn a_target_is_in_the_torque_of_its_own_tick() {
        let twist = torques("twist, base, 1, 0.2 0 0 0 0 0");
        for other in [
            "posture, joints, 1, 0 -1 1 -1 1 0",
            "twist, base, 1, -0.2 0 0 0 0 0",
        ] {
            let mut pairs = twist.iter().zip(torques(other));
            assert_eq!(pairs.position(|(one, other)| *one != other), Some(100));
        }
    }
}
