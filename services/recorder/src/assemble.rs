//! From five streams of messages to whole ticks.

use std::collections::VecDeque;

use shared_types::{PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

/// What has come of one tick so far.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// The tick.
    pub tick: u64,
    /// From the plant.
    pub sensor: Option<SensorSample>,
    /// From the plant.
    pub truth: Option<PlantState>,
    /// From the estimator.
    pub estimate: Option<StateEstimate>,
    /// From the analyzer.
    pub report: Option<SingularityReport>,
    /// From the controller.
    pub command: Option<TorqueCommand>,
}

impl Row {
    /// Becomes the row of a tick of which nothing has come; writes no more than that.
    fn begin(&mut self, tick: u64) {
        self.tick = tick;
        (self.sensor, self.truth, self.estimate, self.report, self.command) = (None, None, None, None, None);
    }

    fn is_whole(&self) -> bool {
        self.sensor.is_some() && self.truth.is_some() && self.estimate.is_some() && self.report.is_some() && self.command.is_some()
    }
}

/// Collects messages by tick and gives out rows in order: whole ones at once, torn ones when they are `patience` ticks old.
///
/// Rows are large: they stay where they are and are used again.
#[derive(Debug)]
pub struct Assembler {
    /// What there is, by tick.
    rows: VecDeque<Box<Row>>,
    given: Option<Box<Row>>,
    spare: Vec<Box<Row>>,
    next: u64,
    patience: u64,
    horizon: u64,
}

impl Assembler {
    /// An assembler that waits `patience` ticks for what is missing. Ticks of which nothing has come are given out empty; where there are more
    /// than `horizon` of them on end they are not, and what comes after them has to wait for its time: the tick may be a wrong one.
    #[must_use]
    pub fn new(patience: u64, horizon: u64) -> Self {
        Self { rows: VecDeque::new(), given: None, spare: Vec::new(), next: 0, patience, horizon }
    }

    /// Goes on where an earlier assembler had come to, with the rows that it had not given out.
    pub fn resume(&mut self, next: u64, rows: impl IntoIterator<Item = Row>) {
        self.next = next;
        self.rows.extend(rows.into_iter().map(Box::new));
    }

    /// The next tick to be given out.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.next
    }

    /// The next tick to be given out, and what there is of it and the ticks after it.
    pub fn pending(&self) -> (u64, impl Iterator<Item = &Row>) {
        (self.next, self.rows.iter().map(|row| &**row))
    }

    /// The row of a tick; `None` when it has been given out already.
    pub fn row(&mut self, tick: u64) -> Option<&mut Row> {
        if tick < self.next {
            return None;
        }
        let place = self.rows.partition_point(|row| row.tick < tick);
        if self.rows.get(place).is_none_or(|row| row.tick != tick) {
            let row = self.empty(tick);
            self.rows.insert(place, row);
        }
        self.rows.get_mut(place).map(|row| &mut **row)
    }

    /// The next row, if it is whole, or too old to wait for at tick `now`; with `flush`, whatever there is.
    ///
    /// The age counts from what was on its way before the topics were looked at, not from what has come since: topics are taken in one after
    /// the other, and the last of them may be far ahead of the first.
    pub fn pop(&mut self, now: u64, flush: bool) -> Option<&Row> {
        let front = self.rows.front()?;
        let gap = front.tick - self.next;
        let is_jump = gap > self.horizon;
        let is_old = if is_jump { front.tick < now } else { self.next.saturating_add(self.patience) < now };
        if !(is_old || flush || gap == 0 && front.is_whole()) {
            return None;
        }
        self.spare.extend(self.given.take());
        self.given = if gap == 0 || is_jump { self.rows.pop_front() } else { Some(self.empty(self.next)) };
        self.next = self.given.as_ref()?.tick.saturating_add(1);
        self.given.as_deref()
    }

    /// A row of which nothing has come, where one has been given back in its place.
    fn empty(&mut self, tick: u64) -> Box<Row> {
        let mut row = self.spare.pop().unwrap_or_default();
        row.begin(tick);
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(assembler: &mut Assembler, tick: u64) {
        let row = assembler.row(tick).unwrap();
        row.sensor = Some(SensorSample::default());
        row.truth = Some(PlantState::default());
        row.estimate = Some(StateEstimate::default());
        row.report = Some(SingularityReport::default());
        row.command = Some(TorqueCommand::default());
    }

    #[test]
    fn rows_come_whole_and_in_order() {
        let mut assembler = Assembler::new(10, 20);
        fill(&mut assembler, 1);
        assert!(assembler.pop(0, false).is_none(), "tick 0 is still missing");
        fill(&mut assembler, 0);
        assert_eq!((assembler.pop(0, false).unwrap().tick, assembler.pop(0, false).unwrap().tick), (0, 1));
        assert!(assembler.pop(0, false).is_none());
        assert!(assembler.row(0).is_none(), "given out already");
    }

    #[test]
    fn what_is_missing_is_not_waited_for_for_ever() {
        let mut assembler = Assembler::new(3, 6);
        assembler.row(0).unwrap().sensor = Some(SensorSample::default());
        (1..=3).for_each(|tick| fill(&mut assembler, tick));
        assert!(assembler.pop(3, false).is_none(), "the rest of tick 0 may still be in a buffer");
        let torn = assembler.pop(4, false).unwrap();
        assert!(torn.tick == 0 && torn.truth.is_none());
        assert_eq!(assembler.pop(4, false).unwrap().tick, 1);
    }

    #[test]
    fn ticks_of_which_nothing_came_are_given_out_empty() {
        let mut assembler = Assembler::new(3, 6);
        (0..8).filter(|tick| !(2..4).contains(tick)).for_each(|tick| fill(&mut assembler, tick));
        let mut rows = Vec::new();
        while let Some(row) = assembler.pop(7, false) {
            rows.push((row.tick, row.is_whole(), row.sensor.is_some()));
        }
        let expected: Vec<_> = (0..8).map(|tick| (tick, !(2..4).contains(&tick), !(2..4).contains(&tick))).collect();
        assert_eq!(rows, expected);
    }

    #[test]
    fn topics_that_are_drained_one_after_the_other_lose_nothing() {
        let mut assembler = Assembler::new(256, 2048);
        for place in 0..5 {
            for tick in 0..1024 {
                let row = assembler.row(tick).unwrap();
                match place {
                    0 => row.sensor = Some(SensorSample::default()),
                    1 => row.truth = Some(PlantState::default()),
                    2 => row.estimate = Some(StateEstimate::default()),
                    3 => row.report = Some(SingularityReport::default()),
                    _ => row.command = Some(TorqueCommand::default()),
                }
            }
        }
        let whole = std::iter::from_fn(|| assembler.pop(0, false).map(Row::is_whole)).collect::<Vec<_>>();
        assert_eq!(whole, [true; 1024]);
    }

    #[test]
    fn the_end_gives_out_everything() {
        let mut assembler = Assembler::new(3, 6);
        assembler.row(1).unwrap().sensor = Some(SensorSample::default());
        assert_eq!((assembler.pop(0, true).unwrap().tick, assembler.pop(0, true).unwrap().tick), (0, 1));
        assert!(assembler.pop(0, true).is_none());
    }

    #[test]
    fn a_tick_from_nowhere_costs_nothing_but_itself() {
        let mut assembler = Assembler::new(3, 6);
        fill(&mut assembler, 0);
        assembler.row(1_000_000_000).unwrap().sensor = Some(SensorSample::default());
        fill(&mut assembler, 1);
        assembler.row(2).unwrap().sensor = Some(SensorSample::default());
        let mut ticks = |now: u64, flush| std::iter::from_fn(|| assembler.pop(now, flush).map(|row| row.tick)).collect::<Vec<_>>();
        assert_eq!(ticks(3, false), [0, 1]);
        assert_eq!((ticks(6, false), ticks(500, false), ticks(6, true)), (vec![2], vec![], vec![1_000_000_000]));
    }
}
