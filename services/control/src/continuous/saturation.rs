//! Torque limits (+): the null-space torque is scaled down first, then the task torque along the path, then its rest.
//!
//! Reduces to the paper's Γ wherever it respects the limits: the sum is passed on unchanged (proof: `limits_hold_and_the_null_space_goes_first`).

use crate::law::Torques;
use nalgebra::SVector;

/// Torques within the limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limited<const N: usize> {
    /// Γ within the limits, N·m.
    pub tau: SVector<f64, N>,
    /// Its task part, with the bias, N·m.
    pub task: SVector<f64, N>,
    /// Its null-space part, N·m.
    pub null: SVector<f64, N>,
    /// Fraction of the null-space torque.
    pub null_scale: f64,
    /// Fraction of the task torque along the path.
    pub task_scale: f64,
    /// Bit i: joint i is at its limit.
    pub mask: u32,
    /// Largest |Γ_i| over its limit before limiting.
    pub load: f64,
}

/// Share of a torque limit up to which a disturbance is compensated: payload and friction take less, a contact is not pressed against.
const COMPENSATED: f64 = 0.25;

/// The disturbance torques that are compensated, N·m: up to a share of each limit.
#[must_use]
#[inline]
pub fn compensated<const N: usize>(
    tau_disturbance: &SVector<f64, N>,
    limits: &SVector<f64, N>,
) -> SVector<f64, N> {
    tau_disturbance.zip_map(limits, |tau, limit| {
        tau.clamp(-COMPENSATED * limit, COMPENSATED * limit)
    })
}

/// Γ = bias + k_r·rest + k_t·path + k_n·null: the largest k_n, then the largest k_t, then the largest k_r in [0, 1] that respect every limit.
///
/// Shapes N · Units N·m · Ensures |Γ_i| ≤ limit_i: an excess that no k removes is cut at the joint · Errors none · Cost O(N), no allocation
#[must_use]
#[inline]
pub fn limit<const N: usize>(
    bias: &SVector<f64, N>,
    torques: &Torques<N>,
    limits: &SVector<f64, N>,
) -> Limited<N> {
    let whole = bias + torques.rest + torques.path;
    let total = whole + torques.null;
    let load = (0..N).fold(0.0_f64, |load, i| load.max(total[i].abs() / limits[i]));
    let (mut null_scale, mut task_scale, mut rest_scale) = (1.0, 1.0, 1.0);
    if load > 1.0 {
        null_scale = largest_share(&whole, &torques.null, limits);
        let null = torques.null * null_scale;
        let fixed = bias + torques.rest + null;
        task_scale = largest_share(&fixed, &torques.path, limits);
        rest_scale = largest_share(
            &(bias + null + torques.path * task_scale),
            &torques.rest,
            limits,
        );
    }
    let null = torques.null * null_scale;
    let task = bias + torques.rest * rest_scale + torques.path * task_scale;
    let mut tau = task + null;
    let mut mask = 0;
    for i in 0..N {
        if tau[i].abs() >= limits[i] * (1.0 - 1e-9) {
            mask |= 1 << i;
            tau[i] = tau[i].clamp(-limits[i], limits[i]);
        }
    }
    Limited {
        tau,
        task: tau - null,
        null,
        null_scale,
        task_scale: task_scale.min(rest_scale),
        mask,
        load,
    }
}

/// The largest k in [0, 1] with |fixed + k·part| ≤ limits; where none is, the k that violates them least: 0 or 1.
fn largest_share<const N: usize>(
    fixed: &SVector<f64, N>,
    part: &SVector<f64, N>,
    limits: &SVector<f64, N>,
) -> f64 {
    // Rounding is not a violation: the last cut makes up for it.
    if (0..N).all(|i| (fixed[i] + part[i]).abs() <= limits[i] * (1.0 + 1e-12)) {
        return 1.0;
    }
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    for i in 0..N {
        if part[i] == 0.0 {
            continue;
        }
        let (a, b) = (
            (-limits[i] - fixed[i]) / part[i],
            (limits[i] - fixed[i]) / part[i],
        );
        low = low.max(a.min(b));
        high = high.min(a.max(b));
    }
    if low <= high {
        return high;
    }
    let excess = |k: f64| {
        (0..N).fold(0.0_f64, |worst, i| {
            worst.max((fixed[i] + k * part[i]).abs() / limits[i])
        })
    };
    if excess(0.0) <= excess(1.0) { 0.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector2<f64>> {
        prop::array::uniform2(-30.0..30.0).prop_map(Vector2::from)
    }

    proptest! {
        #[test]
        fn limits_hold_and_the_null_space_goes_first(bias in vector(), path in vector(), rest in vector(), null in vector()) {
            let limits = Vector2::new(20.0, 10.0);
            let torques = Torques { path, rest, null, qdot_nominal: Vector2::zeros(), qddot_path: Vector2::zeros() };
            let out = limit(&bias, &torques, &limits);
            for i in 0..2 {
                prop_assert!(out.tau[i].abs() <= limits[i]);
            }
            let whole = bias + path + rest;
            if (0..2).all(|i| (whole + null)[i].abs() <= limits[i]) {
                prop_assert!((out.tau - whole - null).amax() < 1e-12 && out.mask == 0);
            }
            if (0..2).all(|i| whole[i].abs() <= limits[i]) {
                prop_assert!(out.task_scale == 1.0, "task torque is untouched while giving up null torque suffices");
                prop_assert!((out.tau - whole - null * out.null_scale).amax() < 1e-9);
            }
        }
    }
}
