//! Numbers of places and meshes as Arrow's arrays. Rerun's own types make the same ones number by number.

use std::sync::Arc;

use re_chunk::external::arrow::array::{ArrayRef, FixedSizeListArray, Float32Array, UInt32Array};
use re_chunk::external::arrow::datatypes::{DataType, Field};
use re_sdk_types::{ComponentDescriptor, SerializedComponentBatch};

use crate::solid::Rgba;

/// Points, directions, sizes or quaternions.
pub(super) fn numbers<const N: usize>(
    values: Vec<[f32; N]>,
    descriptor: ComponentDescriptor,
) -> SerializedComponentBatch {
    lists(
        N,
        DataType::Float32,
        Arc::new(Float32Array::from(values.into_flattened())),
        descriptor,
    )
}

/// Corners of triangles.
pub(super) fn corners(
    values: Vec<[u32; 3]>,
    descriptor: ComponentDescriptor,
) -> SerializedComponentBatch {
    lists(
        3,
        DataType::UInt32,
        Arc::new(UInt32Array::from(values.into_flattened())),
        descriptor,
    )
}

/// Colours.
pub(super) fn colours(
    values: &[Rgba],
    descriptor: ComponentDescriptor,
) -> SerializedComponentBatch {
    let values = values.iter().map(|rgba| u32::from_be_bytes(*rgba));
    SerializedComponentBatch::new(Arc::new(UInt32Array::from_iter_values(values)), descriptor)
}

fn lists(
    size: usize,
    of: DataType,
    values: ArrayRef,
    descriptor: ComponentDescriptor,
) -> SerializedComponentBatch {
    let field = Arc::new(Field::new("item", of, false));
    SerializedComponentBatch::new(
        Arc::new(FixedSizeListArray::new(field, size as i32, values, None)),
        descriptor,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_sdk_types::archetypes::{Mesh3D, Transform3D};
    use re_sdk_types::components::Color;
    use re_sdk_types::datatypes::Quaternion;

    #[test]
    fn the_arrays_are_those_that_rerun_makes() {
        let (points, triangles, tints) = (
            vec![[1.0_f32, 2.0, 3.0], [4.0, 5.0, -6.0]],
            vec![[0_u32, 1, 7]],
            [[1_u8, 2, 3, 4], [255, 0, 128, 9]],
        );
        let mesh = Mesh3D::new(points.clone())
            .with_vertex_normals(points.clone())
            .with_vertex_colors(tints.map(|[r, g, b, a]| Color::from_unmultiplied_rgba(r, g, b, a)))
            .with_triangle_indices(triangles.clone());
        assert_eq!(
            mesh.vertex_positions,
            Some(numbers(
                points.clone(),
                Mesh3D::descriptor_vertex_positions()
            ))
        );
        assert_eq!(
            mesh.vertex_normals,
            Some(numbers(points.clone(), Mesh3D::descriptor_vertex_normals()))
        );
        assert_eq!(
            mesh.vertex_colors,
            Some(colours(&tints, Mesh3D::descriptor_vertex_colors()))
        );
        assert_eq!(
            mesh.triangle_indices,
            Some(corners(triangles, Mesh3D::descriptor_triangle_indices()))
        );
        let turns = vec![[0.0_f32, 0.6, 0.0, 0.8], [0.0, 0.0, 0.0, 1.0]];
        let track = Transform3D::update_fields()
            .with_many_translation(points.clone())
            .with_many_scale(points.clone())
            .with_many_quaternion(turns.iter().map(|turn| Quaternion::from_xyzw(*turn)));
        assert_eq!(
            track.translation,
            Some(numbers(
                points.clone(),
                Transform3D::descriptor_translation()
            ))
        );
        assert_eq!(
            track.scale,
            Some(numbers(points, Transform3D::descriptor_scale()))
        );
        assert_eq!(
            track.quaternion,
            Some(numbers(turns, Transform3D::descriptor_quaternion()))
        );
    }
}
