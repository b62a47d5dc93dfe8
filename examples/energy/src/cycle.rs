//! The pure step: an estimate in, its energy out.

use model::{Model, ModelError, Robot, joints};
use shared_types::{MAX_DOF, StateEstimate};

use crate::message::{Energy, EnergyCheckpoint};

/// The arm, and the largest kinetic energy so far.
pub(crate) struct Cycle {
    /// As many places as a message has: absent joints have no mass.
    arm: Model<MAX_DOF>,
    peak_kinetic_j: f64,
}

impl Cycle {
    /// # Errors
    /// [`ModelError`] where the robot has no such frame.
    pub(crate) fn new(robot: &Robot, frame: Option<&str>) -> Result<Self, ModelError> {
        Ok(Self {
            arm: Model::new(robot, frame)?,
            peak_kinetic_j: 0.0,
        })
    }

    pub(crate) fn step(&mut self, estimate: &StateEstimate, out: &mut Energy) {
        let (q, qdot) = (joints(&estimate.q), joints(&estimate.qdot));
        let jacobian = self.arm.jacobian(&q);
        out.kinetic_j = self.arm.kinetic_energy(&q, &qdot);
        out.potential_j = self.arm.potential_energy(&q);
        out.manipulability = (jacobian * jacobian.transpose())
            .determinant()
            .max(0.0)
            .sqrt();
        self.peak_kinetic_j = self.peak_kinetic_j.max(out.kinetic_j);
        out.peak_kinetic_j = self.peak_kinetic_j;
    }

    pub(crate) fn save(&self, out: &mut EnergyCheckpoint) {
        out.peak_kinetic_j = self.peak_kinetic_j;
    }

    pub(crate) fn restore(&mut self, from: &EnergyCheckpoint) {
        self.peak_kinetic_j = from.peak_kinetic_j;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(q: &[f64], qdot: &[f64]) -> StateEstimate {
        let mut estimate = StateEstimate::default();
        estimate.q[..q.len()].copy_from_slice(q);
        estimate.qdot[..qdot.len()].copy_from_slice(qdot);
        estimate
    }

    #[test]
    fn the_peak_survives_a_restart_and_a_wrist_lock_has_no_manipulability() {
        let robot = Robot::builtin("puma560").unwrap();
        let (mut cycle, mut out) = (Cycle::new(&robot, None).unwrap(), Energy::default());
        cycle.step(
            &estimate(&[0.3, -1.0, 2.9, 0.1, 0.6, 0.2], &[0.5; 6]),
            &mut out,
        );
        assert!(
            out.kinetic_j > 0.0 && out.kinetic_j == out.peak_kinetic_j && out.manipulability > 1e-3,
            "{out:?}"
        );
        let (mut checkpoint, mut next) = (
            EnergyCheckpoint::default(),
            Cycle::new(&robot, None).unwrap(),
        );
        cycle.save(&mut checkpoint);
        next.restore(&checkpoint);
        let peak = out.peak_kinetic_j;
        next.step(
            &estimate(&[0.3, -1.0, 2.9, 0.1, 0.0, 0.2], &[0.0; 6]),
            &mut out,
        );
        // The square root of a determinant of round-off, 1e-16.
        assert!(
            (out.kinetic_j, out.peak_kinetic_j) == (0.0, peak) && out.manipulability < 1e-7,
            "{out:?}"
        );
    }
}
