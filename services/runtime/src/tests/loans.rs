//! Loans, and the end of a tick with the last of its outputs.

use super::*;

/// A state of one number.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Counted(f64);

impl shared_types::wire::Part for Counted {
    const ELEMENT: &'static str = "Counted";
    fn is_finite(&self) -> bool {
        self.0.is_finite()
    }
}

impl shared_types::Layout for Counted {
    const TYPE_NAME: &'static str = "armplane.test.Counted.v1";
    const FIELDS: &'static [shared_types::wire::Field] = &[];
    const ABOUT: &'static str = "";
}

impl shared_types::Checkpoint for Counted {}

#[test]
fn a_loan_is_empty_and_a_dropped_one_is_not_sent() {
    let stage = stage(Mode::Lockstep);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer::<SensorSample>().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    for tick in 0..200 {
        let mut abandoned = sensors.loan(tick).unwrap();
        abandoned.q_encoder = [7.0; 8];
        drop(abandoned);
        let mut loan = sensors.loan(tick).unwrap();
        assert_eq!(
            *loan,
            sample(tick),
            "nothing of earlier messages is left in it"
        );
        loan.q_encoder[2] = tick as f64;
        loan.send().unwrap();
        let lent = inlet.at(tick).unwrap().unwrap();
        assert_eq!(
            (lent.header.tick, lent.q_encoder[2], lent.q_encoder[3]),
            (tick, tick as f64, 0.0)
        );
    }
}

#[test]
fn a_tick_is_closed_with_the_last_of_its_outputs_and_its_checkpoint_is_committed_by_then() {
    let stage = stage(Mode::Lockstep);
    let (run, entry) = (RunDir::create().unwrap(), 1);
    let mut manifest = Manifest::read(&stage.run).unwrap();
    manifest.processes[entry].writes = vec!["estimate".into(), "singularity".into()];
    manifest.write(&run).unwrap();
    let (control_page, _hub) = (
        ControlPage::create(&run).unwrap(),
        Hub::create(&run, &manifest).unwrap(),
    );
    control_page.process(entry).begin_incarnation();
    control_page.begin(Phase::Work);
    let first = Shell::open(run.path(), "estimator").unwrap();
    let (mut estimates, mut reports) = (
        first.writer::<StateEstimate>().unwrap(),
        first.writer::<SingularityReport>().unwrap(),
    );
    let mut checkpoint = first.checkpoint::<Counted>().unwrap();
    assert_eq!(checkpoint.previous(), None);
    for tick in 0..5 {
        *checkpoint.slot() = Counted(tick as f64);
        estimates.loan(tick).unwrap().send().unwrap();
        assert_eq!(
            control_page.process(entry).ticks(),
            tick,
            "one output is missing"
        );
        reports.loan(tick).unwrap().send().unwrap();
        assert_eq!(control_page.process(entry).ticks(), tick + 1);
    }
    // It dies in the middle of tick 5, which it will not have sent: once before and once after its state is committed.
    *checkpoint.slot() = Counted(5.0);
    estimates.loan(5).unwrap().send().unwrap();
    let predecessor = first.shared();
    drop(first);
    for is_committed in [false, true] {
        if is_committed {
            predecessor.commit(5);
        }
        let death = Fault {
            at_tick: Some(5),
            for_ticks: Some(2),
            ..Fault::new("estimator", Kind::Kill)
        }
        .schedule(&on(1), 1000, 0)
        .unwrap();
        let place = control_page
            .fault_table()
            .enter(&death, Origin::Detected)
            .unwrap();
        control_page.fault_table().mark_injected(place, now_ns());
        control_page.process(entry).begin_incarnation();
        let second = Shell::open(run.path(), "estimator").unwrap();
        assert_eq!(
            second.checkpoint::<Counted>().unwrap().previous(),
            Some(&Counted(4.0)),
            "{is_committed}"
        );
    }
}
