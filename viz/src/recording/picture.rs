//! The picture of a tick: arm, path, ellipsoids, ghosts; and another law's arm, in a race.

use glam::Vec3;
use nalgebra::SVector;
use re_sdk_types::archetypes::{Clear, InstancePoses3D, TextDocument};
use re_sdk_types::components::Radius;
use re_sdk_types::datatypes::Quaternion;
use rerun::AsComponents;
use shared_types::MAX_DOF;

use super::shapes::{arrows, coloured, ghost3d, lines, mesh3d};
use super::{Recording, Track};
use crate::arm::{placement, pose, vec3};
use crate::blueprint::{JOINTS, MAGNIFIED};
use crate::entity;
use crate::manipulability::{Ellipsoid, Half};
use crate::scene::{self, Mark, Presence, differs, rotation};
use crate::signals::TickRow;
use crate::solid::{Mesh, Placement, Rgba};

/// A size that cannot be seen. Nothing else hides a mesh that is to come back: none would be its own size, and a cleared one had to be
/// written again.
pub(super) const UNSEEN: f32 = 1e-6;
/// The hand's reachable speeds, and its accelerations under unit forces.
const ABILITIES: [&str; 2] = [
    "/world/manipulability/velocity",
    "/world/manipulability/mobility",
];
/// Where a link has been in null-space motion; its number follows.
const GHOST: &str = "/world/null_motion/link";
/// A link of the other law's arm, in a race.
const RIVAL: &str = "/world/rival/link";
const PALE: Rgba = 0xaadcffff;
/// The lines that grow: path, colour, radius over the arm's reach.
const WAYS: [(&str, Rgba, f32); 5] = [
    (entity::PATH_RIVAL, 0xff5a50ff, 0.0045),
    (entity::PATH_MAGNIFIED, 0xffb02eff, 0.006),
    (entity::PATH_ACTUAL, 0xf0f0f5ff, 0.0035),
    (entity::PATH_DESIRED, 0x6eeb96ff, 0.006),
    (entity::PATH_ELBOW, PALE, 0.004),
];

impl Recording<'_> {
    /// What stands in the picture from the beginning.
    pub(super) fn write_figure(&mut self) {
        self.sink
            .log_static("/world/arm/base", &mesh3d(&self.run.figure.base));
        for (i, link) in self.run.figure.links.iter().enumerate() {
            self.sink
                .log_static(entity::link(entity::LINK, i), &mesh3d(link));
        }
        let size = 0.11 * self.run.figure.reach;
        let hand = arrows(
            Vec3::ZERO,
            Vec3::AXES.map(|axis| axis * size),
            0xffffffff,
            0.03 * size,
        );
        let hand = hand.with_colors([0xf05050ff_u32, 0x60d060ff, 0x5090ffff]);
        self.sink.log_static(entity::HAND, &hand);
        let axes = Vec3::AXES.map(|axis| axis * (1.35 * size));
        self.sink.log_static(
            entity::TARGET,
            &arrows(Vec3::ZERO, axes, 0x90f0b0ff, 0.018 * size),
        );
        let mut ball = Mesh::default();
        ball.add_sphere(Placement::IDENTITY, 1.0, 0xffffffff);
        let body = mesh3d(&ball).with_albedo_factor(0x5aaaff3c);
        self.sink.log_static(ABILITIES[0], &body);
        let circle = |(x, y): (Vec3, Vec3)| {
            (0..=48).map(move |k| {
                let (sin, cos) = (std::f32::consts::TAU * k as f32 / 48.0).sin_cos();
                x * cos + y * sin
            })
        };
        let circles = [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)];
        if self.run.rival.is_some() {
            self.write_rival();
        }
        let net = lines(circles.map(circle), 0x96ebe1ff, Radius::new_ui_points(1.0));
        self.sink.log_static(ABILITIES[1], &net);
    }

    pub(super) fn see(&mut self, row: &TickRow) {
        let Some(q) = row.q() else { return };
        let (tick, links) = (row.tick, self.run.links(q));
        let desired = row
            .control_state
            .map(|command| pose(&command.p_BE_d, &command.R_BE_d));
        let kinematic = || placement(&self.run.arm.forward_kinematics(&SVector::from(*q)));
        let hand = row.plant_state.map(|state| pose(&state.p_BE, &state.R_BE));
        let hand = hand.unwrap_or_else(kinematic);
        let mark = |one| row.singularity.map(|report| Mark::new(one, report.p_BC));
        let marks: Vec<Mark> = row.singularities().iter().filter_map(mark).collect();
        self.write_marks(row, q, &marks, &hand);
        self.write_target(row, &hand, desired.as_ref());
        if self.motion.null.update(row) {
            self.write_ghosts(tick);
        }
        self.write_turned(tick, &links);
        let corners = self.run.figure.corners(&links);
        self.motion.room.push(corners, hand.p);
        self.motion
            .stretches
            .push(tick, row.singularities(), &marks, hand.p);
        for (i, link) in links[..self.run.figure.links.len()].iter().enumerate() {
            self.place(entity::link(entity::LINK, i), tick, *link);
        }
        let joints = self.subject.joints;
        if joints > self.run.task.iter().filter(|served| **served).count() {
            self.picture.ways[4].push((tick, links[joints / 2].p));
        }
        self.place(entity::HAND.to_owned(), tick, hand);
        self.picture.ways[2].push((tick, hand.p));
        if let Some(desired) = desired {
            self.place(entity::TARGET.to_owned(), tick, desired);
            self.picture.ways[3].push((tick, desired.p));
            if self.subject.stands_still {
                self.picture.ways[1].push((tick, desired.p + (hand.p - desired.p) * MAGNIFIED));
            }
        }
        self.place_marks(tick, &marks);
        self.write_captions(row, &marks, hand.p);
        if let Some(report) = row.singularity {
            self.see_abilities(row, q, report.p_BC, &marks);
        }
    }

    /// The hand's mobility, at C, in the half of the twist that the nearest singularity is of.
    fn see_abilities(&mut self, row: &TickRow, q: &[f64; MAX_DOF], p_BC: [f64; 3], marks: &[Mark]) {
        let nearness = |one: &shared_types::SingularityState| one.s.abs() / one.eta_out;
        let near = row.singularities().iter().zip(marks);
        let near = near.filter(|(_, mark)| mark.look.presence != Presence::Hidden);
        let nearest = near.min_by(|a, b| nearness(a.0).total_cmp(&nearness(b.0)));
        let half = match nearest {
            Some((one, _)) if one.angular == 1 => Half::Angular,
            _ => Half::Linear,
        };
        let q = SVector::from(*q);
        let J = self.run.jacobian(&q, p_BC);
        let shapes = [
            Some(Ellipsoid::velocity(&J, self.run.arm.velocity(), half)),
            Ellipsoid::mobility(&J, &self.run.arm.mass_matrix(&q), half),
        ];
        for (path, shape) in ABILITIES.into_iter().zip(shapes) {
            if let Some(Ellipsoid { axes, half_axes }) = shape {
                // Flat, but not so flat that it has no sides.
                let size = half_axes.max(Vec3::splat(0.012)) * 0.62 * self.run.mark_size();
                let track = self.track(path.to_owned(), row.tick);
                let (R, p) = (axes, vec3(&p_BC.into()));
                track.places.push(Placement { R, p });
                track.sizes.push(size.to_array());
            }
        }
    }

    /// A row of a track of what is drawn.
    pub(super) fn track(&mut self, path: String, tick: u64) -> &mut Track {
        let track = self.picture.tracks.entry(path).or_default();
        track.ticks.push(tick);
        track
    }

    pub(super) fn place(&mut self, path: String, tick: u64, at: Placement) {
        self.track(path, tick).places.push(at);
    }

    /// Draws what can be cleared again.
    pub(super) fn draw(&mut self, tick: u64, path: String, archetype: &dyn AsComponents) {
        self.sink.log(tick, &path, archetype);
        self.picture.drawn.insert(path);
    }

    /// Clears what has been drawn.
    pub(super) fn clear(&mut self, tick: u64, paths: impl IntoIterator<Item = String>) {
        for path in paths {
            if self.picture.drawn.remove(&path) {
                self.sink.log(tick, &path, &Clear::flat());
            }
        }
    }

    /// Where the arm has been in the present null-space motion.
    pub(super) fn write_ghosts(&mut self, tick: u64) {
        let postures = self.motion.null.postures.iter();
        let postures: Vec<[Placement; MAX_DOF]> = postures.map(|q| self.run.links(q)).collect();
        for i in 0..self.run.figure.links.len() {
            let mut places: Vec<Placement> = postures.iter().map(|links| links[i]).collect();
            let now = places.pop();
            places.retain(|link| now.is_some_and(|now| differs(link, &now)));
            // No instances would mean the mesh itself, at the origin: one too small to see instead.
            let size = if places.is_empty() { UNSEEN } else { 0.985 };
            let path = entity::link(GHOST, i);
            let is_known = self.picture.drawn.contains(&path);
            // A mesh is large: a link that has no ghosts needs none.
            let had = std::mem::replace(&mut self.picture.ghosts[i], places.len());
            if places.is_empty() && had == 0 {
                continue;
            }
            if !is_known {
                let pale = ghost3d(&self.run.figure.links[i], 0x96cdff6e);
                self.draw(tick, path.clone(), &pale);
            }
            if places.is_empty() {
                places.push(Placement::IDENTITY);
            }
            let turn = |link: &Placement| Quaternion::from_xyzw(rotation(link).to_array());
            let poses = InstancePoses3D::new()
                .with_translations(places.iter().map(|link| link.p.to_array()))
                .with_quaternions(places.iter().map(turn))
                .with_scales(vec![[size; 3]; places.len()]);
            self.sink.log(tick, path, &poses);
        }
        // The ways of the joints that have moved.
        let trail = |i: usize| -> Vec<Vec3> { postures.iter().map(|links| links[i].p).collect() };
        let moved = |strip: &Vec<Vec3>| {
            let mut steps = strip.windows(2);
            steps.any(|pair| pair[0].distance(pair[1]) > 0.005)
        };
        let strips = (0..self.run.figure.links.len()).map(trail).filter(moved);
        let trail = lines(strips, PALE, 0.005 * self.run.figure.reach);
        self.sink.log(tick, "/world/null_motion/trail", &trail);
    }

    /// How far each joint has turned in the present null-space motion, in the colours that the plots have for them.
    fn write_turned(&mut self, tick: u64, links: &[Placement]) {
        if !self.motion.null.has_turned() {
            return;
        }
        let arc = |(i, angle): (usize, f64)| {
            let ring = self.run.figure.rings.get(i)?.as_ref()?;
            Some((scene::turning(ring, &links[i], angle as f32), JOINTS[i]))
        };
        let arcs = self.motion.null.most().filter_map(arc);
        let arcs = coloured(arcs, self.run.fine());
        self.sink.log(tick, entity::TURNED, &arcs);
    }

    pub(super) fn write_picture(&mut self) {
        for (path, track) in std::mem::take(&mut self.picture.tracks) {
            self.sink.send_columns(&path, &track.ticks, track.columns());
        }
        for (way, (path, colour, radius)) in WAYS.into_iter().enumerate() {
            let points = std::mem::take(&mut self.picture.ways[way]);
            self.picture.ways[way].extend(points.last());
            // Pieces of a tenth of a second, each a row, so that the line grows with the cursor.
            let mut from = 0;
            while from + 1 < points.len() {
                let to = (from + 5).min(points.len() - 1);
                if points[from].1.distance(points[to].1) > 1e-4 {
                    let piece = points[from..=to].iter().map(|(_, p)| *p);
                    let strip = lines([piece], colour, radius * self.run.figure.reach);
                    self.sink.log(points[to].0, path, &strip);
                }
                from = to;
            }
        }
    }

    /// The pose of the other law's arm, and Markdown that compares both so far. The words replace those about singularities.
    pub(super) fn see_rival(&mut self, tick: u64) {
        let Some(rival) = self.run.rival else { return };
        // A rival that is done stays where it is.
        let place = (tick / rival.every.max(1)) as usize;
        let Some(q) = rival.postures.get(place).or(rival.postures.last()) else {
            return;
        };
        for (i, link) in self.run.links(q)[..self.run.figure.links.len()]
            .iter()
            .enumerate()
        {
            self.place(entity::link(RIVAL, i), tick, *link);
        }
        let hand = vec3(&self.run.arm.forward_kinematics(&SVector::from(*q)).p);
        self.picture.ways[0].push((tick, hand));
        let words = rival.words.get(place).or(rival.words.last());
        if let Some(words) = words.filter(|words| **words != self.picture.told) {
            self.picture.told.clone_from(words);
            let document = TextDocument::from_markdown(words.as_str());
            self.sink.log(tick, entity::NOW, &document);
        }
    }

    /// The other law's links, a little inside the solid arm, which hides them where both are in one place.
    fn write_rival(&self) {
        let inwards = -0.004 * self.run.figure.reach;
        for (i, link) in self.run.figure.links.iter().enumerate() {
            let mut mesh = link.clone();
            for (p, normal) in mesh.positions.iter_mut().zip(&mesh.normals) {
                *p += inwards * *normal;
            }
            let pale = ghost3d(&mesh, 0xff50468c);
            self.sink.log_static(entity::link(RIVAL, i), &pale);
        }
    }
}
