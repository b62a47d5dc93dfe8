//! The pure step of the plant: turns the robot's state into messages, and the commanded torque into
//! the torque sent. PURE.

use model::{Model, padded};
use nalgebra::SVector;
use shared_types::codes::DRIVE_RATE;
use shared_types::task_end::TaskEnd;
use shared_types::{Header, PlantState, SensorSample, TorqueCommand};
use sim::Drive;

use crate::approach::Approach;
use crate::interface::{JOINTS, RATE_HZ};

type Joints = SVector<f64, JOINTS>;

/// Largest change of the torque sent in a tick, N·m. The interface stops the arm beyond 1; the rest is for rounding on its side.
const STEP: f64 = 0.999;

/// The robot's measurements at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measured {
    /// Joint positions; rad.
    pub(crate) q: Joints,
    /// Joint velocities; rad/s.
    pub(crate) qdot: Joints,
    /// Torque in force, without gravity, as the robot has it; N·m.
    pub(crate) tau_in_force: Joints,
}

impl Measured {
    /// Whether all of it is numbers.
    pub(crate) fn is_finite(&self) -> bool {
        [&self.q, &self.qdot, &self.tau_in_force]
            .iter()
            .all(|joints| joints.iter().all(|x| x.is_finite()))
    }
}

/// The plant's side of the interface, from tick to tick.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    model: Model<JOINTS>,
    drive: Drive<JOINTS>,
    /// Torque sent last, without gravity; N·m.
    sent: Joints,
    /// Total torque over the tick before; N·m.
    acted: Joints,
    /// Posture in which the arm is held while braked; rad.
    held: Option<Joints>,
    flags: u32,
    saturation_mask: u32,
    end: TaskEnd,
    ticks: u64,
}

impl Cycle {
    /// An arm at rest at `start`; the task is planned to take `length` ticks.
    pub(crate) fn new(
        model: Model<JOINTS>,
        hold_ticks: u32,
        length: u64,
        start: &Measured,
    ) -> Self {
        let gravity = model.gravity(&start.q);
        Self {
            sent: start.tau_in_force,
            acted: start.tau_in_force + gravity,
            held: None,
            flags: 0,
            saturation_mask: 0,
            end: TaskEnd::new(RATE_HZ, u64::from(TaskEnd::LONGEST).saturating_mul(length)),
            ticks: 0,
            drive: Drive::new(model.clone(), RATE_HZ, hold_ticks, &gravity),
            model,
        }
    }

    /// The messages of `tick`; the caller fills stamps and incarnation. Without a simulator, the
    /// robot's measurements are the truth.
    pub(crate) fn sample(
        &self,
        tick: u64,
        now: &Measured,
        sample: &mut SensorSample,
        truth: &mut PlantState,
    ) {
        let (header, applied) = (
            Header {
                tick,
                ..Header::default()
            },
            self.drive.state(),
        );
        *sample = SensorSample {
            header,
            q_encoder: padded(&now.q),
            tau_drive: padded(&self.acted),
            drive: applied.drive,
            stale_ticks: applied.stale_ticks,
        };
        *truth = PlantState {
            header,
            q: padded(&now.q),
            qdot: padded(&now.qdot),
            tau: padded(&self.acted),
            limit_mask: self.beyond_limits(&now.q),
            saturation_mask: self.saturation_mask,
            drive: applied.drive,
            drive_flags: self.flags,
            refused: applied.refused,
            ..self.model.motion(&now.q, &now.qdot).truth()
        };
    }

    /// The torque to send for the tick, without gravity, N·m, given the command for it (`None`: none came).
    ///
    /// Ensures within 0.999 N·m of the torque in force and of the one sent last, where these are within 2 N·m of each other, and within the effort
    /// limits. No allocation.
    pub(crate) fn step(
        &mut self,
        now: &Measured,
        command: Option<&TorqueCommand>,
    ) -> [f64; JOINTS] {
        let tau = command.map(|command| Joints::from_column_slice(&command.tau[..JOINTS]));
        let age = command.map_or(0, |command| self.ticks.saturating_sub(command.header.tick));
        let applied = *self.drive.answer(
            &now.q,
            &now.qdot,
            tau.as_ref(),
            u32::try_from(age).unwrap_or(u32::MAX),
        );
        let gravity = self.model.gravity(&now.q);
        let is_braked = self.drive.is_braked();
        self.held = is_braked.then(|| self.held.unwrap_or(now.q));
        // A Franka arm has no brakes that a client could set: it is held where it stands.
        let wanted = match &self.held {
            Some(at) => Approach::hold(&self.model, at, &now.q, &now.qdot),
            None => self.drive.tau() - gravity,
        };
        (self.flags, self.saturation_mask) = (applied.flags, applied.saturation_mask);
        let sent = self.send_within_steps(now, &wanted);
        self.acted = self.sent + gravity;
        self.end.take(command.map(|command| command.phase));
        self.ticks += 1;
        sent
    }

    /// The torque nearest to `wanted` that the interface accepts; both without gravity, N·m.
    pub(crate) fn send_within_steps(&mut self, now: &Measured, wanted: &Joints) -> [f64; JOINTS] {
        for i in 0..JOINTS {
            let effort = self.model.effort()[i];
            let (before, in_force) = (self.sent[i], now.tau_in_force[i]);
            let tau = wanted[i]
                .clamp(in_force - STEP, in_force + STEP)
                .clamp(before - STEP, before + STEP)
                .clamp(-effort, effort);
            if tau != wanted[i] {
                self.flags |= DRIVE_RATE;
                self.saturation_mask |= 1 << i;
            }
            self.sent[i] = tau;
        }
        self.sent.into()
    }

    /// Writes into the last messages of the run that the robot has stopped the arm by itself.
    pub(crate) fn stopped_by_robot(&mut self) {
        self.drive.brake(0);
    }

    /// Whether the task is done, or has been refused and the arm has had 2 s to come to rest, or is 20 times as long as planned.
    pub(crate) fn is_over(&self) -> bool {
        self.end.is_over(self.ticks)
    }

    /// The drives' state, one of `codes::DRIVES`.
    pub(crate) fn drive(&self) -> u32 {
        self.drive.state().drive
    }

    fn beyond_limits(&self, q: &Joints) -> u32 {
        let beyond = |i: &usize| q[*i] <= self.model.lower()[*i] || q[*i] >= self.model.upper()[*i];
        (0..JOINTS).filter(beyond).fold(0, |mask, i| mask | 1 << i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::Robot;
    use shared_types::Message;
    use shared_types::codes::{DRIVE_BRAKED, DRIVE_HOLDING, DRIVE_STOPPING, PHASE_DONE};
    use shared_types::wire::Part;

    fn model() -> Model<JOINTS> {
        Model::new(&Robot::builtin("fr3").unwrap(), None).unwrap()
    }

    fn at_rest() -> Measured {
        Measured {
            q: Joints::from([0.3, -0.4, 0.1, -1.5, 0.2, 1.6, 0.7]),
            qdot: Joints::zeros(),
            tau_in_force: Joints::zeros(),
        }
    }

    fn cycle() -> Cycle {
        Cycle::new(model(), 3, 1000, &at_rest())
    }

    fn command(tick: u64, tau: Joints) -> TorqueCommand {
        let mut command = TorqueCommand {
            tau: padded(&tau),
            ..TorqueCommand::default()
        };
        command.header.tick = tick;
        command
    }

    #[test]
    fn gravity_is_left_to_the_interface() {
        let (mut cycle, now) = (cycle(), at_rest());
        let gravity = model().gravity(&now.q);
        assert!(gravity.amax() > 10.0);
        let sent = cycle.step(&now, Some(&command(0, gravity + Joints::repeat(0.25))));
        assert!(
            sent.iter().all(|tau| (tau - 0.25).abs() < 1e-12),
            "{sent:?}"
        );
        let (mut sample, mut truth) = <(SensorSample, PlantState)>::default();
        cycle.sample(1, &now, &mut sample, &mut truth);
        assert!(sample.is_finite() && truth.is_finite() && sample.header().tick == 1);
        assert!(
            (truth.tau[1] - gravity[1] - 0.25).abs() < 1e-12,
            "the messages have the whole torque"
        );
        assert_eq!((sample.tau_drive, truth.drive_flags), (truth.tau, 0));
    }

    #[test]
    fn no_torque_changes_by_more_than_the_interface_allows() {
        let (mut cycle, mut now) = (cycle(), at_rest());
        let gravity = model().gravity(&now.q);
        let mut last = [0.0; JOINTS];
        let mut check = |sent: [f64; JOINTS], now: &mut Measured| {
            assert!(
                sent.iter().zip(last).all(|(a, b)| (a - b).abs() <= 1.0),
                "{last:?} {sent:?}"
            );
            (last, now.tau_in_force) = (sent, Joints::from(sent));
        };
        for tick in 0..60 {
            let wild = Joints::from_fn(|i, _| {
                if (tick as usize + i).is_multiple_of(7) {
                    80.0
                } else {
                    -80.0
                }
            });
            check(
                cycle.step(&now, Some(&command(tick, gravity + wild))),
                &mut now,
            );
        }
        assert_ne!(cycle.flags & DRIVE_RATE, 0);
        for _ in 60..100 {
            check(cycle.step(&now, None), &mut now);
        }
    }

    #[test]
    fn a_lost_packet_leaves_the_torque_within_reach_of_the_robots_own() {
        let (mut cycle, now) = (cycle(), at_rest());
        let gravity = model().gravity(&now.q);
        let up = |by: f64| gravity + Joints::repeat(by);
        cycle.step(&now, Some(&command(0, up(0.9))));
        // The robot still has 0: the packet did not arrive.
        let sent = cycle.step(&now, Some(&command(1, up(1.8))));
        assert!(
            sent.iter().all(|tau| (tau - STEP).abs() < 1e-12),
            "{sent:?}"
        );
    }

    #[test]
    fn without_commands_the_arm_is_stopped_and_held_where_it_stands() {
        let (mut cycle, mut now) = (cycle(), at_rest());
        let gravity = model().gravity(&now.q);
        cycle.step(&now, Some(&command(0, gravity)));
        now.qdot = Joints::repeat(0.5);
        let mut seen = vec![];
        for _ in 0..1500 {
            now.tau_in_force = Joints::from(cycle.step(&now, None));
            if seen.last() != Some(&cycle.drive()) {
                seen.push(cycle.drive());
            }
            if cycle.drive() == DRIVE_STOPPING {
                assert!(
                    now.tau_in_force.dot(&now.qdot) <= 1e-9,
                    "it takes energy out"
                );
                now.qdot *= 0.98;
            }
        }
        assert_eq!(seen, [DRIVE_HOLDING, DRIVE_STOPPING, DRIVE_BRAKED]);
        now.q[3] += 0.01;
        now.qdot.fill(0.0);
        for _ in 0..100 {
            now.tau_in_force = Joints::from(cycle.step(&now, None));
        }
        assert!(
            now.tau_in_force[3] < -1.0,
            "pushed away, it pulls back: {}",
            now.tau_in_force
        );
    }

    #[test]
    fn it_is_over_when_the_task_is() {
        let (mut cycle, now) = (cycle(), at_rest());
        let gravity = model().gravity(&now.q);
        cycle.step(&now, Some(&command(0, gravity)));
        assert!(!cycle.is_over());
        cycle.step(
            &now,
            Some(&TorqueCommand {
                phase: PHASE_DONE,
                ..command(1, gravity)
            }),
        );
        assert!(cycle.is_over());
    }
}
