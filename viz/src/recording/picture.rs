//! The picture of a tick: ghosts, paths, and poses.

use glam::Vec3;
use re_sdk_types::archetypes::{InstancePoses3D, LineStrips3D};
use re_sdk_types::components::Color;
use shared_types::MAX_DOF;

use super::columns::{Picture, Track};
use super::marks::UNSEEN;
use super::pieces::{ghost3d, lettered, quaternion};
use super::state::Recording;
use crate::scene::differs;
use crate::solid::{Placement, Rgba};
use crate::{blueprint, entity, scene};

impl Recording {
    /// Where the arm has been in the present null-space motion.
    pub(super) fn write_ghosts(&mut self, tick: u64, all: bool) {
        let postures: Vec<[Placement; MAX_DOF]> = self
            .story
            .motion
            .postures
            .iter()
            .map(|q| self.links(q))
            .collect();
        let (now, before) = match postures.split_last() {
            Some((now, before)) => (Some(now), before),
            None => (None, &[][..]),
        };
        for i in 0..self.run.figure.links.len() {
            let places: Vec<&Placement> = before
                .iter()
                .map(|links| &links[i])
                .filter(|link| now.is_some_and(|now| differs(link, &now[i])))
                .collect();
            let none_before = std::mem::replace(&mut self.story.ghosts[i], places.len()) == 0;
            // A mesh is large: a link that has no ghosts needs none.
            if places.is_empty() && !self.part.ghost_drawn[i] {
                continue;
            }
            if !std::mem::replace(&mut self.part.ghost_drawn[i], true) {
                let pale = ghost3d(&self.run.figure.links[i], [150, 205, 255, 110]);
                self.log(tick, entity::ghost(i), &pale);
            }
            let poses = InstancePoses3D::new();
            let poses = match places.is_empty() {
                true if none_before && !all => continue,
                // No instances would mean the mesh itself, at the origin: one too small to see instead.
                true => poses
                    .with_translations([[0.0; 3]])
                    .with_scales([[UNSEEN; 3]]),
                false => poses
                    .with_translations(places.iter().map(|link| link.p.to_array()))
                    .with_quaternions(places.iter().map(|link| quaternion(link)))
                    .with_scales(vec![[0.985; 3]; places.len()]),
            };
            self.log(tick, entity::ghost(i), &poses);
        }
        self.write_trail(tick, &postures);
    }

    /// The ways of the joints that have moved.
    fn write_trail(&self, tick: u64, postures: &[[Placement; MAX_DOF]]) {
        let trail = |i: usize| -> Vec<[f32; 3]> {
            postures.iter().map(|links| links[i].p.to_array()).collect()
        };
        let moved = |strip: &Vec<[f32; 3]>| {
            let mut steps = strip.windows(2);
            steps.any(|pair| Vec3::from(pair[0]).distance(Vec3::from(pair[1])) > 0.005)
        };
        let strips = (0..self.run.figure.links.len()).map(trail).filter(moved);
        let strips = LineStrips3D::new(strips)
            .with_colors([Color::from_unmultiplied_rgba(150, 205, 255, 160)])
            .with_radii([0.002 * self.run.figure.reach]);
        self.log(tick, entity::TRAIL, &strips);
    }

    /// How far each joint has turned in the present null-space motion, in the colours that the plots have for them.
    pub(super) fn write_turned(&mut self, tick: u64, links: &[Placement], turned: &[f64]) {
        let most = turned
            .iter()
            .fold(0.0f64, |most, angle| most.max(angle.abs()));
        let joints = self
            .run
            .figure
            .rings
            .iter()
            .zip(links)
            .zip(turned)
            .zip(blueprint::JOINTS)
            .enumerate();
        let arcs = joints.filter_map(|(i, (((ring, X_BL), angle), [r, g, b, _]))| {
            // Those that move most, each with its words: an arc without any is a hook that belongs to nothing.
            let ring = ring
                .as_ref()
                .filter(|_| angle.abs() > (0.5 * most).max(0.06))?;
            Some((
                scene::turning(ring, X_BL, *angle as f32),
                [r, g, b, 255],
                format!("q{} {:+.0}°", i + 1, angle.to_degrees()),
            ))
        });
        let (mut strips, mut colours, mut words) = (Vec::new(), Vec::new(), Vec::<String>::new());
        // Words of arcs next to each other would lie over each other: they share a place.
        let near = 0.8 * self.mark_size();
        let place = |strip: &[[f32; 3]]| {
            strip.iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / strip.len().max(1) as f32
        };
        for (strip, colour, word) in arcs {
            let beside = |(other, words): (&Vec<[f32; 3]>, &String)| {
                !words.is_empty() && place(other).distance(place(&strip)) < near
            };
            let shared = strips.iter().zip(&words).position(beside);
            words.push(String::new());
            let last = words.len() - 1;
            match shared {
                Some(first) => words[first] += &format!(", {word}"),
                None => words[last] = word,
            }
            strips.push(strip);
            colours.push(colour);
        }
        let radius = 0.004 * self.run.figure.reach;
        self.log(
            tick,
            entity::TURNED,
            &lettered(strips, colours, words, radius),
        );
    }

    pub(super) fn write_picture(&mut self) {
        let Some(picture) = self.picture.take() else {
            return;
        };
        let mut tracks: Vec<(String, &Track)> = vec![
            (entity::HAND.to_owned(), &picture.hand),
            (entity::TARGET.to_owned(), &picture.target),
            (entity::VELOCITY.to_owned(), &picture.abilities[0]),
            (entity::MOBILITY.to_owned(), &picture.abilities[1]),
        ];
        let count = self.run.figure.links.len();
        tracks.extend((0..count).map(entity::link).zip(&picture.links));
        for ((name, _), mark) in self.subject.singularities.iter().zip(&picture.marks) {
            tracks.extend([
                (entity::singularity(name), &mark.frame),
                (entity::glyph(name), &mark.size),
                (entity::label(name), &mark.label),
            ]);
        }
        let rival = self.rival.as_mut();
        let rival = rival.map(|rival| std::mem::take(&mut rival.links));
        let rival = rival.unwrap_or_default();
        tracks.extend((0..count).map(entity::rival_link).zip(&rival));
        for (path, track) in tracks {
            if !track.ticks.is_empty() {
                self.send_columns(&path, &track.ticks, track.columns());
            }
        }
        self.write_paths(&picture);
    }

    fn write_paths(&mut self, picture: &Picture) {
        if let Some(rival) = &mut self.rival {
            let path = std::mem::take(&mut rival.path);
            rival.path.extend(path.last());
            self.write_path(entity::RIVAL_PATH, &path, [255, 90, 80, 255], 0.0045);
        }
        let (actual, desired) = (&picture.actual, &picture.desired);
        if self.subject.stands_still {
            let off = actual.iter().zip(desired);
            let off =
                off.map(|((tick, p), (_, p_d))| (*tick, *p_d + (*p - *p_d) * entity::MAGNIFIED));
            let off: Vec<_> = off.collect();
            self.write_path(entity::PATH_MAGNIFIED, &off, [255, 176, 46, 255], 0.006);
        }
        self.write_path(entity::PATH_ACTUAL, actual, [240, 240, 245, 255], 0.0035);
        self.write_path(entity::PATH_DESIRED, desired, [110, 235, 150, 255], 0.006);
    }

    /// A path in pieces of a tenth of a second, each a row, so that it grows with the cursor.
    pub(super) fn write_path(
        &self,
        path: &str,
        points: &[(u64, Vec3)],
        [r, g, b, a]: Rgba,
        radius: f32,
    ) {
        const PIECE: usize = 5;
        let mut from = 0;
        while from + 1 < points.len() {
            let to = (from + PIECE).min(points.len() - 1);
            let piece = points[from..=to].iter().map(|(_, p)| p.to_array());
            let piece: Vec<[f32; 3]> = piece.collect();
            if Vec3::from(piece[0]).distance(points[to].1) > 1e-4 {
                let strip = LineStrips3D::new([piece])
                    .with_colors([Color::from_unmultiplied_rgba(r, g, b, a)])
                    .with_radii([radius * self.run.figure.reach]);
                self.log(points[to].0, path, &strip);
            }
            from = to;
        }
    }
}
