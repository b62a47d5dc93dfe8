//! An estimate in, its energy out. The state that survives a tick is the largest energy so far.

use model::{Model, Refused, Robot, RobotText, joints};
use process::{Flow, Inputs, Outputs, Port, Process, Running};
use shared_types::wire::{Header, wire};
use shared_types::{MAX_DOF, StateEstimate};

wire! {
    /// Energy and manipulability of the arm, from its estimated state.
    Energy on "energy" version 1 {
        /// Tick, incarnation, stamps.
        header: Header,
        /// Kinetic energy ½ q̇ᵀA(q)q̇; J.
        kinetic_j: f64,
        /// Potential energy in the field of gravity; J.
        potential_j: f64,
        /// Yoshikawa's manipulability √det(J Jᵀ); product of m and rad units of J's rows.
        manipulability: f64,
        /// Largest kinetic energy since the first tick; J.
        peak_kinetic_j: f64,
    }
}

/// The arm, which never changes. It has as many places as a message has: absent joints have no mass.
pub(crate) struct Meter(Model<MAX_DOF>);

impl Meter {
    /// Before the first tick.
    ///
    /// # Errors
    /// [`Refused`] where the robot cannot be read, or has no such frame.
    pub(crate) fn begin(robot: &RobotText, frame: Option<&str>) -> Result<Running<Self>, Refused> {
        let robot = Robot::from_source(robot).map_err(Refused::because)?;
        let meter = Self(Model::new(&robot, frame).map_err(Refused::because)?);
        Ok(Running::new(meter, Energy::default()))
    }
}

impl Process for Meter {
    type State = Energy;
    const READS: &'static [Port] = &[Port::of::<StateEstimate>()];
    const WRITES: &'static [Port] = &[Port::of::<Energy>()];

    fn step(&self, last: &mut Energy, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        if let Some(estimate) = inputs.get::<StateEstimate>() {
            let (q, qdot) = (joints(&estimate.q), joints(&estimate.qdot));
            let jacobian = self.0.jacobian(&q);
            let determinant = (jacobian * jacobian.transpose()).determinant();
            last.kinetic_j = self.0.kinetic_energy(&q, &qdot);
            last.potential_j = self.0.potential_energy(&q);
            last.manipulability = determinant.max(0.0).sqrt();
            last.peak_kinetic_j = last.peak_kinetic_j.max(last.kinetic_j);
        }
        outputs.put(last);
        Flow::Go
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use process::{Scratch, Step};
    use shared_types::Message;

    fn step(process: &mut dyn Step, q: &[f64], qdot: &[f64]) -> Energy {
        let (mut estimate, mut out) = (StateEstimate::default(), Energy::default());
        estimate.q[..q.len()].copy_from_slice(q);
        estimate.qdot[..qdot.len()].copy_from_slice(qdot);
        let (mut scratch, mut inputs) = (Scratch::default(), Inputs::of(0, &[]));
        inputs.add(StateEstimate::TOPIC, bytemuck::bytes_of(&estimate));
        let mut outputs = Outputs::new(&mut scratch);
        outputs.add(Energy::TOPIC, bytemuck::bytes_of_mut(&mut out));
        assert_eq!(process.step(&inputs, &mut outputs), Flow::Go);
        out
    }

    #[test]
    fn the_peak_survives_a_restart_and_a_wrist_lock_has_no_manipulability() {
        let robot = Robot::builtin("puma560").unwrap().source;
        let [mut first, mut second] = [0, 1].map(|_| Meter::begin(&robot, None).unwrap());
        let out = step(&mut first, &[0.3, -1.0, 2.9, 0.1, 0.6, 0.2], &[0.5; 6]);
        assert!(
            out.kinetic_j > 0.0 && out.kinetic_j == out.peak_kinetic_j && out.manipulability > 1e-3,
            "{out:?}"
        );
        let (mut saved, peak) = (Vec::new(), out.peak_kinetic_j);
        first.save(&mut saved);
        second.restore(&saved).unwrap();
        let out = step(&mut second, &[0.3, -1.0, 2.9, 0.1, 0.0, 0.2], &[0.0; 6]);
        // The square root of a determinant of round-off, 1e-16.
        assert!(
            (out.kinetic_j, out.peak_kinetic_j) == (0.0, peak) && out.manipulability < 1e-7,
            "{out:?}"
        );
    }
}
