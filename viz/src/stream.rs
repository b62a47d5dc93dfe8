//! The bytes of an `.rrd` stream: header, messages, table of contents.
//!
//! Rerun's `Encoder` writes the same bytes at more than twice the cost: it parses every batch again, twice, for what the chunk says itself, and enters
//! the chunks of a blueprint, half of those of a short run and with a column for each of their components, into the table of contents. A
//! blueprint is read from its first message to its last, never sought in, so this table lists the recording's chunks only.

use std::collections::HashMap;
use std::fmt::Display;

use re_chunk::{Chunk, Span};
use re_log_encoding::external::lz4_flex::block::{
    CompressTable, compress_into_with_table, get_maximum_output_size,
};
use re_log_encoding::{
    CodecError, Compression, CrateVersion, Encodable, EncodingOptions, MessageHeader, MessageKind,
    RRD_FOURCC, StreamFooter, StreamHeader, ToTransport,
};
use re_log_types::{LogMsg, StoreId, StoreKind};
use re_protos::common::v1alpha1::{Compression as Packing, Schema};
use re_protos::external::prost::Message;
use re_protos::log_msg::v1alpha1::{ArrowMsg, Encoding, RrdFooter, RrdManifest, log_msg::Msg};

use crate::contents::Contents;
use crate::ipc::Encoder;
use crate::storage::{RecordError, Storage};

/// Bytes of messages that wait, at which they are written.
const MOST_WAITING: usize = 1 << 18;

/// A stream in the making: each message is written whole or, where the storage refuses, not at all.
pub(crate) struct Stream {
    storage: Box<dyn Storage>,
    /// Bytes of whole messages in the storage.
    written: u64,
    /// The table of contents of each recording.
    contents: HashMap<StoreId, Contents>,
    /// The chunks that wait, with their places and sizes, for it: what is not in the storage is not listed.
    unlisted: Vec<(StoreId, Chunk, Span<u64>, u64)>,
    encoder: Encoder,
    /// A chunk as Arrow writes it, and the messages that wait: kept, so that their memory is.
    table: Vec<u8>,
    waiting: Vec<u8>,
    packer: Packer,
}

/// LZ4 with its memory.
#[derive(Default)]
struct Packer {
    packed: Vec<u8>,
    /// For less than 64 KiB.
    small: CompressTable,
    large: Option<CompressTable>,
}

impl Packer {
    fn pack(&mut self, bytes: &[u8]) -> Option<&[u8]> {
        let most = get_maximum_output_size(bytes.len());
        if self.packed.len() < most {
            self.packed.resize(most, 0);
        }
        let table = if bytes.len() < usize::from(u16::MAX) {
            &mut self.small
        } else {
            self.large.get_or_insert_with(CompressTable::large)
        };
        let size = compress_into_with_table(bytes, &mut self.packed, table).ok()?;
        Some(&self.packed[..size])
    }
}

impl Stream {
    /// Begins a stream with its header.
    pub(crate) fn begin(storage: Box<dyn Storage>) -> Result<Self, RecordError> {
        let (contents, encoder, packer) = (HashMap::new(), Encoder::default(), Packer::default());
        let (unlisted, table, waiting) = (Vec::new(), Vec::new(), Vec::new());
        let mut stream = Self {
            storage,
            written: 0,
            contents,
            unlisted,
            encoder,
            table,
            waiting,
            packer,
        };
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        stream.append(&StreamHeader {
            fourcc: RRD_FOURCC,
            version: CrateVersion::LOCAL.to_bytes(),
            options,
        })?;
        // Alone: whatever comes of the rest, this is a stream.
        stream.flush()?;
        Ok(stream)
    }

    /// Size so far, of what waits too; bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.written + self.waiting.len() as u64
    }

    /// Appends a message that is no chunk; it waits for [`Stream::flush`].
    pub(crate) fn message(&mut self, message: &LogMsg) -> Result<(), RecordError> {
        let message = message
            .to_transport(Compression::LZ4)
            .map_err(|error| self.defect(&error))?;
        self.append(&message)
    }

    /// Appends a chunk of a store; it waits for [`Stream::flush`], but for no more than a quarter of a megabyte.
    pub(crate) fn chunk(&mut self, store: &StoreId, chunk: Chunk) -> Result<(), RecordError> {
        self.table.clear();
        self.encoder
            .write(&chunk, &mut self.table)
            .map_err(|error| self.defect(&error))?;
        let (begin, size) = (self.bytes(), self.table.len() as u64);
        let payload = self
            .packer
            .pack(&self.table)
            .map(<[u8]>::to_vec)
            .ok_or_else(|| self.defect(&"LZ4 wants more room than its worst case"))?;
        self.append(&Msg::ArrowMsg(ArrowMsg {
            store_id: Some(store.clone().into()),
            chunk_id: Some(chunk.id().as_tuid().into()),
            compression: Packing::Lz4 as i32,
            uncompressed_size: size,
            encoding: Encoding::ArrowIpc as i32,
            payload: payload.into(),
            is_static: Some(chunk.is_static()),
        }))?;
        if store.kind() == StoreKind::Recording {
            let header = MessageHeader::ENCODED_SIZE_BYTES as u64;
            let place = Span {
                start: begin + header,
                len: self.bytes() - begin - header,
            };
            self.unlisted.push((store.clone(), chunk, place, size));
        }
        if self.waiting.len() < MOST_WAITING {
            Ok(())
        } else {
            self.flush()
        }
    }

    /// Writes the messages that wait.
    pub(crate) fn flush(&mut self) -> Result<(), RecordError> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let written = self
            .storage
            .write_all(&self.waiting)
            .and_then(|()| self.storage.flush());
        let bytes = self.waiting.len();
        self.waiting.clear();
        let unlisted = std::mem::take(&mut self.unlisted);
        if let Err(source) = written {
            // The first error is the one to report, not the error of the cut.
            let _ = self.storage.cut(self.written);
            return Err(RecordError::Write {
                bytes: self.written,
                source,
            });
        }
        self.written += bytes as u64;
        for (store, chunk, place, size) in unlisted {
            self.contents
                .entry(store)
                .or_default()
                .enter(&chunk, place, size);
        }
        Ok(())
    }

    /// Ends the stream with its footer and makes it durable; where the footer does not fit, the stream ends without one, after its last whole
    /// message. Returns the size, too.
    pub(crate) fn end(mut self) -> (u64, Result<(), RecordError>) {
        let ended = self
            .flush()
            .and_then(|()| self.footer())
            .and_then(|()| self.flush());
        let bytes = self.written;
        (
            bytes,
            ended.and(
                self.storage
                    .sync()
                    .map_err(|source| RecordError::Write { bytes, source }),
            ),
        )
    }

    /// Table of contents and the place of it, as the last message.
    fn footer(&mut self) -> Result<(), RecordError> {
        let contents = std::mem::take(&mut self.contents)
            .into_iter()
            .map(|(store, builder)| {
                let contents = builder.build(store)?;
                // As `to_transport`, without its check of a table that has just been built: a fifth of the cost.
                Ok::<_, CodecError>(RrdManifest {
                    store_id: Some(contents.store_id.into()),
                    sorbet_schema_sha256: Some(contents.sorbet_schema_sha256.to_vec().into()),
                    sorbet_schema: Some(
                        Schema::try_from(&contents.sorbet_schema)
                            .map_err(CodecError::ArrowSerialization)?,
                    ),
                    data: Some(contents.data.into()),
                })
            });
        let manifests = contents
            .collect::<Result<_, _>>()
            .map_err(|error| self.defect(&error))?;
        let footer = RrdFooter { manifests }.encode_to_vec();
        let out = &mut self.waiting;
        let header = MessageHeader {
            kind: MessageKind::End,
            len: footer.len() as u64,
        }
        .to_rrd_bytes(out);
        let place = self.written + out.len() as u64;
        out.extend_from_slice(&footer);
        let ended = header
            .and_then(|_| StreamFooter::from_rrd_footer_bytes(place, &footer).to_rrd_bytes(out));
        ended.map(drop).map_err(|error| self.defect(&error))
    }

    /// Adds a message to those that wait.
    fn append(&mut self, message: &impl Encodable) -> Result<(), RecordError> {
        let before = self.waiting.len();
        let added = message.to_rrd_bytes(&mut self.waiting);
        added.map(drop).map_err(|error| {
            self.waiting.truncate(before);
            self.defect(&error)
        })
    }

    fn defect(&self, reason: &impl Display) -> RecordError {
        RecordError::Encode {
            bytes: self.written,
            reason: reason.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_chunk::{RowId, TimePoint};
    use re_log_encoding::RawRrdManifest;
    use re_sdk_types::archetypes::TextLog;

    #[test]
    fn the_table_of_contents_leads_to_the_chunks_of_the_recording() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let mut stream =
            Stream::begin(Box::new(file.reopen().expect("the file"))).expect("a stream");
        let store = |kind| StoreId::new(kind, "armplane-test", "run");
        let mut chunks = Vec::new();
        for (path, kind) in [
            ("/a", StoreKind::Recording),
            ("/view", StoreKind::Blueprint),
            ("/b", StoreKind::Recording),
        ] {
            let chunk = Chunk::builder(path)
                .with_archetype(RowId::new(), TimePoint::default(), &TextLog::new(path))
                .build()
                .expect("a chunk");
            if kind == StoreKind::Recording {
                chunks.push(chunk.id().as_tuid());
            }
            stream.chunk(&store(kind), chunk).expect("written");
        }
        let (size, ended) = stream.end();
        ended.expect("ended");
        let bytes = std::fs::read(file.path()).expect("the file");
        assert_eq!(bytes.len() as u64, size);
        let contents = RawRrdManifest::from_rrd_bytes(&bytes).expect("a footer");
        assert_eq!(
            contents
                .iter()
                .map(|table| table.store_id.kind())
                .collect::<Vec<_>>(),
            [StoreKind::Recording]
        );
        let column = |values: re_log_encoding::CodecResult<
            &re_chunk::external::arrow::array::UInt64Array,
        >| { values.expect("a column").values().to_vec() };
        let places = column(contents[0].col_chunk_byte_offset_raw())
            .into_iter()
            .zip(column(contents[0].col_chunk_byte_size_raw()));
        let found = places.map(|(from, size)| {
            ArrowMsg::decode(&bytes[from as usize..(from + size) as usize])
                .expect("a message")
                .chunk_id
        });
        assert_eq!(
            found.collect::<Vec<_>>(),
            chunks
                .into_iter()
                .map(|id| Some(id.into()))
                .collect::<Vec<_>>()
        );
    }
}
