//! The arm as outlines: each convex solid of its figure is one polygon, its end a lighter one, drawn from the back to the front. PURE.

use glam::{Vec2, Vec3};

use super::camera::Camera;
use super::path::Path;
use crate::solid::{FACETS, Mesh, Placement, Rgba};

/// A convex solid of a link, in the link's frame.
struct Solid {
    /// 0 is the base, then the links.
    body: usize,
    colour: usize,
    points: Vec<Vec3>,
    centre: Vec3,
    /// Its two flat ends: outline, middle, outward normal.
    ends: Vec<(Vec<Vec3>, Vec3, Vec3)>,
}

/// The solids of an arm, and the colours they are painted in.
pub(super) struct Solids {
    solids: Vec<Solid>,
    pub(super) colours: Vec<Rgba>,
}

/// Where a solid is in a picture.
struct Placed<'a> {
    solid: &'a Solid,
    points: Vec<Vec3>,
    ends: Vec<(Vec3, Vec3)>,
    low: Vec2,
    high: Vec2,
    depth: f32,
}

impl Solids {
    pub(super) fn new<'a>(bodies: impl Iterator<Item = &'a Mesh>) -> Self {
        let (mut solids, mut colours) = (Vec::new(), Vec::new());
        for (body, mesh) in bodies.enumerate() {
            let ends = mesh
                .solids
                .iter()
                .copied()
                .skip(1)
                .chain([mesh.positions.len()]);
            for (from, to) in mesh.solids.iter().copied().zip(ends) {
                let Some(colour) = mesh.colours.get(from) else {
                    continue;
                };
                let colour = colours
                    .iter()
                    .position(|known| known == colour)
                    .unwrap_or_else(|| {
                        colours.push(*colour);
                        colours.len() - 1
                    });
                let points: Vec<Vec3> = mesh.positions[from..to]
                    .iter()
                    .map(|p| Vec3::from_array(*p))
                    .collect();
                let middle = |ring: &[Vec3]| ring.iter().sum::<Vec3>() / ring.len().max(1) as f32;
                let centre = middle(&points);
                let rings = [
                    &points[..FACETS.min(points.len())],
                    &points[points.len().saturating_sub(FACETS)..],
                ];
                let ends = rings
                    .map(|ring| {
                        (
                            ring.to_vec(),
                            middle(ring),
                            (middle(ring) - centre).normalize_or_zero(),
                        )
                    })
                    .to_vec();
                solids.push(Solid {
                    body,
                    colour,
                    points,
                    centre,
                    ends,
                });
            }
        }
        Self { solids, colours }
    }

    /// All points of the bodies at these places, for framing.
    pub(super) fn points(&self, bodies: &[Placement]) -> Vec<Vec3> {
        let of = |solid: &Solid| {
            bodies.get(solid.body).map(|at| {
                solid
                    .points
                    .iter()
                    .step_by(7)
                    .map(|p| at.R * *p + at.p)
                    .collect::<Vec<_>>()
            })
        };
        self.solids.iter().filter_map(of).flatten().collect()
    }

    /// Paints the arm whose base and links are at `bodies`; `put` takes colour, whether it is an end, and the outline.
    pub(super) fn paint(
        &self,
        bodies: &[Placement],
        camera: &Camera,
        mut put: impl FnMut(usize, bool, Path),
    ) {
        let placed: Vec<Placed> = self
            .solids
            .iter()
            .filter_map(|solid| Placed::new(solid, bodies.get(solid.body)?, camera))
            .collect();
        for place in order(&placed, camera) {
            let Placed { solid, points, .. } = &placed[place];
            put(
                solid.colour,
                false,
                outline(points.iter().map(|p| camera.place(*p))),
            );
            let at = bodies[solid.body];
            for (ring, _, normal) in &solid.ends {
                if (at.R * *normal).dot(camera.forward) < -0.08 {
                    let end = outline(ring.iter().map(|p| camera.place(at.R * *p + at.p)));
                    if !end.is_empty() {
                        put(solid.colour, true, end);
                    }
                }
            }
        }
    }
}

impl<'a> Placed<'a> {
    fn new(solid: &'a Solid, at: &Placement, camera: &Camera) -> Option<Self> {
        let points: Vec<Vec3> = solid.points.iter().map(|p| at.R * *p + at.p).collect();
        let places = points.iter().map(|p| camera.place(*p));
        let (low, high) = places.fold(
            (Vec2::splat(f32::INFINITY), Vec2::splat(f32::NEG_INFINITY)),
            |(low, high), p| (low.min(p), high.max(p)),
        );
        let ends = solid
            .ends
            .iter()
            .map(|(_, middle, normal)| (at.R * *middle + at.p, at.R * *normal))
            .collect();
        (low.is_finite() && high.is_finite()).then(|| Self {
            solid,
            ends,
            low,
            high,
            depth: camera.depth(at.R * solid.centre + at.p),
            points,
        })
    }

    /// Whether this one is behind the other: a plane through one of its ends, or of the other's, parts them.
    fn is_behind(&self, other: &Self, camera: &Camera) -> Option<bool> {
        if self.high.cmplt(other.low).any() || other.high.cmplt(self.low).any() {
            return None;
        }
        let beyond = |(middle, normal): &(Vec3, Vec3), points: &[Vec3]| {
            normal.length_squared() > 0.5
                && points
                    .iter()
                    .step_by(5)
                    .all(|p| (*p - *middle).dot(*normal) > -0.002)
        };
        let towards_eye = |normal: Vec3| normal.dot(camera.forward) < 0.0;
        if let Some((_, normal)) = self.ends.iter().find(|end| beyond(end, &other.points)) {
            return Some(towards_eye(*normal));
        }
        other
            .ends
            .iter()
            .find(|end| beyond(end, &self.points))
            .map(|(_, normal)| !towards_eye(*normal))
    }
}

/// From the back to the front: as the planes between them say, else by their distance.
fn order(placed: &[Placed], camera: &Camera) -> Vec<usize> {
    let n = placed.len();
    // How many are to be painted before each, and which each comes before.
    let (mut waits, mut before) = (vec![0usize; n], vec![Vec::new(); n]);
    for i in 0..n {
        for k in i + 1..n {
            let (first, second) = match placed[i].is_behind(&placed[k], camera) {
                Some(true) => (i, k),
                Some(false) => (k, i),
                None => continue,
            };
            before[first].push(second);
            waits[second] += 1;
        }
    }
    let mut left: Vec<usize> = (0..n).collect();
    left.sort_by(|a, b| placed[*b].depth.total_cmp(&placed[*a].depth));
    let mut out = Vec::with_capacity(n);
    while !left.is_empty() {
        // In a circle none is free: the farthest goes first.
        let next = left.remove(
            left.iter()
                .position(|place| waits[*place] == 0)
                .unwrap_or(0),
        );
        before[next]
            .iter()
            .for_each(|place| waits[*place] = waits[*place].saturating_sub(1));
        out.push(next);
    }
    out
}

/// The convex outline of points of the drawing, without corners that are not seen.
fn outline(points: impl Iterator<Item = Vec2>) -> Path {
    let mut points: Vec<[i32; 2]> = points
        .map(|p| [p.x.round() as i32, p.y.round() as i32])
        .collect();
    points.sort_unstable();
    points.dedup();
    let cross = |o: [i32; 2], a: [i32; 2], b: [i32; 2]| {
        i64::from(a[0] - o[0]) * i64::from(b[1] - o[1])
            - i64::from(a[1] - o[1]) * i64::from(b[0] - o[0])
    };
    // Twice the area that a corner may add without being seen; square units.
    let flat = 12;
    let half = |points: &mut dyn Iterator<Item = [i32; 2]>| {
        let mut chain: Vec<[i32; 2]> = Vec::new();
        for p in points {
            while chain.len() >= 2
                && cross(chain[chain.len() - 2], chain[chain.len() - 1], p) <= flat
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain
    };
    let (mut hull, mut upper) = (
        half(&mut points.iter().copied()),
        half(&mut points.iter().rev().copied()),
    );
    hull.pop();
    upper.pop();
    hull.append(&mut upper);
    if hull.len() < 3 {
        Path::default()
    } else {
        Path::closed(&hull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blueprint::Eye;
    use crate::solid::disc;

    #[test]
    fn the_outline_of_a_square_has_its_corners() {
        let grid =
            (0..=20).flat_map(|x| (0..=20).map(move |y| Vec2::new(x as f32 * 5.0, y as f32 * 5.0)));
        assert_eq!(outline(grid).text(), "M0 0l100 0 0 100-100 0z");
        assert!(outline([Vec2::ZERO, Vec2::X].into_iter()).is_empty());
    }

    #[test]
    fn the_nearer_of_two_stacked_drums_is_painted_last_from_either_side() {
        let mut mesh = Mesh::default();
        for (z, red) in [(0.0, 0), (0.2, 20)] {
            mesh.add_extrusion(
                Placement::IDENTITY,
                &[disc(0.0, 0.0, 0.5)],
                z,
                z + 0.2,
                0.0,
                [red, 0, 0, 255],
            );
        }
        let solids = Solids::new([&mesh].into_iter());
        for (height, last) in [(2.0, 1), (-2.0, 0)] {
            let eye = Eye {
                position: Vec3::new(0.0, -3.0, height),
                look_at: Vec3::ZERO,
                up: Vec3::Z,
            };
            let points = solids.points(&[Placement::IDENTITY]);
            let (camera, _) = Camera::framing(&eye, points.into_iter(), 400.0);
            let mut painted = Vec::new();
            solids.paint(&[Placement::IDENTITY], &camera, |colour, is_end, _| {
                painted.push((colour, is_end))
            });
            let sides: Vec<_> = painted.iter().filter(|(_, is_end)| !is_end).collect();
            assert!(sides.last().is_some_and(|one| one.0 == last) && painted.len() > sides.len());
        }
    }
}
