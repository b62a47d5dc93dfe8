//! The end of a leg: a goal that a damped route, or one stopped by a fold, misses by less than may be missed.

use super::*;
use crate::linear::Joints;

/// Largest joint motion over which a posture is moved onto the goal, rad.
const CLOSING: f64 = 0.4;
/// How far a leg's end may be off where no posture near by has its pose, as far as so much deviation is allowed: the law keeps the directions that are not
/// lost, and arrives within 1 mm and 0.5°.
const MISSED: Deviation = Deviation {
    position_m: 0.7e-3,
    orientation_rad: 6e-3,
};
/// Points of that motion at which the deviation is checked.
const POINTS: u32 = 8;

impl<const N: usize> Search<'_, N> {
    /// Moves a posture at the end of a leg onto its goal, over its last edge; false where it stays further away than [`MISSED`].
    pub(super) fn closes(&mut self, node: usize, goal: &Pose) -> bool {
        let q = self.nodes[node].q;
        let error = |q: &Joints<N>| self.arm.error(goal, &self.arm.pose(q));
        if error(&q).norm() < 1e-5 {
            return true;
        }
        self.spent.set(self.spent.get() + 12);
        let excess = |q: &Joints<N>| self.excess(&error(q), goal);
        let near = |by: &Joints<N>| {
            by.amax() < CLOSING
                && self.outside(&(q + by), &q).is_none()
                && (1..POINTS)
                    .all(|k| excess(&(q + by * (f64::from(k) / f64::from(POINTS)))) < LEFT.1)
        };
        let Some(by) = self
            .arm
            .approach(goal, &q)
            .map(|there| there - q)
            .filter(near)
        else {
            let over = excess(&q);
            self.nodes[node].cost += over;
            let most = self.request.allowed.at_most(MISSED);
            return self.arm.excess(&error(&q), &goal.R, &most) < 1.0;
        };
        let from = self.nodes[node]
            .parent
            .and_then(|parent| self.nodes[parent].knots.last())
            .map_or(0.0, |knot| knot.t);
        let node = &mut self.nodes[node];
        let to = node.knots.last().map_or(from, |knot| knot.t);
        for knot in &mut node.knots {
            knot.q += by * ((knot.t - from) / (to - from).max(SHORTEST)).clamp(0.0, 1.0);
        }
        node.q = q + by;
        true
    }
}
