//! The limits of a drive: torque, and change of torque in one tick.
//!
//! Reduces to the paper's Γ wherever it respects both: the sum is passed on unchanged (proof: `limits_and_rates_hold_and_the_null_space_goes_first`).

use super::{Parts, shares};
use crate::linear::{Jacobian, Joints, Vector3};
use model::{Model, Terms};

/// Share of a torque limit up to which a disturbance is compensated beside the weight of a payload: friction takes less, a contact is not pressed against.
const COMPENSATED: f64 = 0.25;

/// The drives of an arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drives<const N: usize> {
    /// Torque limits, N·m.
    pub effort: Joints<N>,
    /// Largest change of each torque in a tick, N·m.
    pub step: Joints<N>,
    /// Acceleration of free fall, base axes, m/s².
    pub fall: Vector3,
}

/// The torque of a tick and its parts: what the next one may differ from by a rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sent<const N: usize> {
    /// Γ, N·m.
    pub tau: Joints<N>,
    /// Its part along the path, N·m.
    pub path: Joints<N>,
    /// Its part in the null space, N·m.
    pub null: Joints<N>,
}

/// What the drives left of a torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limited {
    /// Fraction of the null-space torque.
    pub null_scale: f64,
    /// Fraction of the task torque.
    pub task_scale: f64,
    /// Bit i: joint i is at its torque limit.
    pub saturation_mask: u32,
    /// Bit i: joint i would have changed faster than its drive accepts.
    pub rate_mask: u32,
}

/// Bit i where `is_set(i)`.
fn mask<const N: usize>(is_set: impl Fn(usize) -> bool) -> u32 {
    (0..N)
        .filter(|i| is_set(*i))
        .fold(0, |mask, i| mask | 1 << i)
}

impl<const N: usize> Drives<N> {
    /// Those of `model` in ticks of `dt` s, where a body falls with `fall`, m/s².
    pub fn of(model: &Model<N>, fall: Vector3, dt: f64) -> Self {
        Self {
            effort: *model.effort(),
            step: model.torque_rate() * dt,
            fall,
        }
    }

    /// The torque that moves nothing: gravity and Coriolis, what bears a contact, and what is compensated of a disturbance, N·m.
    #[must_use]
    #[inline]
    pub fn bias(
        &self,
        terms: &Terms<N>,
        bearing: Option<Joints<N>>,
        disturbance: Option<&Joints<N>>,
    ) -> Joints<N> {
        let bias = bearing.map_or_else(|| terms.bias(), |bearing| terms.bias() + bearing);
        disturbance.map_or(bias, |torque| self.compensating(bias, torque, &terms.J))
    }

    /// `bias` less `disturbance`, N·m, up to a share of each limit beside the torque of the mass at E that explains most of the disturbance. A force that no
    /// mass has, upwards, is no payload's.
    ///
    /// Shapes N, `J` 6×N at E in base axes
    #[inline]
    fn compensating(&self, bias: Joints<N>, disturbance: &Joints<N>, J: &Jacobian<N>) -> Joints<N> {
        let per_kg = J.fixed_rows::<3>(0).tr_mul(&self.fall);
        let mass_kg = per_kg.dot(disturbance) / per_kg.norm_squared().max(f64::MIN_POSITIVE);
        let weight = per_kg * mass_kg.max(0.0);
        bias - Joints::from_fn(|i, _| {
            let most = COMPENSATED * self.effort[i];
            disturbance[i].clamp(weight[i].min(0.0) - most, weight[i].max(0.0) + most)
        })
    }

    /// The torque nearest to `bias` plus `parts` that limits and rates allow; it becomes the last one.
    ///
    /// Torque: Γ = bias + k_r·rest + k_p·path + k_n·null within ±effort. Rate: ΔΓ = Δrest + k_p·Δpath + k_n·Δnull within ±step. An excess that no k
    /// removes is cut at the joint, so that every other joint follows at once.
    ///
    /// Shapes N · Units N·m · Requires finite torques, the last one within the limits · Ensures |Γ_i| ≤ effort_i and |ΔΓ_i| ≤ step_i though the
    /// parts be delayed one without the other, and the sum unchanged where it respects both · Errors none · Cost O(N), no allocation
    #[inline]
    pub fn send(&self, last: &mut Sent<N>, bias: &Joints<N>, parts: &Parts<N>) -> Limited {
        let (effort, mut scales) = (&self.effort, [1.0; 3]);
        let whole = bias + parts.sum();
        if (0..N).any(|i| whole[i].abs() > effort[i]) {
            scales = shares(bias, parts, [&-effort, effort]);
        }
        let Parts { null, path, rest } = parts.scaled(scales);
        let wanted = bias + rest + path + null;
        let saturation_mask = mask::<N>(|i| wanted[i].abs() >= effort[i] * (1.0 - 1e-9));
        let wanted = wanted.zip_map(effort, |tau, limit| tau.clamp(-limit, limit));
        let rate_mask = self.follow(
            last,
            &Sent {
                tau: wanted,
                path,
                null,
            },
        );
        Limited {
            null_scale: scales[0],
            task_scale: scales[1].min(scales[2]),
            saturation_mask,
            rate_mask,
        }
    }

    /// Moves `last` towards `wanted` within the rates; bit i where joint i met its rate.
    #[inline]
    fn follow(&self, last: &mut Sent<N>, wanted: &Sent<N>) -> u32 {
        let step = &self.step;
        let change = wanted.tau - last.tau;
        if (0..N).all(|i| change[i].abs() <= step[i]) {
            *last = *wanted;
            return 0;
        }
        let (null, path) = (wanted.null - last.null, wanted.path - last.path);
        let mut parts = Parts {
            null,
            path,
            rest: change - null - path,
        };
        // No share helps a joint that the rest alone takes beyond its rate: it is cut below, and the others follow at once.
        for i in 0..N {
            if parts.rest[i].abs() > step[i] {
                parts.rest[i] = 0.0;
                (parts.null[i], parts.path[i]) = (0.0, 0.0);
            }
        }
        let [k_n, k_p, _] = shares(&Joints::zeros(), &parts, [&-step, step]);
        let allowed = change + null * (k_n - 1.0) + path * (k_p - 1.0);
        last.tau = Joints::from_fn(|i, _| {
            (last.tau[i] + allowed[i].clamp(-step[i], step[i]))
                .clamp(-self.effort[i], self.effort[i])
        });
        last.path += path * k_p;
        last.null += null * k_n;
        mask::<N>(|i| change[i].abs() > step[i])
    }
}

impl<const N: usize> Sent<N> {
    /// Of an arm that is carried at rest by `gravity`, N·m.
    pub fn holding(gravity: &Joints<N>, effort: &Joints<N>) -> Self {
        Self {
            tau: gravity.zip_map(effort, |g, limit| g.clamp(-limit, limit)),
            path: Joints::zeros(),
            null: Joints::zeros(),
        }
    }

    /// The drives carry the arm with all that it holds, which pulls with `disturbance`, N·m: the first torque goes on from there.
    pub(crate) fn carry(&mut self, disturbance: &Joints<N>, effort: &Joints<N>) {
        if disturbance.amax() > 0.0 {
            self.tau = Self::holding(&(self.tau - disturbance), effort).tau;
        }
    }

    /// One that a checkpoint has, within the limits; nothing at all where it is not a number: a damaged checkpoint moves no arm.
    pub fn restored([tau, path, null]: [Joints<N>; 3], effort: &Joints<N>) -> Self {
        let zero = Joints::zeros();
        if ![tau, path, null].iter().flatten().all(|x| x.is_finite()) {
            return Self::holding(&zero, effort);
        }
        Self {
            path,
            null,
            ..Self::holding(&tau, effort)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn vector(most: f64) -> impl Strategy<Value = Vector2<f64>> {
        prop::array::uniform2(-most..most).prop_map(Vector2::from)
    }

    /// Two sliding joints, one upright: a push downwards is a payload's, one upwards a contact's.
    #[test]
    fn a_payload_is_carried_and_a_contact_is_not_pressed_against() {
        let mut J = Jacobian::zeros();
        (J[(2, 0)], J[(0, 1)]) = (1.0, 1.0);
        let drives = Drives {
            effort: Vector2::repeat(20.0),
            step: Vector2::repeat(1.0),
            fall: Vector3::new(0.0, 0.0, -9.81),
        };
        let given = |push| drives.compensating(Vector2::zeros(), &push, &J);
        let sent = given(Vector2::new(-8.0, 8.0));
        assert!((sent - Vector2::new(8.0, -5.0)).amax() < 1e-12, "{sent}");
        assert_eq!(given(Vector2::new(8.0, 3.0)), Vector2::new(-5.0, -3.0));
    }

    proptest! {
        #[test]
        fn limits_and_rates_hold_and_the_null_space_goes_first(
            (tau, bias) in (vector(9.0), vector(30.0)),
            (path, rest, null) in (vector(30.0), vector(30.0), vector(30.0)),
            slow in any::<bool>(),
        ) {
            let effort = Vector2::new(20.0, 10.0);
            let step = if slow { Vector2::new(1.0, 0.5) } else { Vector2::repeat(100.0) };
            let drives = Drives { effort, step, fall: Vector3::zeros() };
            let mut sent = Sent { tau, path: Vector2::zeros(), null: Vector2::zeros() };
            let out = drives.send(&mut sent, &bias, &Parts { null, path, rest });
            for i in 0..2 {
                prop_assert!(sent.tau[i].abs() <= effort[i] && (sent.tau[i] - tau[i]).abs() <= step[i] + 1e-12);
            }
            let task = bias + rest + path;
            let is_within = |x: &Vector2<f64>, limit: &Vector2<f64>| (0..2).all(|i| x[i].abs() <= limit[i]);
            if is_within(&(task + null), &effort) && out.rate_mask == 0 {
                prop_assert!((sent.tau - task - null).amax() < 1e-12 && out.null_scale == 1.0);
            }
            if is_within(&task, &effort) {
                prop_assert!(out.task_scale == 1.0, "task torque is untouched while giving up null torque suffices");
                if out.rate_mask == 0 {
                    prop_assert!((sent.tau - task - null * out.null_scale).amax() < 1e-9);
                } else if is_within(&(task - tau), &step) {
                    prop_assert!((sent.path - path).amax() < 1e-12, "the path's torque is untouched while waiting null torque suffices");
                }
            }
        }
    }
}
