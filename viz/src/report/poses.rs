//! Where arm, path and marks were, as the recording has it at the picture's rate. PURE.

use std::collections::BTreeMap;

use glam::{Mat3, Quat, Vec3};

use crate::entity;
use crate::solid::Placement;

/// Places over time, in the order of the ticks.
#[derive(Default)]
pub(super) struct Track(Vec<(u64, Placement)>);

impl Track {
    fn push(&mut self, tick: u64, at: Placement) {
        if self.0.last().is_none_or(|(last, _)| *last < tick) {
            self.0.push((tick, at));
        }
    }

    /// The last place up to a tick.
    pub(super) fn at(&self, tick: u64) -> Option<&Placement> {
        self.0[..self.0.partition_point(|(known, _)| *known <= tick)]
            .last()
            .map(|(_, at)| at)
    }

    /// The same where it is not older than so many ticks.
    pub(super) fn fresh(&self, tick: u64, ticks: u64) -> Option<&Placement> {
        let (known, at) = self.0[..self.0.partition_point(|(known, _)| *known <= tick)].last()?;
        (tick - known <= ticks).then_some(at)
    }

    /// The rows of a stretch, both ends included.
    pub(super) fn between(&self, from: u64, to: u64) -> &[(u64, Placement)] {
        let range = self.0.partition_point(|(tick, _)| *tick < from)
            ..self.0.partition_point(|(tick, _)| *tick <= to);
        self.0.get(range).unwrap_or_default()
    }
}

/// The mark of one singularity.
#[derive(Default)]
pub(super) struct MarkTrack {
    /// The singular frame, x along ζ, where |s_i| is below twice η_out.
    pub(super) frame: Track,
    /// The mark's words, where the arm is inside the neighbourhood.
    pub(super) label: Track,
    /// Whether ζ is a rotation, since when.
    angular: Vec<(u64, bool)>,
}

impl MarkTrack {
    /// The frames since the arm entered the neighbourhood it is in at a tick; places hold for so many ticks.
    pub(super) fn since_entry(&self, tick: u64, hold: u64) -> &[(u64, Placement)] {
        let before = self.label.between(0, tick);
        let begin = before
            .windows(2)
            .rposition(|pair| pair[1].0 - pair[0].0 > hold)
            .map_or(0, |place| place + 1);
        before
            .get(begin)
            .map_or(&[], |(from, _)| self.frame.between(*from, tick))
    }

    /// The frames of a stretch in which the arm is inside.
    pub(super) fn inside(&self, from: u64, to: u64) -> &[(u64, Placement)] {
        match self.label.between(from, to) {
            [] => &[],
            [(first, _), .., (last, _)] => self.frame.between(*first, *last),
            [_] => &[],
        }
    }

    pub(super) fn is_angular(&self, tick: u64) -> bool {
        self.angular[..self.angular.partition_point(|(known, _)| *known <= tick)]
            .last()
            .or(self.angular.first())
            .is_some_and(|one| one.1)
    }
}

/// All of them.
#[derive(Default)]
pub(super) struct Poses {
    /// Of each link.
    pub(super) links: Vec<Track>,
    pub(super) hand: Track,
    pub(super) target: Track,
    /// By the singularity's name.
    pub(super) marks: BTreeMap<String, MarkTrack>,
}

impl Poses {
    pub(super) fn place(&mut self, tick: u64, of: &str, p: [f32; 3], xyzw: [f32; 4]) {
        let R = Mat3::from_quat(Quat::from_array(xyzw).normalize());
        let at = Placement {
            R,
            p: Vec3::from_array(p),
        };
        if !(at.p.is_finite() && at.R.is_finite()) {
            return;
        }
        match of {
            entity::HAND => self.hand.push(tick, at),
            entity::TARGET => self.target.push(tick, at),
            of => {
                if let Some(link) = of
                    .strip_prefix("/world/arm/link")
                    .and_then(|number| number.parse::<usize>().ok())
                {
                    if (1..=shared_types::MAX_DOF).contains(&link) {
                        self.links
                            .resize_with(self.links.len().max(link), Track::default);
                        self.links[link - 1].push(tick, at);
                    }
                } else if let Some(name) = of.strip_prefix("/world/label/") {
                    self.marks
                        .entry(name.to_owned())
                        .or_default()
                        .label
                        .push(tick, at);
                } else if let Some(name) = of
                    .strip_prefix("/world/singularity/")
                    .filter(|name| !name.contains('/'))
                {
                    self.marks
                        .entry(name.to_owned())
                        .or_default()
                        .frame
                        .push(tick, at);
                }
            }
        }
    }

    pub(super) fn label(&mut self, tick: u64, of: &str, text: &str) {
        if let Some(name) = of.strip_prefix("/world/label/") {
            self.marks
                .entry(name.to_owned())
                .or_default()
                .angular
                .push((tick, text.ends_with("turn")));
        }
    }

    /// The ticks of the pictures.
    pub(super) fn ticks(&self) -> impl Iterator<Item = u64> {
        self.links
            .first()
            .into_iter()
            .flat_map(|link| link.0.iter().map(|(tick, _)| *tick))
    }
}

/// The directions that ζ has had, as it turns: a line, whose sign may be either, followed without jumps; and how far it has turned, degrees.
pub(super) fn swept(frames: &[(u64, Placement)]) -> (Vec<Vec3>, f32) {
    let mut directions: Vec<Vec3> = Vec::new();
    let mut turned = 0.0;
    for (_, frame) in frames {
        let zeta = frame.R.x_axis.normalize_or(Vec3::X);
        let Some(last) = directions.last().copied() else {
            directions.push(zeta);
            continue;
        };
        let zeta = if last.dot(zeta) < 0.0 { -zeta } else { zeta };
        let angle = last.angle_between(zeta).to_degrees();
        if angle > 2.0 {
            turned += angle;
            directions.push(zeta);
        }
    }
    (directions, turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeta_is_a_line_and_turns_by_the_sum_of_its_steps() {
        let about_z = |degrees: f32| Placement {
            R: Mat3::from_rotation_z(degrees.to_radians()),
            p: Vec3::ZERO,
        };
        // Once the same line, the other way round.
        let angle = |k: u64| 3.0 * k as f32 + if k == 10 { 180.0 } else { 0.0 };
        let frames: Vec<(u64, Placement)> = (0..=30).map(|k| (k, about_z(angle(k)))).collect();
        let (directions, turned) = swept(&frames);
        assert!((turned - 90.0).abs() < 0.5, "{turned}");
        assert!(
            directions
                .windows(2)
                .all(|pair| pair[0].dot(pair[1]) > 0.99)
        );
    }

    #[test]
    fn a_place_holds_until_the_next_and_an_old_one_is_not_fresh() {
        let mut poses = Poses::default();
        for (link, tick) in [(1, 0), (1, 20), (1, 40), (1, 20), (99, 0)] {
            let of = format!("/world/arm/link{link}");
            poses.place(tick, &of, [tick as f32, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
        }
        assert_eq!(
            (poses.links.len(), poses.ticks().collect::<Vec<_>>()),
            (1, vec![0, 20, 40])
        );
        let link = &poses.links[0];
        assert_eq!(link.at(35).map(|at| at.p.x), Some(20.0));
        assert!(link.fresh(90, 30).is_none() && link.fresh(60, 30).is_some());
        assert_eq!(link.between(10, 40).len(), 2);
    }
}
