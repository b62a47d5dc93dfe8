//! The messages of a run, tick by tick, as the recorder kept them.

use std::path::Path;

use message_log::{LogError, LogReader, Logs, RowReader, Shape, TopicHash};
use shared_types::job::Job;
use shared_types::summary::Summary;
use shared_types::topics::{self, Build, ByTopic, Each, Family, Topic};

use crate::assemble::{Assembler, Row, Set};
use crate::foreign::content;
use crate::log_account::LogAccount;
use crate::{HORIZON, PATIENCE};

/// Ticks that are taken from the messages at a time.
const STRIDE: u64 = 64;

/// The messages of all topics, in the order of their ticks.
struct StoredMessages;

impl Family for StoredMessages {
    type Of<M: Topic> = Option<Messages<M>>;
}

struct Messages<M: Topic> {
    /// `None`: no message has reached a file.
    reader: Option<LogReader<M>>,
    /// Read, and of a later tick than was asked for.
    next: Option<M>,
    account: LogAccount,
}

impl<M: Topic> Messages<M> {
    /// The next message; a place that is not as it was written is noted and passed over. A block that was being written when its writer died ends the log.
    fn read(&mut self) -> Option<M> {
        loop {
            match self.reader.as_mut()?.next_message() {
                Ok(message) => {
                    message
                        .iter()
                        .for_each(|message| self.account.read(message.header().tick));
                    return message;
                }
                Err(error) => {
                    self.account.fail(&error);
                    if !error.is_damage() {
                        self.reader = None;
                    }
                }
            }
        }
    }
}

/// The log of a topic that only the graph knows: it is in no row.
struct OwnMessages {
    reader: Option<RowReader>,
    account: LogAccount,
}

impl OwnMessages {
    /// Reads all of it.
    fn read(&mut self) {
        while let Some(reader) = &mut self.reader {
            match reader.next_row() {
                Ok(Some(row)) => {
                    self.account.read(message_log::tick_of(&row));
                    self.account
                        .hash
                        .add_content(content(bytemuck::cast_slice(&row)));
                }
                Err(error) if error.is_damage() => self.account.fail(&error),
                end => {
                    end.err().iter().for_each(|error| self.account.fail(error));
                    self.reader = None;
                }
            }
        }
    }
}

/// The rows of a run's message logs: whatever there is of each tick, in order.
pub struct MessageRows {
    messages: ByTopic<StoredMessages>,
    own: Vec<OwnMessages>,
    assembler: Assembler,
    until: u64,
    has_more: bool,
}

/// A log that may be absent or damaged: that is noted.
fn excused<R>(
    opened: Result<R, LogError>,
    account: &mut LogAccount,
) -> Result<Option<R>, LogError> {
    match opened {
        Err(error) if error.is_before_the_first_message() => Ok(None),
        Err(error) if error.is_damage() => {
            account.fail(&error);
            Ok(None)
        }
        opened => opened.map(Some),
    }
}

impl MessageRows {
    /// The messages of a job's run in a folder, of the topics that its graph's processes write.
    ///
    /// # Errors
    /// [`LogError`] where a topic's messages are not there, are of another run, or are not this program's.
    pub fn open(folder: &Path, job: &Job) -> Result<Self, LogError> {
        Self::open_with(folder, job, false)
    }

    /// The same where a topic may have no log yet, or one that is damaged or of another run.
    ///
    /// # Errors
    /// [`LogError`] where a topic's messages cannot be read or are not this program's.
    pub fn open_left(folder: &Path, job: &Job) -> Result<Self, LogError> {
        Self::open_with(folder, job, true)
    }

    fn open_with(folder: &Path, job: &Job, is_excused: bool) -> Result<Self, LogError> {
        struct Open<'a>(&'a Path, &'a Logs, bool);
        impl Build<StoredMessages> for Open<'_> {
            type Error = LogError;
            fn build<M: Topic>(&mut self) -> Result<Option<Messages<M>>, LogError> {
                if self.1.place(M::TOPIC).is_none() {
                    return Ok(None);
                }
                let mut account = LogAccount::new(M::TOPIC);
                let opened = LogReader::open_of(self.0, self.1);
                let reader = if self.2 {
                    excused(opened, &mut account)?
                } else {
                    Some(opened?)
                };
                Ok(Some(Messages {
                    reader,
                    next: None,
                    account,
                }))
            }
        }
        let logs = Logs::of(job);
        let messages = ByTopic::try_build(&mut Open(folder, &logs, is_excused))?;
        let open = |layout: shared_types::layout::MessageLayout| {
            let mut account = LogAccount::new(&layout.topic);
            let opened = RowReader::open_of(folder, &Shape::from(&layout), &logs);
            let reader = if is_excused {
                excused(opened, &mut account)?
            } else {
                Some(opened?)
            };
            Ok(OwnMessages { reader, account })
        };
        let own = job
            .graph
            .own_messages()
            .map(open)
            .collect::<Result<_, LogError>>()?;
        let assembler = Assembler::new(
            Set::of(|topic| job.graph.writer(topic).is_some()),
            PATIENCE,
            HORIZON,
        );
        let mut rows = Self {
            messages,
            own,
            assembler,
            until: 0,
            has_more: true,
        };
        rows.compare(&logs);
        Ok(rows)
    }

    /// Each log tells how many messages the others had: those that are missing at an end are named there.
    fn compare(&mut self, logs: &Logs) {
        struct Known<'a>(&'a mut ByTopic<StoredMessages>, &'a mut Vec<u64>);
        impl Each for Known<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                if let Some(reader) = M::of_mut(self.0)
                    .as_mut()
                    .and_then(|messages| messages.reader.as_mut())
                {
                    most(self.1, reader.rows().known());
                }
            }
        }
        struct Expect<'a>(&'a mut ByTopic<StoredMessages>, &'a dyn Fn(&str) -> u64);
        impl Each for Expect<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                let Some(messages) = M::of_mut(self.0) else {
                    return;
                };
                expect(
                    messages.reader.as_mut().map(LogReader::rows),
                    &mut messages.account,
                    self.1,
                );
            }
        }
        fn most(known: &mut [u64], other: &[u64]) {
            known
                .iter_mut()
                .zip(other)
                .for_each(|(known, other)| *known = (*known).max(*other));
        }
        fn expect(
            reader: Option<&mut RowReader>,
            account: &mut LogAccount,
            known: &dyn Fn(&str) -> u64,
        ) {
            let messages = known(&account.topic);
            match reader {
                Some(reader) => reader.expect(messages),
                None if messages > 0 && account.damage(0).is_none() => account.is_absent(messages),
                None => {}
            }
        }
        let mut known = vec![0; logs.len()];
        topics::each(&mut Known(&mut self.messages, &mut known));
        self.own
            .iter()
            .filter_map(|own| own.reader.as_ref())
            .for_each(|reader| most(&mut known, reader.known()));
        let of = |topic: &str| {
            logs.place(topic)
                .and_then(|place| known.get(place).copied())
                .unwrap_or_default()
        };
        topics::each(&mut Expect(&mut self.messages, &of));
        self.own
            .iter_mut()
            .for_each(|own| expect(own.reader.as_mut(), &mut own.account, &of));
    }

    /// The next row; `None` at the end.
    pub fn next_row(&mut self) -> Option<&Row> {
        /// Puts the messages of the ticks before `until` into their rows; whether there are more.
        struct Put<'a>(&'a mut ByTopic<StoredMessages>, &'a mut Assembler, u64);
        impl Each for Put<'_> {
            type Output = bool;
            fn each<M: Topic>(&mut self) -> bool {
                let Some(messages) = M::of_mut(self.0) else {
                    return false;
                };
                while let Some(message) = messages.next.take().or_else(|| messages.read()) {
                    let tick = message.header().tick;
                    if tick >= self.2 {
                        messages.next = Some(message);
                        return true;
                    }
                    messages.account.hash.add(&message);
                    if let Some(row) = self.1.row(tick) {
                        row.put(&message);
                    }
                }
                false
            }
        }
        while self.has_more && !self.assembler.is_ready(self.until) {
            self.until += STRIDE;
            self.has_more = topics::each(&mut Put(
                &mut self.messages,
                &mut self.assembler,
                self.until,
            ))
            .contains(&true);
            if !self.has_more {
                self.own.iter_mut().for_each(OwnMessages::read);
            }
        }
        self.assembler.pop(self.until, !self.has_more)
    }

    /// The topics whose log, read to its end, is not as it was written or does not hold what a run's summary counts, where there is one: a clause for
    /// each. A topic that the summary does not name is left out of the comparison.
    #[must_use]
    pub fn damage(mut self, summary: Option<&Summary>) -> Vec<String> {
        while self.next_row().is_some() {}
        let damage = self.damage_so_far();
        let differs = |account: &LogAccount| {
            let (topic, found) = (&account.topic, account.hash);
            let expected = summary?
                .topics
                .get(topic)
                .filter(|expected| **expected != found.summary())?;
            Some(match expected.count == found.count() {
                true => format!("{topic}.log holds other numbers than the run has sent"),
                false => format!(
                    "{topic}.log holds {} of {} messages",
                    found.count(),
                    expected.count
                ),
            })
        };
        let of = |account: &LogAccount| {
            damage
                .iter()
                .find(|(topic, _)| *topic == account.topic)
                .map(|(_, damage)| damage.clone())
                .or_else(|| differs(account))
        };
        self.accounts().into_iter().filter_map(of).collect()
    }

    /// The damage in the logs as far as they have been read: topic and clause.
    pub(crate) fn damage_so_far(&self) -> Vec<(String, String)> {
        let accounts = self.accounts();
        let end = accounts
            .iter()
            .filter_map(|account| account.last)
            .max()
            .map_or(0, |last| last.saturating_add(1));
        accounts
            .into_iter()
            .filter_map(|account| Some((account.topic.clone(), account.damage(end)?)))
            .collect()
    }

    /// How many messages of each topic have been read, and their hash.
    pub(crate) fn hashes(&self) -> Vec<(&str, TopicHash)> {
        self.accounts()
            .into_iter()
            .map(|account| (account.topic.as_str(), account.hash))
            .collect()
    }

    /// The topics that are in no row.
    pub(crate) fn not_drawn(&self) -> Vec<String> {
        self.own
            .iter()
            .map(|own| own.account.topic.clone())
            .collect()
    }

    fn accounts(&self) -> Vec<&LogAccount> {
        struct Accounts<'a>(&'a ByTopic<StoredMessages>);
        impl<'a> Each for Accounts<'a> {
            type Output = Option<&'a LogAccount>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of(self.0).as_ref().map(|messages| &messages.account)
            }
        }
        let known = topics::each(&mut Accounts(&self.messages))
            .into_iter()
            .flatten();
        known
            .chain(self.own.iter().map(|own| &own.account))
            .collect()
    }
}
