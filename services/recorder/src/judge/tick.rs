//! The judge's input: one whole tick.

use nalgebra::Vector3;
use shared_types::topics::{ByTopic, Lent};
use shared_types::{
    ControlState, PlantState, SensorSample, ServoState, SingularityReport, Target, TorqueCommand,
    WristForce,
};

/// One tick, whole: a message of each topic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tick<'a> {
    /// From the plant.
    pub(super) sensor: &'a SensorSample,
    /// From the plant.
    pub(super) truth: &'a PlantState,
    /// From the analyzer.
    pub(super) report: &'a SingularityReport,
    /// From the controller.
    pub(super) control: &'a ControlState,
    /// From the controller.
    pub(super) torque: &'a TorqueCommand,
    /// From the operator, in a steered run.
    pub(super) target: Option<&'a Target>,
    /// From the controller, in a steered run.
    pub(super) servo: Option<&'a ServoState>,
    /// From the plant, where a force is controlled by it.
    pub(super) wrist: Option<&'a WristForce>,
}

impl<'a> Tick<'a> {
    /// The judge's part of a tick; `None` if a message of it is missing.
    pub(crate) fn of(messages: &ByTopic<Lent<'a>>) -> Option<Self> {
        messages.estimate?;
        Some(Self {
            sensor: messages.sensor?,
            truth: messages.plant_state?,
            report: messages.singularity?,
            control: messages.control_state?,
            torque: messages.torque?,
            target: messages.target,
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
