//! Single decisions of the protocol, on the machine that the simulation explores.

use super::*;
use crate::engine::Carried;
use crate::simulation::Graph;

#[test]
fn a_process_that_dies_again_before_it_answers_has_the_incarnation_of_both_deaths() {
    let death = |place, at, until| Outage {
        place,
        process: 1,
        at,
        until,
        has_struck: false,
        is_death: true,
        is_unplanned: false,
        after_outputs: 0,
    };
    let graph = Graph {
        reads: vec![vec![], vec![(0, 0)]],
        outputs: vec![1, 1],
        ticks: 20,
    };
    let mut run = graph.begin(&[death(0, 5, 10), death(1, 5, 12)], None);
    run.run().unwrap();
    assert_eq!(
        (run.processes[1].progress.incarnation, run.broken),
        (3, None)
    );
    let ticks: Vec<_> = run.topics[1].retained.iter().map(Carried::tick).collect();
    assert_eq!(ticks, (0..5).chain(12..20).collect::<Vec<_>>());
}

/// Three processes at the same tick: the source, one of the chain, the recorder.
struct At7 {
    chain: u64,
}

impl View for At7 {
    fn processes(&self) -> usize {
        3
    }
    fn role(&self, process: usize) -> Role {
        Role {
            makes_ticks: process == 0,
            polled: process == 2,
        }
    }
    fn progress(&self, process: usize) -> Progress {
        let ticks = if process == 1 { self.chain } else { 7 };
        Progress {
            ticks,
            incarnation: 1,
            is_running: true,
            awaits_progress: true,
        }
    }
    fn has_faults(&self) -> bool {
        false
    }
    fn outages(&self) -> impl Iterator<Item = Outage> {
        std::iter::empty()
    }
    fn is_lockstep(&self) -> bool {
        true
    }
}

#[test]
fn an_unplanned_death_lasts_until_the_source_cannot_have_passed_its_end() {
    let down = |rate_hz| {
        let death = unplanned_death(1, 500, 0, rate_hz);
        death.until - death.at
    };
    assert_eq!(
        [1_000, 100, 1].map(down),
        [100, CHAIN_LAG + 2, CHAIN_LAG + 2]
    );
}

#[test]
fn without_faults_the_source_waits_for_those_that_lag_and_for_no_other() {
    let follows = At7 { chain: u64::MAX };
    let source = Protocol::new(&follows, 0);
    assert_eq!(
        (source.reports_to(), source.returns_at(), source.downfall(7)),
        (Report::Unneeded, 0, None)
    );
    assert_eq!(Protocol::new(&follows, 1).reports_to(), Report::Source(0));
    assert_eq!(
        (
            source.holds_back(7 + RECORDER_LAG),
            source.holds_back(8 + RECORDER_LAG)
        ),
        (None, Some(2))
    );
    let follows = At7 { chain: 7 };
    let source = Protocol::new(&follows, 0);
    assert_eq!(
        (
            source.holds_back(7 + CHAIN_LAG),
            source.holds_back(8 + CHAIN_LAG)
        ),
        (None, Some(1))
    );
    assert_eq!(
        (source.unfinished(7), source.unfinished(8)),
        (None, Some(1))
    );
    assert!(
        source.has_closed(Some(1), 6)
            && !source.has_closed(Some(1), 7)
            && !source.has_closed(None, 0)
    );
    assert!(source.is_settled(7) && !source.is_settled(8));
}
