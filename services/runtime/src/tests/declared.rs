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
    assert!(matches!(stranger, Err(ProcessError::NotInGraph { .. })));
    let mut manifest = estimator.manifest().clone();
    manifest.processes[0].writes = vec!["weather".into()];
    let hub = Hub::create(&RunDir::create().unwrap(), &manifest).map(drop);
    assert!(matches!(hub, Err(TopicError::Unknown { .. })));
}
