//! The picture of a tick: marks, ghosts, paths.

use glam::Vec3;
use nalgebra::SVector;
use re_chunk::{Chunk, RowId};
use re_sdk_types::archetypes::{Arrows3D, Clear, InstancePoses3D, LineStrips3D, Points3D, Transform3D};
use re_sdk_types::components::{Color, Radius};
use shared_types::MAX_DOF;
use shared_types::messages::SingularityState;

use super::columns::{MarkTracks, Track};
use super::pieces::{mesh3d, quaternion, tinted};
use super::state::Recording;
use crate::arm::placement;
use crate::scene::{Mark, Presence, differs, glyph};
use crate::solid::{Placement, Rgba};
use crate::{blueprint, entity, narration, scene};

/// A size that cannot be seen. Nothing else hides a mesh that is to come back: none would be its own size, and a cleared one had to be
/// written again.
pub(super) const UNSEEN: f32 = 1e-6;

impl Recording {
    /// Marks change their looks rarely; their places go with the picture.
    pub(super) fn write_marks(&mut self, tick: u64, singularities: &[SingularityState], marks: &[Mark]) {
        for (i, (one, mark)) in singularities.iter().zip(marks).enumerate() {
            let Some((name, _)) = self.subject.singularities.get(i) else { return };
            let (name, fan) = (name.clone(), entity::fan(name));
            if self.marks[i] != mark.look {
                self.marks[i] = mark.look;
                self.write_look(tick, &name, i, mark, &narration::label(one, i));
            }
            let inside = mark.look.presence == Presence::Inside;
            let zeta = mark.zeta();
            // Where ζ was on entry, then every 6°: null-space motion that turns it sweeps a fan, and what stays has none.
            let turned = self.fans[i].is_some_and(|last| last.dot(zeta).abs() < 0.9945);
            if !inside {
                self.fans[i] = None;
            } else if self.fans[i].is_none() {
                self.fans[i] = Some(zeta);
            } else if turned {
                let last = self.fans[i].replace(zeta).unwrap_or(zeta);
                let reach = last * (0.9 * self.mark_size());
                let (from, to) = (mark.X_BS.p - reach, mark.X_BS.p + reach);
                let [r, g, b, _] = narration::colour_of_type(mark.look.class);
                let line = LineStrips3D::new([[from.to_array(), to.to_array()]])
                    .with_colors([Color::from_unmultiplied_rgba(r, g, b, 110)])
                    .with_radii([0.0014 * self.figure.reach]);
                self.log(tick, fan, &line);
            }
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame and the words.
    pub(super) fn write_look(&mut self, tick: u64, name: &str, i: usize, mark: &Mark, words: &str) {
        let path = entity::singularity(name);
        let [solid, rings, axes, label] = [entity::glyph(name), entity::edge(name), format!("{path}/axes"), entity::label(name)];
        let [r, g, b, _] = narration::colour_of_type(mark.look.class);
        let unit = self.mark_size();
        // Meshes are large: they are written once, later changes are their tint and their size.
        let shape = (mark.look.class, mark.look.angular);
        if self.drawn[i] != Some(shape) && mark.look.presence != Presence::Hidden {
            self.drawn[i] = Some(shape);
            self.log(tick, &*solid, &mesh3d(&glyph(mark.look.angular, [r, g, b, 255]), None));
            self.log(tick, &*rings, &mesh3d(&scene::rings(mark.edge, unit, [255; 4]), None));
        }
        let is_inside = mark.look.presence == Presence::Inside;
        if mark.look.presence == Presence::Hidden {
            for path in [solid, rings] {
                self.log(tick, path, &Transform3D::update_fields().with_scale(UNSEEN));
            }
        } else {
            let opacity = if is_inside { 255 } else { 70 };
            let rim = if is_inside { [255, 110, 110, 255] } else { [190, 195, 205, 255] };
            self.log(tick, solid, &tinted([255, 255, 255, opacity]));
            self.log(tick, &*rings, &tinted(rim));
            self.log(tick, rings, &Transform3D::update_fields().with_scale(1.0));
        }
        if is_inside {
            let frame = Arrows3D::from_vectors([[0.0, 0.5 * unit, 0.0], [0.0, 0.0, 0.5 * unit]]);
            self.log(tick, axes, &frame.with_colors([0xc8d0dcff_u32]).with_radii([0.012 * unit]));
            let point = Points3D::new([[0.0; 3]]).with_radii([Radius::new_ui_points(0.5)]).with_colors([Color::from_rgb(r, g, b)]);
            self.log(tick, label, &point.with_labels([words]).with_show_labels(true));
        } else {
            self.log(tick, axes, &Clear::flat());
            self.log(tick, label, &Clear::flat());
        }
    }

    /// Where the arm has been in the present null-space motion.
    pub(super) fn write_ghosts(&mut self, tick: u64, all: bool) {
        let postures: Vec<[Placement; MAX_DOF]> =
            self.motion.postures.iter().map(|q| self.arm.link_poses(&SVector::from_column_slice(q)).map(|X| placement(&X))).collect();
        let (now, before) = match postures.split_last() {
            Some((now, before)) => (Some(now), before),
            None => (None, &[][..]),
        };
        for i in 0..self.figure.links.len() {
            let places: Vec<&Placement> =
                before.iter().map(|links| &links[i]).filter(|link| now.is_some_and(|now| differs(link, &now[i]))).collect();
            let none_before = std::mem::replace(&mut self.ghosts[i], places.len()) == 0;
            let poses = InstancePoses3D::new();
            let poses = match places.is_empty() {
                true if none_before && !all => continue,
                // No instances would mean the mesh itself, at the origin: one too small to see instead.
                true => poses.with_translations([[0.0; 3]]).with_scales([[UNSEEN; 3]]),
                false => poses
                    .with_translations(places.iter().map(|link| link.p.to_array()))
                    .with_quaternions(places.iter().map(|link| quaternion(link)))
                    .with_scales(vec![[0.985; 3]; places.len()]),
            };
            self.log(tick, entity::ghost(i), &poses);
        }
        let trail = |i: usize| -> Vec<[f32; 3]> { postures.iter().map(|links| links[i].p.to_array()).collect() };
        let moved = |strip: &Vec<[f32; 3]>| strip.windows(2).any(|pair| Vec3::from(pair[0]).distance(Vec3::from(pair[1])) > 0.005);
        let strips: Vec<Vec<[f32; 3]>> = (0..self.figure.links.len()).map(trail).filter(moved).collect();
        self.log(
            tick,
            entity::TRAIL,
            &LineStrips3D::new(strips)
                .with_colors([Color::from_unmultiplied_rgba(150, 205, 255, 160)])
                .with_radii([0.002 * self.figure.reach]),
        );
    }

    /// How far each joint has turned in the present null-space motion, in the colours that the plots have for them.
    pub(super) fn write_turned(&mut self, tick: u64, links: &[Placement], turned: &[f64]) {
        let most = turned.iter().fold(0.0f64, |most, angle| most.max(angle.abs()));
        let joints = self.figure.rings.iter().zip(links).zip(turned).zip(blueprint::JOINTS).enumerate();
        let arcs = joints.filter_map(|(i, (((ring, X_BL), angle), [r, g, b, _]))| {
            let ring = ring.as_ref().filter(|_| angle.abs() > 0.06)?;
            // Words at those that move most.
            let words = if angle.abs() > 0.6 * most { format!("q{} {:+.0}°", i + 1, angle.to_degrees()) } else { String::new() };
            Some((scene::turning(ring, X_BL, *angle as f32), Color::from_rgb(r, g, b), words))
        });
        let (mut strips, mut colours, mut words) = (Vec::new(), Vec::new(), Vec::new());
        for (strip, colour, word) in arcs {
            strips.push(strip);
            colours.push(colour);
            words.push(word);
        }
        let radius = 0.004 * self.figure.reach;
        let arcs = LineStrips3D::new(strips).with_colors(colours).with_radii([radius]).with_labels(words).with_show_labels(true);
        self.log(tick, entity::TURNED, &arcs);
    }

    pub(super) fn write_picture(&mut self) {
        let Some(picture) = self.picture.take() else { return };
        self.written.picture = picture.hand.ticks.last().map_or(self.written.picture, |last| last + 1);
        let mut tracks: Vec<(String, Track)> = Vec::new();
        tracks.extend((0..self.figure.links.len()).map(entity::link).zip(picture.links));
        tracks.extend([(entity::HAND.to_owned(), picture.hand), (entity::TARGET.to_owned(), picture.target)]);
        let [velocity, mobility] = picture.abilities;
        tracks.extend([(entity::VELOCITY.to_owned(), velocity), (entity::MOBILITY.to_owned(), mobility)]);
        for ((name, _), MarkTracks { frame, size, label }) in self.subject.singularities.iter().zip(picture.marks) {
            tracks.extend([(entity::singularity(name), frame), (entity::glyph(name), size), (entity::label(name), label)]);
        }
        for (path, track) in tracks {
            if !track.ticks.is_empty() {
                let ticks = track.ticks.clone();
                let chunk = self.chunk_of(&path, &ticks, track.columns());
                self.sink.chunk(&self.store, chunk);
            }
        }
        self.write_path(entity::PATH_ACTUAL, &picture.actual, [240, 240, 245, 255], 0.0035);
        self.write_path(entity::PATH_DESIRED, &picture.desired, [110, 235, 150, 255], 0.006);
    }

    /// A path in pieces of a tenth of a second, each a row, so that it grows with the cursor.
    pub(super) fn write_path(&mut self, path: &str, points: &[(u64, Vec3)], [r, g, b, a]: Rgba, radius: f32) {
        const PIECE: usize = 5;
        let mut chunk = Chunk::builder(path);
        let mut any = false;
        let mut from = 0;
        while from + 1 < points.len() {
            let to = (from + PIECE).min(points.len() - 1);
            let piece: Vec<[f32; 3]> = points[from..=to].iter().map(|(_, p)| p.to_array()).collect();
            if Vec3::from(piece[0]).distance(points[to].1) > 1e-4 {
                let strip = LineStrips3D::new([piece])
                    .with_colors([Color::from_unmultiplied_rgba(r, g, b, a)])
                    .with_radii([radius * self.figure.reach]);
                chunk = chunk.with_archetype(RowId::new(), self.at(points[to].0), &strip);
                any = true;
            }
            from = to;
        }
        if any {
            self.sink.chunk(&self.store, chunk.build());
        }
    }

    pub(super) fn mark_size(&self) -> f32 {
        0.2 * self.figure.reach
    }
}
