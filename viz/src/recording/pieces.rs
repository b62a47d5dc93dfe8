//! Poses, meshes and the eye, as Rerun takes them.

use glam::Vec3;
use model::Robot;
use re_log_types::ApplicationId;
use re_sdk_types::archetypes::{LineStrips3D, Mesh3D};
use re_sdk_types::components::{AlbedoFactor, Color};
use re_sdk_types::datatypes::Quaternion;

use crate::blueprint::{Eye, Subject};
use crate::scene::rotation;
use crate::solid::{Mesh, Placement, Rgba};
use crate::tint::of_words;

/// Recordings of one robot share their blueprint.
pub(super) fn application(robot: &Robot) -> ApplicationId {
    ApplicationId::new_or_unknown(format!("armplane-{}", robot.name))
}

pub(super) fn pose(p: &[f64; 3], R: &[f64; 9]) -> Placement {
    let R = R.map(|x| x as f32);
    Placement {
        R: glam::Mat3::from_cols_array(&R),
        p: Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32),
    }
}

pub(super) fn quaternion(at: &Placement) -> Quaternion {
    Quaternion::from_xyzw(rotation(at).to_array())
}

pub(super) fn mesh3d(mesh: &Mesh, tint: Option<Rgba>) -> Mesh3D {
    let colours = mesh.colours.iter().map(|colour| rgba(*colour));
    let made = shape3d(mesh).with_vertex_colors(colours);
    match tint {
        Some(tint) => made.with_albedo_factor(albedo(tint)),
        None => made,
    }
}

/// A mesh without its colours.
fn shape3d(mesh: &Mesh) -> Mesh3D {
    Mesh3D::new(mesh.positions.iter().copied())
        .with_vertex_normals(mesh.normals.iter().copied())
        .with_triangle_indices(mesh.triangles.iter().copied())
}

pub(super) fn rgba([r, g, b, a]: Rgba) -> Color {
    Color::from_unmultiplied_rgba(r, g, b, a)
}

/// Lines of one width, some with words at their middle. Words have the colour of their line, which the viewer's light theme hides, so each
/// belongs to a line of its own, too short to be seen.
pub(super) fn lettered(
    mut strips: Vec<Vec<[f32; 3]>>,
    mut colours: Vec<Rgba>,
    words: Vec<String>,
    radius: f32,
) -> LineStrips3D {
    let (mut radii, mut labels) = (
        vec![radius; strips.len()],
        vec![String::new(); strips.len()],
    );
    for (i, word) in words
        .into_iter()
        .enumerate()
        .filter(|(_, word)| !word.is_empty())
    {
        let middle =
            strips[i].iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / strips[i].len().max(1) as f32;
        strips.push(vec![
            middle.to_array(),
            (middle + Vec3::splat(1e-4)).to_array(),
        ]);
        colours.push(of_words(colours[i]));
        radii.push(1e-5);
        labels.push(word);
    }
    LineStrips3D::new(strips)
        .with_colors(colours.into_iter().map(rgba))
        .with_radii(radii)
        .with_labels(labels)
        .with_show_labels(true)
}

/// A mesh of one colour that lets through what is behind it.
pub(super) fn ghost3d(mesh: &Mesh, tint: Rgba) -> Mesh3D {
    shape3d(mesh).with_albedo_factor(albedo(tint))
}

/// Another tint for a mesh that has been written.
pub(super) fn tinted(tint: Rgba) -> Mesh3D {
    Mesh3D::update_fields().with_albedo_factor(albedo(tint))
}

fn albedo(tint: Rgba) -> AlbedoFactor {
    AlbedoFactor(rgba(tint).0)
}

/// The room that an arm takes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Room {
    /// Origins of its links, the hand last, at the beginning.
    places: Vec<Vec3>,
    /// Corners of the box of all of them, from then on, and of the hand's.
    links: Option<[Vec3; 2]>,
    hand: Option<[Vec3; 2]>,
}

impl Room {
    pub(crate) fn of(places: Vec<Vec3>) -> Self {
        Self {
            places,
            ..Self::default()
        }
    }

    /// Takes a posture in.
    pub(super) fn push(&mut self, places: impl Iterator<Item = Vec3>, hand: Vec3) {
        let grow = |corners: &mut Option<[Vec3; 2]>, p: Vec3| {
            let [low, high] = corners.get_or_insert([p, p]);
            (*low, *high) = (low.min(p), high.max(p));
        };
        places.for_each(|p| grow(&mut self.links, p));
        grow(&mut self.hand, hand);
    }

    /// An eye that sees the arm from floor to hand wherever it has been so far, and where the task takes the hand, with room for a mark of that
    /// size there: off to the side of the plane in which the arm reaches out, a little above; a planar arm from above.
    pub(crate) fn eye(&self, mark: f32, subject: &Subject, planar: bool) -> Eye {
        // Half of Rerun's field of view; the sphere is roomier than the arm in it.
        let distance = |radius: f32| 0.88 * radius / 27.5f32.to_radians().sin();
        let hand = self.places.last().copied().unwrap_or(Vec3::X);
        let foot = if planar {
            Vec3::ZERO
        } else {
            Vec3::Z * subject.floor_m.min(0.0)
        };
        // Above the mark are its words; seen from above, beside it.
        let words = if planar && !subject.stands_still {
            Vec3::X * (2.2 * mark)
        } else {
            Vec3::Z * (1.8 * mark)
        };
        let around = |hand: Vec3| {
            [
                hand + Vec3::splat(mark),
                hand - Vec3::splat(mark),
                hand + words,
            ]
        };
        let ends = subject.ways.iter().scan(hand, |hand, way| {
            *hand = way.after(*hand);
            Some(*hand)
        });
        let hands = ends.chain([hand]).chain(self.hand.into_iter().flatten());
        let room: Vec<Vec3> = hands
            .flat_map(around)
            .chain([foot])
            .chain(self.links.into_iter().flatten())
            .collect();
        let (low, high) = self
            .places
            .iter()
            .chain(&room)
            .fold((Vec3::ZERO, Vec3::ZERO), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        let (look_at, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
        if planar {
            return Eye {
                position: look_at + Vec3::new(0.0, -0.25, 1.0).normalize() * distance(radius),
                look_at,
                up: Vec3::Y,
            };
        }
        let heading = hand.with_z(0.0).normalize_or(Vec3::X);
        let side = Vec3::new(heading.y, -heading.x, 0.0);
        let position =
            look_at + (heading * 0.7 + side + Vec3::Z * 0.38).normalize() * distance(radius);
        Eye {
            position,
            look_at,
            up: Vec3::Z,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eye_steps_back_for_a_hand_that_goes_where_no_plan_said() {
        let mut room = Room::of(vec![Vec3::ZERO, Vec3::Z * 0.6, Vec3::new(0.6, 0.0, 0.6)]);
        let subject = Subject::default();
        let planned = room.eye(0.15, &subject, false);
        room.push(room.places.clone().into_iter(), room.places[2]);
        let stayed = room.eye(0.15, &subject, false);
        assert!(
            planned.position.distance(stayed.position) < 1e-6,
            "it stayed where it was"
        );
        room.push([Vec3::ZERO, Vec3::Z, Vec3::Y].into_iter(), Vec3::Y);
        let far = room.eye(0.15, &subject, false);
        let distance = |eye: &Eye| eye.position.distance(eye.look_at);
        assert!(
            distance(&far) > 1.1 * distance(&planned),
            "{} m",
            distance(&far)
        );
        assert!(
            far.look_at.y > planned.look_at.y + 0.2,
            "towards where it went"
        );
    }
}
