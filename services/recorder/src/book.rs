//! A run as it is recorded: its messages are judged and written, those of an earlier record first.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use model::Robot;
use runtime::{Mode, ProcessError};
use shared_types::event::{Event, Level, Source};
use shared_types::job::Job;
use shared_types::summary::{RecorderSummary, Summary};

use crate::MESSAGES;
use crate::contents::Contents;
use crate::error::RecordError;
use crate::judge::{Judge, Tick};
use crate::reader::{Item, RecordReader};
use crate::ticks::{Assembler, Row, places, refusal};
use crate::writer::RecordWriter;

/// A chunk of the record is closed after so much time: a recorder that is killed in real time takes it along.
pub(crate) const CHUNK: Duration = Duration::from_millis(50);

/// A run as far as it is known.
pub(crate) struct Book<'a> {
    job: &'a Job,
    pub(crate) assembler: Assembler,
    judge: Judge,
    pub(crate) record: Record,
    /// Ticks judged.
    rows: u64,
    /// The ways in which an earlier record is not as it was written, in words.
    lacks: Vec<String>,
}

impl<'a> Book<'a> {
    /// Before the first message; nothing is written yet.
    pub(crate) fn new(robot: &Robot, job: &'a Job) -> Result<Self, ProcessError> {
        let judge = Judge::in_processes(&job.graph, robot, &job.scenario);
        let judge = judge.map_err(ProcessError::setup)?;
        Ok(Self {
            job,
            assembler: Assembler::new(&Contents::of(job)),
            judge: match job.mode {
                Mode::Realtime => judge.on_grid(1_000_000_000 / u64::from(job.scenario.rate_hz)),
                Mode::Lockstep => judge,
            },
            record: Record::none(),
            rows: 0,
            lacks: Vec::new(),
        })
    }

    /// The next message of a channel.
    pub(crate) fn take(&mut self, channel: usize, message: &[u8]) {
        self.assembler.take(channel, message);
        self.record.write(|record| record.append(channel, message));
    }

    /// Judges the ticks that are whole.
    pub(crate) fn judge_ready(&mut self) {
        while let Some(row) = self.assembler.next_row() {
            self.judge(&row);
        }
    }

    fn judge(&mut self, row: &Row) {
        self.rows += 1;
        self.judge.take(&row.messages().lent());
        for (tick, text) in self.judge.events() {
            let event = Event {
                tick,
                level: Level::Warning,
                source: Source::Judge,
                text,
            };
            self.record.write(|record| record.event(&event));
        }
    }

    /// Takes in an earlier record to its end; `meanwhile` is called from time to time. Its messages, by number.
    pub(crate) fn take_up<E>(
        &mut self,
        earlier: &mut RecordReader,
        mut meanwhile: impl FnMut() -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut count = 0;
        while let Some(item) = earlier.next_item() {
            self.record.write(|record| record.add(&item));
            if let Item::Message { channel, message } = item {
                self.assembler.take(channel, message);
                self.judge_ready();
                count += 1;
                if count % 1024 == 0 {
                    meanwhile()?;
                }
            }
        }
        self.lacks.extend(places(earlier.damage()));
        Ok(count)
    }

    /// Judges the rest. The messages of a run that was killed end at different ticks: what follows the last whole one is left out.
    pub(crate) fn judge_rest(&mut self, is_killed: bool) {
        let mut rest: Vec<_> = std::iter::from_fn(|| self.assembler.rest()).collect();
        if is_killed {
            let whole = |row: &Row| Tick::of(&row.messages().lent()).is_some();
            let last = rest.iter().rposition(|row| whole(row));
            rest.truncate(last.map_or(0, |last| last + 1));
        }
        rest.iter().for_each(|row| self.judge(row));
    }

    /// Number of messages so far.
    pub(crate) fn messages(&self) -> u64 {
        let accounts = self.assembler.accounts().iter();
        accounts.map(|one| one.hash.count()).sum()
    }

    /// The recorder's part of the summary; the launcher adds the processes.
    pub(crate) fn summary(self, lost: u64) -> Summary {
        let is_error = |error: &String| !error.is_empty();
        let errors = self.lacks.into_iter().chain([self.record.error]);
        let errors: Vec<String> = errors.filter(is_error).collect();
        let accounts = || self.assembler.accounts().iter().filter(|one| one.is_read);
        Summary {
            of: self.job.into(),
            topics: accounts()
                .map(|one| (one.topic.clone(), one.hash.summary()))
                .collect(),
            recorder: RecorderSummary {
                rows: self.rows,
                bytes: self.record.bytes,
                error: errors.join("; "),
                lost,
                messages: accounts().map(|one| one.hash.count()).sum(),
                not_drawn: self.assembler.foreign(),
                file: if self.job.record {
                    MESSAGES.to_owned()
                } else {
                    String::new()
                },
                ..RecorderSummary::default()
            },
            ..self.judge.verdict()
        }
    }
}

/// Judges a run whose launcher was killed from the record in its folder, to the last tick that is whole; a run that was killed before its first message has
/// no tick. Writes the record again where its writer could not end it. The damage of a record stands in the recorder's part of the summary, as its error; a
/// damaged record stays as it is.
///
/// # Errors
/// [`ProcessError`] if the messages cannot be read.
pub fn rebuild(robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    let path = job.out.join(MESSAGES);
    let contents = Contents::of(job);
    let mut book = Book::new(robot, job)?;
    let mut missing = 0;
    match RecordReader::open(&path, &contents) {
        Ok(mut earlier) => {
            if !earlier.has_summary() {
                book.record = Record::create(&path, &contents, true);
            }
            let taken = book.take_up(&mut earlier, || Ok::<_, ProcessError>(()));
            taken.map(drop)?;
            missing = earlier.missing;
        }
        Err(RecordError::Unbegun { .. }) => {}
        Err(error) => {
            let refused = refusal(error).map_err(ProcessError::setup)?;
            book.lacks.push(format!("{MESSAGES} {refused}"));
        }
    }
    book.judge_rest(true);
    if book.lacks.is_empty() {
        book.record.place()
    } else {
        book.record.leave()
    }
    book.record.finish();
    let mut summary = book.summary(missing);
    summary.recorder.bytes = std::fs::metadata(&path).map_or(0, |file| file.len());
    Ok(summary)
}

/// The record, as long as it can be written; the first error ends it and is kept. A disk that is full ends the record, not the run.
pub(crate) struct Record {
    writer: Option<RecordWriter>,
    /// The file whose place it is to take: until then it is written beside it.
    replaces: Option<PathBuf>,
    bytes: u64,
    pub(crate) error: String,
    closed: Instant,
}

/// The place of a record that is to take the place of another.
fn beside(path: &Path) -> PathBuf {
    path.with_added_extension("tmp")
}

impl Record {
    fn none() -> Self {
        Self {
            writer: None,
            replaces: None,
            bytes: 0,
            error: String::new(),
            closed: Instant::now(),
        }
    }

    /// A record in its place, or beside the one that is there until [`place`](Self::place).
    pub(crate) fn create(path: &Path, contents: &Contents, replaces: bool) -> Self {
        let mut record = Self {
            replaces: replaces.then(|| path.to_owned()),
            ..Self::none()
        };
        let path = if replaces {
            beside(path)
        } else {
            path.to_owned()
        };
        match RecordWriter::create(&path, contents) {
            Ok(writer) => record.writer = Some(writer),
            Err(error) => record.fail(&error),
        }
        record
    }

    /// Takes the place of the record beside it.
    pub(crate) fn place(&mut self) {
        if let Some(path) = self.replaces.take_if(|_| self.writer.is_some())
            && let Err(error) = std::fs::rename(beside(&path), &path)
        {
            self.fail(&RecordError::file("replace", &path)(error));
        }
    }

    /// Leaves the record beside it as it is.
    pub(crate) fn leave(&mut self) {
        self.writer = None;
        if let Some(path) = self.replaces.take() {
            let _ = std::fs::remove_file(beside(&path));
            self.bytes = std::fs::metadata(&path).map_or(0, |file| file.len());
        }
    }

    pub(crate) fn write(
        &mut self,
        write: impl FnOnce(&mut RecordWriter) -> Result<(), RecordError>,
    ) {
        if let Some(writer) = &mut self.writer
            && let Err(error) = write(writer)
        {
            self.bytes = writer.bytes();
            self.fail(&error);
        }
    }

    /// Closes the chunk, if it is time.
    pub(crate) fn close_chunk(&mut self) {
        if self.closed.elapsed() >= CHUNK {
            self.closed = Instant::now();
            self.write(RecordWriter::close_chunk);
        }
    }

    fn fail(&mut self, error: &RecordError) {
        runtime::complain(error);
        self.error = error.to_string();
        self.leave();
    }

    /// Ends it.
    pub(crate) fn finish(&mut self) {
        match self.writer.take().map(RecordWriter::finish) {
            None => {}
            Some(Ok(bytes)) => self.bytes = bytes,
            Some(Err(error)) => self.fail(&error),
        }
    }
}
