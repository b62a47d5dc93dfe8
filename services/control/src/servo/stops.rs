//! The joints' limits on the reference arm: no acceleration takes a joint to where it can no longer stop before the end of its range.
//!
//! A joint at the distance d from its stop is never faster than v(d) = √(a²/K² + 2·a·d) − a/K: braking from v takes less than a, and the approach
//! is exponential at the end. The acceleration that keeps it is (v(d) − q̇)/T, and v(d) is at most 0.98 of the joint's speed. The null-space motion is
//! given up first, then the motion along the reference's path, then the joint's own.

use nalgebra::SVector;

/// Rate of the last approach to a stop, K, 1/s.
const APPROACH: f64 = 8.0;
/// Time in which a speed is adapted, T, s: 1/T > 4·K, so that no joint overshoots.
const ADAPT_S: f64 = 0.025;
/// Distance from the end of its range at which a joint stops, rad (m for prismatic joints): many times the arm's distance from the reference arm.
const MARGIN: f64 = 0.003;
/// Share of a joint's speed that it may take.
const SPEED: f64 = 0.98;
/// Share of a joint's torque with which braking is planned.
const BRAKE: f64 = 0.3;

/// The limits of an arm's joints: lower and upper end of their ranges, speeds, and torques. Shapes N; for prismatic joints m, m/s and N.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a, const N: usize> {
    /// rad.
    pub lower: &'a SVector<f64, N>,
    /// rad.
    pub upper: &'a SVector<f64, N>,
    /// rad/s.
    pub velocity: &'a SVector<f64, N>,
    /// N·m.
    pub effort: &'a SVector<f64, N>,
}

/// Accelerations of the joints, rad/s². Shapes N; `whole` is the sum of `path`, `null` and what answers to errors.
#[derive(Clone, Copy, Debug)]
pub struct Parts<const N: usize> {
    /// All of it.
    pub whole: SVector<f64, N>,
    /// The share along the reference's path.
    pub path: SVector<f64, N>,
    /// The share in the null space.
    pub null: SVector<f64, N>,
}

/// An acceleration that keeps the limits. Shape N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundedAcceleration<const N: usize> {
    /// rad/s².
    pub qddot: SVector<f64, N>,
    /// A joint that is held before the end of its range, and whether that is the upper one.
    pub joint: Option<(usize, bool)>,
}

/// The accelerations nearest to `parts` with which every joint can still stop: the null space is scaled down first, then the path, then the joint is held.
///
/// `inertia` is the diagonal of A. Shapes N · Units rad, rad/s, kg·m² · Requires a state that keeps the limits · Ensures that the next state does, and
/// `parts.whole` unchanged away from all limits · Errors none · Cost O(N), no allocation
#[must_use]
pub fn bounded<const N: usize>(
    (q, qdot): (&SVector<f64, N>, &SVector<f64, N>),
    parts: &Parts<N>,
    inertia: &SVector<f64, N>,
    limits: &Limits<'_, N>,
) -> BoundedAcceleration<N> {
    let (mut low, mut high) = (SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros());
    let (mut upwards, mut downwards) = ([false; N], [false; N]);
    for i in 0..N {
        let most = SPEED * limits.velocity[i];
        let braking = BRAKE * limits.effort[i] / inertia[i];
        let (up, down) = (
            fastest(limits.upper[i] - q[i], braking),
            fastest(q[i] - limits.lower[i], braking),
        );
        (upwards[i], downwards[i]) = (up < most, down < most);
        high[i] = (up.min(most) - qdot[i]) / ADAPT_S;
        low[i] = (-down.min(most) - qdot[i]) / ADAPT_S;
    }
    let is_within = |x: &SVector<f64, N>| (0..N).all(|i| x[i] >= low[i] && x[i] <= high[i]);
    if is_within(&parts.whole) {
        return BoundedAcceleration {
            qddot: parts.whole,
            joint: None,
        };
    }
    let share = |fixed: &SVector<f64, N>, part: &SVector<f64, N>| {
        (0..N).fold(1.0_f64, |share, i| {
            let room = if part[i] > 0.0 {
                high[i] - fixed[i]
            } else {
                fixed[i] - low[i]
            };
            if part[i].abs() > room {
                share.min(room.max(0.0) / part[i].abs())
            } else {
                share
            }
        })
    };
    let rest = parts.whole - parts.path - parts.null;
    let null = parts.null * share(&(rest + parts.path), &parts.null);
    let path = parts.path * share(&(rest + null), &parts.path);
    let wanted = rest + path + null;
    let mut joint = None;
    for i in 0..N {
        if upwards[i] && parts.whole[i] > high[i] {
            joint = Some((i, true));
        } else if downwards[i] && parts.whole[i] < low[i] {
            joint = Some((i, false));
        }
    }
    BoundedAcceleration {
        qddot: SVector::from_fn(|i, _| wanted[i].clamp(low[i], high[i].max(low[i]))),
        joint,
    }
}

/// The speed from which a joint stops within `distance` less the margin; 0 beyond it.
fn fastest(distance: f64, braking: f64) -> f64 {
    let (d, slow) = ((distance - MARGIN).max(0.0), braking / APPROACH);
    if d.is_infinite() {
        f64::INFINITY
    } else {
        (slow * slow + 2.0 * braking * d).sqrt() - slow
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_motion_leaves_the_range_or_the_speed(
            pushes in prop::collection::vec(prop::array::uniform6(-80.0..80.0_f64), 1..20),
        ) {
            let (range, velocity, effort) = (Vector2::new(0.4, 1.0), Vector2::new(2.0, 1.0), Vector2::new(20.0, 3.0));
            let limits = Limits { lower: &-range, upper: &range, velocity: &velocity, effort: &effort };
            let (mut q, mut qdot, dt) = (Vector2::zeros(), Vector2::zeros(), 1e-3);
            for push in &pushes {
                let [path, null, rest] = [0, 2, 4].map(|k| Vector2::new(push[k], push[k + 1]));
                for _ in 0..300 {
                    let parts = Parts { whole: path + null + rest, path, null };
                    let bounded = bounded((&q, &qdot), &parts, &Vector2::new(1.0, 2.0), &limits);
                    q += qdot * dt + bounded.qddot * (0.5 * dt * dt);
                    qdot += bounded.qddot * dt;
                    for i in 0..2 {
                        prop_assert!(q[i].abs() <= range[i] - 0.5 * MARGIN && qdot[i].abs() <= 0.981 * velocity[i], "{q} {qdot}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_null_space_goes_first_and_away_from_limits_nothing_changes() {
        let one = Vector2::repeat(1.0);
        let limits = Limits {
            lower: &-one,
            upper: &one,
            velocity: &one,
            effort: &(one * 10.0),
        };
        let parts = Parts {
            whole: Vector2::new(2.0, 1.0),
            path: Vector2::new(0.0, 1.0),
            null: Vector2::new(2.0, 0.5),
        };
        let at = |q: Vector2<f64>| bounded((&q, &Vector2::zeros()), &parts, &one, &limits);
        assert_eq!(
            at(Vector2::zeros()),
            BoundedAcceleration {
                qddot: parts.whole,
                joint: None
            }
        );
        let bounded = at(Vector2::new(0.997, 0.0));
        assert!(
            (bounded.qddot - Vector2::new(0.0, 0.5)).amax() < 1e-9
                && bounded.joint == Some((0, true)),
            "{bounded:?}"
        );
    }
}
