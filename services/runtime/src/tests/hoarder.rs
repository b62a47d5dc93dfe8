//! A reader that keeps what it has read.

use super::*;

#[test]
fn a_reader_that_never_releases_its_samples_harms_itself_alone() {
    let stage = stage(Mode::Realtime);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let topic = Topic::open(
        &join(&stage.run, "hoarder", false).unwrap(),
        Format::of::<SensorSample>(),
    )
    .unwrap();
    let hoarder = topic.receiver(CHAIN_DEPTH).unwrap();
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    let mut hoarded = Vec::new();
    for tick in 0..10 * RECORDER_DEPTH as u64 {
        sensors.send(sample(tick)).unwrap();
        assert_eq!(inlet.next().unwrap().unwrap().header.tick, tick);
        hoarded.extend(hoarder.receive().ok().flatten());
    }
    assert!(hoarder.receive().is_err(), "it is refused more");
    assert_eq!(
        hoarded.iter().map(|held| held.tick()).collect::<Vec<_>>(),
        [0, 1, 2, 3],
        "and what it holds stays as it was"
    );
}
