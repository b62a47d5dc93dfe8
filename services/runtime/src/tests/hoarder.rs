//! A reader that keeps the messages it has read.

use super::*;

#[test]
fn a_reader_that_never_releases_its_samples_harms_itself_alone() {
    let stage = stage(Mode::Realtime);
    let (_estimator, mut sensors, mut inlet) = stage.pair();
    let bus = join(&stage.run, "hoarder", false).unwrap();
    let topic = Topic::open(&bus, Format::of::<SensorSample>()).unwrap();
    let hoarder = topic.receiver(CHAIN_DEPTH).unwrap();
    let mut hoarded = Vec::new();
    for tick in 0..10 * RECORDER_DEPTH as u64 {
        send(&mut sensors, [tick]);
        assert_eq!(next(&mut inlet), Ok(Some(tick)));
        hoarded.extend(hoarder.receive().ok().flatten());
    }
    assert!(hoarder.receive().is_err(), "it is refused more");
    let ticks: Vec<_> = hoarded.iter().map(|held| held.tick()).collect();
    assert_eq!(ticks, [0, 1, 2, 3], "what it holds stays as it was");
}
