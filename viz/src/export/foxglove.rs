//! Foxglove's message types, as far as an export uses them: schemas and messages in JSON. PURE.
//!
//! Their names and fields: <https://docs.foxglove.dev/docs/sdk/schemas>. Foxglove knows a type by its name, and by the title `time` which objects
//! are times. Lengths in m, angles as unit quaternions.

use serde_json::{Map, Value, json};
use shared_types::codes::{KIND_NUMERIC, KINDS};

use super::format::Place;
use crate::narration::colour_of;
use crate::read::Solid;

/// The frame in which everything is placed.
pub(super) const BASE: &str = "base";

/// For how long a singular direction is shown; s. It is sent again with every picture while the arm is near the singularity.
const SHOWN_S: f64 = 0.06;

fn object(title: &str, properties: Value) -> Value {
    json!({"type": "object", "title": title, "properties": properties})
}

fn numbers(title: &str, names: &[&str]) -> Value {
    let all: Map<String, Value> = names
        .iter()
        .map(|name| ((*name).to_owned(), json!({"type": "number"})))
        .collect();
    object(title, Value::Object(all))
}

fn clock(title: &str) -> Value {
    let integer = json!({"type": "integer", "minimum": 0});
    object(
        title,
        json!({"sec": integer, "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999}}),
    )
}

fn vector() -> Value {
    numbers("foxglove.Vector3", &["x", "y", "z"])
}

fn rotation() -> Value {
    numbers("foxglove.Quaternion", &["x", "y", "z", "w"])
}

fn pose() -> Value {
    object(
        "foxglove.Pose",
        json!({"position": vector(), "orientation": rotation()}),
    )
}

fn colour() -> Value {
    numbers("foxglove.Color", &["r", "g", "b", "a"])
}

fn text() -> Value {
    json!({"type": "string"})
}

fn list(items: Value) -> Value {
    json!({"type": "array", "items": items})
}

/// The schema of `foxglove.Log`.
pub(super) fn log_schema() -> Value {
    let integer = json!({"type": "integer"});
    let properties = json!({"timestamp": clock("time"), "level": integer, "message": text(), "name": text(), "file": text(), "line": integer});
    object("foxglove.Log", properties)
}

/// The schema of `foxglove.FrameTransform`.
pub(super) fn transform_schema() -> Value {
    let (frame, at) = (text(), clock("time"));
    let places = json!({"timestamp": at, "parent_frame_id": frame, "child_frame_id": frame, "translation": vector(), "rotation": rotation()});
    object("foxglove.FrameTransform", places)
}

/// The schema of `foxglove.PoseInFrame`.
pub(super) fn pose_schema() -> Value {
    object(
        "foxglove.PoseInFrame",
        json!({"timestamp": clock("time"), "frame_id": text(), "pose": pose()}),
    )
}

/// The schema of `foxglove.SceneUpdate`.
pub(super) fn scene_schema() -> Value {
    let number = json!({"type": "number"});
    let arrow = json!({
        "pose": pose(), "shaft_length": number, "shaft_diameter": number, "head_length": number, "head_diameter": number, "color": colour(),
    });
    let triangles = json!({
        "pose": pose(), "points": list(vector()), "color": colour(), "colors": list(colour()),
        "indices": list(json!({"type": "integer", "minimum": 0})),
    });
    let other = list(json!({"type": "object"}));
    let entity = json!({
        "timestamp": clock("time"), "frame_id": text(), "id": text(), "lifetime": clock("duration"), "frame_locked": {"type": "boolean"},
        "metadata": other, "arrows": list(object("foxglove.ArrowPrimitive", arrow)), "cubes": other, "spheres": other, "cylinders": other,
        "lines": other, "triangles": list(object("foxglove.TriangleListPrimitive", triangles)), "texts": other, "models": other,
    });
    object(
        "foxglove.SceneUpdate",
        json!({"deletions": other, "entities": list(object("foxglove.SceneEntity", entity))}),
    )
}

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
    let mut entity = Map::new();
    for empty in [
        "metadata",
        "arrows",
        "cubes",
        "spheres",
        "cylinders",
        "lines",
        "triangles",
        "texts",
        "models",
    ] {
        entity.insert(empty.to_owned(), json!([]));
    }
    entity.insert("timestamp".to_owned(), time(at));
    entity.insert("frame_id".to_owned(), json!(frame));
    entity.insert("id".to_owned(), json!(id));
    entity.insert("lifetime".to_owned(), time((lifetime_s * 1e9) as u64));
    entity.insert("frame_locked".to_owned(), json!(true));
    entity.insert(shape.0.to_owned(), shape.1);
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
    let points: Vec<_> = positions
        .iter()
        .map(|p| p.map(|x| (f64::from(x) * 1e5).round() / 1e5))
        .collect();
    let points: Vec<_> = points
        .into_iter()
        .map(|[x, y, z]| json!({"x": x, "y": y, "z": z}))
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
    let kind = KINDS
        .iter()
        .find(|(_, known)| *known == name)
        .map(|(kind, _)| (*kind, 0));
    let (kind, place) = kind.unwrap_or_else(|| {
        (
            KIND_NUMERIC,
            name[1..].parse::<usize>().unwrap_or(1).saturating_sub(1),
        )
    });
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
