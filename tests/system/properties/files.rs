//! Files that people write, and what a run's folder says of it.

use model::{Robot, RobotText};
use shared_types::graph::Graph;
use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;
use shared_types::target_file;
use shared_types::wire::Part;

/// A scenario is refused with a sentence, or it is valid: written out and read again it is the same.
pub fn scenario(text: &str) {
    match Scenario::parse("fuzz.toml", text, &[]) {
        Ok(scenario) => {
            let again = toml::to_string(&scenario).expect("a scenario can be written");
            assert_eq!(
                Scenario::parse("fuzz.toml", &again, &[]).expect("and read again"),
                scenario
            );
            assert!(scenario.duration_s().is_finite() && scenario.dt_s() > 0.0);
        }
        Err(error) => assert!(error.to_string().starts_with("fuzz.toml"), "{error}"),
    }
}

/// A graph is refused with a sentence, or it is one.
pub fn graph(text: &str) {
    match Graph::parse("fuzz.toml", text) {
        Ok(graph) => assert!(!graph.process.is_empty()),
        Err(error) => assert!(error.to_string().starts_with("fuzz.toml"), "{error}"),
    }
}

/// A URDF is refused with a sentence, or its arm can be computed with.
pub fn urdf(text: &str) {
    let source = RobotText {
        name: "fuzz".to_owned(),
        urdf: text.to_owned(),
        ..RobotText::default()
    };
    match Robot::from_source(&source) {
        Ok(robot) => assert!(
            robot
                .joints
                .iter()
                .all(|joint| joint.lower <= joint.upper && joint.effort >= 0.0),
            "{robot:?}"
        ),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A file of targets is refused with a sentence that names a line, or read again as it is written.
pub fn target_file(text: &str) {
    match target_file::parse(text, 1000) {
        Ok(rows) => {
            assert!(rows.iter().all(|row| row.target.is_finite()), "{rows:?}");
            assert_eq!(
                target_file::parse(&target_file::write(&rows, 1000), 1000),
                Ok(rows)
            );
        }
        Err(error) => assert!(error.line > 0 && !error.message.is_empty(), "{error}"),
    }
}

/// A job as a run leaves it.
pub fn job() -> String {
    let job = Job {
        run: "armplane-0-1-1-0".to_owned(),
        id: 0x0123_4567_89ab_cdef,
        version: "0.1.0".to_owned(),
        mode: shared_types::job::Mode::Lockstep,
        out: "runs/fig5-wrist-rotation-001".into(),
        record: true,
        scenario: Scenario::parse(
            "fig5",
            sim::scenarios::text("fig5-wrist-rotation").expect("built in"),
            &[],
        )
        .expect("valid"),
        robot: Default::default(),
        dof: 6,
        graph: Graph::parse(
            "graph.toml",
            include_str!("../../../shared-types/graph.toml"),
        )
        .expect("valid"),
        from: None,
        deaths: Vec::new(),
    };
    serde_json::to_string(&job).expect("a job can be written")
}

/// A results folder's description of its run is refused with a sentence, or describes a possible run.
pub fn results(bytes: &[u8]) {
    if let Ok(job) = serde_json::from_slice::<Job>(bytes) {
        match job.check() {
            Ok(()) => {
                assert!(
                    (50..=20_000).contains(&job.scenario.rate_hz)
                        && job.scenario.duration_s() <= 36_000.0
                );
                assert!(job.graph.writer("torque").is_some());
                let again = serde_json::to_vec(&job).expect("a job can be written");
                assert_eq!(
                    serde_json::from_slice::<Job>(&again).expect("and read again"),
                    job
                );
            }
            Err(complaint) => assert!(!complaint.to_string().is_empty()),
        }
    }
    if let Ok(summary) = serde_json::from_slice::<Summary>(bytes) {
        let again = serde_json::to_vec(&summary).expect("a summary can be written");
        assert!(serde_json::from_slice::<Summary>(&again).is_ok());
    }
}
