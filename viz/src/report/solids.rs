//! The arm as outlines: each convex solid of its figure is one polygon, its end a lighter one, drawn from the back to the front. PURE.

use glam::{Vec2, Vec3};

use super::camera::Camera;
use super::drawing::polygon;
use crate::arm::Figure;
use crate::solid::{FACETS, Placement, Rgba};

/// The convex solids of an arm's base and links: their corners, where they are, their colour.
pub(super) fn of<'a>(
    figure: &'a Figure,
    bodies: &'a [Placement],
) -> impl Iterator<Item = (&'a [Vec3], &'a Placement, Rgba)> {
    let meshes = std::iter::once(&figure.base).chain(&figure.links);
    meshes.zip(bodies).flat_map(|(mesh, at)| {
        let ends = mesh
            .solids
            .iter()
            .copied()
            .skip(1)
            .chain([mesh.positions.len()]);
        let ranges = mesh.solids.iter().copied().zip(ends);
        ranges.map(move |(from, to)| (&mesh.positions[from..to], at, mesh.colours[from]))
    })
}

/// How deep a cap may be sunk into what it stands on: figures sink theirs by 2 mm, to which rounding adds; m.
const SUNK: f32 = 0.0021;

/// A solid in a picture.
struct Placed {
    colour: Rgba,
    points: Vec<Vec3>,
    /// Middle and outward normal of its two flat ends.
    ends: [(Vec3, Vec3); 2],
    low: Vec2,
    high: Vec2,
    depth: f32,
}

impl Placed {
    fn new(solid: &[Vec3], at: &Placement, colour: Rgba, camera: &Camera) -> Option<Self> {
        let points: Vec<Vec3> = solid.iter().map(|p| at.of(*p)).collect();
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for place in points.iter().map(|p| camera.place(*p)) {
            (low, high) = (low.min(place), high.max(place));
        }
        let middle = |ring: &[Vec3]| ring.iter().sum::<Vec3>() / ring.len() as f32;
        let centre = middle(&points);
        let rings = [&points[..FACETS], &points[points.len() - FACETS..]];
        let ends = rings.map(|ring| (middle(ring), (middle(ring) - centre).normalize_or_zero()));
        let depth = camera.depth(centre);
        let placed = Self {
            colour,
            points,
            ends,
            low,
            high,
            depth,
        };
        (low.is_finite() && high.is_finite()).then_some(placed)
    }

    /// Whether this one is behind the other: a plane through one of its ends, or of the other's, parts them.
    fn is_behind(&self, other: &Self, camera: &Camera) -> Option<bool> {
        if self.high.cmplt(other.low).any() || other.high.cmplt(self.low).any() {
            return None;
        }
        // Whether the plane through an end of the one that has the other on its outer side faces the eye.
        let parted = |one: &Self, other: &Self| {
            let is_beyond = |(middle, normal): &&(Vec3, Vec3)| {
                let mut points = other.points.iter().step_by(5);
                normal.length_squared() > 0.5 && points.all(|p| (*p - *middle).dot(*normal) > -SUNK)
            };
            let (_, normal) = one.ends.iter().find(is_beyond)?;
            Some(normal.dot(camera.forward) < 0.0)
        };
        parted(self, other).or_else(|| Some(!parted(other, self)?))
    }
}

/// Paints the arm whose base and links are at `bodies`; `put` takes colour, whether it is an end, and the outline.
pub(super) fn paint(
    figure: &Figure,
    bodies: &[Placement],
    camera: &Camera,
    mut put: impl FnMut(Rgba, bool, String),
) {
    let solids = of(figure, bodies);
    let placed = solids.filter_map(|(solid, at, colour)| Placed::new(solid, at, colour, camera));
    let placed: Vec<Placed> = placed.collect();
    for place in order(&placed, camera) {
        let Placed {
            colour,
            points,
            ends,
            ..
        } = &placed[place];
        put(*colour, false, outline(points, camera));
        let rings = [&points[..FACETS], &points[points.len() - FACETS..]];
        for (ring, (_, normal)) in rings.into_iter().zip(ends) {
            if normal.dot(camera.forward) < -0.08 {
                put(*colour, true, outline(ring, camera));
            }
        }
    }
}

/// From the back to the front: as the planes between them say, else by their distance.
fn order(placed: &[Placed], camera: &Camera) -> Vec<usize> {
    let mut left: Vec<usize> = (0..placed.len()).collect();
    left.sort_by(|a, b| placed[*b].depth.total_cmp(&placed[*a].depth));
    // Which are to be painted before each.
    let mut before = vec![Vec::new(); placed.len()];
    for i in 0..placed.len() {
        for k in i + 1..placed.len() {
            match placed[i].is_behind(&placed[k], camera) {
                Some(true) => before[k].push(i),
                Some(false) => before[i].push(k),
                None => {}
            }
        }
    }
    let mut out = Vec::with_capacity(placed.len());
    while !left.is_empty() {
        // In a circle none is free: the farthest goes first.
        let is_free = |one: &usize| before[*one].iter().all(|other| out.contains(other));
        out.push(left.remove(left.iter().position(is_free).unwrap_or(0)));
    }
    out
}

/// The convex outline of points of the drawing, without corners that are not seen.
fn outline(points: &[Vec3], camera: &Camera) -> String {
    let places = points.iter().map(|p| camera.place(*p).round().as_i64vec2());
    let mut points: Vec<[i64; 2]> = places.map(|p| p.to_array()).collect();
    points.sort_unstable();
    points.dedup();
    let cross = |o: [i64; 2], a: [i64; 2], b: [i64; 2]| {
        (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
    };
    // Twice the area that a corner may add without being seen; square units.
    let flat = 12;
    let half = |points: &mut dyn Iterator<Item = &[i64; 2]>| {
        let mut chain: Vec<[i64; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && cross(a, b, *p) <= flat
            {
                chain.pop();
            }
            chain.push(*p);
        }
        // The other half begins with it.
        chain.pop();
        chain
    };
    let hull = [half(&mut points.iter()), half(&mut points.iter().rev())].concat();
    match hull.len() {
        0..3 => String::new(),
        _ => polygon(hull.iter().map(|p| Vec2::new(p[0] as f32, p[1] as f32))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blueprint::Eye;
    use crate::solid::Mesh;

    #[test]
    fn the_nearer_of_two_stacked_drums_is_painted_last_from_either_side() {
        let mut base = Mesh::default();
        for (z, red) in [(0.0, 0), (0.2, 20)] {
            base.add_drum(Placement::IDENTITY, 0.5, [z, z + 0.2], 0.0, red);
        }
        let robot = model::Robot::builtin("planar3r").expect("built in");
        let figure = Figure {
            base,
            links: Vec::new(),
            ..Figure::new(&robot, 0.0, &crate::meshes::Meshes::default())
        };
        for (height, last) in [(2.0, 20), (-2.0, 0)] {
            let position = Vec3::new(0.0, -3.0, height);
            let eye = Eye {
                position,
                look_at: Vec3::ZERO,
                up: Vec3::Z,
            };
            let corners = figure.base.positions.iter().copied();
            let (camera, _) = Camera::framing(&eye, corners, 400.0);
            let mut painted = Vec::new();
            paint(
                &figure,
                &[Placement::IDENTITY],
                &camera,
                |colour, is_end, _| painted.push((colour, is_end)),
            );
            let sides: Vec<_> = painted.iter().filter(|(_, is_end)| !is_end).collect();
            assert!(sides.last().is_some_and(|one| one.0 == last) && painted.len() > sides.len());
        }
    }
}
