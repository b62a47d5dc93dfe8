//! Writes the record of a run: every message as it was sent, and the words on it, as MCAP.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use mcap::records::MessageHeader;
use mcap::{Attachment, McapError, WriteOptions};
use shared_types::event::{Event, Source};

use crate::contents::{Contents, schema, tick_of};
use crate::cut::{CUTS, Cut};
use crate::error::RecordError;
use crate::event::{CDR, EVENTS, ROBOT, put_text, write_event};
use crate::reader::{Item, RecordReader};

/// Bytes of messages after which a chunk is closed.
const CHUNK: usize = 256 << 10;

/// Writes a record. A chunk reaches the file whole or not at all.
pub struct RecordWriter {
    path: PathBuf,
    contents: Contents,
    file: mcap::Writer<Pending>,
    /// Bytes that are in the file.
    written: Rc<Cell<u64>>,
    /// Messages so far, by channel.
    counts: Vec<u32>,
    /// The message in hand, as CDR.
    message: Vec<u8>,
    /// Bytes of the open chunk.
    gathered: usize,
}

impl RecordWriter {
    /// An empty record, in place of any that is there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn create(path: &Path, contents: &Contents) -> Result<Self, RecordError> {
        let written = Rc::new(Cell::new(0));
        let pending = Pending {
            file: files::create(path).map_err(RecordError::file("write", path))?,
            bytes: Cursor::default(),
            written: Rc::clone(&written),
            has_failed: false,
        };
        let file = WriteOptions::new()
            .profile("ros2")
            .library("armplane")
            .compression(contents.compression)
            .chunk_size(None)
            .calculate_data_section_crc(false)
            .create(pending);
        let begun = file.and_then(|mut file| {
            describe(&mut file, contents)?;
            Ok(file)
        });
        let mut writer = Self {
            file: begun.map_err(|error| RecordError::write(path, error))?,
            path: path.to_owned(),
            counts: vec![0; contents.extra()[2] + 1],
            contents: contents.clone(),
            written,
            message: CDR.to_vec(),
            gathered: 0,
        };
        put_text(&mut writer.message, &contents.urdf);
        writer.write(contents.extra()[1], 0)?;
        writer.close_chunk()?;
        Ok(writer)
    }

    /// A record that begins with an earlier one.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn continuing(
        path: &Path,
        contents: &Contents,
        earlier: &mut RecordReader,
    ) -> Result<Self, RecordError> {
        let mut writer = Self::create(path, contents)?;
        while let Some(item) = earlier.next_item() {
            writer.add(&item)?;
        }
        Ok(writer)
    }

    /// Adds a part of an earlier record, but for words that the judge says again.
    ///
    /// # Errors
    /// See [`append`](Self::append).
    pub(crate) fn add(&mut self, item: &Item<'_>) -> Result<(), RecordError> {
        match item {
            Item::Message { channel, message } => self.append(*channel, message),
            Item::Event(event) if event.source == Source::Judge => Ok(()),
            Item::Event(event) => self.event(event),
            Item::Cut(cut) => self.cut(cut),
        }
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written: then it ends with the last whole chunk, and nothing more can be added.
    pub fn append(&mut self, channel: usize, message: &[u8]) -> Result<(), RecordError> {
        self.message.clear();
        self.message.extend(CDR);
        self.message.extend_from_slice(message);
        self.write(channel, self.contents.time_ns(tick_of(message)))
    }

    /// Adds an event.
    ///
    /// # Errors
    /// See [`append`](Self::append).
    pub fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        let time_ns = self.contents.time_ns(event.tick);
        self.message.clear();
        write_event(event, time_ns, &mut self.message);
        self.write(self.contents.extra()[0], time_ns)
    }

    /// Adds a cut, which is in the file when this returns, with all before it.
    ///
    /// # Errors
    /// See [`append`](Self::append).
    pub fn cut(&mut self, cut: &Cut) -> Result<(), RecordError> {
        self.message.clear();
        cut.write(&mut self.message);
        self.write(self.contents.extra()[2], self.contents.time_ns(cut.tick))?;
        self.close_chunk()
    }

    fn write(&mut self, channel: usize, time_ns: u64) -> Result<(), RecordError> {
        let header = MessageHeader {
            channel_id: channel as u16 + 1,
            sequence: self.counts[channel],
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.counts[channel] = self.counts[channel].wrapping_add(1);
        self.gathered += self.message.len();
        self.file
            .write_to_known_channel(&header, &self.message)
            .map_err(|error| RecordError::write(&self.path, error))?;
        if self.gathered < CHUNK {
            Ok(())
        } else {
            self.close_chunk()
        }
    }

    /// Writes the messages that wait for the end of a chunk.
    ///
    /// # Errors
    /// See [`append`](Self::append).
    pub fn close_chunk(&mut self) -> Result<(), RecordError> {
        self.gathered = 0;
        let closed = self.file.flush();
        closed.map_err(|error| RecordError::write(&self.path, error))
    }

    /// Ends the record with the summary by which other programs find messages in it. Returns the bytes of the file.
    ///
    /// # Errors
    /// See [`append`](Self::append).
    pub fn finish(mut self) -> Result<u64, RecordError> {
        self.close_chunk()?;
        let finished = self.file.finish();
        finished.map_err(|error| RecordError::write(&self.path, error))?;
        Ok(self.bytes())
    }

    /// Bytes that are in the file.
    pub fn bytes(&self) -> u64 {
        self.written.get()
    }
}

/// Writes the files that describe the run, and a channel for each topic.
fn describe(file: &mut mcap::Writer<Pending>, contents: &Contents) -> Result<(), McapError> {
    for attached in &contents.files {
        file.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: attached.name.to_owned(),
            media_type: attached.media_type.to_owned(),
            data: Cow::Borrowed(attached.text.as_bytes()),
        })?;
    }
    let mut channel = |topic: &str, layout: String, [name, definition]: [&str; 2]| {
        let schema = file.add_schema(name, "ros2msg", definition.as_bytes())?;
        let about = [("run", contents.run()), ("layout", layout)];
        let about = about.map(|(key, value)| (key.to_owned(), value));
        file.add_channel(schema, topic, "cdr", &BTreeMap::from(about))
    };
    for layout in contents.layouts() {
        let ((name, definition), hash) = (schema(layout), format!("{:016x}", layout.hash));
        channel(&format!("/{}", layout.topic), hash, [&name, &definition])?;
    }
    for [topic, name, definition] in [EVENTS, ROBOT, CUTS] {
        channel(topic, String::new(), [name, definition])?;
    }
    Ok(())
}

/// The end of a file: what is written goes into memory, and into the file with the next flush, whole or not at all.
struct Pending {
    file: File,
    bytes: Cursor<Vec<u8>>,
    written: Rc<Cell<u64>>,
    /// Nothing more goes into the file.
    has_failed: bool,
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.has_failed {
            return Err(io::Error::other("an earlier chunk could not be written"));
        }
        let written = self.written.get();
        if let Err(error) = self.file.write_all(self.bytes.get_ref()) {
            self.has_failed = true;
            // Whole chunks can be read.
            let _ = self.file.set_len(written);
            return Err(error);
        }
        self.written
            .set(written + self.bytes.get_ref().len() as u64);
        self.bytes.get_mut().clear();
        self.bytes.set_position(0);
        Ok(())
    }
}

impl Seek for Pending {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let written = self.written.get();
        let to = match to {
            SeekFrom::Start(at) => SeekFrom::Start(at.saturating_sub(written)),
            other => other,
        };
        Ok(written + self.bytes.seek(to)?)
    }
}
