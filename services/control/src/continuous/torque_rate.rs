//! Torque rate (+): what a drive accepts as a change of torque in one tick, kept on every joint.
//!
//! Reduces to the paper's Γ wherever its change respects the rates: it is passed on unchanged (proof: `rates_hold_and_the_null_space_waits_first`).

use super::saturation::Limited;
use nalgebra::SVector;

/// The torque of a tick and its parts: what the next one may differ from by a rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sent<const N: usize> {
    /// Γ, N·m.
    pub tau: SVector<f64, N>,
    /// Its part along the path, N·m.
    pub path: SVector<f64, N>,
    /// Its part in the null space, N·m.
    pub null: SVector<f64, N>,
}

impl<const N: usize> Sent<N> {
    /// An arm that is carried at rest.
    #[must_use]
    pub fn holding(gravity: &SVector<f64, N>, limits: &SVector<f64, N>) -> Self {
        Self {
            tau: gravity.zip_map(limits, |g, limit| g.clamp(-limit, limit)),
            path: SVector::zeros(),
            null: SVector::zeros(),
        }
    }

    /// The torque that a checkpoint has, within the limits; nothing at all where it is not a number: a damaged checkpoint moves no arm.
    #[must_use]
    pub fn restored(
        tau: SVector<f64, N>,
        path: SVector<f64, N>,
        null: SVector<f64, N>,
        limits: &SVector<f64, N>,
    ) -> Self {
        if !tau.iter().chain(&path).chain(&null).all(|x| x.is_finite()) {
            return Self {
                tau: SVector::zeros(),
                path: SVector::zeros(),
                null: SVector::zeros(),
            };
        }
        Self {
            tau: tau.zip_map(limits, |x, limit| x.clamp(-limit, limit)),
            path,
            null,
        }
    }

    /// The torque nearest to `wanted` that the rates allow, and bit i where joint i met its rate.
    ///
    /// ΔΓ = Δrest + k_t·Δpath + k_n·Δnull: the largest k_n, then the largest k_t in [0, 1] with |ΔΓ_i| ≤ `step_i`, over the joints that the other
    /// parts leave within it; an excess that neither removes is cut at the joint, so that every other joint follows at once.
    ///
    /// Shapes N · Units N·m · Requires finite torques, both within `limits` · Ensures |ΔΓ_i| ≤ step_i, |Γ_i| ≤ limit_i though the parts
    /// be delayed one without the other, and `wanted` unchanged where it respects every rate · Errors none ·
    /// Cost O(N), no allocation
    #[must_use]
    #[inline]
    pub fn next(
        &self,
        wanted: &Limited<N>,
        path: &SVector<f64, N>,
        step: &SVector<f64, N>,
        limits: &SVector<f64, N>,
    ) -> (Self, u32) {
        let change = wanted.tau - self.tau;
        if (0..N).all(|i| change[i].abs() <= step[i]) {
            return (
                Self {
                    tau: wanted.tau,
                    path: *path,
                    null: wanted.null,
                },
                0,
            );
        }
        let (null_change, path_change) = (wanted.null - self.null, path - self.path);
        let without = change - null_change;
        let k_n = largest_share(&without, &null_change, step);
        let k_t = largest_share(
            &(without - path_change + null_change * k_n),
            &path_change,
            step,
        );
        let allowed = without + path_change * (k_t - 1.0) + null_change * k_n;
        let mask = (0..N)
            .filter(|i| change[*i].abs() > step[*i])
            .fold(0, |mask, i| mask | 1 << i);
        let tau = SVector::from_fn(|i, _| {
            (self.tau[i] + allowed[i].clamp(-step[i], step[i])).clamp(-limits[i], limits[i])
        });
        (
            Self {
                tau,
                path: self.path + path_change * k_t,
                null: self.null + null_change * k_n,
            },
            mask,
        )
    }
}

/// The largest k in [0, 1] with |fixed + k·part| ≤ step, over the joints with |fixed| ≤ step: no k helps the others.
fn largest_share<const N: usize>(
    fixed: &SVector<f64, N>,
    part: &SVector<f64, N>,
    step: &SVector<f64, N>,
) -> f64 {
    (0..N)
        .filter(|i| fixed[*i].abs() <= step[*i] && part[*i] != 0.0)
        .fold(1.0_f64, |share, i| {
            let room = if part[i] > 0.0 {
                step[i] - fixed[i]
            } else {
                step[i] + fixed[i]
            };
            share.min(room / part[i].abs())
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn vector(most: f64) -> impl Strategy<Value = Vector2<f64>> {
        prop::array::uniform2(-most..most).prop_map(Vector2::from)
    }

    proptest! {
        #[test]
        fn rates_hold_and_the_null_space_waits_first(tau in vector(9.0), rest in vector(1.5), path in vector(1.5), null in vector(1.5)) {
            let step = Vector2::new(1.0, 0.5);
            let last = Sent { tau, path: Vector2::zeros(), null: Vector2::zeros() };
            let wanted = Limited { tau: tau + rest + path + null, task: tau + rest + path, null, null_scale: 1.0, task_scale: 1.0, mask: 0, load: 0.0 };
            let (next, mask) = last.next(&wanted, &path, &step, &Vector2::repeat(20.0));
            for i in 0..2 {
                prop_assert!((next.tau[i] - tau[i]).abs() <= step[i] + 1e-12);
                let limits = Vector2::repeat(tau.amax().max(wanted.tau.amax()));
                prop_assert!(last.next(&wanted, &path, &step, &limits).0.tau.amax() <= limits.amax());
            }
            if mask == 0 {
                prop_assert_eq!(next.tau, wanted.tau);
            } else if (0..2).all(|i| (rest + path)[i].abs() <= step[i]) {
                prop_assert!((next.path - path).amax() < 1e-12, "the path's torque is untouched while waiting null torque suffices");
                prop_assert!((next.tau - tau - rest - path - next.null).amax() < 1e-12);
            }
        }
    }
}
