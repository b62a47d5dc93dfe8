//! A controller written in Python, as a step on the thread of a trial.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArrayMethods};
use process::{Damaged, Flow, Inputs, Outputs, Port, Step};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use session::load::{self, Loaded};
use shared_types::job::Mode;
use shared_types::{
    ControlState, Message, ServoState, SingularityReport, StateEstimate, Target, TorqueCommand,
    WristForce,
};

use crate::floats::Mode as Floats;
use crate::refused;

/// Those of them that the graph has; as in a process of others, there is no tick without all.
const READS: &[Port] = &[
    Port::of::<StateEstimate>(),
    Port::of::<SingularityReport>(),
    Port::of::<Target>(),
    Port::of::<WristForce>(),
];
const WRITES: &[Port] = &[
    Port::of::<ServoState>(),
    Port::of::<ControlState>(),
    Port::of::<TorqueCommand>(),
];

/// The error that ended a controller.
type Raised = Arc<Mutex<Option<PyErr>>>;

/// A controller that a trial runs.
pub(crate) struct Handle {
    process: Py<PyAny>,
    raised: Raised,
}

impl Handle {
    /// Ends it after its run.
    ///
    /// # Errors
    /// The exception that it raised at a tick, or at its end.
    pub(crate) fn end(self, py: Python<'_>) -> PyResult<()> {
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        match raised.take() {
            Some(error) => Err(error),
            None => self.process.call_method0(py, "end").map(drop),
        }
    }
}

/// The bytes of a message that Python sees.
type Place = (Port, Py<PyArray1<u8>>);

/// A controller in Python, with the messages that it shares with us.
pub(crate) struct Controller {
    /// Takes the number of a tick.
    answer: Py<PyAny>,
    inputs: Vec<Place>,
    outputs: Vec<Place>,
    raised: Raised,
    /// Python's; ours is the standard one.
    floats: Floats,
}

impl Controller {
    /// Starts a controller of a class for a scenario.
    pub(crate) fn new(class: &Bound<'_, PyAny>, loaded: &Loaded) -> PyResult<(Self, Handle)> {
        let (robot, scenario) = (&loaded.robot, loaded.scenario.clone());
        let start = robot.start_posture(&scenario.start).map_err(refused)?;
        let mjcf = robot.to_mjcf(scenario.frame(), &start);
        let graph = load::graph_of(&scenario, None).map_err(refused)?;
        let job = load::job(robot, scenario, graph, Mode::Lockstep, "".into());
        let job = serde_json::to_string(&job).map_err(refused)?;
        let within = class.py().import("armplane.within")?;
        let (process, answer, messages): (_, _, Bound<'_, PyDict>) = within
            .call_method1("begin", (class, job, mjcf))?
            .extract()?;
        let own = |ports: &[Port]| -> PyResult<Vec<Place>> {
            let place = |port: &Port| -> PyResult<Option<Place>> {
                let bytes = messages.get_item(port.topic)?;
                let bytes = bytes.map(|bytes| bytes.extract().map_err(PyErr::from));
                let bytes = bytes.transpose()?;
                Ok(bytes.map(|bytes| (*port, bytes)))
            };
            ports
                .iter()
                .filter_map(|port| place(port).transpose())
                .collect()
        };
        let handle = Handle {
            process,
            raised: Arc::default(),
        };
        let controller = Self {
            answer,
            inputs: own(READS)?,
            outputs: own(WRITES)?,
            raised: Arc::clone(&handle.raised),
            floats: Floats::of_thread(),
        };
        Ok((controller, handle))
    }

    /// Gives it the messages of a tick, and takes its own.
    fn tick(&self, py: Python<'_>, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> PyResult<()> {
        for (port, place) in &self.inputs {
            if let Some(message) = inputs.bytes(port.topic) {
                place
                    .bind(py)
                    .readwrite()
                    .as_slice_mut()?
                    .copy_from_slice(message);
            }
        }
        self.floats
            .during(|| self.answer.call1(py, (inputs.tick,)))?;
        for (port, place) in &self.outputs {
            let Some(out) = outputs.bytes(port.topic) else {
                continue;
            };
            out.copy_from_slice(place.bind(py).readonly().as_slice()?);
            if let Some(field) = (port.not_finite)(out) {
                let (topic, tick) = (port.topic, inputs.tick);
                let why =
                    format!("the controller's `{topic}` of tick {tick}: {field} is not finite");
                return Err(refused(why));
            }
        }
        Ok(())
    }
}

impl Step for Controller {
    fn reads(&self) -> &'static [Port] {
        READS
    }
    fn writes(&self) -> &'static [Port] {
        WRITES
    }
    fn step(&mut self, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        let Err(error) = Python::attach(|py| self.tick(py, inputs, outputs)) else {
            return Flow::Go;
        };
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.get_or_insert(error);
        // No number: under faults, too, the run ends here.
        if let Some(torque) = outputs.bytes(TorqueCommand::TOPIC) {
            torque.fill(0xFF);
        }
        Flow::Over
    }
    fn save(&self, _: &mut Vec<u8>) {}
    fn restore(&mut self, _: &[u8]) -> Result<(), Damaged> {
        Err(Damaged::Content)
    }
    fn obstacle(&self) -> Option<&str> {
        None
    }
    fn warning(&self) -> Option<String> {
        None
    }
}
