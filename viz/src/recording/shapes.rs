//! Meshes, lines, arrows and words, as Rerun takes them.

use glam::Vec3;
use re_sdk_types::archetypes::{Arrows3D, LineStrips3D, Mesh3D, Points3D};
use re_sdk_types::components::{AlbedoFactor, Color, Radius};

use crate::solid::{Mesh, Rgba};
use crate::tint::of_words;

pub(crate) fn rgba([r, g, b, a]: Rgba) -> Color {
    Color::from_unmultiplied_rgba(r, g, b, a)
}

pub(super) fn albedo(tint: Rgba) -> AlbedoFactor {
    AlbedoFactor(rgba(tint).0)
}

/// A mesh of one colour that lets through what is behind it.
pub(super) fn ghost3d(mesh: &Mesh, tint: Rgba) -> Mesh3D {
    shape3d(mesh).with_albedo_factor(albedo(tint))
}

pub(super) fn mesh3d(mesh: &Mesh) -> Mesh3D {
    shape3d(mesh).with_vertex_colors(mesh.colours.iter().map(|colour| rgba(*colour)))
}

/// A mesh without its colours.
fn shape3d(mesh: &Mesh) -> Mesh3D {
    Mesh3D::new(mesh.positions.iter().copied())
        .with_vertex_normals(mesh.normals.iter().copied())
        .with_triangle_indices(mesh.triangles.iter().copied())
}

/// Another tint for a mesh that has been written.
pub(super) fn tinted(tint: Rgba) -> Mesh3D {
    Mesh3D::update_fields().with_albedo_factor(albedo(tint))
}

/// Lines of one colour and radius.
pub(super) fn lines<S: IntoIterator<Item = [f32; 3]>>(
    strips: impl IntoIterator<Item = S>,
    colour: Rgba,
    radius: impl Into<Radius>,
) -> LineStrips3D {
    let strips = strips
        .into_iter()
        .map(|strip| strip.into_iter().collect::<Vec<_>>());
    LineStrips3D::new(strips)
        .with_colors([rgba(colour)])
        .with_radii([radius])
}

/// Arrows of one colour and radius.
pub(super) fn arrows(
    vectors: impl IntoIterator<Item = Vec3>,
    colour: Rgba,
    radius: f32,
) -> Arrows3D {
    let vectors = vectors.into_iter().map(|vector| vector.to_array());
    Arrows3D::from_vectors(vectors)
        .with_colors([rgba(colour)])
        .with_radii([radius])
}

/// Words at a place.
pub(super) fn words(at: Vec3, colour: Rgba, text: &str) -> Points3D {
    Points3D::new([at.to_array()])
        .with_radii([Radius::new_ui_points(0.5)])
        .with_colors([rgba(of_words(colour))])
        .with_labels([text])
        .with_show_labels(true)
}

/// Lines of one width, some with words at their middle. Words have the colour of their line, which the viewer's light theme hides, so each
/// belongs to a line of its own, too short to be seen.
pub(super) fn lettered(lines: Vec<(Vec<[f32; 3]>, Rgba, String)>, radius: f32) -> LineStrips3D {
    let words = lines
        .iter()
        .filter(|(.., word)| !word.is_empty())
        .map(|(strip, colour, word)| {
            let at = middle(strip);
            let strip = [at, at + Vec3::splat(1e-4)].map(|p| p.to_array()).to_vec();
            (strip, rgba(of_words(*colour)), 1e-5, word.clone())
        });
    let plain = lines
        .iter()
        .map(|(strip, colour, _)| (strip.clone(), rgba(*colour), radius, String::new()));
    let all: Vec<_> = plain.chain(words).collect();
    LineStrips3D::new(all.iter().map(|one| one.0.clone()))
        .with_colors(all.iter().map(|one| one.1))
        .with_radii(all.iter().map(|one| one.2))
        .with_labels(all.iter().map(|one| one.3.clone()))
        .with_show_labels(true)
}

/// The middle of a line's points.
pub(super) fn middle(strip: &[[f32; 3]]) -> Vec3 {
    strip.iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / strip.len().max(1) as f32
}
