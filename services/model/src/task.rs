//! The axes of the task space.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

/// One axis of the task space, base axes: a translation or a rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TaskAxis {
    /// Translation along x.
    X,
    /// Translation along y.
    Y,
    /// Translation along z.
    Z,
    /// Rotation about x.
    Rx,
    /// Rotation about y.
    Ry,
    /// Rotation about z.
    Rz,
}

impl TaskAxis {
    /// All six, in the order of the Jacobian's rows.
    pub const ALL: [TaskAxis; 6] = [
        TaskAxis::X,
        TaskAxis::Y,
        TaskAxis::Z,
        TaskAxis::Rx,
        TaskAxis::Ry,
        TaskAxis::Rz,
    ];

    /// The Jacobian's row, 0 to 5.
    pub fn row(self) -> usize {
        self as usize
    }
}

/// Which of the six task axes an arm serves, by the Jacobian's rows [v; ω].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskAxes(pub [bool; 6]);

impl TaskAxes {
    /// Position and orientation.
    pub const ALL: TaskAxes = TaskAxes([true; 6]);

    /// How many axes.
    pub fn count(&self) -> usize {
        self.0.iter().filter(|on| **on).count()
    }

    /// Whether all six.
    pub fn is_full(&self) -> bool {
        self.0 == [true; 6]
    }

    /// The axes served, in row order.
    pub fn iter(&self) -> impl Iterator<Item = TaskAxis> + '_ {
        TaskAxis::ALL.into_iter().filter(|axis| self.0[axis.row()])
    }
}

impl FromIterator<TaskAxis> for TaskAxes {
    fn from_iter<I: IntoIterator<Item = TaskAxis>>(axes: I) -> Self {
        let mut on = [false; 6];
        axes.into_iter().for_each(|axis| on[axis.row()] = true);
        TaskAxes(on)
    }
}

/// J, 6×N, its linear rows divided by `length_m` and the rows that are no axes of the `task` zero: metres and radians become comparable.
#[must_use]
pub fn unit_scaled<const N: usize>(
    J: &SMatrix<f64, 6, N>,
    length_m: f64,
    task: &[bool; 6],
) -> SMatrix<f64, 6, N> {
    let weights: [f64; 6] = std::array::from_fn(|k| match (task[k], k < 3) {
        (false, _) => 0.0,
        (true, true) => 1.0 / length_m,
        (true, false) => 1.0,
    });
    SMatrix::from_fn(|k, j| J[(k, j)] * weights[k])
}
