//! The most that a fault may do to the arm: absolute bounds, whatever a scenario allows itself.
//!
//! Most faults stay far below them: on `fig5-wrist-rotation` a killed process moves no joint by more than 2 mrad, and a drifting encoder by 25 mrad.

use super::cell::Cell;

/// Age of a torque in force; ms.
const STALE_MS: f64 = 5.0;

/// Distance from the path without a fault, of a joint in rad and of the end-effector in mm.
const EXCURSION: (f64, f64) = (0.2, 100.0);

/// The same under a drive that fails for the usual half a second: what the arm falls in that time, whatever the processes do. At a PUMA's shoulder
/// gravity is at most 46 N·m on 4.7 kg·m², which is 1.2 rad in 0.5 s from rest, and 1 m at the arm's reach.
const EXCURSION_FAILED_DRIVE: (f64, f64) = (1.3, 1_100.0);

/// From the fault until the drives follow the controller again, or the arm is at rest; ms.
const REST_MS: f64 = 1_500.0;

/// The error at the end of a task that counts as its goal; mm, degrees.
const GOAL: (f64, f64) = (1.0, 0.5);

/// Whether an arm that ends so far from its goal, in mm and degrees, has reached it.
pub(super) fn is_goal(position_mm: f64, orientation_deg: f64) -> bool {
    position_mm <= GOAL.0 && orientation_deg <= GOAL.1
}

/// The bounds that a cell exceeds, in words.
pub(super) fn broken(cell: &Cell, has_failed_drive: bool) -> Vec<String> {
    let (most_rad, most_mm) = if has_failed_drive { EXCURSION_FAILED_DRIVE } else { EXCURSION };
    let excursions = [("a joint", cell.excursion_max_rad, most_rad, "rad"), ("the end-effector", cell.excursion_max_mm, most_mm, "mm")];
    let strayed = excursions.iter().filter(|(_, value, most, _)| value > most);
    let strayed = strayed.map(|(what, value, most, unit)| format!("{what} left the path by {value:.3} {unit}, at most {most} are allowed"));
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
        assert_eq!(broken(&fine, false), Vec::<String>::new());
        let caught = |cell: Cell, words: &str| {
            let broken = broken(&cell, false);
            assert!(broken.len() == 1 && broken[0].contains(words), "{words}: {broken:?}");
        };
        caught(Cell { stale_ms: 200.0, ..fine.clone() }, "200 ms");
        caught(Cell { excursion_max_rad: 0.49, ..fine.clone() }, "0.490 rad");
        caught(Cell { excursion_max_mm: 300.0, ..fine.clone() }, "300.000 mm");
        caught(Cell { settled_ms: Some(9_000.0), ..fine.clone() }, "no rest for 9000 ms");
        assert!(broken(&Cell { excursion_max_rad: 0.49, ..fine.clone() }, true).is_empty(), "a drive that fails carries its arm");
        assert_eq!(broken(&Cell { excursion_max_rad: 1.4, ..fine.clone() }, true).len(), 1, "not everywhere");
        assert!(is_goal(0.9, 0.4) && !is_goal(1.1, 0.4) && !is_goal(0.9, 0.6) && !is_goal(f64::NAN, 0.0));
    }
}
