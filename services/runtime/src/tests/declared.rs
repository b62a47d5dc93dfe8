//! Topics that the graph declares for a process.

use super::*;

#[test]
fn only_declared_topics_open() {
    let stage = stage(Mode::Lockstep);
    let estimator = stage.shell("estimator");
    assert!(matches!(
        estimator.writer::<SensorSample>(),
        Err(TopicError::Undeclared {
            action: "write",
            ..
        })
    ));
    assert!(matches!(
        estimator.reader::<PlantState>(),
        Err(TopicError::Undeclared { action: "read", .. })
    ));
    let error = ProcessError::from(
        Shell::open(stage.run.path(), "tourist")
            .map(|_| ())
            .unwrap_err(),
    );
    assert!(
        error
            .to_string()
            .contains("its graph has plant, estimator, recorder"),
        "{error}"
    );
    let mut manifest = estimator.manifest().clone();
    manifest.processes[0].writes = vec!["weather".into()];
    let error = Hub::create(&RunDir::create().unwrap(), &manifest).unwrap_err();
    assert!(
        error.to_string().contains("\"weather\"") && error.to_string().contains("singularity"),
        "{error}"
    );
}

#[test]
fn a_process_without_a_writer_for_a_declared_topic_does_not_begin() {
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let stage = stage(mode);
        let estimator = Shell::open(stage.run.path(), "estimator").unwrap();
        let mut inlet = estimator.reader::<SensorSample>().unwrap();
        let error = inlet.next().map(|_| ()).unwrap_err();
        assert_eq!(
            error,
            Interrupted::Unopened {
                process: "estimator".into(),
                topic: "estimate".into()
            }
        );
        assert!(
            error
                .to_string()
                .contains("no writer for topic \"estimate\"")
                && error.to_string().contains("`Shell::writer`"),
            "{error}"
        );
        assert_ne!(
            stage.control_page.process(1).state(),
            State::Ready,
            "it does not report itself ready"
        );
        let plant = stage.shell("plant");
        let error = plant.tick_source(0).next().unwrap_err();
        assert!(
            matches!(&error, Interrupted::Unopened { topic, .. } if topic == "sensor"),
            "{error}"
        );
    }
}
