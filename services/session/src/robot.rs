//! A run on a robot instead of the simulated arm.

use model::Robot;
use plant_fci::Address;
use shared_types::graph::{Graph, Role};
use shared_types::job::Mode;
use shared_types::scenario::Scenario;

use crate::failure::Failure;
use crate::load::Loaded;
use crate::mujoco;
use crate::progress::{Observer, say};
use crate::results::ROBOT_URDF;

/// Default pace for a plant: a robot has its own clock.
pub fn mode_of(plant: Option<&str>) -> Mode {
    match plant {
        Some(plant) if mujoco::scene(plant).is_none() => Mode::Realtime,
        _ => Mode::Lockstep,
    }
}

/// Puts MuJoCo (`mujoco`, `mujoco:SCENE.xml`) or the robot at an address (`fci://HOST`) in place of the process that makes the ticks.
///
/// # Errors
/// [`Failure::Input`] if `plant` is neither, it cannot be had, or another program makes the ticks.
pub(crate) fn put_in(loaded: &mut Loaded, plant: &str) -> Result<(), Failure> {
    let mut processes = loaded.graph.process.iter_mut();
    let world = processes.find(|process| process.role() == Role::World);
    let world = world.filter(|process| !process.is_of_others());
    let Some(process) = world else {
        return Err(Failure::Input(format!(
            "--plant {plant}: the graph already has another program as its plant; leave one of them out"
        )));
    };
    if let Some(scene) = mujoco::scene(plant) {
        mujoco::take_over(process, scene)?;
        let name = process.name.clone();
        return mujoco::check(loaded, &name);
    }
    let refused = |why: String| Failure::Input(format!("--plant: {why}, or `mujoco`"));
    let address: Address = plant.parse().map_err(refused)?;
    process.robot = address.to_string();
    if loaded.scenario.presses() {
        return Err(Failure::Input(format!(
            "--plant {plant}: the robot's own estimate of a force is not read; leave out `force`"
        )));
    }
    Ok(())
}

/// The built-in graph with `plant` in it, for runs of a scenario in lockstep.
///
/// # Errors
/// [`Failure::Input`] as [`run`](crate::run) with such a plant, and where that is a robot.
pub fn simulated(plant: &str, robot: &Robot, scenario: &Scenario) -> Result<Graph, Failure> {
    with_plant(Graph::of(scenario)?, plant, robot, scenario)
}

/// A graph with `plant` in it; see [`simulated`].
pub(crate) fn with_plant(
    graph: Graph,
    plant: &str,
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Graph, Failure> {
    let mut loaded = Loaded {
        scenario: scenario.clone(),
        robot: robot.clone(),
        graph,
    };
    put_in(&mut loaded, plant)?;
    check_mode(&loaded.graph, Mode::Lockstep)?;
    Ok(loaded.graph)
}

/// # Errors
/// [`Failure::Input`] if a robot of the graph is to run in lockstep.
pub(crate) fn check_mode(graph: &Graph, mode: Mode) -> Result<(), Failure> {
    let mut robots = graph.process.iter().map(|process| &process.robot);
    match robots.find(|robot| !robot.is_empty()) {
        Some(robot) if mode == Mode::Lockstep => Err(Failure::Input(format!(
            "the robot at {robot} runs in real time, not in lockstep: use `armplane run --mode realtime`"
        ))),
        _ => Ok(()),
    }
}

/// The run as the robot of its graph needs it: the arm as the robot describes it, in real time. Without a robot nothing changes.
///
/// # Errors
/// [`Failure`] if the robot does not answer or is not ready, or if mode, rate, start or faults do
/// not fit it.
pub(crate) fn settle(
    mut loaded: Loaded,
    mode: Mode,
    observer: Observer<'_>,
) -> Result<Loaded, Failure> {
    let Some(world) = loaded
        .graph
        .process
        .iter()
        .find(|process| !process.robot.is_empty())
    else {
        return Ok(loaded);
    };
    let address: Address = world.robot.parse().map_err(Failure::Input)?;
    let refuse = |sentence: String| Err(Failure::Input(sentence));
    check_mode(&loaded.graph, mode)?;
    if loaded.scenario.rate_hz != plant_fci::RATE_HZ {
        return refuse(format!(
            "rate_hz = {}: the robot runs at {} Hz, leave it out",
            loaded.scenario.rate_hz,
            plant_fci::RATE_HZ
        ));
    }
    if loaded.robot.dof() != plant_fci::JOINTS {
        let (name, dof) = (&loaded.robot.name, loaded.robot.dof());
        return refuse(format!(
            "the scenario's arm, {name}, has {dof} joints, a Franka arm {}: use a scenario of the FR3, such as fr3-wrist",
            plant_fci::JOINTS
        ));
    }
    let described = plant_fci::describe(&address, &loaded.robot.name).map_err(Failure::work)?;
    match described {
        Some(source) => {
            loaded.robot = Robot::from_source(&source).map_err(Failure::work)?;
            // The texts are kept beside the results: the scenario file that repeats the run names them.
            ROBOT_URDF.clone_into(&mut loaded.scenario.robot);
            loaded.scenario.frame.clear();
        }
        None => say(
            observer,
            format_args!(
                "the robot at {address} gives no URDF (interface version 5), so the scenario's {} is used",
                loaded.robot.name
            ),
        ),
    }
    loaded
        .robot
        .start_posture(&loaded.scenario.start)
        .map_err(Failure::input)?;
    Ok(loaded)
}
