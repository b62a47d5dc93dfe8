//! The picture of a tick: arm, paths, ellipsoids, ghosts; and another law's arm, in a race.

use glam::{Affine3, Vec3};
use nalgebra::SVector;
use re_sdk_types::archetypes::{
    Arrows3D, Boxes3D, Capsules3D, Cylinders3D, Ellipsoids3D, InstancePoses3D, LineStrips3D, Mesh3D,
};
use re_sdk_types::components::{FillMode, Radius};
use re_sdk_types::{AsComponents, SerializedComponentBatch};

use super::rows::quaternion;
use super::{Recording, Track};
use crate::blueprint::MAGNIFIED;
use crate::body::{Form, Part};
use crate::entity;
use crate::manipulability::Ellipsoid;
use crate::picture::{Picture, nearness};
use crate::pose::{Rgba, vec3};
use crate::run::Tick;
use crate::scene::differs;
use crate::tint::faded;

/// The hand's reachable speeds, and its accelerations under unit forces.
const ABILITIES: [&str; 2] = [
    "/world/manipulability/velocity",
    "/world/manipulability/mobility",
];
/// Postures of null-space motion; a link of the other law's arm in a race, its number follows.
const GHOST: &str = "/world/null_motion";
const RIVAL: &str = "/world/rival/link";
const PALE: Rgba = 0x78b4f0ff;
/// Colours and radii, over the arm's reach, of the lines that grow.
const WAYS: [(Rgba, f32); 5] = [
    (0xff5a50ff, 0.0045),
    (0xffb02eff, 0.006),
    (0x9aa4b4ff, 0.0035),
    (0x4fd07aff, 0.006),
    (PALE, 0.004),
];
/// Parts in another one's place are a little smaller, which hides them.
const INWARDS: f32 = 0.985;

pub(super) fn array(places: impl IntoIterator<Item = Vec3>) -> Vec<[f32; 3]> {
    places.into_iter().map(|p| p.to_array()).collect()
}

/// Lines of one colour and radius.
pub(super) fn lines<S: IntoIterator<Item = Vec3>>(
    strips: impl IntoIterator<Item = S>,
    colour: Rgba,
    radius: impl Into<Radius>,
) -> LineStrips3D {
    LineStrips3D::new(strips.into_iter().map(array))
        .with_colors([colour])
        .with_radii([radius])
}

/// Arrows of one colour and radius.
pub(super) fn arrows(
    arrows: impl IntoIterator<Item = [Vec3; 2]>,
    colour: Rgba,
    radius: f32,
) -> Arrows3D {
    let (origins, vectors): (Vec<_>, Vec<_>) = arrows.into_iter().map(|[p, v]| (p, v)).unzip();
    Arrows3D::from_vectors(array(vectors))
        .with_origins(array(origins))
        .with_colors([colour])
        .with_radii([radius])
}

/// Axes at the origin.
fn axes(size: f32) -> impl Iterator<Item = [Vec3; 2]> {
    Vec3::AXES
        .into_iter()
        .map(move |axis| [Vec3::ZERO, axis * size])
}

impl Recording<'_> {
    /// The parts that stand in the picture from the beginning.
    pub(super) fn write_arm(&mut self) {
        let body = &self.run.body;
        self.write_parts("/world/arm/base", body.of(None), None);
        for i in 0..self.run.joints() {
            self.write_parts(&entity::link(entity::LINK, i), body.of(Some(i)), None);
            if self.run.happened.rival.is_some() {
                let red = Some(0xff50468c);
                self.write_parts(&entity::link(RIVAL, i), body.of(Some(i)), red);
            }
        }
        let surfaces: Vec<_> = self
            .run
            .job
            .scenario
            .plant
            .surface
            .iter()
            .map(|one| Part::surface(one, body.reach))
            .collect();
        self.write_parts("/world/surface", surfaces.iter(), None);
        let size = 0.11 * body.reach;
        let hand = arrows(axes(size), 0xe8ecf4ff, 0.03 * size);
        self.sink.log_static(entity::HAND, &hand);
        let target = arrows(axes(1.35 * size), 0x4fd07aff, 0.018 * size);
        self.sink.log_static(entity::TARGET, &target);
        for (path, colour, mode) in [
            (ABILITIES[0], 0x5aaaff3c, FillMode::Solid),
            (ABILITIES[1], 0x50c8b4ff, FillMode::MajorWireframe),
        ] {
            let ball = Ellipsoids3D::from_radii([1.0])
                .with_colors([colour])
                .with_line_radii([Radius::new_ui_points(0.75)]);
            self.sink.log_static(path, &ball.with_fill_mode(mode));
        }
    }

    /// Parts that stay in the frame of their link, each in its colour or all in one tint and a little smaller.
    fn write_parts<'p>(
        &mut self,
        path: &str,
        parts: impl Iterator<Item = &'p Part>,
        tint: Option<Rgba>,
    ) {
        let size = tint.map_or(1.0, |_| INWARDS);
        for (k, part) in parts.enumerate() {
            let path = format!("{path}/{k}");
            let shape = solid(part, tint.unwrap_or(part.colour));
            self.sink.log_static(path.as_str(), &shape);
            self.sink.log_static(path, &poses(part, &[part.at], size));
        }
    }

    /// The picture of a tick.
    pub(super) fn draw(&mut self, row: &Tick, picture: &Picture) {
        let (tick, links, hand) = (row.tick, &picture.links, picture.hand);
        let joints = self.run.joints();
        for (i, link) in links[..joints].iter().enumerate() {
            self.place(entity::link(entity::LINK, i), tick, *link);
        }
        self.place(entity::HAND, tick, hand);
        let near = Affine3::from_translation(hand.translation);
        self.place(entity::NEAR, tick, near);
        self.ways[2].push((tick, hand.translation));
        if let Some(desired) = picture.desired {
            self.place(entity::TARGET, tick, desired);
            self.ways[3].push((tick, desired.translation));
            if self.run.stands_still {
                let off = hand.translation - desired.translation;
                self.ways[1].push((tick, desired.translation + off * MAGNIFIED));
            }
        }
        // The way of the elbow of an arm whose joints can move while its hand stands still.
        if joints > self.run.robot.task.count() {
            self.ways[4].push((tick, links[joints / 2].translation));
        }
        self.draw_ghosts(picture);
        self.draw_marks(row, picture);
        self.draw_target(row, picture);
        self.draw_force(row, picture);
        self.draw_abilities(row, picture);
        self.draw_rival(tick);
    }

    /// Postures gone through in the present null-space motion, on both sides of a lock, where they differ from the present one. The shape of a part, which
    /// may be large, is written once. If it has no place it gets a size that cannot be seen, for without a place it would stand at the origin.
    fn draw_ghosts(&mut self, picture: &Picture) {
        let key = format!("{:?}", picture.postures);
        if self.shown.get(GHOST).map_or("[]", String::as_str) == key {
            return;
        }
        self.shown.insert(GHOST.to_owned(), key);
        let postures: Vec<_> = picture.postures.iter().map(|q| self.run.links(q)).collect();
        for (k, part) in self.run.body.parts.iter().enumerate() {
            let (Some(link), path) = (part.link, format!("{GHOST}/{k}")) else {
                continue;
            };
            let links = postures.iter().map(|links| &links[link]);
            let places: Vec<_> = links
                .filter(|ghost| differs(ghost, &picture.links[link]))
                .map(|ghost| *ghost * part.at)
                .collect();
            let poses = match places[..] {
                [] if !self.shown.contains_key(&path) => continue,
                [] => poses(part, &[Affine3::IDENTITY], 1e-6),
                _ => poses(part, &places, INWARDS),
            };
            let shape = || solid(part, faded(PALE, 0x50));
            self.show(picture.tick, path.clone(), String::new(), shape);
            self.sink.log(picture.tick, path, &poses);
        }
    }

    /// The hand's mobility, at C, in the half of the twist that the nearest singularity is of.
    fn draw_abilities(&mut self, row: &Tick, picture: &Picture) {
        let Some(report) = row.singularity else {
            return;
        };
        let is_angular = row
            .singularities()
            .iter()
            .zip(&picture.signs)
            .filter(|(_, sign)| sign.mark.is_seen)
            .min_by(|a, b| nearness(a.0).total_cmp(&nearness(b.0)))
            .is_some_and(|(one, _)| one.angular == 1);
        let q = SVector::from(picture.q);
        let (J, arm) = (self.run.jacobian(&q, report.p_BC), &self.run.arm);
        let shapes = [
            Some(Ellipsoid::velocity(&J, arm.velocity(), is_angular)),
            Ellipsoid::mobility(&J, &arm.mass_matrix(&q), is_angular),
        ];
        for (path, shape) in ABILITIES.into_iter().zip(shapes) {
            if let Some(Ellipsoid { axes, half_axes }) = shape {
                // Flat, but not so flat that it has no sides.
                let size = half_axes.max(Vec3::splat(0.012)) * 0.62 * self.run.mark_size();
                let track = self.track(path, row.tick);
                let centre = vec3(&report.p_BC.into());
                let place = Affine3::from_mat3_translation(axes, centre);
                track.places.push(place);
                track.sizes.push(size.to_array());
            }
        }
    }

    /// A row of a track of what is drawn.
    fn track(&mut self, path: impl Into<String>, tick: u64) -> &mut Track {
        let track = self.tracks.entry(path.into()).or_default();
        track.ticks.push(tick);
        track
    }

    pub(super) fn place(&mut self, path: impl Into<String>, tick: u64, at: Affine3) {
        self.track(path, tick).places.push(at);
    }

    pub(super) fn write_tracks(&mut self) {
        for (path, track) in std::mem::take(&mut self.tracks) {
            self.sink.send_columns(&path, &track.ticks, track.columns());
        }
        for (way, (path, (colour, radius))) in entity::WAYS.into_iter().zip(WAYS).enumerate() {
            let points = std::mem::take(&mut self.ways[way]);
            self.ways[way].extend(points.last());
            // Pieces of a tenth of a second, each a row, so that the line grows with the cursor.
            for from in (0..points.len().saturating_sub(1)).step_by(5) {
                let piece = &points[from..points.len().min(from + 6)];
                let (first, last) = (piece[0], piece[piece.len() - 1]);
                if first.1.distance(last.1) > 1e-4 {
                    let strip = [piece.iter().map(|(_, p)| *p)];
                    let strip = lines(strip, colour, radius * self.run.body.reach);
                    self.sink.log(last.0, path, &strip);
                }
            }
        }
    }

    /// The pose of the other law's arm, and Markdown that compares both so far. The words replace those about singularities.
    fn draw_rival(&mut self, tick: u64) {
        let Some(rival) = self.run.happened.rival else {
            return;
        };
        // A rival that is done stays where it is.
        let place = (tick / rival.every.max(1)) as usize;
        let Some(q) = rival.postures.get(place).or(rival.postures.last()) else {
            return;
        };
        let links = self.run.links(q);
        for (i, link) in links[..self.run.joints()].iter().enumerate() {
            self.place(entity::link(RIVAL, i), tick, *link);
        }
        self.ways[0].push((tick, self.run.hand(q).translation));
        if let Some(words) = rival.words.get(place).or(rival.words.last()) {
            self.tell_now(tick, words);
        }
    }
}

/// The places and the size of a part.
fn poses(part: &Part, places: &[Affine3], size: f32) -> InstancePoses3D {
    // A capsule of Rerun's begins at its origin.
    let begin = match part.form {
        Form::Capsule { length, .. } => Vec3::Z * (-0.5 * length * size),
        _ => Vec3::ZERO,
    };
    let origins = places.iter().map(|at| at.transform_point3(begin));
    InstancePoses3D::new()
        .with_translations(array(origins))
        .with_quaternions(places.iter().map(quaternion))
        .with_scales(vec![[size; 3]; places.len()])
}

/// The shape of a part in its own frame.
fn solid(part: &Part, colour: Rgba) -> Vec<SerializedComponentBatch> {
    let fill = FillMode::Solid;
    match &part.form {
        Form::Box(sides) => Boxes3D::from_sizes([sides.to_array()])
            .with_colors([colour])
            .with_fill_mode(fill)
            .as_serialized_batches(),
        Form::Cylinder { radius, length } => {
            Cylinders3D::from_lengths_and_radii([*length], [*radius])
                .with_colors([colour])
                .with_fill_mode(fill)
                .as_serialized_batches()
        }
        Form::Capsule { radius, length } => {
            Capsules3D::from_lengths_and_radii([*length], [*radius])
                .with_colors([colour])
                .with_fill_mode(fill)
                .as_serialized_batches()
        }
        Form::Mesh(mesh) => Mesh3D::new(array(mesh.positions.iter().copied()))
            .with_vertex_normals(array(mesh.normals.iter().copied()))
            .with_albedo_factor(colour)
            .as_serialized_batches(),
    }
}
