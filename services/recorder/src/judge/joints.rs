//! Loads of the joints, and the limits that they reach.

use control::GroundTruth;
use hdrhistogram::Histogram;
use model::{JointKind, Robot};
use shared_types::SingularityState;
use shared_types::bounds::{larger, share, within};
use shared_types::codes::{
    DRIVE_ACTIVE, DRIVE_RATE, DRIVE_SPEED, PHASE_REFUSED, REFUSAL_LIMIT, REFUSAL_UNLISTED,
};
use shared_types::summary::{JointSummary, LimitSummary};

use super::chatter::{ChatterMeter, Clock};
use super::histogram::histogram;
use super::tick::Tick;

/// Torque steps are kept in millionths of the limit: a ratio of 1 is 1 000 000.
const STEP_UNIT: f64 = 1e6;
/// Larger steps than this many limits, which only a fault makes, count as it.
const STEP_MOST: f64 = 1e3;
/// Time over which the jump of a switch is taken back, s: the default velocity feedback's, 1/k_v.
const SWITCH_S: f64 = 0.025;
/// Ticks at the torque rate that cost nothing worth a word: less than the velocity feedback takes to answer.
const FREE_TICKS: u64 = 10;
/// How far a stop yields, rad (m).
const GIVE: f64 = 2e-3;
/// Share of a limit by which a command at the limit may be beyond it by rounding.
const ROUNDING: f64 = 1e-9;

/// The arm's limits: task axes, and one entry a joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// The task axes that the arm serves: errors on others are not its own.
    pub served: [bool; 6],
    /// Names.
    pub names: Vec<String>,
    /// Motion of the joints.
    pub kinds: Vec<JointKind>,
    /// Lower position limits, rad (m for a sliding joint).
    pub lower: Vec<f64>,
    /// Upper ones.
    pub upper: Vec<f64>,
    /// N·m.
    pub effort: Vec<f64>,
    /// rad/s.
    pub velocity: Vec<f64>,
}

impl Limits {
    /// Whether a position lies beyond the limits of a joint, whatever the plant says of its stops: by more than a stop gives way. A NaN does.
    fn excludes(&self, joint: usize, q: f64) -> bool {
        !(self.lower[joint] - GIVE..=self.upper[joint] + GIVE).contains(&q)
    }

    /// Whether a torque is at its joint's limit. A NaN is.
    fn is_reached(&self, joint: usize, torque: f64) -> bool {
        !within(share(torque, self.effort[joint]), 1.0 - 1e-9)
    }

    /// Those of a robot.
    pub fn of(robot: &Robot) -> Self {
        let of = |value: fn(&model::Joint) -> f64| robot.joints.iter().map(value).collect();
        Self {
            served: robot.task.0,
            names: robot
                .joints
                .iter()
                .map(|joint| joint.name.clone())
                .collect(),
            kinds: robot.joints.iter().map(|joint| joint.kind).collect(),
            lower: of(|joint| joint.lower),
            upper: of(|joint| joint.upper),
            effort: of(|joint| joint.effort),
            velocity: of(|joint| joint.velocity),
        }
    }
}

/// Gathers the joints' loads tick by tick.
#[derive(Debug)]
pub(super) struct JointMeter {
    limits: Limits,
    summary: JointSummary,
    torque_steps: Histogram<u32>,
    last_tau: Option<Vec<f64>>,
    chatter: ChatterMeter,
    /// Posture of the arm when the controller refused to continue.
    refused: Option<String>,
    /// The first tick that the drives had the arm, and how many they had it; ticks without a torque, in between, are theirs.
    braked: Option<[u64; 2]>,
    last_tick: u64,
}

impl JointMeter {
    pub(super) fn new(limits: Limits) -> Self {
        Self {
            limits,
            summary: JointSummary::default(),
            torque_steps: histogram(),
            last_tau: None,
            chatter: ChatterMeter::default(),
            refused: None,
            braked: None,
            last_tick: 0,
        }
    }

    /// The task axes that the arm serves.
    pub(super) fn served(&self) -> &[bool; 6] {
        &self.limits.served
    }

    /// Number of joints.
    pub(super) fn count(&self) -> usize {
        self.limits.effort.len()
    }

    /// Takes in a tick with `switches` changes of mode; a limit that is reached for the first time goes into `events`.
    pub(super) fn tick(
        &mut self,
        tick: &Tick<'_>,
        truth: &dyn GroundTruth,
        clock: Clock,
        switches: usize,
        mut events: impl FnMut(String),
    ) {
        self.measure_switches(tick, switches);
        if let Some(last) = &self.last_tau {
            let tau = &tick.torque.tau[..self.limits.effort.len()];
            self.chatter
                .tick((last, tau), &self.limits.effort, truth, clock);
        }
        // The plant's word, or the position itself.
        let beyond = (0..self.count()).filter(|i| self.limits.excludes(*i, tick.truth.q[*i]));
        let stops = beyond.fold(tick.truth.limit_mask, |stops, i| stops | 1 << i);
        let k = tick.truth.header.tick;
        if tick.truth.drive != DRIVE_ACTIVE && k > 0 {
            let after_last = self.last_tau.as_ref().map_or(k, |_| self.last_tick + 1);
            let first = after_last.min(k);
            self.braked.get_or_insert([first, 0])[1] += k + 1 - first;
        }
        self.last_tick = k;
        self.measure_loads(tick, stops);
        if tick.torque.phase == PHASE_REFUSED && self.refused.is_none() {
            self.refused = self.place_of_refusal(tick);
            self.refused.iter().for_each(|text| events(text.clone()));
        }
        for i in 0..self.count() {
            self.watch_limits(tick, stops, i, &mut events);
        }
    }

    /// Numbers that belong to the reason of a refusal: the joint nearest to its limit on the way it moves, or the rank that is left.
    fn place_of_refusal(&self, tick: &Tick<'_>) -> Option<String> {
        let k = tick.truth.header.tick;
        match tick.control.refusal {
            REFUSAL_LIMIT => {
                let room = |i: usize| {
                    let q = tick.truth.q[i];
                    let qdot = tick.truth.qdot[i];
                    if qdot > 0.0 {
                        (self.limits.upper[i] - q, self.limits.upper[i])
                    } else {
                        (q - self.limits.lower[i], self.limits.lower[i])
                    }
                };
                let joint = (0..self.count()).min_by(|a, b| room(*a).0.total_cmp(&room(*b).0))?;
                let (left, limit) = room(joint);
                let name = &self.limits.names[joint];
                let kind = self.limits.kinds[joint];
                let [unit, _] = kind.units();
                Some(format!(
                    "{name} was {:.2}{unit} from its limit of {:.1}{unit} at tick {k}",
                    kind.shown(left),
                    kind.shown(limit)
                ))
            }
            REFUSAL_UNLISTED => {
                let is_inside = |s: &&SingularityState| s.inside != 0;
                let listed = tick.report.listed().iter().filter(is_inside).count();
                Some(format!(
                    "at tick {k} the Jacobian had rank {} with {listed} singularities listed",
                    tick.report.rank
                ))
            }
            _ => None,
        }
    }

    fn measure_loads(&mut self, tick: &Tick<'_>, stops: u32) {
        let n = self.count();
        let joints = &mut self.summary;
        let tau = &tick.torque.tau[..n];
        // A controller's word on its own torques counts for nothing, whichever way it errs.
        let mut is_at_limit = false;
        for (i, torque) in tau.iter().enumerate() {
            joints.speed_max_ratio = larger(
                joints.speed_max_ratio,
                share(tick.truth.qdot[i], self.limits.velocity[i]),
            );
            joints.torque_max_ratio = larger(
                joints.torque_max_ratio,
                share(tick.truth.tau[i], self.limits.effort[i]),
            );
            let commanded = share(*torque, self.limits.effort[i]);
            joints.torque_commanded_max_ratio =
                larger(joints.torque_commanded_max_ratio, commanded);
            is_at_limit |= self.limits.is_reached(i, *torque);
        }
        if let Some(last) = &self.last_tau {
            let step = (0..n).fold(0.0f64, |step, i| {
                larger(step, share(tau[i] - last[i], self.limits.effort[i]))
            });
            joints.torque_step_max_ratio = larger(joints.torque_step_max_ratio, step);
            self.torque_steps
                .saturating_record((step.min(STEP_MOST) * STEP_UNIT) as u64 + 1);
        } else {
            joints.q_start = tick.truth.q[..n].to_vec();
        }
        joints.q_end.clear();
        joints.q_end.extend_from_slice(&tick.truth.q[..n]);
        joints.stopped_ticks +=
            u64::from(stops != 0 || tick.truth.drive != DRIVE_ACTIVE && tick.truth.header.tick > 0);
        joints.saturated_ticks += u64::from(is_at_limit);
        joints.rate_limited_ticks += u64::from(tick.control.rate_mask != 0);
        joints.rejected_estimate_ticks += u64::from(tick.control.rejected_ticks != 0);
        let last = self.last_tau.get_or_insert_default();
        last.clear();
        last.extend_from_slice(tau);
    }

    /// The jump in power that a change of mode commands.
    fn measure_switches(&mut self, tick: &Tick<'_>, changes: usize) {
        self.summary.switches += changes as u64;
        if changes > 0
            && let Some(last) = &self.last_tau
        {
            let jump: f64 = last
                .iter()
                .enumerate()
                .map(|(i, before)| (tick.torque.tau[i] - before) * tick.truth.qdot[i])
                .sum();
            self.summary.switch_energy_j += jump.abs() * SWITCH_S;
        }
    }

    fn watch_limits(
        &mut self,
        tick: &Tick<'_>,
        stops: u32,
        i: usize,
        events: &mut impl FnMut(String),
    ) {
        let bit = 1u32 << i;
        let is_fast = !within(share(tick.truth.qdot[i], self.limits.velocity[i]), 1.0);
        // At almost every tick.
        let is_commanded = self.limits.is_reached(i, tick.torque.tau[i]);
        if !is_fast && !is_commanded && (stops | tick.truth.saturation_mask) & bit == 0 {
            return;
        }
        let middle = 0.5 * (self.limits.lower[i] + self.limits.upper[i]);
        let stop = if tick.truth.q[i] > middle {
            "upper stop"
        } else {
            "lower stop"
        };
        let cut = tick.truth.saturation_mask & bit != 0;
        let [by_speed, by_rate] =
            [DRIVE_SPEED, DRIVE_RATE].map(|flag| tick.truth.drive_flags & flag != 0);
        let is_at_effort = self.limits.is_reached(i, tick.truth.tau[i]) || !(by_speed || by_rate);
        for (is_reached, limit) in [
            (stops & bit != 0, stop),
            (is_fast, "speed"),
            (is_commanded || cut && is_at_effort, "torque"),
            (cut && !is_at_effort && by_speed, "drive speed"),
            (cut && !is_at_effort && !by_speed, "drive rate"),
        ] {
            if !is_reached {
                continue;
            }
            let joint = &self.limits.names[i];
            let mut known = self.summary.limits.iter_mut();
            if let Some(known) = known.find(|one| one.joint == *joint && one.limit == limit) {
                known.ticks += 1;
                continue;
            }
            let first = LimitSummary {
                joint: joint.clone(),
                limit: limit.to_owned(),
                first_tick: tick.truth.header.tick,
                ticks: 1,
            };
            events(reached(&first));
            self.summary.limits.push(first);
        }
    }

    /// Whether the drives had the arm instead of the controller.
    pub(super) fn is_braked(&self) -> bool {
        self.braked.is_some()
    }

    /// One clause for what the drives did by themselves, and for each limit that was reached.
    pub(super) fn clauses(&self) -> impl Iterator<Item = String> {
        let limits = self.summary.limits.iter().map(|limit| {
            let LimitSummary {
                first_tick, ticks, ..
            } = limit;
            format!(
                "{} for {ticks} ticks from tick {first_tick} on",
                reached(limit)
            )
        });
        let JointSummary {
            rate_limited_ticks,
            rejected_estimate_ticks,
            ..
        } = self.summary;
        let waits = (rate_limited_ticks > FREE_TICKS)
            .then(|| format!("torques waited for the rates that the drives accept, {rate_limited_ticks} ticks in all"));
        let rejections = (rejected_estimate_ticks > 0).then(|| {
            format!("the estimate was set aside for {rejected_estimate_ticks} ticks, because no torque within the limits moves the arm so")
        });
        let braked = self.braked.map(|[first, ticks]| {
            format!("without fresh torque, the drives held and braked the arm for {ticks} ticks from tick {first} on")
        });
        braked
            .into_iter()
            .chain(self.refused.clone())
            .chain(limits)
            .chain(waits)
            .chain(rejections)
    }

    /// Whether a joint ran against its stop, above its speed limit, or was commanded a torque above its limit.
    pub(super) fn has_broken_a_limit(&self) -> bool {
        let is_one = |limit: &LimitSummary| limit.limit == "speed" || limit.limit.ends_with("stop");
        self.summary.limits.iter().any(is_one)
            || !within(self.summary.torque_commanded_max_ratio, 1.0 + ROUNDING)
    }

    pub(super) fn finish(mut self) -> JointSummary {
        (self.summary.chatter, self.summary.jump_energy_j) =
            (self.chatter.count, self.chatter.energy_j);
        let unit = |kind: &JointKind| match kind {
            JointKind::Prismatic => "m",
            _ => "rad",
        };
        self.summary.units = self.limits.kinds.iter().map(|k| unit(k).into()).collect();
        let has_limit = |limits: &[f64]| limits.iter().any(|limit| !limit.is_infinite());
        self.summary.has_speed_limit = has_limit(&self.limits.velocity);
        self.summary.has_torque_limit = has_limit(&self.limits.effort);
        let steps = self.torque_steps;
        if !steps.is_empty() {
            let ratio = |quantile| steps.value_at_quantile(quantile) as f64 / STEP_UNIT;
            self.summary.torque_step_p95_ratio = ratio(0.95);
            self.summary.torque_step_p99_ratio = ratio(0.99);
        }
        self.summary
    }
}

fn reached(limit: &LimitSummary) -> String {
    let joint = &limit.joint;
    match limit.limit.as_str() {
        "speed" => format!("{joint} above its speed limit"),
        "torque" => format!("{joint} at its torque limit"),
        "drive speed" => format!("{joint}'s torque cut by its drive because of the speed"),
        "drive rate" => format!("{joint}'s torque delayed by its drive because of the rate"),
        stop => format!("{joint} against its {stop}"),
    }
}
