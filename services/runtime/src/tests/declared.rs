//! Topics that the graph declares for a process.

use super::*;

#[test]
fn only_declared_topics_open() {
    let stage = stage(Mode::Lockstep);
    let estimator = stage.shell("estimator");
    let refused = [
        estimator.writer::<SensorSample>().map(drop),
        estimator.reader::<PlantState>().map(drop),
    ];
    let action = |end: Result<(), TopicError>| match end {
        Err(TopicError::Undeclared { action, .. }) => action,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused.map(action), ["write", "read"]);
    let stranger = Shell::open(stage.run.path(), "tourist").map(drop);
    assert!(matches!(stranger, Err(OpenError::NotInGraph { .. })));
    let mut manifest = estimator.manifest().clone();
    manifest.processes[0].writes = vec!["weather".into()];
    let hub = Hub::create(&RunDir::create().unwrap(), &manifest).map(drop);
    assert!(matches!(hub, Err(TopicError::Unknown { .. })));
}

#[test]
fn a_process_without_a_writer_for_a_declared_topic_does_not_begin() {
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let stage = stage(mode);
        let estimator = Shell::open(stage.run.path(), "estimator").unwrap();
        let mut inlet = estimator.reader::<SensorSample>().unwrap();
        let unopened = |process: &str, topic: &str| Interrupted::Unopened {
            process: process.into(),
            topic: topic.into(),
        };
        assert_eq!(next(&mut inlet), Err(unopened("estimator", "estimate")));
        // It does not report itself ready.
        assert_ne!(stage.control_page.process(1).state(), State::Ready);
        let plant = stage.shell("plant");
        assert_eq!(
            plant.tick_source(0).next(),
            Err(unopened("plant", "sensor"))
        );
    }
}
