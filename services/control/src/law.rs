//! The input and output that every control law shares: desired motion and auxiliary coordinates in, joint torques out.

use crate::centre::AtCentre;
use crate::linear::SolveError;
use crate::paper::operational_space::OperationalError;
use crate::types::Refusal;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};
use shared_types::MAX_SINGULARITIES;

/// Why a law gives no torque.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LawError {
    /// The augmented system is singular.
    #[error("the arm is singular in a way that the law does not handle here: {0}")]
    Solve(#[from] SolveError),
    /// The reduced Jacobian is rank deficient.
    #[error("the reduced Jacobian is rank deficient: {0}")]
    Operational(#[from] OperationalError),
    /// The path's joint speeds exceed what the slowest clock can reach.
    #[error("the path asks a joint for {share:.0} times the speed it has: no clock is slow enough")]
    Speed {
        /// Largest share of a speed limit at full clock speed.
        share: f64,
    },
    /// A joint is about to reach its limit.
    #[error("joint {} is about to reach its limit", joint + 1)]
    Limit {
        /// Index of the joint.
        joint: usize,
    },
    /// The joint limits leave no room to turn ζ.
    #[error("turning ζ by {angle_deg:.1}° would take a joint beyond its limits, either way round")]
    Room {
        /// Commanded angle, degrees.
        angle_deg: f64,
    },
    /// A direction is lost that no listed singularity explains.
    #[error(
        "the Jacobian has rank {rank} with {listed} singularities listed: a direction is lost that none of them explains"
    )]
    Unlisted {
        /// Rank of the Jacobian.
        rank: u32,
        /// Singularities inside their neighbourhoods.
        listed: usize,
    },
    /// More rows than joints.
    #[error(
        "{rows} rows of task and auxiliary coordinates for {joints} joints: ask for fewer task axes"
    )]
    TooManyRows {
        /// Rows of task and auxiliary coordinates.
        rows: usize,
        /// Joints there are.
        joints: usize,
    },
}

impl LawError {
    /// Its code on the wire.
    #[must_use]
    pub fn refusal(&self) -> Refusal {
        match self {
            Self::Solve(_) | Self::Operational(_) | Self::TooManyRows { .. } => Refusal::Singular,
            Self::Speed { .. } => Refusal::Speed,
            Self::Limit { .. } => Refusal::Limit,
            Self::Room { .. } => Refusal::Room,
            Self::Unlisted { .. } => Refusal::Unlisted,
        }
    }
}

/// A singularity that takes part in the solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Active<const N: usize> {
    /// ζ, base axes, at C.
    pub zeta_B: Vector6<f64>,
    /// ζᵀJ = gain·aux_row modulo the other rows.
    pub gain: f64,
    /// 1: operational control along ζ; 0: auxiliary control.
    pub beta: f64,
    /// Gradient of the auxiliary coordinate.
    pub aux_row: SVector<f64, N>,
    /// Desired auxiliary acceleration, less its value at q̈ = 0; rad/s².
    pub aux_acceleration: f64,
    /// Auxiliary rate at which the path would be followed at full clock speed, rad/s.
    pub aux_rate: f64,
}

/// The desired motion and accelerations of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a, const N: usize> {
    /// Mass matrix.
    pub A: &'a SMatrix<f64, N, N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
    /// C in the end-effector's axes, m.
    pub p_EC: &'a Vector3<f64>,
    /// Which of the six task axes count.
    pub task: [bool; 6],
    /// Operational acceleration a*, base axes at C.
    pub a: Vector6<f64>,
    /// The share of a* that lies along the path, which saturation scales down before the rest.
    pub a_path: Vector6<f64>,
    /// Nominal twist of the path, for predicting joint speeds.
    pub V: Vector6<f64>,
    /// Acceleration of the path at its present speed, for predicting torques.
    pub a_feed: Vector6<f64>,
    /// Desired acceleration in the null space that is left (redundant arms), rad/s².
    pub posture: SVector<f64, N>,
}

/// The engaged singularities, in a bounded array.
#[derive(Clone, Copy, Debug)]
pub struct Actives<const N: usize> {
    list: [Active<N>; MAX_SINGULARITIES],
    count: usize,
}

impl<const N: usize> Actives<N> {
    /// None.
    #[must_use]
    pub fn none() -> Self {
        let nothing = Active {
            zeta_B: Vector6::zeros(),
            gain: 0.0,
            beta: 1.0,
            aux_row: SVector::zeros(),
            aux_acceleration: 0.0,
            aux_rate: 0.0,
        };
        Self {
            list: [nothing; MAX_SINGULARITIES],
            count: 0,
        }
    }

    /// Adds one; a report holds no more than fit.
    #[inline]
    pub fn push(&mut self, active: Active<N>) {
        if self.count < MAX_SINGULARITIES {
            self.list[self.count] = active;
            self.count += 1;
        }
    }
}

impl<const N: usize> std::ops::Deref for Actives<N> {
    type Target = [Active<N>];
    fn deref(&self) -> &[Active<N>] {
        &self.list[..self.count]
    }
}

/// Torques before gravity, Coriolis and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Torques<const N: usize> {
    /// Along the path, N·m.
    pub path: SVector<f64, N>,
    /// The rest of the task torque: feedback and the motion orthogonal to the path, N·m.
    pub rest: SVector<f64, N>,
    /// In the null space of the kept rows, N·m.
    pub null: SVector<f64, N>,
    /// Joint velocities at which the path would be followed at full clock speed, rad/s.
    pub qdot_nominal: SVector<f64, N>,
    /// Joint accelerations of the path itself, without feedback and without a change of its clock, rad/s².
    pub qddot_path: SVector<f64, N>,
}

impl<const N: usize> Torques<N> {
    /// Largest share of a joint's speed limit at full clock speed; `velocity` are the limits, rad/s.
    #[must_use]
    #[inline]
    pub fn speed_share(&self, velocity: &SVector<f64, N>) -> f64 {
        (0..N).fold(0.0_f64, |share, i| {
            share.max(self.qdot_nominal[i].abs() / velocity[i])
        })
    }
}
