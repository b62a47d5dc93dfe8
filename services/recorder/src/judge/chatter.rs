//! Torque steps that reverse shortly after.

use control::GroundTruth;

/// Change of torque in one tick, as a share of the limit, from which on it is a jump.
const JUMP: f64 = 0.1;
/// Time within which a jump back is chatter; s.
const BACK_WITHIN_S: f64 = 0.010;

/// The tick and the rate at which it comes, and the velocity gain of the loop that answers a jump.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub(super) tick: u64,
    pub(super) rate_hz: f64,
    pub(super) k_v: f64,
}

/// Counts reversed steps, and sums the energy that steps put in.
#[derive(Debug, Default)]
pub(super) struct ChatterMeter {
    pub(super) count: u64,
    /// Σ ½ΔΓᵀA⁻¹ΔΓ/k_v² over the ticks with a jump, J.
    pub(super) energy_j: f64,
    /// Per joint: when it jumped last, and which way.
    last: Vec<Option<(u64, f64)>>,
    step: Vec<f64>,
}

impl ChatterMeter {
    /// Takes in the torques of the tick before and of this one, N·m, against their limits.
    pub(super) fn tick(
        &mut self,
        (before, now): (&[f64], &[f64]),
        effort: &[f64],
        truth: &dyn GroundTruth,
        clock: Clock,
    ) {
        let back_within = libm::ceil(BACK_WITHIN_S * clock.rate_hz) as u64;
        self.last.resize(now.len(), None);
        self.step.clear();
        self.step
            .extend(now.iter().zip(before).map(|(now, before)| now - before));
        let mut any = false;
        for ((step, effort), last) in self.step.iter().zip(effort).zip(&mut self.last) {
            if step.abs() <= JUMP * effort {
                continue;
            }
            any = true;
            let back = last.is_some_and(|(when, way)| {
                clock.tick.saturating_sub(when) <= back_within && way * step < 0.0
            });
            self.count += u64::from(back);
            *last = Some((clock.tick, step.signum()));
        }
        if any {
            self.energy_j += truth.response(&self.step) / (clock.k_v * clock.k_v);
        }
    }
}
