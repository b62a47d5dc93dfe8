//! A first scenario for any arm, as a file with comments.

mod shapes;

pub use shapes::Shape;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use model::Robot;
use session::{Failure, load};
use shared_types::scenario::{Scenario, is_name};
use shared_types::summary::REACHED;

use crate::trial::Trial;

const TEMPLATE: &str = include_str!("first.toml");
/// Lengths of a line that may suit the arm, the first that does is taken; m.
const LENGTHS: [f64; 2] = [0.1, 0.01];

/// Writes `NAME.toml`, and for a table `NAME.csv`, a path of this shape that the arm follows within the goal's bounds. Returns the file, and what was assumed of the arm.
///
/// # Errors
/// [`Failure`] where the file exists or cannot be written, there is no such robot, or no such path is found that it can follow.
pub fn begin(name: &Path, robot: &str, shape: Shape) -> Result<(PathBuf, Vec<String>), Failure> {
    let mut path = name.as_os_str().to_owned();
    path.push(if name.extension().is_some_and(|it| it == "toml") {
        ""
    } else {
        ".toml"
    });
    let path = PathBuf::from(path);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    // It names folders and stands in commands.
    if !stem.starts_with(|c: char| c.is_ascii_alphanumeric()) || !is_name(&stem) {
        return Err(Failure::Input(format!(
            "{} is not a name for a scenario: use letters, digits, `-`, `_` and `.`, beginning with a letter or a digit",
            name.display()
        )));
    }
    let taken = |path: &Path| {
        let path = path.display();
        Failure::Input(format!("{path} exists already: choose another name"))
    };
    let table = path.with_extension("csv");
    for file in [Some(&path), Some(&table).filter(|_| shape == Shape::Table)] {
        if let Some(file) = file.filter(|file| file.symlink_metadata().is_ok()) {
            return Err(taken(file));
        }
    }
    let arm = load::robot(robot, None, None)?;
    arm.complete().map_err(Failure::input)?;
    let (text, rows) = text(&path, robot, &arm, shape).map_err(|failure| match failure {
        Failure::Input(why) if !arm.notes.is_empty() => {
            Failure::Input(format!("{why}; {}", arm.notes.join("; ")))
        }
        other => other,
    })?;
    // Another shell may have made it meanwhile.
    let write = |path: &Path, text: String| {
        files::write_new(path, text).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => taken(path),
            ErrorKind::NotFound => {
                let folder = path.parent().unwrap_or(path).display();
                Failure::Input(format!("there is no folder {folder}: make it first"))
            }
            _ => {
                let path = path.display();
                Failure::Input(format!(
                    "cannot write {path}: {error}; choose another folder"
                ))
            }
        })
    };
    rows.map_or(Ok(()), |rows| write(&table, rows))?;
    write(&path, text)?;
    Ok((path, arm.notes))
}

/// The text of the first path that the arm can follow, and that of its table.
fn text(
    path: &Path,
    robot: &str,
    arm: &Robot,
    shape: Shape,
) -> Result<(String, Option<String>), Failure> {
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let file = path.display().to_string();
    let whole = TEMPLATE
        .replace("NAME", &quoted(&stem))
        .replace("ROBOT", &quoted(&from_folder_of(path, robot)))
        .replace("FILE", &file)
        .replace("TITLE", shape.title());
    for start in starts(arm) {
        for (axis, length) in LENGTHS
            .iter()
            .flat_map(|length| [2, 0, 1].map(|axis| (axis, length)))
        {
            for sign in [1.0, -1.0] {
                let (segments, rows) = shape.segments(&stem, axis, length * sign);
                let text = whole
                    .replace("START", &start)
                    .replace("SEGMENTS", &segments);
                let mut scenario = Scenario::parse(&file, &text, &[])?;
                for segment in &mut scenario.segment {
                    if let (Some(table), Some(rows)) = (&mut segment.table, &rows) {
                        table.rows.clone_from(rows);
                    }
                    segment.take_times().map_err(Failure::input)?;
                }
                let trial = Trial {
                    robot: arm,
                    scenario,
                    graph: None,
                };
                if trial
                    .run()
                    .is_ok_and(|row| row.outcome == REACHED && row.task.s2)
                {
                    return Ok((text, rows));
                }
            }
        }
    }
    Err(Failure::Work(format!(
        "no such path was found that {} can follow: name a bent posture in its description (docs/reference/arm.md), and try again",
        arm.name
    )))
}

/// A robot's name, or the path of its file as a scenario at `path` states it: from the scenario's folder.
fn from_folder_of(path: &Path, robot: &str) -> String {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    let whole = |path: &Path| path.canonicalize().ok();
    let beside = folder.and_then(|folder| {
        let (file, folder) = (whole(Path::new(robot))?, whole(folder)?);
        Some(
            file.strip_prefix(folder)
                .map_or(file.clone(), Path::to_owned),
        )
    });
    beside.map_or_else(|| robot.to_owned(), |file| file.display().to_string())
}

/// Postures to start in: those that the description names, and one bent and the one in the middle of all ranges.
fn starts(arm: &Robot) -> Vec<String> {
    // A posture in the middle of all ranges is often singular, which takes long to find.
    let named = arm.postures.keys().filter(|name| *name != "middle");
    let mut named: Vec<_> = named.collect();
    named.sort_by_key(|name| !["home", "nominal", "bent", "ready"].contains(&name.as_str()));
    let bent = arm.middle().into_iter().zip(&arm.joints);
    let bent: Vec<_> = bent
        .map(|(q, joint)| (q + 0.4).min(0.5 * (q + joint.upper)))
        .collect();
    let numbers = [bent, arm.middle()].map(|q| {
        let q: Vec<_> = q.iter().map(|q| format!("{q:.3}")).collect();
        format!("q = [{}]", q.join(", "))
    });
    named
        .into_iter()
        .map(|name| format!("posture = \"{name}\""))
        .chain(numbers)
        .collect()
}
