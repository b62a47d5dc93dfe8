//! The most that a fault may do to the arm: absolute bounds, whatever a scenario allows itself. Under a drive that fails the arm may fall as far as its
//! own weight and inertia say, if that is more.
//!
//! Most faults stay far below them: on `fig5-wrist-rotation` a killed process moves no joint by more than 2 mrad, and a drifting encoder by 25 mrad.

use super::cell::Cell;
use super::fall::Fall;
use shared_types::scenario::Goal;

/// Age of a torque in force; ms.
const STALE_MS: f64 = 5.0;

/// Distance from the path without a fault, of a joint in rad and of the end-effector in mm.
const EXCURSION: (f64, f64) = (0.2, 100.0);

/// From the fault until the drives follow the controller again, or the arm is at rest; ms.
const REST_MS: f64 = 1_500.0;

/// Whether an arm that ends so far from its goal, in mm and degrees, has reached it by the bounds of a scenario that states none.
pub(super) fn is_goal(position_mm: f64, orientation_deg: f64) -> bool {
    let goal = Goal::default();
    position_mm <= goal.position_mm && orientation_deg <= goal.orientation_deg
}

/// The bounds that a cell exceeds, in words; `fall` is that of the arm where a drive fails.
pub(super) fn broken(cell: &Cell, fall: Option<Fall>) -> Vec<String> {
    let Fall { joint_rad, hand_mm } = fall.unwrap_or_default();
    let (most_rad, most_mm) = (EXCURSION.0.max(joint_rad), EXCURSION.1.max(hand_mm));
    let excursions = [("a joint", cell.excursion_max_rad, most_rad, "rad"), ("the end-effector", cell.excursion_max_mm, most_mm, "mm")];
    let strayed = excursions.iter().filter(|(_, value, most, _)| value > most);
    let strayed =
        strayed.map(|(what, value, most, unit)| format!("{what} left the path by {value:.3} {unit}, at most {most:.3} are allowed"));
    let times = [("a torque was in force for", cell.stale_ms, STALE_MS), ("no rest for", cell.settled_ms.unwrap_or(0.0), REST_MS)];
    let late = times.iter().filter(|(_, value, most)| value > most);
    let late = late.map(|(what, value, most)| format!("{what} {value:.0} ms, at most {most} are allowed"));
    strayed.chain(late).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bound_is_absolute() {
        let fine = Cell { stale_ms: 3.0, excursion_max_rad: 0.01, excursion_max_mm: 2.0, settled_ms: Some(300.0), ..Cell::default() };
        assert_eq!(broken(&fine, None), Vec::<String>::new());
        let caught = |cell: Cell, words: &str| {
            let broken = broken(&cell, None);
            assert!(broken.len() == 1 && broken[0].contains(words), "{words}: {broken:?}");
        };
        caught(Cell { stale_ms: 200.0, ..fine.clone() }, "200 ms");
        caught(Cell { excursion_max_rad: 0.49, ..fine.clone() }, "0.490 rad");
        caught(Cell { excursion_max_mm: 300.0, ..fine.clone() }, "300.000 mm");
        caught(Cell { settled_ms: Some(9_000.0), ..fine.clone() }, "no rest for 9000 ms");
        let fall = Some(Fall { joint_rad: 0.9, hand_mm: 50.0 });
        let under = |excursion_max_rad, excursion_max_mm| broken(&Cell { excursion_max_rad, excursion_max_mm, ..fine.clone() }, fall).len();
        assert_eq!((under(0.49, 2.0), under(0.95, 2.0)), (0, 1), "a drive that fails lets its arm fall, as far as it can");
        assert_eq!((under(0.49, 90.0), under(0.49, 110.0)), (0, 1), "an arm that falls less has the bound of every fault");
        assert!(is_goal(0.9, 0.4) && !is_goal(1.1, 0.4) && !is_goal(0.9, 0.6) && !is_goal(f64::NAN, 0.0));
    }
}
