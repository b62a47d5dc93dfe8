//! The plant's pure step: from torque to motion, and from motion to sensor readings.

use bytemuck::{bytes_of, pod_read_unaligned};
use model::{Model, Refused, Robot, embedded, joints, padded, stack};
use nalgebra::SVector;
use process::{CUT_TICKS, Damaged, Flow, Inputs, Outputs, Port, Process, Snapshot};
use shared_types::checkpoints::PlantCheckpoint;
use shared_types::codes::DRIVE_DIVERGED;
use shared_types::fault::ScheduledFault;
use shared_types::scenario::{self, Push, Scenario};
use shared_types::task_end::TaskEnd;
use shared_types::{Header, Layout, PlantState, SensorSample, TorqueCommand, WristForce};
use sim::{Drive, Encoders, Plant, gaussians};
use std::array;

use crate::hardware_faults::HardwareFaults;

/// The part of the plant that never changes: its encoders, and the size of its arm.
pub(crate) struct Cycle<const N: usize> {
    encoders: Encoders<N>,
    /// The scenario's: pushes on the hand, noise of the wrist's sensor.
    options: scenario::Plant,
    /// Of that noise.
    wrist_seed: u64,
    /// Number of the arm's joints; further entries of a command are ignored.
    dof: usize,
    /// Length of a tick, s.
    dt_s: f64,
}

/// The arm, its drives and their faults, from tick to tick.
///
/// Between tick k and k + 1 the torque commanded from the sample of tick k acts.
pub(crate) struct World<const N: usize> {
    plant: Plant<N>,
    drive: Drive<N>,
    end: TaskEnd,
    hardware_faults: HardwareFaults<N>,
    /// The state of this process alone: `ticks`, `diverged`, `contradicted`, and `acted`, the torque applied by the drives, unless one failed.
    own: PlantCheckpoint,
}

impl<const N: usize> Cycle<N> {
    /// The simulated `robot` at rest at the scenario's start.
    ///
    /// # Errors
    /// [`Refused`] if the scenario and the robot do not fit, or cannot be simulated.
    pub(crate) fn new(robot: &Robot, scenario: &Scenario) -> Result<(Self, World<N>), Refused> {
        let (options, frame, rate_hz) = (&scenario.plant, scenario.frame(), scenario.rate_hz);
        let start = robot.start_posture(&scenario.start);
        let start = embedded(&start.map_err(Refused::because)?);
        // The drives' model is the description's, without the simulated deviation from it.
        let known = Model::new(robot, frame).map_err(Refused::because)?;
        let plant = Plant::new(robot, frame, options, rate_hz, &start);
        let plant = plant.map_err(Refused::because)?;
        // They carry the arm as it is, with all that it holds.
        let carries = plant.model().gravity(&start);
        let drive = Drive::new(known, rate_hz, options.hold_ticks, &carries);
        let cycle = Self {
            encoders: Encoders::new(
                robot,
                options.encoder_bits,
                options.encoder_noise_counts,
                scenario.seed,
            ),
            options: options.clone(),
            // Not the encoders' numbers.
            wrist_seed: !scenario.seed,
            dof: robot.dof(),
            dt_s: scenario.dt_s(),
        };
        let world = World {
            plant,
            own: PlantCheckpoint {
                acted: drive.state().tau,
                ..PlantCheckpoint::default()
            },
            drive,
            hardware_faults: HardwareFaults::new(scenario.dt_s()),
            end: TaskEnd::of(scenario),
        };
        Ok((cycle, world))
    }

    /// The sensors' readings at `tick`, and the truth; the runtime fills their headers.
    ///
    /// A pure function of the world and `tick`: asking twice gives the same.
    fn sample(
        &self,
        world: &World<N>,
        tick: u64,
        sample: &mut SensorSample,
        truth: &mut PlantState,
    ) {
        let World {
            plant,
            drive,
            hardware_faults,
            own,
            ..
        } = world;
        let (x, touch, applied) = (plant.state(), plant.touch(), drive.state());
        *sample = SensorSample {
            header: Header::default(),
            q_encoder: padded(&hardware_faults.read(tick, &self.encoders.read(tick, &x.q))),
            tau_drive: applied.tau,
            drive: applied.drive,
            stale_ticks: applied.stale_ticks,
        };
        *truth = PlantState {
            q: padded(&x.q),
            qdot: padded(&x.qdot),
            tau: own.acted,
            contact_force_n: touch.force.into(),
            contact_torque_nm: plant.pressed().fixed_rows::<3>(3).into(),
            contacts: touch.contacts,
            limit_mask: touch.limits,
            saturation_mask: applied.saturation_mask,
            drive: applied.drive,
            drive_flags: applied.flags,
            refused: applied.refused,
            ..plant.motion().truth()
        };
    }

    /// The wrist's sensor at `tick`: the wrench on the hand, with noise that is a function of the seed and the tick.
    fn feel(&self, world: &World<N>, tick: u64) -> WristForce {
        let noise: [f64; 6] = gaussians(self.wrist_seed, tick);
        let felt = world.plant.pressed();
        WristForce {
            header: Header::default(),
            force_n: array::from_fn(|i| felt[i] + noise[i] * self.options.wrist_noise_n),
            torque_nm: array::from_fn(|i| felt[3 + i] + noise[3 + i] * self.options.wrist_noise_nm),
        }
    }

    /// Takes up the faults that concern `tick`, before its sample.
    fn apply_faults(&self, world: &mut World<N>, tick: u64, faults: &[ScheduledFault]) {
        let q = &world.plant.state().q;
        let reading = self.encoders.read(tick, q);
        let acted = joints(&world.own.acted);
        world.hardware_faults.begin(faults, &reading, &acted);
        let read = world.hardware_faults.read(tick, &reading);
        world.own.contradicted = (!self.encoders.agrees(&read, q)).into();
    }

    /// The joint torques of what pushes the hand, N·m.
    fn pushed(&self, world: &World<N>) -> SVector<f64, N> {
        let t_s = world.own.ticks as f64 * self.dt_s;
        let lasts = |push: &&Push| (push.at_s..push.at_s + push.for_s).contains(&t_s);
        let now = self.options.push.iter().filter(lasts);
        now.fold(SVector::zeros(), |sum, push| {
            let F = stack(&push.force_n.into(), &push.torque_nm.into());
            let plant = &world.plant;
            sum + plant.model().jacobian(&plant.state().q).transpose() * F
        })
    }

    /// Advances one tick under `command` (`None`: none came); its header gives its age.
    fn advance(&self, world: &mut World<N>, command: Option<&TorqueCommand>) {
        let tau = command.map(|command| embedded::<N>(&command.tau[..self.dof]));
        let ticks = world.own.ticks;
        let age = command.map_or(0, |command| ticks.saturating_sub(command.header.tick));
        let x = world.plant.state();
        match (world.own.contradicted, &tau) {
            (1, Some(_)) => world.drive.refuse(&x.q, &x.qdot),
            (_, tau) => world.drive.answer(
                &x.q,
                &x.qdot,
                tau.as_ref(),
                u32::try_from(age).unwrap_or(u32::MAX),
            ),
        };
        let effort = world.plant.model().effort();
        let acting = world
            .hardware_faults
            .act(&world.drive.tau(), &x.qdot, effort);
        world.own.acted = padded(&acting);
        if world.drive.is_braked() {
            world.plant.hold();
        } else if world.plant.step(&(acting + self.pushed(world))).is_err() {
            world.drive.brake(DRIVE_DIVERGED);
            world.plant.hold();
            world.own.diverged = 1;
        }
        world.end.take(command.map(|command| command.phase));
        world.own.ticks += 1;
    }
}

impl<const N: usize> World<N> {
    /// Whether the simulation is over: the task is done; or the controller refused to continue, 2 s
    /// ago; or the motion is no longer finite; or the run is 20 times as long as planned, or as
    /// long as the interrupted run that it repeats.
    fn is_over(&self) -> bool {
        self.own.diverged == 1 || self.end.is_over(self.own.ticks)
    }
}

impl<const N: usize> Snapshot for World<N> {
    fn layout(&self) -> u64 {
        PlantCheckpoint::layout_hash()
    }

    fn write(&self, out: &mut Vec<u8>) {
        let begin = out.len();
        out.resize(begin + size_of::<PlantCheckpoint>(), 0);
        let stuck = self.hardware_faults.save(out);
        let mut checkpoint = self.own;
        [checkpoint.stuck_reading, checkpoint.stuck_torque] =
            stuck.map(|values| padded(&SVector::from(values)));
        (checkpoint.phase, checkpoint.refused_ticks) = self.end.saved();
        checkpoint.drives = *self.drive.state();
        self.plant.save(&mut checkpoint);
        out[begin..][..size_of::<PlantCheckpoint>()].copy_from_slice(bytes_of(&checkpoint));
    }

    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        let parts = from.split_at_checked(size_of::<PlantCheckpoint>());
        let (checkpoint, faults) = parts.ok_or(Damaged::Content)?;
        let checkpoint: PlantCheckpoint = pod_read_unaligned(checkpoint);
        let stuck = [checkpoint.stuck_reading, checkpoint.stuck_torque];
        let stuck = stuck.map(|values| joints::<N>(&values).into());
        if !self.hardware_faults.restore(faults, stuck) {
            return Err(Damaged::Content);
        }
        self.plant.restore(&checkpoint);
        self.drive.restore(&checkpoint.drives);
        (self.end).resume(checkpoint.phase, checkpoint.refused_ticks);
        self.own = checkpoint;
        Ok(())
    }
}

impl<const N: usize> Process for Cycle<N> {
    type State = World<N>;
    const READS: &'static [Port] = &[Port::of::<TorqueCommand>()];
    const WRITES: &'static [Port] = &[
        Port::of::<SensorSample>(),
        Port::of::<PlantState>(),
        Port::optional::<WristForce>(),
    ];

    /// The torque of the tick before acts until this tick, at which the sensors are read.
    fn step(&self, world: &mut World<N>, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        if inputs.tick.is_multiple_of(CUT_TICKS) {
            world.plant.forget();
        }
        if inputs.tick > 0 {
            self.advance(world, inputs.get());
            if world.is_over() {
                return Flow::Over;
            }
        }
        if !inputs.faults.is_empty() || world.hardware_faults.is_any() {
            self.apply_faults(world, inputs.tick, inputs.faults);
            // Its torque will be refused.
            outputs.has_noticed = world.own.contradicted == 1;
        }
        if let (Some(sample), Some(truth)) = (outputs.place(), outputs.place()) {
            self.sample(world, inputs.tick, sample, truth);
        }
        if let Some(wrist) = outputs.place() {
            *wrist = self.feel(world, inputs.tick);
        }
        Flow::Go
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::MAX_DOF;
    use shared_types::codes::{
        DRIVE_ACTIVE, DRIVE_BRAKED, DRIVE_ENCODER, DRIVE_STOPPING, PHASE_DONE, PHASE_REFUSED,
        PHASE_RUNNING,
    };
    use shared_types::fault::{Fault, Kind, Target, Way};
    use shared_types::process::Role;
    use shared_types::scenario::{Segment, Start};
    use shared_types::wire::Part;
    use std::sync::LazyLock;

    fn scenario() -> Scenario {
        let name = "fig5-wrist-rotation";
        let mut scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap();
        scenario.start = Start {
            posture: Some("nominal".into()),
            ..Start::default()
        };
        scenario.segment = vec![Segment {
            duration_s: 0.1,
            ..Segment::default()
        }];
        scenario.settle_s = 0.05;
        scenario
    }

    static ROBOT: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("puma560").unwrap());
    static ARM: LazyLock<Model<6>> = LazyLock::new(|| Model::new(&ROBOT, None).unwrap());

    /// A plant with its world.
    struct Simulated(Cycle<6>, World<6>);

    impl Simulated {
        fn step(&mut self, command: Option<&TorqueCommand>) {
            self.0.advance(&mut self.1, command);
        }
        fn apply_faults(&mut self, tick: u64, faults: &[ScheduledFault]) {
            self.0.apply_faults(&mut self.1, tick, faults);
        }
    }

    fn cycle(scenario: &Scenario) -> Simulated {
        let (cycle, world) = Cycle::new(&ROBOT, scenario).unwrap();
        Simulated(cycle, world)
    }

    fn joints(values: &[f64; MAX_DOF]) -> SVector<f64, 6> {
        model::joints(values)
    }

    fn sampled(Simulated(cycle, world): &Simulated, tick: u64) -> (SensorSample, PlantState) {
        let (mut sample, mut truth) = <(SensorSample, PlantState)>::default();
        cycle.sample(world, tick, &mut sample, &mut truth);
        assert!(sample.is_finite() && truth.is_finite());
        truth.header.tick = tick;
        (sample, truth)
    }

    /// Gravity compensation plus `extra`.
    fn command(truth: &PlantState, extra: [f64; 6]) -> TorqueCommand {
        let tau = ARM.bias(&joints(&truth.q), &joints(&truth.qdot)) + SVector::from(extra);
        TorqueCommand {
            header: truth.header,
            tau: padded(&tau),
            ..TorqueCommand::default()
        }
    }

    #[test]
    fn a_push_moves_the_hand_while_it_lasts() {
        let scenario = scenario();
        let mut with_push = scenario.clone();
        with_push.plant.push = vec![Push {
            at_s: 0.1,
            for_s: 0.05,
            force_n: [20.0, 0.0, 0.0],
            torque_nm: [0.0, 0.0, 2.0],
        }];
        let (mut pushed, mut unpushed) = (cycle(&with_push), cycle(&scenario));
        let mut impulse = SVector::<f64, 6>::zeros();
        for tick in 0..=150 {
            let (_, truth) = sampled(&pushed, tick);
            let (_, other) = sampled(&unpushed, tick);
            if tick <= 100 {
                assert_eq!(truth, other, "nothing pushes at tick {tick}");
            } else {
                let q = joints(&other.q);
                let F = stack(&[20.0, 0.0, 0.0].into(), &[0.0, 0.0, 2.0].into());
                impulse += ARM.jacobian(&q).transpose() * F * 1e-3;
            }
            pushed.step(Some(&command(&truth, [0.0; 6])));
            unpushed.step(Some(&command(&other, [0.0; 6])));
        }
        // A·q̇ is what the push has given, while the arm has hardly moved.
        let (truth, other) = (sampled(&pushed, 151).1, sampled(&unpushed, 151).1);
        let by = joints(&truth.qdot) - joints(&other.qdot);
        let given = ARM.mass_matrix(&joints(&truth.q)) * by;
        assert!(
            (given - impulse).norm() < 0.05 * impulse.norm(),
            "{given} {impulse}"
        );
    }

    #[test]
    fn the_messages_say_what_the_arm_does() {
        let mut cycle = cycle(&scenario());
        for tick in 0..500 {
            let (_, truth) = sampled(&cycle, tick);
            cycle.step(Some(&command(&truth, [10.0, -5.0, 3.0, 1.0, 0.5, 0.2])));
        }
        let (sample, truth) = sampled(&cycle, 500);
        let off = (joints(&sample.q_encoder) - joints(&truth.q)).amax();
        let count = std::f64::consts::TAU / 65536.0;
        assert!(
            off > 0.0 && off < 6.0 * count,
            "encoders read the truth, but not exactly"
        );
        assert_eq!(sample.tau_drive, truth.tau);
        assert!(truth.qdot[0] > 0.1 && truth.V_BE[..3].iter().any(|v| v.abs() > 0.01));
        // The twist is the pose's rate.
        cycle.step(Some(&command(&truth, [0.0; 6])));
        let (_, next) = sampled(&cycle, 501);
        for i in 0..3 {
            let mean = 0.5 * (truth.V_BE[i] + next.V_BE[i]);
            assert!(((next.p_BE[i] - truth.p_BE[i]) * 1000.0 - mean).abs() < 1e-5);
        }
        let (q, qdot) = (joints(&next.q), joints(&next.qdot));
        let mechanical = ARM.kinetic_energy(&q, &qdot) + ARM.potential_energy(&q);
        assert!((next.energy_j - mechanical).abs() < 1e-12);
        assert_eq!(
            (&truth.q[6..], &truth.tau[6..]),
            (&[0.0; 2][..], &[0.0; 2][..])
        );
    }

    #[test]
    fn a_torque_computed_from_an_encoder_that_is_stuck_is_refused_until_it_reads_the_joint_again() {
        let mut cycle = cycle(&scenario());
        let fault = Fault {
            way: Some(Way::Stuck),
            joint: Some(1),
            at_tick: Some(200),
            for_ticks: Some(500),
            ..Fault::new("plant", Kind::Sensor)
        };
        let target = Target::sending::<SensorSample>(0, Role::World);
        let stuck = [fault.schedule(&target, 1000, 1).unwrap()];
        let (mut refused, mut stopped) = (0, 0);
        for tick in 0..900 {
            let in_force = if (200..700).contains(&tick) {
                &stuck[..]
            } else {
                &[]
            };
            cycle.apply_faults(tick, in_force);
            let (sample, truth) = sampled(&cycle, tick);
            let error = (sample.q_encoder[0] - truth.q[0]).abs();
            assert!(
                error < 0.2,
                "the arm is stopped at tick {tick}, {error} rad on"
            );
            assert_eq!(cycle.1.own.contradicted == 1, error > 0.03, "tick {tick}");
            // From when it is stuck on, as much torque as joint 1 has, in the direction of the motion.
            let push = match tick {
                0..200 => 10.0,
                200..700 => 97.6,
                _ => 0.0,
            };
            cycle.step(Some(&command(&truth, [push, 0.0, 0.0, 0.0, 0.0, 0.0])));
            let next = sampled(&cycle, tick + 1).1;
            refused += u32::from(next.drive_flags & DRIVE_ENCODER != 0);
            stopped += u32::from(matches!(next.drive, DRIVE_STOPPING | DRIVE_BRAKED));
        }
        assert!(
            refused > 400 && stopped > 400,
            "{refused} refused, {stopped} stopped"
        );
        assert_eq!(sampled(&cycle, 900).1.drive, DRIVE_ACTIVE);
    }

    #[test]
    fn it_is_over_when_done_or_refused_or_far_too_long() {
        let ticks = |phase: u32, most: u64| {
            let mut cycle = cycle(&scenario());
            (1..=most).find(|_| {
                let (_, truth) = sampled(&cycle, 0);
                let command = command(&truth, [0.0; 6]);
                cycle.step(Some(&TorqueCommand { phase, ..command }));
                cycle.1.is_over()
            })
        };
        assert_eq!(ticks(PHASE_DONE, 10), Some(1));
        assert_eq!(ticks(PHASE_REFUSED, 3000), Some(2001));
        let longest = f64::from(TaskEnd::LONGEST) * scenario().duration_s() * 1000.0;
        assert_eq!(ticks(PHASE_RUNNING, 4000), Some(longest.round() as u64));
    }
}
