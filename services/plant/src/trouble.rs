//! Faults that physics sees: encoders that lie, drives that do not do what they are told.

use nalgebra::SVector;
use shared_types::fault::{Kind, ScheduledFault, Way};
use sim::gaussian;

/// What is wrong with an arm's sensors and drives at a tick. No allocation.
#[derive(Clone, Debug)]
pub(crate) struct Trouble<const N: usize> {
    sensor: [Option<ScheduledFault>; N],
    drive: [Option<ScheduledFault>; N],
    stuck_reading: [f64; N],
    stuck_torque: [f64; N],
    dt: f64,
}

/// Speed below which dry friction is proportional to speed; rad/s.
const STICTION_SPEED: f64 = 0.01;

impl<const N: usize> Trouble<N> {
    pub(crate) fn new(dt: f64) -> Self {
        Self { sensor: [None; N], drive: [None; N], stuck_reading: [0.0; N], stuck_torque: [0.0; N], dt }
    }

    /// Takes up what concerns this tick; `reading` and `tau` are what a joint that gets stuck now is stuck at.
    pub(crate) fn begin(&mut self, strikes: &[ScheduledFault], reading: &SVector<f64, N>, tau: &SVector<f64, N>) {
        let (mut sensor, mut drive) = ([None; N], [None; N]);
        for strike in strikes {
            let joint = strike.target as usize;
            match strike.kind() {
                Some(Kind::Sensor) if joint < N => sensor[joint] = Some(*strike),
                Some(Kind::Drive) if joint < N => drive[joint] = Some(*strike),
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

    /// What the encoders say instead of `reading`; rad.
    pub(crate) fn read(&self, tick: u64, reading: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|joint, _| {
            let true_reading = reading[joint];
            let Some(strike) = &self.sensor[joint] else { return true_reading };
            let amount = strike.amount;
            match strike.way() {
                Some(Way::Bias) => true_reading + amount,
                Some(Way::Drift) => true_reading + amount * (tick - strike.at.min(tick)) as f64 * self.dt,
                Some(Way::Noise) => true_reading + amount * gaussian(strike.seed, tick, joint as u64),
                Some(Way::Quantise) if amount > 0.0 => (true_reading / amount).round() * amount,
                Some(Way::Stuck) => self.stuck_reading[joint],
                _ => true_reading,
            }
        })
    }

    /// The torque that acts on the joints when the drives apply `tau`, N·m, with the drives' own limits as the measure.
    pub(crate) fn act(&self, tau: &SVector<f64, N>, qdot: &SVector<f64, N>, effort: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|joint, _| {
            let told = tau[joint];
            let Some(strike) = &self.drive[joint] else { return told };
            let part = strike.amount.clamp(0.0, 1.0) * effort[joint];
            match strike.way() {
                Some(Way::Lost) => 0.0,
                Some(Way::Stuck) => self.stuck_torque[joint],
                Some(Way::Saturated) => told.clamp(-part, part),
                Some(Way::Friction) => told - part * (qdot[joint] / STICTION_SPEED).clamp(-1.0, 1.0),
                _ => told,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::fault::Fault;

    fn struck(kind: Kind, way: Way, amount: f64) -> Trouble<2> {
        let fault = Fault { way: Some(way), joint: Some(2), amount: Some(amount), at_tick: Some(10), ..Fault::new("plant", kind) };
        let mut trouble = Trouble::new(1e-3);
        trouble.begin(&[fault.schedule(0, 1000, 1).unwrap()], &SVector::from([0.1, 0.2]), &SVector::from([3.0, 4.0]));
        trouble
    }

    #[test]
    fn an_encoder_lies_as_it_is_told_and_only_that_one() {
        let reading = SVector::from([0.5, 0.7]);
        let read = |way, amount, tick| struck(Kind::Sensor, way, amount).read(tick, &reading);
        assert_eq!(read(Way::Bias, 0.25, 10), SVector::from([0.5, 0.95]));
        assert!((read(Way::Drift, 2.0, 110)[1] - 0.9).abs() < 1e-12);
        assert!((read(Way::Quantise, 0.3, 10)[1] - 0.6).abs() < 1e-12);
        assert_ne!(read(Way::Noise, 0.1, 10), read(Way::Noise, 0.1, 11));
        assert_eq!(read(Way::Noise, 0.1, 10), read(Way::Noise, 0.1, 10));
        let none = struck(Kind::Drive, Way::Lost, 0.0).read(10, &reading);
        assert_eq!(none, reading);
    }

    #[test]
    fn what_is_stuck_stays_what_it_was() {
        let mut trouble = struck(Kind::Sensor, Way::Bias, 0.0);
        let strikes = [trouble.sensor[1].unwrap()];
        trouble.sensor = [None; 2];
        trouble.begin(&strikes, &SVector::from([0.1, 0.2]), &SVector::zeros());
        trouble.begin(&strikes, &SVector::from([0.3, 0.4]), &SVector::zeros());
        assert_eq!(trouble.stuck_reading, [0.3, 0.2], "joint 2 has not moved on");
    }

    #[test]
    fn a_drive_fails_as_it_is_told() {
        let (tau, effort) = (SVector::from([5.0, 8.0]), SVector::from([10.0, 10.0]));
        let act = |way, amount, speed| struck(Kind::Drive, way, amount).act(&tau, &SVector::from([speed, speed]), &effort)[1];
        assert_eq!((act(Way::Lost, 0.0, 0.0), act(Way::Saturated, 0.3, 0.0)), (0.0, 3.0));
        assert_eq!((act(Way::Friction, 0.1, 1.0), act(Way::Friction, 0.1, -1.0), act(Way::Friction, 0.1, 0.0)), (7.0, 9.0, 8.0));
        assert_eq!(struck(Kind::Drive, Way::Lost, 0.0).act(&tau, &SVector::zeros(), &effort)[0], 5.0);
    }
}
