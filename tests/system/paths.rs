//! Whole paths on one thread, as `tests/golden/paths.toml` lists them: how a run ends, how far the hand leaves its path orthogonal to ζ, and where joints go.

use std::collections::BTreeMap;

use lab::row::Row;
use lab::trial::Trial;
use model::Robot;
use serde::Deserialize;
use session::load;
use shared_types::MAX_DOF;
use shared_types::scenario::Scenario;

use crate::command::{Desk, Known, root, source};

/// See the head of the list.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Path {
    scenario: String,
    robot: String,
    start: String,
    segment: String,
    times: usize,
    set: Vec<String>,
    ends: Option<String>,
    refused: Option<String>,
    within: BTreeMap<String, [f64; 2]>,
    moved_deg: Vec<(usize, f64, f64)>,
}

#[derive(Deserialize)]
struct Paths {
    path: Vec<Path>,
}

/// A file beside the list.
fn golden(file: &str) -> String {
    root().join("tests/golden").join(file).display().to_string()
}

impl Path {
    fn name(&self, desk: &Desk) -> String {
        let Self {
            scenario,
            robot,
            start,
            segment,
            times,
            ..
        } = self;
        match scenario.as_str() {
            "" => {}
            file if file.ends_with(".toml") => return golden(file),
            name => return name.to_owned(),
        }
        let robot = match robot.ends_with(".urdf") {
            true => golden(robot),
            false => robot.clone(),
        };
        let segments = format!("[[segment]]\n{segment}\n").repeat((*times).max(1));
        let text = format!("name = \"path\"\nrobot = \"{robot}\"\n[start]\n{start}\n{segments}");
        desk.file("path.toml", text).display().to_string()
    }

    fn run(&self, desk: &Desk) -> Result<Row, String> {
        let loaded = load::scenario(&self.name(desk), &self.set, None);
        let loaded = loaded.map_err(|error| error.to_string())?;
        let trial = Trial {
            robot: &loaded.robot,
            scenario: loaded.scenario,
            graph: None,
        };
        trial.run().map_err(|refused| refused.to_string())
    }

    fn check(&self, desk: &Desk) {
        let row = match (self.run(desk), &self.refused) {
            (Err(reason), Some(words)) => {
                return assert!(reason.contains(words), "{self:?}: {reason}");
            }
            (Ok(row), None) => row,
            (other, _) => panic!("{self:?}: {other:?}"),
        };
        let ends = self.ends.as_deref().unwrap_or("goal reached");
        assert_eq!(row.outcome, ends, "{self:?}: {}", row.reason);
        let json = serde_json::to_value(&row).expect("JSON");
        let mut within = BTreeMap::from([
            ("speed_max_ratio", [0.0, 1.0]),
            ("torque_commanded_max_ratio", [0.0, 1.0]),
            ("torque_step_max_ratio", [0.0, 0.0501]),
        ]);
        within.extend(
            self.within
                .iter()
                .map(|(key, range)| (key.as_str(), *range)),
        );
        for (key, [low, high]) in within {
            let value = json[key].number();
            assert!((low..high).contains(&value), "{self:?}: {key} {value}");
        }
        for (joint, least, most) in &self.moved_deg {
            let [start, end] = ["q_start", "q_end"].map(|key| json[key][joint].number());
            let moved = (end - start).to_degrees();
            assert!(
                (*least..*most).contains(&moved),
                "{self:?}: {joint} {moved}°"
            );
        }
    }
}

// covers: CK95 Figure 5
#[test]
fn paths_end_as_they_should() {
    let paths: Paths = toml::from_str(&source("tests/golden/paths.toml")).expect("the list");
    assert!(paths.path.len() > 40);
    let (first, second) = paths.path.split_at(paths.path.len() / 2);
    std::thread::scope(|scope| {
        for part in [first, second] {
            scope.spawn(|| part.iter().for_each(|path| path.check(&Desk::new())));
        }
    });
}

#[test]
fn a_turn_of_zeta_goes_as_it_was_announced() {
    let text = sim::scenarios::text("ur5-wrist").unwrap();
    let scenario = Scenario::parse("ur5-wrist", text, &[]).unwrap();
    let robot = Robot::builtin(&scenario.robot).unwrap();
    let (mut start, mut planned, mut moved) = (None, [0.0; MAX_DOF], [0.0; MAX_DOF]);
    chain::run(&robot, &scenario, |tick| {
        let (q, control) = (tick.plant_state.q, tick.control_state);
        let start = *start.get_or_insert(q);
        if control.segment == 0 && control.planned != 0 {
            (planned, moved) = (control.planned_dq, std::array::from_fn(|i| q[i] - start[i]));
        }
    })
    .unwrap();
    assert!(planned[3].abs() > 0.5, "{planned:?}");
    for (planned, moved) in planned.iter().zip(moved) {
        assert!((planned - moved).abs() < 2e-3, "{planned} {moved}");
    }
}

/// The position of a frame far from the wrist centre, of a task that leaves the rotations free: the arms of the case that was 30 mm off.
#[test]
fn a_task_of_positions_alone_moves_the_point_that_it_names() {
    let flange = "q = [0.3, -0.8, 2.9, 0.2, 0.5, 0.1]";
    for (robot, frame, start) in [
        ("puma560", "flange", flange),
        ("ur5", "", "q_deg = [20, -70, 80, -40, -90, 0]"),
        ("iiwa14", "", "q_deg = [0, 30, 0, -80, 0, 60, 0]"),
    ] {
        let desk = Desk::new();
        let [urdf, toml] =
            ["urdf", "toml"].map(|end| source(&format!("services/model/robots/{robot}.{end}")));
        let free = toml.lines().filter(|line| !line.starts_with("task"));
        let free = free.collect::<Vec<_>>().join("\n");
        let arm = desk.file("arm.urdf", urdf).display().to_string();
        desk.file("arm.toml", format!("task = [\"x\", \"y\", \"z\"]\n{free}"));
        let path = Path {
            robot: arm,
            start: start.to_owned(),
            segment: "by_m = [0.1, 0.1, 0.1]\nduration_s = 2.0".to_owned(),
            set: vec![format!("frame=\"{frame}\"")],
            within: [("final_position_mm".to_owned(), [0.0, 1.0])].into(),
            ..Path::default()
        };
        path.check(&desk);
    }
}
