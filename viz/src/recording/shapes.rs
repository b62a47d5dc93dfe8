//! Meshes, lines, arrows and words, as Rerun takes them.

use glam::Vec3;
use re_sdk_types::archetypes::{Arrows3D, LineStrips3D, Mesh3D, Points3D};
use re_sdk_types::components::Radius;

use crate::solid::{Mesh, Rgba};

/// A mesh of one colour that lets through what is behind it.
pub(super) fn ghost3d(mesh: &Mesh, tint: Rgba) -> Mesh3D {
    shape3d(mesh).with_albedo_factor(tint)
}

pub(super) fn mesh3d(mesh: &Mesh) -> Mesh3D {
    shape3d(mesh).with_vertex_colors(mesh.colours.iter().copied())
}

/// A mesh without its colours.
fn shape3d(mesh: &Mesh) -> Mesh3D {
    Mesh3D::new(array(mesh.positions.iter().copied()))
        .with_vertex_normals(array(mesh.normals.iter().copied()))
        .with_triangle_indices(mesh.triangles.iter().copied())
}

/// Another tint for a mesh that has been written.
pub(super) fn tinted(tint: Rgba) -> Mesh3D {
    Mesh3D::update_fields().with_albedo_factor(tint)
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

fn array(places: impl IntoIterator<Item = Vec3>) -> Vec<[f32; 3]> {
    places.into_iter().map(|p| p.to_array()).collect()
}

/// Arrows of one colour and radius, from one place.
pub(super) fn arrows(
    origin: Vec3,
    vectors: impl IntoIterator<Item = Vec3>,
    colour: Rgba,
    radius: f32,
) -> Arrows3D {
    let vectors = array(vectors);
    let origins = vec![origin.to_array(); vectors.len()];
    Arrows3D::from_vectors(vectors)
        .with_origins(origins)
        .with_colors([colour])
        .with_radii([radius])
}

/// Words at the origin, white: their ground is dark or, in the viewer's light theme, of a middle grey.
pub(super) fn words(text: &str) -> Points3D {
    Points3D::new([[0.0; 3]])
        .with_radii([Radius::new_ui_points(0.0)])
        .with_colors([0xffffffff])
        .with_labels([text])
        .with_show_labels(true)
}

/// Lines of one width, each with its colour.
pub(super) fn coloured(
    lines: impl Iterator<Item = (Vec<Vec3>, Rgba)>,
    radius: f32,
) -> LineStrips3D {
    let (strips, colours): (Vec<_>, Vec<_>) = lines.unzip();
    LineStrips3D::new(strips.into_iter().map(array))
        .with_colors(colours)
        .with_radii([radius])
}
