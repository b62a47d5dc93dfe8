//! Loans, and the end of a tick with the last of its outputs.

use super::*;

#[test]
fn a_loan_is_empty_and_a_dropped_one_is_not_sent() {
    let stage = stage(Mode::Lockstep);
    let (_estimator, mut sensors, mut inlet) = stage.pair();
    for tick in 0..200 {
        sensors.loan(tick).unwrap().q_encoder = [7.0; 8];
        let loan = sensors.loan(tick).unwrap();
        assert_eq!(
            (loan.header.tick, loan.q_encoder),
            (tick, [0.0; 8]),
            "nothing of earlier messages is left in it"
        );
        loan.q_encoder[2] = tick as f64;
        sensors.send().unwrap();
        let lent = inlet.at(tick).unwrap().unwrap();
        assert_eq!(
            (lent.header.tick, lent.q_encoder[2..4].to_vec()),
            (tick, vec![tick as f64, 0.0])
        );
    }
}

#[test]
fn a_tick_is_closed_with_the_last_of_its_outputs_and_its_checkpoint_is_committed_by_then() {
    let stage = stage_of(Mode::Realtime, &["plant", "estimator"], |manifest| {
        manifest.processes[1].writes.push("singularity".into());
    });
    let (run, line) = (stage.run.path(), stage.control_page.process(1));
    let first = Shell::open(run, "estimator").unwrap();
    let mut estimates = first.writer::<StateEstimate>().unwrap();
    let mut reports = first.writer::<SingularityReport>().unwrap();
    let (cell, earlier) = first.state_cell(1).unwrap();
    assert_eq!(earlier, None);
    for tick in 0..5 {
        assert!(cell.write(&[tick as u8]));
        send(&mut estimates, [tick]);
        assert_eq!(line.ticks(), tick, "one output is missing");
        send(&mut reports, [tick]);
        assert_eq!(line.ticks(), tick + 1);
    }
    // It dies in the middle of tick 5, which it will not have sent.
    assert!(cell.write(&[5]));
    send(&mut estimates, [5]);
    drop(first);
    line.begin_incarnation();
    let second = Shell::open(run, "estimator").unwrap();
    assert_eq!(second.state_cell(1).unwrap().1, Some(vec![4]));
}
