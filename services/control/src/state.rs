//! What the controller carries from tick to tick.

use crate::baselines::resolved_rate::JointMemory;
use crate::continuous::auxiliary::Loop;
use crate::continuous::governor::Governor;
use crate::paper::reference::Memory;
use crate::paper::type_2::Turn;
use crate::trajectory::Progress;
use crate::types::{Mode, Refusal};
use model::Pose;
use nalgebra::{Matrix3, SVector, Vector3};
use shared_types::MAX_SINGULARITIES;

/// The state from tick to tick: all of it survives a restart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct State<const N: usize> {
    pub(crate) progress: Progress,
    pub(crate) governor: Governor,
    pub(crate) loops: [Loop; MAX_SINGULARITIES],
    pub(crate) turn: Turn<N>,
    pub(crate) refusal: Refusal,
    pub(crate) path_time_s: f64,
    pub(crate) joint_memory: JointMemory<N>,
}

impl<const N: usize> State<N> {
    /// The state as numbers, for the message's `resume`.
    pub(crate) fn values(&self) -> [f64; 80] {
        let mut out = Packer { values: [0.0; 80], at: 0 };
        let State { progress, governor, loops, turn, refusal, path_time_s, joint_memory } = self;
        out.put(progress.leg as f64);
        out.put(progress.time_s);
        out.put(flag(progress.begun));
        progress.start.R.iter().chain(progress.start.p.iter()).for_each(|x| out.put(*x));
        progress.by.iter().chain(progress.turn.iter()).for_each(|x| out.put(*x));
        out.put(governor.rate);
        out.put(governor.rate_dot);
        out.put(governor.demand);
        turn.from.iter().for_each(|x| out.put(*x));
        out.put(turn.angle);
        turn.by.iter().for_each(|x| out.put(*x));
        out.put(turn.duration_s);
        out.put(f64::from(refusal.code()));
        out.put(*path_time_s);
        out.put(flag(joint_memory.holding));
        out.put(joint_memory.votes);
        out.put(f64::from(joint_memory.reversed));
        joint_memory.q.iter().for_each(|x| out.put(*x));
        for one in loops {
            let flags = flag(one.memory.passing) + 2.0 * flag(one.memory.holding) + 4.0 * (one.memory.side + 1.0);
            out.put(f64::from(one.mode.code()) + 32.0 * flags);
            out.put(one.rate);
            out.put(one.feed_forward);
            out.put(one.trust);
            out.put(one.memory.passage);
        }
        out.values
    }

    /// The state from its [`values`](Self::values).
    pub(crate) fn from_values(values: &[f64; 80]) -> Self {
        let mut from = values.iter().copied();
        let mut get = || from.next().unwrap_or(0.0);
        let (leg, time_s, begun) = (get() as usize, get(), get() != 0.0);
        let R = Matrix3::from_iterator((0..9).map(|_| get()));
        let mut vector = || Vector3::from_fn(|_, _| get());
        let (p, by, turn) = (vector(), vector(), vector());
        let progress = Progress { leg, time_s, begun, start: Pose { R, p }, by, turn };
        let governor = Governor { rate: get(), rate_dot: get(), demand: get() };
        let turn = Turn { from: Vector3::from_fn(|_, _| get()), angle: get(), by: SVector::from_fn(|_, _| get()), duration_s: get() };
        let refusal = Refusal::from_code(get() as u32).unwrap_or_default();
        let path_time_s = get();
        let joint_memory = JointMemory { holding: get() != 0.0, votes: get(), reversed: get() as u32, q: SVector::from_fn(|_, _| get()) };
        let loops = std::array::from_fn(|_| {
            let packed = get() as u32;
            let flags = packed / 32;
            let mode = Mode::from_code(packed % 32).unwrap_or_default();
            let [rate, feed_forward, trust, passage] = [get(), get(), get(), get()];
            let memory = Memory { passing: flags & 1 != 0, holding: flags & 2 != 0, side: f64::from(flags / 4) - 1.0, passage };
            Loop { mode, rate, feed_forward, trust, memory }
        });
        Self { progress, governor, loops, turn, refusal, path_time_s, joint_memory }
    }
}

fn flag(x: bool) -> f64 {
    f64::from(u8::from(x))
}

struct Packer {
    values: [f64; 80],
    at: usize,
}

impl Packer {
    fn put(&mut self, x: f64) {
        self.values[self.at] = x;
        self.at += 1;
    }
}
