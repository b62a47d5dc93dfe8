//! Joint limits of a steered arm: the clock slows before them, and stands at them.

use nalgebra::SVector;

/// Speed towards a limit per distance to it, 1/s: slower than the governor's clock changes.
const APPROACH: f64 = 4.0;
/// Distance from a limit at which the joint stands, rad (m for prismatic joints).
pub const MARGIN: f64 = 0.005;
/// Joint speed at full clock speed below which a joint is not on its way anywhere, rad/s.
const RESTING: f64 = 1e-4;
/// Share of a joint's speed that the reference may take.
const SPEED: f64 = 0.95;

/// The joint that allows the least, and the clock's speed that it allows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fastest {
    /// Speed of the clock, 0 to 1.
    pub clock: f64,
    /// Index of the joint at its limit and whether that is the upper one; `None` where no limit matters.
    pub joint: Option<(usize, bool)>,
}

impl Default for Fastest {
    fn default() -> Self {
        Self {
            clock: 1.0,
            joint: None,
        }
    }
}

/// The fastest clock: |q̇_i| ≤ 0.95 of the joint's speed, and q̇_i ≤ 4·(distance to the limit ahead − margin).
///
/// `qdot` are the joint velocities at full clock speed. Shapes N · Units rad, rad/s · Ensures a clock in [0, 1], 0 only where a joint that moves
/// towards its limit is at the margin · Errors none · Cost O(N), no allocation
#[must_use]
pub fn fastest<const N: usize>(
    q: &SVector<f64, N>,
    qdot: &SVector<f64, N>,
    (lower, upper): (&SVector<f64, N>, &SVector<f64, N>),
    velocity: &SVector<f64, N>,
) -> Fastest {
    let mut fastest = Fastest::default();
    for i in 0..N {
        let speed = qdot[i].abs();
        if speed < RESTING {
            continue;
        }
        let is_up = qdot[i] > 0.0;
        let room = (if is_up {
            upper[i] - q[i]
        } else {
            q[i] - lower[i]
        } - MARGIN)
            .max(0.0);
        let at_limit = APPROACH * room / speed;
        if at_limit < fastest.clock {
            fastest = Fastest {
                clock: at_limit,
                joint: Some((i, is_up)),
            };
        }
        let at_speed = SPEED * velocity[i] / speed;
        if at_speed < fastest.clock {
            fastest = Fastest {
                clock: at_speed,
                joint: None,
            };
        }
    }
    fastest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn the_clock_slows_before_a_limit_and_is_free_away_from_it() {
        let (lower, upper, velocity) = (
            Vector2::repeat(-1.0),
            Vector2::repeat(1.0),
            Vector2::repeat(2.0),
        );
        let at = |q: f64, qdot: f64| {
            fastest(
                &Vector2::new(q, 0.0),
                &Vector2::new(qdot, 0.0),
                (&lower, &upper),
                &velocity,
            )
        };
        assert_eq!(at(0.0, 1.0), Fastest::default());
        assert!(at(0.995, 1.0).clock < 1e-12 && at(0.995, 1.0).joint == Some((0, true)));
        assert_eq!(at(0.995, -1.0), Fastest::default());
        assert!(
            (at(-0.9, -1.0).clock - 0.38).abs() < 1e-12 && at(-0.9, -1.0).joint == Some((0, false))
        );
        assert!((at(0.0, 19.0).clock - 0.1).abs() < 1e-12 && at(0.0, 19.0).joint.is_none());
        assert_eq!(at(1.2, 1.0).clock, 0.0, "beyond the limit");
    }
}
