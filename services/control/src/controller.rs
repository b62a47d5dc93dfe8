//! The controller of one arm and one task, from before its first tick.

use crate::law::force::Forces;
use crate::limits::torque::Drives;
use crate::linear::Joints;
use crate::plan::{Deviation, Request, beyond_reach, rehearsal};
use crate::reference::guide::Guide;
use crate::reference::path::Path;
use crate::reference::posture::Postures;
use crate::reference::targets::{self, Targets};
use crate::setup::SetupError;
use crate::singularity::analyzer::Analyzer;
use crate::singularity::family::Family;
use crate::state::State;
use crate::types::Refusal;
use model::{Model, Robot};
use shared_types::ControllerCheckpoint;
use shared_types::scenario::Scenario;
use std::cell::Cell;

/// What does not change from tick to tick: the arm, its task, and the terms on which it is followed.
#[derive(Clone, Debug)]
pub(crate) struct Setup<const N: usize> {
    pub(crate) model: Model<N>,
    pub(crate) drives: Drives<N>,
    pub(crate) family: Family<N>,
    pub(crate) task: [bool; 6],
    pub(crate) length_m: f64,
    pub(crate) scenario: Scenario,
    pub(crate) path: Path,
    pub(crate) postures: Postures<N>,
    /// The plan of the whole path.
    pub(crate) guide: Guide<N>,
    /// Forces of the segments.
    pub(crate) forces: Forces,
}

/// The control law of one arm and one task.
#[derive(Clone, Debug)]
pub struct Controller<const N: usize> {
    pub(crate) setup: Setup<N>,
    pub(crate) state: State<N>,
    /// Of a steered run.
    pub(crate) targets: Option<Targets<N>>,
    /// Why the path cannot be followed.
    obstacle: Option<String>,
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
        q_start: Joints<N>,
    ) -> Result<Self, SetupError> {
        let rest = model.evaluate(&q_start, &Joints::zeros());
        let mut analyzer = Analyzer::new(robot, &scenario.analysis);
        let report = analyzer.step(&q_start, &Joints::zeros(), &rest);
        let family = analyzer.family().clone();
        let path = Path::new(scenario, rest.X_BE, &report)?;
        let is_steered = scenario.servo.is_some();
        if !is_steered {
            path.check(&robot.task.0, rest.X_BE, &report)?;
        }
        let postures = Postures::new(robot, scenario, q_start)?;
        let fresh = Analyzer::new(robot, &scenario.analysis);
        let forces = Forces::of(scenario);
        let (strategy, dt) = (scenario.control.strategy, scenario.dt_s());
        let too_strong = forces.impossible(&rest, model.effort(), strategy, &robot.task.0, dt);
        let targets = is_steered.then(|| Targets::new(&model, robot, scenario));
        let model = match is_steered {
            true => model.with_torque_share(targets::SHARE),
            false => model,
        };
        let legs = path.legs().len();
        let mut setup = Setup {
            drives: Drives::of(&model, robot.gravity, scenario.dt_s()),
            model,
            family,
            task: robot.task.0,
            length_m: robot.length_m,
            scenario: targets::without_text(scenario),
            path,
            postures,
            guide: Guide::new(None, legs),
            forces,
        };
        let request = Request {
            model: &setup.model,
            robot,
            scenario,
            path: &setup.path,
            analyzer: &fresh,
            q_start,
            postures: setup.postures.goals(),
            allowed: Deviation::of(&scenario.goal),
        };
        let begun = State::begin(&rest, q_start, setup.model.effort());
        let rehearsed = Cell::new(begun);
        let is_followed = || {
            let state = rehearsal::followed(&setup, &fresh, q_start, &report, begun);
            state.map(|state| rehearsed.set(state)).is_some()
        };
        let found = request.route_ahead(&is_followed);
        let obstacle = found.as_ref().err().cloned().or(too_strong);
        setup.guide = Guide::new(found.ok().flatten(), legs);
        setup.postures.stay(setup.guide.beyond_reach());
        let mut state = rehearsed.get();
        state.clock.rate = setup.guide.first_speed();
        if obstacle.is_some() {
            state.refusal = Refusal::Route;
        }
        Ok(Self {
            setup,
            state,
            targets,
            obstacle,
        })
    }

    /// Begins the law of a steered run at rest in another posture: as [`new`](Self::new) for that start, without the cost of an analysis made anew.
    ///
    /// Shapes `q_start` N · Units rad · Requires a steered scenario, and a controller before its first tick, or [restored](Self::restore) to that · Cost
    /// some µs, 0.1 ms for an arm whose singularities are found by number; no allocation
    pub fn begin(&mut self, q_start: Joints<N>) {
        let Setup {
            model,
            family,
            postures,
            guide,
            ..
        } = &mut self.setup;
        let rest = model.evaluate(&q_start, &Joints::zeros());
        if let Some(targets) = &self.targets {
            let mut analyzer = targets.analyzer.clone();
            analyzer.step(&q_start, &Joints::zeros(), &rest);
            *family = analyzer.family().clone();
        }
        postures.begin(q_start);
        self.state = State::begin(&rest, q_start, model.effort());
        self.state.clock.rate = guide.first_speed();
    }

    /// Why the path cannot be followed, found before the first tick: the controller then refuses from the first tick on.
    pub fn obstacle(&self) -> Option<&str> {
        self.obstacle.as_deref()
    }

    /// A goal that no posture of the arm has, found before the first tick, in words.
    pub fn warning(&self) -> Option<String> {
        beyond_reach::warning(&self.setup.guide)
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    pub fn save(&self, out: &mut ControllerCheckpoint) {
        self.state.save(out);
        if let Some(targets) = &self.targets {
            targets.analyzer.save(&mut out.servo.analysis);
        }
    }

    /// Takes up what [`save`](Self::save) has written: the next tick continues bit for bit. A damaged checkpoint is refused, and the arm brought to rest.
    pub fn restore(&mut self, from: &ControllerCheckpoint) {
        self.state = State::from_checkpoint(from, self.setup.model.effort());
        if let Some(targets) = &mut self.targets {
            targets.analyzer.restore(&from.servo.analysis);
        }
    }
}
