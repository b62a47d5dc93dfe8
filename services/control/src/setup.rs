//! From a scenario to what a controller needs before its first tick.

use crate::linear::Joints;
use crate::reference::path::PathError;
use model::{ModelError, PostureError, Robot};
use shared_types::scenario::Scenario;

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
    Start(#[from] PostureError),
    /// A posture goal does not fit the arm.
    #[error("segment {segment}: {error}")]
    Posture {
        /// Index of the segment.
        segment: usize,
        /// The defect.
        error: PostureError,
    },
}

/// The start posture of a scenario. Shape N; rad.
///
/// # Errors
/// [`SetupError::Start`] if it does not fit the robot or lies outside its limits.
pub fn start_posture<const N: usize>(
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Joints<N>, SetupError> {
    let q = robot.start_posture(&scenario.start)?;
    Ok(model::embedded(&q))
}

/// The posture goal of each segment that has one, rad.
///
/// # Errors
/// [`SetupError::Posture`] for a posture that does not fit the robot.
pub(crate) fn posture_goals<const N: usize>(
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Vec<Option<Joints<N>>>, SetupError> {
    let goal = |(segment, goal): (usize, &shared_types::scenario::Segment)| {
        let q = goal.posture().map(|start| robot.start_posture(&start));
        let q = q.transpose();
        let q = q.map_err(|error| SetupError::Posture { segment, error })?;
        Ok(q.map(|q| model::embedded(&q)))
    };
    scenario.segment.iter().enumerate().map(goal).collect()
}
