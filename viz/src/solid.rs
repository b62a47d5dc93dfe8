//! Triangle meshes of solids, generated in code. PURE.

use glam::{Mat3, Vec2, Vec3};

/// sRGB bytes and opacity, `0xrrggbbaa`, as Rerun stores colours.
pub(crate) type Rgba = u32;

/// A disc in the plane of an outline: centre and radius; m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Disc {
    pub(crate) centre: Vec2,
    pub(crate) radius: f32,
}

/// A disc at (x, y) with a radius; m.
pub(crate) const fn disc(x: f32, y: f32, radius: f32) -> Disc {
    Disc {
        centre: Vec2::new(x, y),
        radius,
    }
}

/// Where a mesh stands in the frame it is drawn in: `p ↦ R·p + p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub(crate) R: Mat3,
    pub(crate) p: Vec3,
}

impl Placement {
    pub(crate) const IDENTITY: Self = Self {
        R: Mat3::IDENTITY,
        p: Vec3::ZERO,
    };

    /// At `p`, not turned.
    pub(crate) const fn at(p: Vec3) -> Self {
        Self {
            p,
            ..Self::IDENTITY
        }
    }

    /// A place of the solid in the frame it is drawn in.
    pub(crate) fn of(&self, place: Vec3) -> Vec3 {
        self.R * place + self.p
    }

    /// At `p`, with the solid's z axis along `axis` and its x axis as near to `x` as that allows.
    pub(crate) fn along(p: Vec3, axis: Vec3, x: Vec3) -> Self {
        let z = axis.normalize_or(Vec3::Z);
        let x = x
            .reject_from_normalized(z)
            .try_normalize()
            .unwrap_or_else(|| z.any_orthonormal_vector());
        Self {
            R: Mat3::from_cols(x, z.cross(x), z),
            p,
        }
    }
}

/// Two corners of the box about places.
pub(crate) fn span(mut places: impl Iterator<Item = Vec3>) -> Option<[Vec3; 2]> {
    let first = places.next()?;
    Some(places.fold([first; 2], |[low, high], p| [low.min(p), high.max(p)]))
}

/// A coloured triangle mesh with smooth normals; m.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) colours: Vec<Rgba>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// Facets of a full turn.
const FACETS: usize = 24;

impl Mesh {
    /// Its outermost corners, towards each corner, edge and side of a cube.
    pub(crate) fn ends(&self) -> Vec<Vec3> {
        let towards = (0..27).map(|k| Vec3::from([1, 3, 9].map(|step| (k / step % 3 - 1) as f32)));
        let far = |way: Vec3| {
            let places = self.positions.iter().copied();
            places.max_by(|a, b| a.dot(way).total_cmp(&b.dot(way)))
        };
        towards.filter_map(far).collect()
    }

    /// The convex hull of discs, extruded from `z0` to `z1` with edges rounded by `bevel`: a cylinder, a slab, a tapered arm.
    pub(crate) fn add_extrusion(
        &mut self,
        at: Placement,
        discs: &[Disc],
        z0: f32,
        z1: f32,
        bevel: f32,
        colour: Rgba,
    ) {
        // A fine edge needs few facets, a ball many: meshes are a tenth of a short recording.
        let steps = match bevel {
            ball if ball > 0.03 => 7,
            edge if edge > 0.006 => 3,
            _ => 1,
        };
        // Up the rounding: how far below the end, how far in, and the normal's slope.
        let edge =
            (0..=steps).map(|k| (std::f32::consts::FRAC_PI_2 * k as f32 / steps as f32).sin_cos());
        let edge: Vec<_> = edge
            .map(|(sin, cos)| (bevel * (1.0 - sin), bevel * (1.0 - cos), sin))
            .collect();
        // (z, inset of the outline, slope of the normal): bottom cap, rounding, side, rounding, top cap.
        let mut profile = vec![(z0, bevel, -1.0)];
        profile.extend(
            edge.iter()
                .rev()
                .map(|(below, inset, slope)| (z0 + below, *inset, -slope)),
        );
        profile.extend(
            edge.iter()
                .map(|(below, inset, slope)| (z1 - below, *inset, *slope)),
        );
        profile.push((z1, bevel, 1.0));
        self.add_profile(at, discs, &profile, colour);
    }

    /// A cylinder between two heights.
    pub(crate) fn add_drum(
        &mut self,
        at: Placement,
        radius: f32,
        [z0, z1]: [f32; 2],
        bevel: f32,
        colour: Rgba,
    ) {
        self.add_extrusion(at, &[disc(0.0, 0.0, radius)], z0, z1, bevel, colour);
    }

    /// A frustum from radius `r0` at `z0` to `r1` at `z1` (0: a cone's tip), closed at both ends.
    pub(crate) fn add_cone(
        &mut self,
        at: Placement,
        r0: f32,
        r1: f32,
        z0: f32,
        z1: f32,
        colour: Rgba,
    ) {
        let slope = (r0 - r1) / (r0 - r1).hypot(z1 - z0);
        let flat = -(z1 - z0).signum();
        self.add_profile(
            at,
            &[disc(0.0, 0.0, r0)],
            &[
                (z0, 0.0, flat),
                (z0, 0.0, slope),
                (z1, r0 - r1, slope),
                (z1, r0 - r1, -flat),
            ],
            colour,
        );
    }

    /// A sphere.
    pub(crate) fn add_sphere(&mut self, at: Placement, radius: f32, colour: Rgba) {
        self.add_capsule(at, radius, 0.0, colour);
    }

    /// A capsule along z, centred; `length` between the centres of its caps.
    pub(crate) fn add_capsule(&mut self, at: Placement, radius: f32, length: f32, colour: Rgba) {
        self.add_extrusion(
            at,
            &[disc(0.0, 0.0, radius)],
            -radius - length / 2.0,
            radius + length / 2.0,
            radius,
            colour,
        );
    }

    /// A box of full side lengths `size`, centred, with slightly rounded edges.
    pub(crate) fn add_box(&mut self, at: Placement, size: Vec3, colour: Rgba) {
        let bevel = 0.08 * size.min_element();
        let corner = size.truncate() / 2.0 - bevel;
        let discs = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| disc(x * corner.x, y * corner.y, bevel));
        self.add_extrusion(at, &discs, -size.z / 2.0, size.z / 2.0, bevel, colour);
    }

    /// Triangles out of a file, whose lengths `scale` makes metres. Their normals turn with the scene's nodes only where they fit their face.
    pub(crate) fn add_triangles(
        &mut self,
        at: Placement,
        scale: Vec3,
        mesh: &mesh_loader::Mesh,
        colour: Rgba,
    ) {
        let place = |p: &[f32; 3]| at.of(Vec3::from(*p) * scale);
        for face in &mesh.faces {
            let [a, mut b, mut c] = face.map(|corner| corner as usize);
            if scale.element_product() < 0.0 {
                (b, c) = (c, b);
            }
            let corners = [a, b, c].map(|corner| mesh.vertices.get(corner).map(place));
            let [Some(p), Some(q), Some(r)] = corners else {
                continue;
            };
            let Some(flat) = (q - p).cross(r - p).try_normalize() else {
                continue;
            };
            let first = self.positions.len() as u32;
            for (corner, p) in [(a, p), (b, q), (c, r)] {
                let own = mesh.normals.get(corner).map(|n| Vec3::from(*n) / scale);
                let own = own.map(|n| at.R * n.normalize_or_zero());
                self.push(p, own.filter(|n| n.dot(flat) > 0.7).unwrap_or(flat), colour);
            }
            self.triangles.push([first, first + 1, first + 2]);
        }
    }

    /// A tube along a polyline, open at its ends.
    pub(crate) fn add_tube(&mut self, path: &[Vec3], radius: f32, colour: Rgba) {
        const AROUND: usize = 8;
        let first = self.positions.len() as u32;
        let Some(mut side) = path.get(1).map(|next| {
            (*next - path[0])
                .normalize_or(Vec3::X)
                .any_orthonormal_vector()
        }) else {
            return;
        };
        for (i, p) in path.iter().enumerate() {
            let tangent = (path[(i + 1).min(path.len() - 1)] - path[i.saturating_sub(1)])
                .normalize_or(Vec3::X);
            side = side
                .reject_from_normalized(tangent)
                .normalize_or(tangent.any_orthonormal_vector());
            let up = tangent.cross(side);
            for k in 0..AROUND {
                let (sin, cos) = (std::f32::consts::TAU * k as f32 / AROUND as f32).sin_cos();
                let normal = side * cos + up * sin;
                self.push(*p + normal * radius, normal, colour);
            }
        }
        self.stitch(first, path.len(), AROUND);
    }

    /// Rings of the hull's outline, stacked: each (z, inset of the outline, z part of the normal), from the bottom to the top, closed at both.
    fn add_profile(
        &mut self,
        at: Placement,
        discs: &[Disc],
        profile: &[(f32, f32, f32)],
        colour: Rgba,
    ) {
        let first = self.positions.len() as u32;
        for &(z, inset, slope) in profile {
            for k in 0..FACETS {
                let (sin, cos) = (std::f32::consts::TAU * k as f32 / FACETS as f32).sin_cos();
                let u = Vec2::new(cos, sin);
                // The hull's support point in direction u: insetting every radius keeps normals and topology.
                let Some(far) = discs.iter().max_by(|a, b| {
                    (a.centre.dot(u) + a.radius).total_cmp(&(b.centre.dot(u) + b.radius))
                }) else {
                    return;
                };
                let rim = far.centre + u * (far.radius - inset);
                let normal = (u * (1.0 - slope * slope).max(0.0).sqrt()).extend(slope);
                self.push(at.R * rim.extend(z) + at.p, at.R * normal, colour);
            }
        }
        self.stitch(first, profile.len(), FACETS);
        // Fans over the end rings: they are convex.
        let last = first + ((profile.len() - 1) * FACETS) as u32;
        for k in 1..FACETS as u32 - 1 {
            self.triangles.push([first, first + k + 1, first + k]);
            self.triangles.push([last, last + k, last + k + 1]);
        }
    }

    fn push(&mut self, position: Vec3, normal: Vec3, colour: Rgba) {
        self.positions.push(position);
        self.normals.push(normal.normalize_or(Vec3::Z));
        self.colours.push(colour);
    }

    /// Quads between successive rings of `around` vertices.
    fn stitch(&mut self, first: u32, rings: usize, around: usize) {
        let around = around as u32;
        for ring in 0..rings.saturating_sub(1) as u32 {
            for k in 0..around {
                let [a, b] = [k, (k + 1) % around].map(|k| first + ring * around + k);
                self.triangles.push([a, b, b + around]);
                self.triangles.push([a, b + around, a + around]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    /// Volume by the divergence theorem: positive only where every face points outwards.
    #[test]
    fn solids_have_the_volume_of_their_formula() {
        let at = Placement::along(Vec3::ONE, Vec3::Y, Vec3::X);
        let mut meshes: [Mesh; 4] = Default::default();
        meshes[0].add_sphere(at, 0.1, 0xffffffff);
        meshes[1].add_cone(at, 0.1, 0.0, 0.0, 0.3, 0xffffffff);
        meshes[2].add_box(at, Vec3::new(0.2, 0.3, 0.4), 0xffffffff);
        let hull = [disc(0.0, 0.0, 0.1), disc(0.4, 0.0, 0.1)];
        meshes[3].add_extrusion(at, &hull, 0.0, 0.1, 0.0, 0xffffffff);
        let exact = [
            PI * 0.004 / 3.0,
            PI * 0.001,
            0.024,
            (0.08 + PI * 0.01) * 0.1,
        ];
        for (mesh, exact) in meshes.iter().zip(exact) {
            let corner = |i: u32| mesh.positions[i as usize];
            let faces = mesh.triangles.iter().map(|corners| corners.map(corner));
            let volume: f32 = faces.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
            assert!(
                (volume / exact - 1.0).abs() < 0.03,
                "{volume} against {exact}"
            );
        }
    }
}
