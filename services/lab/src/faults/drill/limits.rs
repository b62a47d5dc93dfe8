//! The most that a fault may do to the arm: absolute bounds, whatever a scenario allows itself. Under a drive or a sensor that fails the arm may go as far
//! as its own data say, if that is more.
//!
//! Most faults stay far below them: on `fig5-wrist-rotation` a killed process moves no joint by more than 2 mrad, and a drifting encoder by 25 mrad.

use super::cell::Cell;
use shared_types::scenario::Goal;

/// Age of a torque in force; ms.
pub(super) const STALE_MS: f64 = 5.0;

/// A distance from the path without a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Excursion {
    /// Of a joint; rad.
    pub(super) joint_rad: f64,
    /// Of the end-effector; mm.
    pub(super) hand_mm: f64,
}

impl Excursion {
    /// No distance.
    pub(super) const NONE: Self = Self {
        joint_rad: 0.0,
        hand_mm: 0.0,
    };
    /// The most under an ordinary fault.
    pub(super) const ORDINARY: Self = Self {
        joint_rad: 0.2,
        hand_mm: 100.0,
    };

    /// The larger of two, of the joint and of the end-effector.
    pub(super) fn or(self, other: Self) -> Self {
        Self {
            joint_rad: self.joint_rad.max(other.joint_rad),
            hand_mm: self.hand_mm.max(other.hand_mm),
        }
    }
}

/// From the fault until the drives follow the controller again, or the arm is at rest; ms.
const REST_MS: f64 = 1_500.0;

/// Whether an arm that ends so far from its goal, in mm and degrees, has reached it by the bounds of a scenario that states none.
pub(super) fn is_goal(position_mm: f64, orientation_deg: f64) -> bool {
    let goal = Goal::default();
    position_mm <= goal.position_mm && orientation_deg <= goal.orientation_deg
}

/// The bounds that a cell exceeds, in words.
pub(super) fn broken(cell: &Cell) -> Vec<String> {
    let excursions = [
        (
            "a joint",
            cell.excursion_max_rad,
            cell.excursion_allowed_rad,
            "rad",
        ),
        (
            "the end-effector",
            cell.excursion_max_mm,
            cell.excursion_allowed_mm,
            "mm",
        ),
    ];
    let strayed = excursions.iter().filter(|(_, value, most, _)| value > most);
    let strayed = strayed.map(|(what, value, most, unit)| {
        format!("{what} left the path by {value:.3} {unit}, at most {most:.3} are allowed")
    });
    let times = [
        ("a torque was in force for", cell.stale_ms, STALE_MS),
        ("no rest for", cell.settled_ms.unwrap_or(0.0), REST_MS),
    ];
    let late = times.iter().filter(|(_, value, most)| value > most);
    let late =
        late.map(|(what, value, most)| format!("{what} {value:.0} ms, at most {most} are allowed"));
    strayed.chain(late).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bound_is_absolute() {
        let most = Excursion::ORDINARY;
        let allowed = Cell {
            excursion_allowed_rad: most.joint_rad,
            excursion_allowed_mm: most.hand_mm,
            ..Cell::default()
        };
        let fine = Cell {
            stale_ms: 3.0,
            excursion_max_rad: 0.01,
            excursion_max_mm: 2.0,
            settled_ms: Some(300.0),
            ..allowed
        };
        assert_eq!(broken(&fine), Vec::<String>::new());
        let caught = |cell: Cell, words: &str| {
            let broken = broken(&cell);
            assert!(
                broken.len() == 1 && broken[0].contains(words),
                "{words}: {broken:?}"
            );
        };
        caught(
            Cell {
                stale_ms: 200.0,
                ..fine.clone()
            },
            "200 ms",
        );
        caught(
            Cell {
                excursion_max_rad: 0.49,
                ..fine.clone()
            },
            "0.490 rad, at most 0.200",
        );
        caught(
            Cell {
                excursion_max_mm: 300.0,
                ..fine.clone()
            },
            "300.000 mm, at most 100.000",
        );
        caught(
            Cell {
                settled_ms: Some(9_000.0),
                ..fine.clone()
            },
            "no rest for 9000 ms",
        );
        let more = most.or(Excursion {
            joint_rad: 0.9,
            hand_mm: 50.0,
        });
        assert_eq!(
            more,
            Excursion {
                joint_rad: 0.9,
                hand_mm: 100.0
            },
            "each has its own bound"
        );
        assert!(
            is_goal(0.9, 0.4)
                && !is_goal(1.1, 0.4)
                && !is_goal(0.9, 0.6)
                && !is_goal(f64::NAN, 0.0)
        );
    }
}
