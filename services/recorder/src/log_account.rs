//! The state of one message log as it is read: how many messages it gave, and what is wrong with it, in words.

use message_log::{Defect, LogError, TopicHash};

/// The messages read of a log, and its flaws.
#[derive(Debug)]
pub(crate) struct LogAccount {
    pub(crate) topic: String,
    pub(crate) hash: TopicHash,
    /// Tick of the last message read.
    pub(crate) last: Option<u64>,
    flaws: Vec<Flaw>,
}

/// The kind of a flaw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Places of the file.
    Of(Defect),
    /// The whole file.
    IsOtherRun,
    IsOtherLog,
    IsAbsent,
}

/// A place at which the log is not as it was written.
#[derive(Clone, Copy, Debug)]
struct Flaw {
    kind: Kind,
    /// Tick of the last message before it, and of the first behind it; without where there is none.
    after: Option<u64>,
    before: Option<u64>,
    /// Messages that are known to be lost, where none follows.
    lost: u64,
    /// Tick of the block, where none is lost.
    tick: Option<u64>,
}

impl Flaw {
    fn is_loss(&self) -> bool {
        !matches!(self.kind, Kind::Of(Defect::Repeated | Defect::Displaced))
    }

    /// The first tick that it concerns.
    fn begin(&self) -> u64 {
        self.tick
            .filter(|_| !self.is_loss())
            .unwrap_or_else(|| self.after.map_or(0, |after| after.saturating_add(1)))
    }

    /// Ticks of which the messages are lost; `end` is the first tick of which no log has a message.
    fn ticks(&self, end: u64) -> u64 {
        let begin = self.begin();
        match self.before {
            _ if !self.is_loss() => 0,
            Some(before) => before.saturating_sub(begin),
            None => end.saturating_sub(begin).max(self.lost),
        }
    }
}

impl LogAccount {
    pub(crate) fn new(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            hash: TopicHash::default(),
            last: None,
            flaws: Vec::new(),
        }
    }

    /// A message of a tick has been read.
    pub(crate) fn read(&mut self, tick: u64) {
        self.flaws
            .last_mut()
            .filter(|flaw| flaw.is_loss() && flaw.before.is_none())
            .into_iter()
            .for_each(|flaw| flaw.before = Some(tick));
        self.last = Some(tick);
    }

    /// The reader has come to a place that is not as it was written, or cannot read the log at all.
    pub(crate) fn fail(&mut self, error: &LogError) {
        let (kind, lost, tick) = match error {
            LogError::OtherRun { .. } => (Kind::IsOtherRun, 0, None),
            LogError::OtherLog { .. } => (Kind::IsOtherLog, 0, None),
            LogError::Place {
                defect, lost, tick, ..
            } => (Kind::Of(*defect), *lost, *tick),
            _ => (Kind::Of(Defect::Damaged), 0, None),
        };
        let flaw = Flaw {
            kind,
            after: self.last,
            before: None,
            lost,
            tick,
        };
        match self
            .flaws
            .last_mut()
            .filter(|open| open.is_loss() && open.before.is_none() && flaw.is_loss())
        {
            // The same gap in the messages: the first cause stands for it.
            Some(open) => open.lost += lost,
            None => self.flaws.push(flaw),
        }
    }

    /// There is no log, or an empty one, and others tell of messages in it.
    pub(crate) fn is_absent(&mut self, messages: u64) {
        self.flaws.push(Flaw {
            kind: Kind::IsAbsent,
            after: None,
            before: None,
            lost: messages,
            tick: None,
        });
    }

    /// The flaws of the log in words; `end` is the first tick of which no log has a message.
    pub(crate) fn damage(&self, end: u64) -> Option<String> {
        let mut kinds: Vec<Kind> = Vec::new();
        self.flaws.iter().for_each(|flaw| {
            if !kinds.contains(&flaw.kind) {
                kinds.push(flaw.kind);
            }
        });
        let clauses: Vec<String> = kinds
            .into_iter()
            .filter_map(|kind| self.clause(kind, end))
            .collect();
        (!clauses.is_empty()).then(|| clauses.join("; "))
    }

    fn clause(&self, kind: Kind, end: u64) -> Option<String> {
        let flaws = || self.flaws.iter().filter(|flaw| flaw.kind == kind);
        let (first, places, log) = (
            flaws().map(Flaw::begin).min()?,
            flaws().count(),
            format!("{}.log", self.topic),
        );
        let place = if places > 1 {
            format!("in {places} places, first at tick {first}")
        } else {
            format!("at tick {first}")
        };
        let lost = match flaws()
            .map(|flaw| flaw.ticks(end))
            .fold(0, u64::saturating_add)
        {
            // Nothing tells how many: no other log is of this run.
            0 if matches!(kind, Kind::IsOtherRun | Kind::IsOtherLog) => {
                "its own messages are lost".to_owned()
            }
            0 => "no message is lost".to_owned(),
            ticks => format!("its messages of {ticks} ticks are lost"),
        };
        Some(match kind {
            Kind::Of(Defect::Damaged) => format!("{log} is damaged {place}: {lost}"),
            Kind::Of(Defect::Missing) => format!("{log} lacks blocks {place}: {lost}"),
            Kind::Of(Defect::Repeated) => format!("{log} holds blocks twice {place}: {lost}"),
            Kind::Of(Defect::Displaced) => {
                format!("{log} holds blocks out of their order {place}: {lost}")
            }
            Kind::Of(Defect::OtherRun) => {
                format!("{log} holds blocks of another run {place}: {lost}")
            }
            Kind::Of(Defect::OtherLog) => {
                format!("{log} holds blocks of another log {place}: {lost}")
            }
            Kind::IsOtherRun => format!("{log} is the log of another run: {lost}"),
            Kind::IsOtherLog => format!("{log} is another log of its run, renamed: {lost}"),
            Kind::IsAbsent => format!("{log} is missing or empty: {lost}"),
        })
    }
}
