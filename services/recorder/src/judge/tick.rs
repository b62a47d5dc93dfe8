//! The judge's input: one whole tick.

use nalgebra::Vector3;
use shared_types::topics::{ByTopic, Lent};
use shared_types::{
    ControlState, PlantState, SensorSample, ServoState, SingularityReport, StateEstimate,
    TorqueCommand, WristForce,
};

/// One tick, whole: a message of each topic.
#[derive(Clone, Copy, Debug)]
pub struct Tick<'a> {
    /// From the plant.
    pub sensor: &'a SensorSample,
    /// From the plant.
    pub truth: &'a PlantState,
    /// From the estimator.
    pub estimate: &'a StateEstimate,
    /// From the analyzer.
    pub report: &'a SingularityReport,
    /// From the controller.
    pub control: &'a ControlState,
    /// From the controller.
    pub torque: &'a TorqueCommand,
    /// From the controller, in a steered run.
    pub servo: Option<&'a ServoState>,
    /// From the plant, where a force is controlled by it.
    pub wrist: Option<&'a WristForce>,
}

impl<'a> Tick<'a> {
    /// The judge's part of a tick; `None` if a message of it is missing.
    pub fn of(messages: &ByTopic<Lent<'a>>) -> Option<Self> {
        Some(Self {
            sensor: messages.sensor?,
            truth: messages.plant_state?,
            estimate: messages.estimate?,
            report: messages.singularity?,
            control: messages.control_state?,
            torque: messages.torque?,
            servo: messages.servo_state,
            wrist: messages.wrist_force,
        })
    }
}

/// The linear and the angular half of a twist.
pub(super) fn halves(twist: &[f64; 6]) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(twist[0], twist[1], twist[2]),
        Vector3::new(twist[3], twist[4], twist[5]),
    )
}
