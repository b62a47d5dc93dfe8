//! Foxglove's message types, as far as an export uses them: messages in JSON; their schemas are in `foxglove.json`. PURE.
//!
//! Their names and fields: <https://docs.foxglove.dev/docs/sdk/schemas>. Foxglove knows a type by its name, and by the title `time` which objects
//! are times. Lengths in m, angles as unit quaternions.

use serde_json::{Value, json};
use shared_types::codes::{KIND_NUMERIC, KINDS};

use super::format::Place;
use crate::narration::colour_of;
use crate::read::Solid;

/// The frame in which everything is placed.
pub(super) const BASE: &str = "base";

/// For how long a singular direction is shown; s. It is sent again with every picture while the arm is near the singularity.
const SHOWN_S: f64 = 0.06;

/// A time, or a duration.
pub(super) fn time(nanoseconds: u64) -> Value {
    json!({"sec": nanoseconds / 1_000_000_000, "nsec": nanoseconds % 1_000_000_000})
}

fn xyz([x, y, z]: [f32; 3]) -> Value {
    json!({"x": x, "y": y, "z": z})
}

fn xyzw([x, y, z, w]: [f32; 4]) -> Value {
    json!({"x": x, "y": y, "z": z, "w": w})
}

fn rgba(colour: [u8; 4]) -> Value {
    let [r, g, b, a] = colour.map(|part| (f64::from(part) / 255.0 * 1e3).round() / 1e3);
    json!({"r": r, "g": g, "b": b, "a": a})
}

/// The frame of something drawn, by its path; `None` for what has none in an export.
pub(super) fn frame(path: &str) -> Option<String> {
    let name = path.strip_prefix("/world/")?;
    match name.split('/').collect::<Vec<_>>()[..] {
        ["arm", "base"] => Some(BASE.to_owned()),
        ["arm", link] => Some(link.to_owned()),
        ["hand"] => Some("hand".to_owned()),
        ["target"] => Some("desired".to_owned()),
        ["singularity", name] => Some(format!("singularity_{name}")),
        _ => None,
    }
}

/// A `foxglove.FrameTransform`: where a frame is in the base.
pub(super) fn transform(frame: &str, place: &Place, at: u64) -> Value {
    json!({
        "timestamp": time(at), "parent_frame_id": BASE, "child_frame_id": frame, "translation": xyz(place.p), "rotation": xyzw(place.xyzw),
    })
}

/// A `foxglove.PoseInFrame`, in the base.
pub(super) fn pose_in_base(place: &Place, at: u64) -> Value {
    json!({"timestamp": time(at), "frame_id": BASE, "pose": {"position": xyz(place.p), "orientation": xyzw(place.xyzw)}})
}

/// A `foxglove.SceneUpdate` of one entity that moves with a frame.
fn scene(frame: &str, id: &str, at: u64, lifetime_s: f64, shape: (&str, Value)) -> Value {
    let mut entity = json!({
        "timestamp": time(at), "frame_id": frame, "id": id, "lifetime": time((lifetime_s * 1e9) as u64), "frame_locked": true,
        "metadata": [], "arrows": [], "cubes": [], "spheres": [], "cylinders": [], "lines": [], "triangles": [], "texts": [], "models": [],
    });
    entity[shape.0] = shape.1;
    json!({"deletions": [], "entities": [entity]})
}

/// The scene of a solid, and the largest distance of its corners from its frame; m.
pub(super) fn solid(frame: &str, solid: &Solid, at: u64) -> (Value, f32) {
    let (positions, triangles, colours) = (solid.corners(), solid.triangles(), solid.colours());
    let extent = positions
        .iter()
        .map(|p| p.iter().map(|x| x * x).sum::<f32>().sqrt())
        .fold(0.0, f32::max);
    // A hundredth of a millimetre.
    let fine = |x: f32| (f64::from(x) * 1e5).round() / 1e5;
    let points: Vec<_> = positions
        .iter()
        .map(|[x, y, z]| json!({"x": fine(*x), "y": fine(*y), "z": fine(*z)}))
        .collect();
    let first = colours.first().copied().unwrap_or([200, 200, 200, 255]);
    let is_plain = colours.len() != points.len() || colours.iter().all(|colour| *colour == first);
    let colours: Vec<_> = if is_plain {
        vec![]
    } else {
        colours.into_iter().map(rgba).collect()
    };
    let indices: Vec<u32> = triangles.into_iter().flatten().collect();
    let identity = json!({"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}});
    let shape = json!([{"pose": identity, "points": points, "color": rgba(first), "colors": colours, "indices": indices}]);
    (scene(frame, frame, at, 0.0, ("triangles", shape)), extent)
}

/// The scene of a singular direction: a double arrow along the first axis of its frame, in the colour of its kind; `length` in m.
pub(super) fn direction(frame: &str, length: f32, at: u64) -> Value {
    let name = frame.trim_start_matches("singularity_");
    let kind = KINDS.iter().find(|(_, known)| *known == name);
    let (kind, place) = kind.map_or_else(
        || {
            let number = name
                .get(1..)
                .and_then(|number| number.parse::<usize>().ok());
            (KIND_NUMERIC, number.unwrap_or(1).saturating_sub(1))
        },
        |(kind, _)| (*kind, 0),
    );
    let arrow = |orientation: [f32; 4]| {
        json!({
            "pose": {"position": xyz([0.0; 3]), "orientation": xyzw(orientation)}, "shaft_length": 0.75 * length, "shaft_diameter": 0.06 * length,
            "head_length": 0.25 * length, "head_diameter": 0.16 * length, "color": rgba(colour_of(kind, place)),
        })
    };
    // Along x, and turned about z by half a turn.
    scene(
        frame,
        name,
        at,
        SHOWN_S,
        (
            "arrows",
            json!([arrow([0.0, 0.0, 0.0, 1.0]), arrow([0.0, 0.0, 1.0, 0.0])]),
        ),
    )
}
