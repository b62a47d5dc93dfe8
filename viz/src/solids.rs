//! The arm as our pictures show it, for pictures that others draw.

use glam::Vec3;
use model::Robot;
use serde_json::{Value, json};

use crate::body::{Body, Form, Part};
use crate::meshes::Meshes;
use crate::pose::rotation;

/// The arm's `pieces`, on a floor at this height, m, in base axes; `lacking`, a sentence about meshes that cannot be read, for which simpler shapes stand in, or null.
///
/// Of each piece: `joint`, the index of the joint whose link carries it, null for the base; there its `position`, m, and its rotation `wxyz`; its `form` with `sizes`,
/// m: box (full side lengths), cylinder (radius, length along z), capsule (radius, length between the centres of its caps: 0 for a ball) or mesh (the corners of its
/// triangles, one after the other); and its `color`, red, green and blue.
pub fn solids(robot: &Robot, floor_m: f64) -> Value {
    let (meshes, lacking) = Meshes::of(robot);
    let parts = Body::new(robot, floor_m as f32, &meshes).parts;
    json!({"pieces": parts.iter().map(piece).collect::<Vec<_>>(), "lacking": lacking})
}

fn piece(part: &Part) -> Value {
    let (form, sizes) = match &part.form {
        Form::Box(sides) => ("box", sides.to_array().to_vec()),
        Form::Cylinder { radius, length } => ("cylinder", vec![*radius, *length]),
        Form::Capsule { radius, length } => ("capsule", vec![*radius, *length]),
        Form::Mesh(mesh) => {
            let corners = mesh.positions.iter().flat_map(Vec3::to_array);
            ("mesh", corners.collect())
        }
    };
    let [x, y, z, w] = rotation(&part.at).to_array();
    let [red, green, blue, _] = part.colour.to_be_bytes();
    json!({
        "joint": part.link, "position": part.at.translation.to_array(), "wxyz": [w, x, y, z],
        "form": form, "sizes": sizes, "color": [red, green, blue],
    })
}
