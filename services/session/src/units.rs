//! Whether the numbers of a scenario can belong to its arm: millimetres for metres, radians for degrees.

use std::f64::consts::TAU;

use model::{JointKind, Robot};
use serde_json::Value;
use shared_types::file::Complaint;
use shared_types::scenario::{Frame, Scenario};

/// Multiples of the arm's reach within which its path and its surroundings lie.
const FAR: f64 = 3.0;

/// Lengths that may be of any size, a base in its world, the centre of a short arc, a floor far below; and what is no length.
const FREE: [&str; 5] = [
    "base_m",
    "centre_m",
    "floor_m",
    "stiffness_n_m",
    "damping_s_m",
];

/// Length of the stretched arm without the hand's frame; m.
fn reach(robot: &Robot) -> f64 {
    let travel = |limit: f64| if limit.is_finite() { limit.abs() } else { 0.0 };
    let joints = robot.joints.iter().map(|joint| {
        let slides = joint.kind == JointKind::Prismatic;
        let travel = travel(joint.lower).max(travel(joint.upper));
        joint.X_PJ.p.norm() + if slides { travel } else { 0.0 }
    });
    joints.sum()
}

/// The numbers and the vectors of a value, with their keys; none in the axes of the world, and none of a sphere.
fn numbers(value: &Value, path: &str, found: &mut Vec<(String, Vec<f64>)>) {
    let within = |key: &str| format!("{path}.{key}").trim_start_matches('.').to_owned();
    let row = |items: &[Value]| items.iter().map(Value::as_f64).collect::<Option<Vec<_>>>();
    match value {
        Value::Object(keys)
            if keys.get("frame") != Some(&"world".into()) && !keys.contains_key("radius_m") =>
        {
            keys.iter()
                .for_each(|(key, inner)| numbers(inner, &within(key), found));
        }
        Value::Array(items) => match row(items) {
            Some(row) => found.push((path.to_owned(), row)),
            None => (items.iter().enumerate())
                .for_each(|(i, inner)| numbers(inner, &within(&i.to_string()), found)),
        },
        Value::Number(_) => found.push((path.to_owned(), value.as_f64().into_iter().collect())),
        _ => {}
    }
}

fn norm(row: &[f64]) -> f64 {
    row.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Refuses lengths beyond everything of the arm.
///
/// # Errors
/// [`Complaint`] about the first of them.
pub(crate) fn check(scenario: &Scenario, robot: &Robot) -> Result<(), Complaint> {
    let (arm, mut found) = (reach(robot), Vec::new());
    numbers(&serde_json::json!(scenario), "", &mut found);
    for (i, segment) in scenario.segment.iter().enumerate() {
        let Some(table) = segment
            .table
            .as_ref()
            .filter(|table| table.frame != Frame::World)
        else {
            continue;
        };
        let rows = table.poses().unwrap_or_default();
        let first = rows
            .first()
            .filter(|_| table.frame != Frame::Base)
            .map_or([0.0; 3], |row| row.p_m);
        let from_first = |p: &[f64; 3]| (0..3).map(|k| p[k] - first[k]).collect();
        found.extend(
            rows.iter()
                .map(|row| (format!("segment.{i}.table.rows_m"), from_first(&row.p_m))),
        );
    }
    for (path, row) in found {
        let key = path
            .rsplit('.')
            .find(|key| key.parse::<usize>().is_err())
            .unwrap_or_default();
        let is_length = key.ends_with("_m") && !FREE.contains(&key);
        let is_of_hand = ["tip_m", "com_m"].contains(&key);
        if is_length && norm(&row) > arm * if is_of_hand { 1.0 } else { FAR } {
            let meant: Vec<_> = row.iter().map(|x| (x / 1000.0).to_string()).collect();
            return Err(Complaint::new(
                path.trim_end_matches(".rows_m"),
                format!(
                    "{:.1} m is too far for an arm of {arm:.2} m without its hand",
                    norm(&row)
                ),
                format!("lengths are in metres: did you mean {}?", meant.join(", ")),
            ));
        }
    }
    Ok(())
}

/// An angle in degrees that looks like radians, in words: it may be meant.
pub(crate) fn doubt(scenario: &Scenario) -> Option<String> {
    let mut found = Vec::new();
    numbers(&serde_json::json!(scenario), "", &mut found);
    let looks_so = |(path, row): &(String, Vec<f64>)| {
        let parts = row.iter().filter(|x| x.fract() != 0.0).count();
        // A twelfth of a turn and its multiples, as people write them.
        let twelfths = row[0].to_degrees() / 15.0;
        row.iter().all(|x| x.abs() < TAU + 0.01)
            && (path.ends_with("q_deg") && parts > 2
                || path.ends_with("by_deg")
                    && parts > 0
                    && twelfths.round() != 0.0
                    && (twelfths - twelfths.round()).abs() < 7e-3)
    };
    let (path, row) = found
        .iter()
        .filter(|(_, row)| !row.is_empty())
        .find(|one| looks_so(one))?;
    let meant: Vec<_> = row
        .iter()
        .map(|x| format!("{:.0}", x.to_degrees()))
        .collect();
    Some(format!(
        "{path} is in degrees: did you mean {}?",
        meant.join(", ")
    ))
}
