//! The estimator's pure step: encoder samples to positions, velocities and unexplained torque.

use crate::disturbance::{Disturbance, Unexplained};
use model::{LastTerms, Model, ModelError, Robot, Terms, joints, padded, stack};
use nalgebra::SVector;
use process::{Damaged, Flow, Inputs, Outputs, Port, Process, Scratch, Snapshot};
use shared_types::codes::DRIVE_BRAKED;
use shared_types::scenario::Scenario;
use shared_types::{EstimatorCheckpoint, Header, MAX_DOF, SensorSample, StateEstimate, WristForce};

/// A predictor–corrector observer per joint with the arm's own dynamics as its predictor.
///
/// Between two samples the state follows the model under the torque that the drives report; the encoder then corrects
/// position and velocity with the constant gains g, h of a fading-memory filter (Brookner 1998, *Tracking and Kalman Filtering Made
/// Easy*, §1.4), so that the error dynamics have the discrete poles θ, θ:
///
/// (z − θ)² = (z − 1)² + g(z − 1) + h z, θ = exp(−bandwidth·T)
///
/// A difference of encoder readings would carry their noise times 1/T; this filter carries it times about bandwidth^1.5 √(T/4).
///
/// [`Disturbance`] covers motion that the model leaves unexplained, if it exceeds the encoders'
/// noise.
///
/// A few missing samples are predicted over. After a longer gap position and velocity begin anew, from two samples. A reading that no motion
/// within the speed limits explains is set aside, for as long as it can be a disturbance of the line and not the arm; then its joint begins
/// anew where it says, as fast as it has moved meanwhile: a jump is no motion, and nothing learns from it. A state that is no arm's (a reading or a
/// torque far out of range has led there) is given up, and the next one begins at the sample, at rest.
#[derive(Clone, Debug)]
pub(crate) struct Cycle<const N: usize> {
    model: Model<N>,
    T: f64,
    gains: Gains,
    disturbance: Disturbance,
    /// The largest innovation accepted per tick; rad.
    gate: SVector<f64, N>,
}

/// Missing samples that the model predicts over.
const MOST_PREDICTED: u64 = 5;

/// A reading is accepted within what so many times the speed limit explains, and in any case within [`ACCEPTED`].
const GATE: f64 = 10.0;

/// rad.
const ACCEPTED: f64 = 0.02;

/// Ticks for which an outlier is set aside; after them the filter begins anew at the reading.
const PATIENCE: u32 = 20;

/// No arm is faster than this: the model's own terms grow with its square, and beyond it they soon leave the finite numbers; rad/s.
const ABSURD: f64 = 1e6;

/// The estimate behind a tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<const N: usize> {
    tick: u64,
    /// Ticks since the last beginning, that one counted and those without a sample, too; 0 before the first sample.
    ticks: u32,
    /// Ticks since the first of the readings set aside in a row, that one counted, per joint.
    rejected_ticks: [u32; N],
    /// That reading, rad.
    rejected_reading: SVector<f64, N>,
    q: SVector<f64, N>,
    qdot: SVector<f64, N>,
    /// Acceleration that the model does not explain.
    unexplained: Unexplained<N>,
}

impl<const N: usize> State<N> {
    /// Before the first sample.
    pub(crate) fn unknown() -> Self {
        Self::begin(0, SVector::zeros())
    }

    /// Only the position is known.
    fn begin(tick: u64, q: SVector<f64, N>) -> Self {
        Self {
            tick,
            ticks: 0,
            rejected_ticks: [0; N],
            rejected_reading: q,
            q,
            qdot: SVector::zeros(),
            unexplained: Unexplained::none(),
        }
    }

    /// Whether an arm can move so.
    fn is_an_arms(&self) -> bool {
        self.qdot.iter().all(|x| x.abs() <= ABSURD) && self.unexplained.is_finite()
    }

    /// Ticks since the last sample.
    fn elapsed(&self, tick: u64) -> f64 {
        match self.ticks {
            0 => 1.0,
            _ => tick.saturating_sub(self.tick).max(1) as f64,
        }
    }

    /// Whether a reading of the last sample was set aside.
    fn rejects(&self) -> bool {
        self.rejected_ticks.iter().any(|ticks| *ticks > 0)
    }
}

#[derive(Clone, Copy, Debug)]
struct Gains {
    g: f64,
    h: f64,
}

impl Gains {
    /// Gains that place the error poles at θ, θ.
    fn place(theta: f64) -> Self {
        let g = 1.0 - theta * theta;
        Self {
            g,
            h: 3.0 - 2.0 * theta - 1.0 - g,
        }
    }
}

impl<const N: usize> Cycle<N> {
    /// An estimator for `robot` as `scenario` tunes it; its first sample sets the state, at rest.
    ///
    /// # Errors
    /// [`ModelError`] if the robot does not have `N` joints.
    pub(crate) fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, ModelError> {
        let T = scenario.dt_s();
        let model = Model::<N>::new(robot, scenario.frame())?;
        Ok(Self {
            gate: model
                .velocity()
                .map(|limit| (GATE * limit * T).max(ACCEPTED)),
            model,
            T,
            gains: Gains::place(libm::exp(-scenario.estimator.bandwidth * T)),
            disturbance: Disturbance::new(scenario),
        })
    }
}

impl<const N: usize> Snapshot for State<N> {
    fn layout(&self) -> u64 {
        EstimatorCheckpoint::default().layout()
    }

    fn write(&self, out: &mut Vec<u8>) {
        let checkpoint = EstimatorCheckpoint {
            tick: self.tick,
            q: padded(&self.q),
            qdot: padded(&self.qdot),
            disturbance: padded(&self.unexplained.d),
            disturbance_slow: padded(&self.unexplained.slow),
            disturbance_presence: padded(&self.unexplained.presence),
            rejected_reading: padded(&self.rejected_reading),
            rejected_ticks: std::array::from_fn(|i| *self.rejected_ticks.get(i).unwrap_or(&0)),
            samples: self.ticks,
            reserved: 0,
        };
        checkpoint.write(out);
    }

    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        let mut checkpoint = EstimatorCheckpoint::default();
        checkpoint.read(from)?;
        *self = Self {
            tick: checkpoint.tick,
            ticks: checkpoint.samples,
            rejected_ticks: std::array::from_fn(|i| checkpoint.rejected_ticks[i]),
            rejected_reading: joints(&checkpoint.rejected_reading),
            q: joints(&checkpoint.q),
            qdot: joints(&checkpoint.qdot),
            unexplained: Unexplained {
                d: joints(&checkpoint.disturbance),
                slow: joints(&checkpoint.disturbance_slow),
                presence: joints(&checkpoint.disturbance_presence),
            },
        };
        Ok(())
    }
}

impl<const N: usize> Process for Cycle<N> {
    type State = State<N>;
    const READS: &'static [Port] = &[Port::of::<SensorSample>(), Port::optional::<WristForce>()];
    const WRITES: &'static [Port] = &[Port::of::<StateEstimate>()];

    fn step(&self, known: &mut State<N>, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        if let (Some(sample), Some(out)) = (inputs.get(), outputs.place()) {
            self.estimate(known, sample, inputs.get(), out, outputs.scratch);
            outputs.has_noticed = known.rejects();
        }
        Flow::Go
    }
}

/// The torque that moves the arm: the drives', and that of the contact which the wrist's sensor feels, N·m.
fn driving<const N: usize>(
    terms: &Terms<N>,
    sample: &SensorSample,
    wrist: Option<&WristForce>,
) -> SVector<f64, N> {
    let tau = joints(&sample.tau_drive);
    wrist.map_or(tau, |wrist| {
        let F = stack(&wrist.force_n.into(), &wrist.torque_nm.into());
        tau + terms.J.tr_mul(&F)
    })
}

impl<const N: usize> Cycle<N> {
    /// The estimate at the sample's tick. The model's terms of it are left in `scratch`.
    fn estimate(
        &self,
        known: &mut State<N>,
        sample: &SensorSample,
        wrist: Option<&WristForce>,
        out: &mut StateEstimate,
        scratch: &mut Scratch,
    ) {
        let last = scratch.of(|| LastTerms::of(&self.model));
        let mut measured = joints::<N>(&sample.q_encoder);
        let tick = sample.header.tick;
        let elapsed = known.elapsed(tick) * self.T;
        let mut predicted = match known.ticks {
            0 => self.standing(last, sample, wrist, measured),
            _ => self.reach(known, last, sample, wrist, &measured),
        };
        (predicted.tick, predicted.ticks) = (tick, predicted.ticks.saturating_add(1));
        for i in 0..N {
            self.weigh(i, &mut measured[i], &mut predicted);
        }
        let mut innovation = measured - predicted.q;
        let Gains { g, h } = self.gains;
        let mut state = State {
            q: predicted.q + innovation * g,
            qdot: predicted.qdot + innovation * (h / self.T),
            unexplained: self.disturbance.learned(
                &predicted.unexplained,
                &(innovation * (h / (self.T * elapsed))),
                elapsed,
                f64::from(predicted.ticks) * self.T,
            ),
            ..predicted
        };
        let terms = last.at(&self.model, &state.q, &state.qdot);
        let d = state.unexplained.explained();
        let found = (d.amax() != 0.0).then(|| terms.A * d);
        let mut tau_disturbance = found.unwrap_or_else(SVector::zeros);
        let numbers = [&state.q, &innovation, &tau_disturbance];
        let is_an_arms = state.is_an_arms() && numbers.into_iter().flatten().all(|x| x.is_finite());
        if !is_an_arms {
            state = State {
                ticks: 1,
                ..State::begin(tick, joints(&sample.q_encoder))
            };
            (innovation, tau_disturbance) = (SVector::zeros(), SVector::zeros());
        }
        *known = state;
        *out = StateEstimate {
            header: Header::default(),
            q: padded(&state.q),
            qdot: padded(&state.qdot),
            tau_disturbance: padded(&tau_disturbance),
            innovation: padded(&innovation),
            drive: sample.drive,
            stale_ticks: sample.stale_ticks,
        };
    }

    /// The arm before it moves: what its drives carry beyond the model's gravity is a load.
    fn standing(
        &self,
        last: &mut LastTerms<N>,
        sample: &SensorSample,
        wrist: Option<&WristForce>,
        measured: SVector<f64, N>,
    ) -> State<N> {
        let tick = sample.header.tick;
        let mut state = State::begin(tick, measured);
        // A plant that reports no torque carries the arm by other means.
        if tick == 0 && sample.tau_drive != [0.0; MAX_DOF] {
            let terms = last.at(&self.model, &measured, &state.qdot);
            let tau = driving(terms, sample, wrist);
            let is_seen = |joint: usize| {
                let share = (tau - terms.gravity)[joint].abs() / self.model.effort()[joint];
                share > self.disturbance.seen_at_rest
            };
            if (0..N).any(is_seen) {
                state.unexplained = Unexplained::since_ever(-terms.qddot(&tau));
            }
        }
        state
    }

    /// Decides whether a joint's reading is accepted; the prediction stands in for one that is set aside.
    fn weigh(&self, joint: usize, measured: &mut f64, predicted: &mut State<N>) {
        let rejected = predicted.rejected_ticks[joint];
        if (*measured - predicted.q[joint]).abs() <= self.gate[joint] {
            predicted.rejected_ticks[joint] = 0;
        } else if rejected < PATIENCE {
            if rejected == 0 {
                predicted.rejected_reading[joint] = *measured;
            }
            predicted.rejected_ticks[joint] = rejected + 1;
            *measured = predicted.q[joint];
        } else {
            let (mean, limit) = (
                (*measured - predicted.rejected_reading[joint]) / (f64::from(rejected) * self.T),
                self.model.velocity()[joint],
            );
            predicted.rejected_ticks[joint] = 0;
            predicted.q[joint] = *measured;
            predicted.qdot[joint] = if mean.abs() <= limit { mean } else { 0.0 };
            predicted.unexplained.forget(joint);
        }
    }

    /// The state at `tick` before its sample is taken in.
    fn reach(
        &self,
        state: &State<N>,
        last: &mut LastTerms<N>,
        sample: &SensorSample,
        wrist: Option<&WristForce>,
        measured: &SVector<f64, N>,
    ) -> State<N> {
        let (tick, drive) = (sample.header.tick, sample.drive);
        let gap = tick.saturating_sub(state.tick).max(1);
        if gap > MOST_PREDICTED {
            // Long out of sight: where it is is known, and how far it has come; how fast it is the next sample tells.
            let mean = (measured - state.q) / (gap as f64 * self.T);
            let qdot = if drive == DRIVE_BRAKED {
                SVector::zeros()
            } else {
                mean
            };
            return State {
                ticks: 0,
                rejected_ticks: [0; N],
                q: *measured,
                qdot,
                ..*state
            };
        }
        // A tick without a sample is time that passes, too.
        let missed = (gap - 1) as u32;
        let state = &State {
            ticks: state.ticks.saturating_add(missed),
            rejected_ticks: state.rejected_ticks.map(|ticks| match ticks {
                0 => 0,
                ticks => ticks.saturating_add(missed),
            }),
            ..*state
        };
        if drive == DRIVE_BRAKED {
            return State {
                qdot: SVector::zeros(),
                ..*state
            };
        }
        if state.ticks == 1 && gap == 1 && state.tick > 0 {
            return State {
                q: *measured,
                qdot: (measured - state.q) / self.T,
                ..*state
            };
        }
        let terms = last.at(&self.model, &state.q, &state.qdot);
        let tau = &driving(terms, sample, wrist);
        let first = self.predict(state, terms.qddot(tau), tau);
        (1..gap).fold(first, |state, _| {
            self.predict(
                &state,
                self.model.forward_dynamics(&state.q, &state.qdot, tau),
                tau,
            )
        })
    }

    /// One tick ahead under constant torque, from a state whose acceleration is `qddot` by the model: the midpoint rule, second order in T like the
    /// truth's own variation within a tick.
    fn predict(&self, state: &State<N>, qddot: SVector<f64, N>, tau: &SVector<f64, N>) -> State<N> {
        let T = self.T;
        let d = state.unexplained.explained();
        let half = qddot + d;
        let q_mid = state.q + state.qdot * (T / 2.0);
        let qdot_mid = state.qdot + half * (T / 2.0);
        let qddot = self.model.forward_dynamics(&q_mid, &qdot_mid, tau) + d;
        State {
            q: state.q + state.qdot * T + qddot * (T * T / 2.0),
            qdot: state.qdot + qddot * T,
            ..*state
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::wire::Part;
    use std::sync::LazyLock;

    fn scenario(bandwidth: f64, disturbance: f64) -> Scenario {
        let text = format!(
            "name='t'\nrobot='puma560'\nstart.posture='ready'\nsegment=[{{duration_s=1.0}}]\n[estimator]\nbandwidth={bandwidth}\ndisturbance_bandwidth={disturbance}"
        );
        Scenario::parse("test", &text, &[]).unwrap()
    }

    static ROBOT: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("puma560").unwrap());
    static ARM: LazyLock<Model<6>> = LazyLock::new(|| Model::new(&ROBOT, None).unwrap());

    type Joints = SVector<f64, 6>;

    const PLACE: Joints = Joints::new(0.1, -1.2, 1.9, 0.2, 0.5, 0.3);

    /// An estimator with what it knows.
    #[derive(Debug)]
    struct Estimator {
        cycle: Cycle<6>,
        known: State<6>,
        scratch: Scratch,
    }

    fn estimator(bandwidth: f64, disturbance: f64) -> Estimator {
        Estimator {
            cycle: Cycle::new(&ROBOT, &scenario(bandwidth, disturbance)).unwrap(),
            known: State::unknown(),
            scratch: Scratch::default(),
        }
    }

    fn sample(tick: u64, q: &Joints, tau: &Joints) -> SensorSample {
        let mut sample = SensorSample {
            q_encoder: padded(q),
            tau_drive: padded(tau),
            ..Default::default()
        };
        sample.header.tick = tick;
        sample
    }

    fn step(estimator: &mut Estimator, sample: &SensorSample) -> StateEstimate {
        let mut estimate = StateEstimate::default();
        let Estimator {
            cycle,
            known,
            scratch,
        } = estimator;
        cycle.estimate(known, sample, None, &mut estimate, scratch);
        assert!(estimate.is_finite(), "{estimate:?}");
        estimate
    }

    #[test]
    fn gains_place_the_poles() {
        for theta in [0.74, 0.5, 0.8] {
            let Gains { g, h } = Gains::place(theta);
            for z in [0.1, 0.3, 0.77, 1.3f64] {
                let placed = (z - theta).powi(2);
                let actual = (z - 1.0).powi(2) + g * (z - 1.0) + h * z;
                assert!((placed - actual).abs() < 1e-14, "θ {theta} z {z}");
            }
        }
    }

    /// The arm falls under a constant torque, of which joint 4 has `unknown` N·m that the model does not know; the worst velocity (rad/s), and the
    /// disturbance of joint 4 (N·m), from rounded positions, one sample in `every`.
    fn follow(disturbance_bandwidth: f64, unknown: f64, every: u64) -> (f64, f64) {
        let mut estimator = estimator(150.0, disturbance_bandwidth);
        let (mut q, mut qdot, T) = (PLACE, Joints::zeros(), 1e-3);
        let hold = ARM.gravity(&q);
        let mut tau = hold;
        tau[3] += unknown;
        let (mut worst, mut found) = (0.0_f64, 0.0);
        for tick in 0..500 {
            if tick % every == 0 {
                let counts = 65536.0 / std::f64::consts::TAU;
                let rounded = q.map(|x| (x * counts).round() / counts);
                let estimate = step(&mut estimator, &sample(tick, &rounded, &hold));
                found = estimate.tau_disturbance[3];
                if tick > 100 {
                    worst = worst.max((joints(&estimate.qdot) - qdot).amax());
                }
            }
            for _ in 0..20 {
                qdot += ARM.forward_dynamics(&q, &qdot, &tau) * (T / 20.0);
                q += qdot * (T / 20.0);
            }
        }
        (worst, found)
    }

    #[test]
    fn velocity_is_an_order_better_than_a_difference_and_an_unknown_torque_is_found() {
        let (worst, _) = follow(0.0, 0.0, 1);
        let difference = std::f64::consts::TAU / 65536.0 / 1e-3;
        assert!(worst < 0.1 * difference, "{worst} rad/s of {difference}");
        let (worst, _) = follow(50.0, 0.3, 1);
        assert!(worst < 0.02, "{worst} rad/s");
        // Dropped samples hardly change it.
        for (every, most) in [(1, 0.02), (2, 0.03), (3, 0.03)] {
            let (_, found) = follow(50.0, 0.3, every);
            let off = (found - 0.3).abs();
            assert!(off < most, "every {every}: {found} N·m of 0.3");
        }
    }

    #[test]
    fn what_the_drives_carry_at_rest_is_known_at_once() {
        let weight = Joints::new(0.0, -20.0, 5.0, 0.0, 1.0, 0.0);
        let found = |tick: u64, share: f64, is_reported: bool| {
            let tau = ARM.gravity(&PLACE) - weight * share;
            let tau = if is_reported { tau } else { Joints::zeros() };
            let estimate = step(&mut estimator(150.0, 60.0), &sample(tick, &PLACE, &tau));
            joints::<6>(&estimate.tau_disturbance)
        };
        let off = (found(0, 1.0, true) - weight).amax();
        assert!(off < 1e-9, "{off} N·m off");
        // Less than the encoders' noise explains, an arm that has moved, and a plant that reports no torque.
        for (tick, share, is_reported) in [(0, 1e-3, true), (5, 1.0, true), (0, 1.0, false)] {
            assert_eq!(found(tick, share, is_reported), Joints::zeros());
        }
    }

    #[test]
    fn a_reading_that_jumps_for_a_while_is_no_motion() {
        let gravity = ARM.gravity(&PLACE);
        for (bandwidth, jump) in [(0.0, 1000.0), (60.0, 1000.0), (60.0, 0.3), (0.0, -0.3)] {
            let mut estimator = estimator(150.0, bandwidth);
            for tick in 0..300_u64 {
                let mut q = PLACE;
                q[0] += 0.5e-3 * tick as f64;
                let mut reading = q;
                if (50..150).contains(&tick) {
                    reading[0] += jump;
                }
                let estimate = step(&mut estimator, &sample(tick, &reading, &gravity));
                if tick < 40 {
                    continue;
                }
                let what = format!("jump {jump}, tick {tick}");
                assert!(joints::<6>(&estimate.qdot).amax() < 0.7, "{what}");
                let since = |begin: u64| (begin..begin + u64::from(PATIENCE)).contains(&tick);
                assert_eq!(estimator.known.rejects(), since(50) || since(150), "{what}");
                let is_back = !(48..175).contains(&tick);
                assert!(!is_back || (estimate.q[0] - q[0]).abs() < 1e-3, "{what}");
            }
        }
    }

    #[test]
    fn a_tick_without_a_sample_is_time_that_passes() {
        let gravity = ARM.gravity(&PLACE);
        for every in [1, 2, 4] {
            // A reading jumps, and moves on from there at 0.5 rad/s; the filter begins anew at that speed.
            let mut estimator = estimator(150.0, 60.0);
            let begun = (0..400_u64)
                .filter(|tick| tick % every == 0)
                .map(|tick| {
                    let mut reading = PLACE;
                    if tick >= 100 {
                        reading[0] += 1.0 + 0.5e-3 * (tick - 100) as f64;
                    }
                    (
                        tick,
                        step(&mut estimator, &sample(tick, &reading, &gravity)),
                    )
                })
                .find(|(_, estimate)| estimate.q[0] > PLACE[0] + 0.5);
            let (tick, estimate) = begun.unwrap();
            assert!((120..=124).contains(&tick), "every {every}: tick {tick}");
            let rate = estimate.qdot[0];
            assert!((rate - 0.5).abs() < 1e-6, "every {every}: {rate} rad/s");
        }
    }

    fn spoil(known: &mut State<6>, with: &EstimatorCheckpoint) {
        known.read(bytemuck::bytes_of(with)).unwrap();
    }

    #[test]
    fn a_sample_far_out_of_range_is_answered_with_numbers_and_forgotten() {
        // A reading, a reported torque, and what a predecessor left: each as large as a number can be.
        for (disturbance, what) in [(0.0, 0), (0.0, 1), (60.0, 2), (60.0, 0)] {
            let mut estimator = estimator(150.0, disturbance);
            for tick in 0..80 {
                let (mut q, mut tau) = (PLACE, Joints::zeros());
                if (10..40).contains(&tick) {
                    let huge = if tick % 2 == 0 { 1e308 } else { -1e308 };
                    match what {
                        0 => q[1] = huge,
                        1 => tau[2] = huge,
                        _ => spoil(
                            &mut estimator.known,
                            &EstimatorCheckpoint {
                                tick,
                                q: padded(&PLACE),
                                qdot: [huge; 8],
                                disturbance: [-huge; 8],
                                samples: 2,
                                ..Default::default()
                            },
                        ),
                    }
                }
                let estimate = step(&mut estimator, &sample(tick, &q, &tau));
                let error = (joints(&estimate.q) - PLACE).amax();
                assert!(
                    tick < 65 || error < 0.01,
                    "{what}, tick {tick}: {error} rad"
                );
            }
        }
    }
}
