//! Assembles streams of messages into whole ticks.

use std::collections::VecDeque;

use bytemuck::{bytes_of, try_pod_read_unaligned};
use serde_bytes::ByteBuf;
use shared_types::topics::{self, ByTopic, COUNT, Each, Received, Topic, Whole};

/// Topics, one bit each, at their places in the list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Set(u32);

const _: () = assert!(COUNT <= 32);

impl Set {
    /// The topics of the list with this property.
    pub fn of(mut is_in: impl FnMut(&str) -> bool) -> Self {
        (0..)
            .zip(topics::TOPICS)
            .filter(|(_, topic)| is_in(topic))
            .fold(Self(0), |set, (place, _)| Self(set.0 | 1 << place))
    }

    fn add<M: Topic>(&mut self) {
        self.0 |= 1 << M::INDEX;
    }

    fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// A row that waits for messages, in a checkpoint: its tick, and the bytes of those that have come.
pub(crate) type StoredRow = (u64, Vec<(usize, ByteBuf)>);

/// The messages of one tick so far.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// The tick.
    pub tick: u64,
    messages: ByTopic<Received>,
    come: Set,
}

impl Row {
    /// The row of a tick, with all messages of it.
    pub fn new(tick: u64, whole: &ByTopic<Whole>) -> Self {
        struct Fill<'a>(&'a mut Row, &'a ByTopic<Whole>);
        impl Each for Fill<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                self.0.put(M::of(self.1));
            }
        }
        let mut row = Self::empty(tick);
        topics::each(&mut Fill(&mut row, whole));
        row
    }

    fn empty(tick: u64) -> Self {
        Self {
            tick,
            ..Self::default()
        }
    }

    /// The messages received.
    pub fn messages(&self) -> &ByTopic<Received> {
        &self.messages
    }

    /// Takes a message in.
    pub fn put<M: Topic>(&mut self, message: &M) {
        *M::of_mut(&mut self.messages) = Some(*message);
        self.come.add::<M>();
    }

    /// The bytes of the messages received, with the place of their topic in the list.
    pub(crate) fn bytes(&self) -> Vec<(usize, ByteBuf)> {
        struct Stored<'a>(&'a ByTopic<Received>);
        impl Each for Stored<'_> {
            type Output = Option<(usize, ByteBuf)>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                let message = M::of(self.0).as_ref()?;
                Some((M::INDEX, ByteBuf::from(bytes_of(message))))
            }
        }
        topics::each(&mut Stored(&self.messages))
            .into_iter()
            .flatten()
            .collect()
    }
}

/// Puts a message into a row, from its bytes.
pub(crate) type Put = fn(&mut Row, &[u8]);

/// The way into a row for each topic, in the order of the list.
pub(crate) fn puts() -> [Put; COUNT] {
    struct Puts;
    impl Each for Puts {
        type Output = Put;
        fn each<M: Topic>(&mut self) -> Put {
            |row, bytes| {
                if let Ok(message) = try_pod_read_unaligned::<M>(bytes) {
                    row.put(&message);
                }
            }
        }
    }
    topics::each(&mut Puts)
}

/// Collects messages by tick and gives out rows in order: whole ones at once, torn ones when they are `patience` ticks old.
#[derive(Debug)]
pub struct Assembler {
    /// By tick. They are large: they stay where they are while their places in the queue change.
    rows: VecDeque<Box<Row>>,
    next: u64,
    /// The topics of a complete tick.
    expected: Set,
    patience: u64,
    horizon: u64,
}

impl Assembler {
    /// An assembler of ticks that are whole with the messages of the topics `expected`. It waits
    /// `patience` ticks for missing messages. Ticks of which nothing has come are given out empty;
    /// where there are more than `horizon` of them on end they are not, and what comes after them
    /// has to wait for its time: the tick may be a wrong one.
    pub fn new(expected: Set, patience: u64, horizon: u64) -> Self {
        Self {
            rows: VecDeque::new(),
            next: 0,
            expected,
            patience,
            horizon,
        }
    }

    /// Continues an earlier assembler's work, with the rows that it had not given out.
    pub(crate) fn resume(&mut self, next: u64, rows: Vec<StoredRow>) {
        self.next = next;
        let puts = puts();
        for (tick, messages) in rows {
            if let Some(row) = self.row(tick) {
                messages
                    .iter()
                    .for_each(|(topic, bytes)| puts[*topic](row, bytes));
            }
        }
    }

    /// The next tick to be given out.
    pub fn next_tick(&self) -> u64 {
        self.next
    }

    /// The messages of the next tick to be given out, and of later ones.
    pub(crate) fn pending(&self) -> Vec<StoredRow> {
        self.rows
            .iter()
            .map(|row| (row.tick, row.bytes()))
            .collect()
    }

    /// The row of a tick; `None` when it has been given out already.
    pub fn row(&mut self, tick: u64) -> Option<&mut Row> {
        if tick < self.next {
            return None;
        }
        // Rows are of ticks on end, but for gaps.
        let front = self.rows.front().map_or(tick, |row| row.tick);
        let place = usize::try_from(tick.saturating_sub(front)).unwrap_or(usize::MAX);
        let place = match self.rows.get(place) {
            Some(row) if row.tick == tick => place,
            _ => self.rows.partition_point(|row| row.tick < tick),
        };
        if self.rows.get(place).is_none_or(|row| row.tick != tick) {
            self.rows.insert(place, Box::new(Row::empty(tick)));
        }
        self.rows.get_mut(place).map(Box::as_mut)
    }

    /// The next row, if it is whole, or too old to wait for at tick `now`; with `flush`, whatever there is.
    ///
    /// The age counts from what was on its way before the topics were looked at, not from what has come since: topics are taken in one after
    /// the other, and the last of them may be far ahead of the first.
    pub fn pop(&mut self, now: u64, flush: bool) -> Option<Box<Row>> {
        if !(flush || self.is_ready(now)) {
            return None;
        }
        let gap = self.rows.front()?.tick - self.next;
        let row = match gap == 0 || gap > self.horizon {
            true => self.rows.pop_front()?,
            false => Box::new(Row::empty(self.next)),
        };
        self.next = row.tick.saturating_add(1);
        Some(row)
    }

    /// Whether [`pop`](Self::pop) has a row at tick `now`.
    pub(crate) fn is_ready(&self, now: u64) -> bool {
        self.rows.front().is_some_and(|front| {
            let gap = front.tick - self.next;
            let is_old = if gap > self.horizon {
                front.tick < now
            } else {
                self.next.saturating_add(self.patience) < now
            };
            is_old || gap == 0 && front.come.contains(self.expected)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::SensorSample;

    fn fill(assembler: &mut Assembler, tick: u64) {
        *assembler.row(tick).unwrap() = Row::new(tick, &ByTopic::default());
    }

    fn assembler(patience: u64, horizon: u64) -> Assembler {
        Assembler::new(Set::of(|_| true), patience, horizon)
    }

    /// The ticks that are given out now.
    fn given(assembler: &mut Assembler, now: u64, flush: bool) -> Vec<u64> {
        std::iter::from_fn(|| assembler.pop(now, flush).map(|row| row.tick)).collect()
    }

    #[test]
    fn rows_come_whole_and_in_order() {
        let mut assembler = assembler(10, 20);
        fill(&mut assembler, 1);
        // Tick 0 is still missing.
        assert!(given(&mut assembler, 0, false).is_empty());
        fill(&mut assembler, 0);
        assert_eq!(given(&mut assembler, 0, false), [0, 1]);
        assert!(assembler.row(0).is_none(), "given out already");
    }

    #[test]
    fn a_missing_message_is_not_waited_for_for_ever() {
        let mut assembler = assembler(3, 6);
        assembler.row(0).unwrap().put(&SensorSample::default());
        (1..=3).for_each(|tick| fill(&mut assembler, tick));
        // The rest of tick 0 may still be in a buffer.
        assert!(given(&mut assembler, 3, false).is_empty());
        let torn = assembler.pop(4, false).unwrap();
        assert!(torn.tick == 0 && torn.messages().plant_state.is_none());
        assert_eq!(given(&mut assembler, 4, false)[0], 1);
    }

    #[test]
    fn ticks_of_which_nothing_came_are_given_out_empty() {
        let mut assembler = assembler(3, 6);
        let has_come = |tick: u64| !(2..4).contains(&tick);
        let come = (0..8).filter(|tick| has_come(*tick));
        come.for_each(|tick| fill(&mut assembler, tick));
        for tick in 0..8 {
            let row = assembler.pop(7, false).unwrap();
            let is_whole = row.come == Set::of(|_| true);
            let has_sensor = row.messages().sensor.is_some();
            assert_eq!(
                (row.tick, is_whole, has_sensor),
                (tick, has_come(tick), has_come(tick))
            );
        }
        assert!(assembler.pop(7, false).is_none());
    }

    #[test]
    fn topics_that_are_drained_one_after_the_other_lose_nothing() {
        let mut assembler = assembler(256, 2048);
        struct Drain<'a>(&'a mut Assembler);
        impl Each for Drain<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                (0..1024).for_each(|tick| self.0.row(tick).unwrap().put(&M::zeroed()));
            }
        }
        topics::each(&mut Drain(&mut assembler));
        let whole = std::iter::from_fn(|| {
            assembler
                .pop(0, false)
                .map(|row| row.come == Set::of(|_| true))
        })
        .collect::<Vec<_>>();
        assert_eq!(whole, [true; 1024]);
    }

    #[test]
    fn a_tick_is_whole_without_the_topics_that_nobody_writes() {
        let mut assembler = Assembler::new(Set::of(|topic| topic == "sensor"), 10, 20);
        assembler.row(0).unwrap().put(&SensorSample::default());
        assert!(assembler.pop(0, false).is_some());
    }

    #[test]
    fn the_end_gives_out_everything() {
        let mut assembler = assembler(3, 6);
        assembler.row(1).unwrap().put(&SensorSample::default());
        assert_eq!(given(&mut assembler, 0, true), [0, 1]);
    }

    #[test]
    fn a_tick_from_nowhere_costs_nothing_but_itself() {
        let mut assembler = assembler(3, 6);
        let far = 1_000_000_000;
        fill(&mut assembler, 0);
        assembler.row(far).unwrap().put(&SensorSample::default());
        fill(&mut assembler, 1);
        assembler.row(2).unwrap().put(&SensorSample::default());
        for (now, flush, ticks) in [
            (3, false, &[0, 1][..]),
            (6, false, &[2]),
            (500, false, &[]),
            (6, true, &[far]),
        ] {
            assert_eq!(given(&mut assembler, now, flush), ticks);
        }
    }
}
