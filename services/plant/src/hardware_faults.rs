//! Faults of the hardware: wrong encoder readings, drives that do not follow their command. PURE.

use bytemuck::{Zeroable, bytes_of, pod_read_unaligned};
use nalgebra::SVector;
use shared_types::fault::{Kind, ScheduledFault, Way};
use sim::gaussians;

/// The faults of an arm's sensors and drives at a tick. No allocation.
#[derive(Clone, Debug)]
pub(crate) struct HardwareFaults<const N: usize> {
    sensor: [Option<ScheduledFault>; N],
    drive: [Option<ScheduledFault>; N],
    stuck_reading: [f64; N],
    stuck_torque: [f64; N],
    dt: f64,
}

/// Speed below which dry friction is proportional to speed; rad/s.
const STICTION_SPEED: f64 = 0.01;

impl<const N: usize> HardwareFaults<N> {
    pub(crate) fn new(dt: f64) -> Self {
        Self {
            sensor: [None; N],
            drive: [None; N],
            stuck_reading: [0.0; N],
            stuck_torque: [0.0; N],
            dt,
        }
    }

    /// Appends the faults in force, and gives the readings and torques before them, in this order.
    pub(crate) fn save(&self, out: &mut Vec<u8>) -> [[f64; N]; 2] {
        for fault in self.sensor.iter().chain(&self.drive) {
            out.push(fault.is_some().into());
            out.extend_from_slice(bytes_of(&fault.unwrap_or_else(ScheduledFault::zeroed)));
        }
        [self.stuck_reading, self.stuck_torque]
    }

    /// Goes on from what [`save`](Self::save) has appended and given; whether it was that.
    pub(crate) fn restore(&mut self, from: &[u8], stuck: [[f64; N]; 2]) -> bool {
        const BYTES: usize = 1 + size_of::<ScheduledFault>();
        if from.len() != 2 * N * BYTES {
            return false;
        }
        let faults = self.sensor.iter_mut().chain(&mut self.drive);
        for (fault, bytes) in faults.zip(from.chunks_exact(BYTES)) {
            *fault = (bytes[0] == 1).then(|| pod_read_unaligned(&bytes[1..]));
        }
        [self.stuck_reading, self.stuck_torque] = stuck;
        true
    }

    /// Whether a sensor or a drive is at fault.
    pub(crate) fn is_any(&self) -> bool {
        self.sensor.iter().chain(&self.drive).any(Option::is_some)
    }

    /// Applies the faults of this tick; a joint that gets stuck now keeps its values in `reading`
    /// and `tau`.
    pub(crate) fn begin(
        &mut self,
        scheduled_faults: &[ScheduledFault],
        reading: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) {
        let (mut sensor, mut drive) = ([None; N], [None; N]);
        for scheduled in scheduled_faults {
            let joint = scheduled.target as usize;
            match scheduled.kind() {
                Some(Kind::Sensor) if joint < N => sensor[joint] = Some(*scheduled),
                Some(Kind::Drive) if joint < N => drive[joint] = Some(*scheduled),
                _ => {}
            }
        }
        for joint in 0..N {
            if self.sensor[joint].is_none() {
                self.stuck_reading[joint] = reading[joint];
            }
            if self.drive[joint].is_none() {
                self.stuck_torque[joint] = tau[joint];
            }
        }
        (self.sensor, self.drive) = (sensor, drive);
    }

    /// The encoders' faulty readings in place of `reading`; rad.
    pub(crate) fn read(&self, tick: u64, reading: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|joint, _| {
            let true_reading = reading[joint];
            let Some(scheduled) = &self.sensor[joint] else {
                return true_reading;
            };
            let amount = scheduled.amount;
            match scheduled.way() {
                Some(Way::Bias) => true_reading + amount,
                Some(Way::Drift) => {
                    true_reading + amount * (tick - scheduled.at.min(tick)) as f64 * self.dt
                }
                Some(Way::Noise) => {
                    true_reading + amount * gaussians::<N>(scheduled.seed, tick)[joint]
                }
                Some(Way::Quantise) if amount > 0.0 => (true_reading / amount).round() * amount,
                Some(Way::Stuck) => self.stuck_reading[joint],
                _ => true_reading,
            }
        })
    }

    /// The torque that acts on the joints when the drives apply `tau`, N·m, with the drives' own limits as the measure.
    pub(crate) fn act(
        &self,
        tau: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        effort: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        SVector::from_fn(|joint, _| {
            let commanded = tau[joint];
            let Some(scheduled) = &self.drive[joint] else {
                return commanded;
            };
            let part = scheduled.amount.clamp(0.0, 1.0) * effort[joint];
            match scheduled.way() {
                Some(Way::Lost) => 0.0,
                Some(Way::Stuck) => self.stuck_torque[joint],
                Some(Way::Saturated) => commanded.clamp(-part, part),
                Some(Way::Friction) => {
                    commanded - part * (qdot[joint] / STICTION_SPEED).clamp(-1.0, 1.0)
                }
                _ => commanded,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::SensorSample;
    use shared_types::fault::{Fault, Target};
    use shared_types::process::Role;

    fn with_fault(kind: Kind, way: Way, amount: f64) -> HardwareFaults<2> {
        let fault = Fault {
            way: Some(way),
            joint: Some(2),
            amount: Some(amount),
            at_tick: Some(10),
            ..Fault::new("plant", kind)
        };
        let mut hardware_faults = HardwareFaults::new(1e-3);
        let target = Target::sending::<SensorSample>(0, Role::World);
        let scheduled = [fault.schedule(&target, 1000, 1).unwrap()];
        hardware_faults.begin(&scheduled, &SVector::zeros(), &SVector::zeros());
        hardware_faults
    }

    #[test]
    fn an_encoder_lies_as_it_is_told_and_only_that_one() {
        let reading = SVector::from([0.5, 0.7]);
        let read = |kind, way, amount, tick| {
            let [own, other] = with_fault(kind, way, amount).read(tick, &reading).into();
            assert_eq!(own, 0.5);
            other
        };
        for (kind, way, amount, tick, expected) in [
            (Kind::Sensor, Way::Bias, 0.25, 10, 0.95),
            (Kind::Sensor, Way::Drift, 2.0, 110, 0.9),
            (Kind::Sensor, Way::Quantise, 0.3, 10, 0.6),
            (Kind::Sensor, Way::Stuck, 0.0, 10, 0.0),
            (Kind::Drive, Way::Lost, 0.0, 10, 0.7),
        ] {
            let found = read(kind, way, amount, tick);
            assert!((found - expected).abs() < 1e-12, "{way:?}: {found}");
        }
        let noise = |tick| read(Kind::Sensor, Way::Noise, 0.1, tick);
        assert!(noise(10) != noise(11) && noise(10) == noise(10));
    }

    #[test]
    fn a_stuck_value_stays_as_it_was() {
        let mut faults = with_fault(Kind::Sensor, Way::Bias, 0.0);
        let scheduled = [faults.sensor[1].unwrap()];
        faults.sensor = [None; 2];
        for reading in [[0.1, 0.2], [0.3, 0.4]] {
            faults.begin(&scheduled, &SVector::from(reading), &SVector::zeros());
        }
        // Joint 2 has not moved on.
        assert_eq!(faults.stuck_reading, [0.3, 0.2]);
    }

    #[test]
    fn a_drive_fails_as_it_is_told() {
        let (tau, effort) = (SVector::from([5.0, 8.0]), SVector::from([10.0, 10.0]));
        for (way, amount, speed, expected) in [
            (Way::Lost, 0.0, 0.0, 0.0),
            (Way::Saturated, 0.3, 0.0, 3.0),
            (Way::Friction, 0.1, 1.0, 7.0),
            (Way::Friction, 0.1, -1.0, 9.0),
            (Way::Friction, 0.1, 0.0, 8.0),
        ] {
            let faults = with_fault(Kind::Drive, way, amount);
            let acting = faults.act(&tau, &SVector::repeat(speed), &effort);
            assert_eq!(acting, SVector::from([5.0, expected]), "{way:?}");
        }
    }
}
