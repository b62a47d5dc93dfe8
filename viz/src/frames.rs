//! The chunks of an `.rrd` file, which may be damaged: each length that it states is checked before it is used.
//!
//! Rerun's own stream decoder allocates the length that a file states for a message, and Arrow's the length that a message states for a table: a
//! flipped bit there ends the program. Only what is whole is handed to them, and a panic of theirs is an error.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::Once;

use re_chunk::Chunk;
use re_chunk::external::arrow::ipc::root_as_message;
use re_log_encoding::external::lz4_flex::block::decompress;
use re_log_encoding::rrd::Decodable;
use re_log_encoding::{MessageHeader, MessageKind, StreamHeader, ToApplication};
use re_log_types::StoreId;
use re_protos::common::v1alpha1::Compression;
use re_protos::log_msg::v1alpha1::ArrowMsg;

/// The chunks in a file, in order. A torn end, which a killed recorder leaves, is the end.
pub(crate) struct Frames {
    file: BufReader<File>,
    size: u64,
    place: u64,
}

impl Frames {
    /// # Errors
    /// When the file cannot be opened.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let file = files::open(path)?;
        Ok(Self {
            size: file.metadata()?.len(),
            file: BufReader::new(file),
            place: 0,
        })
    }

    /// How far the file has been read; bytes.
    pub(crate) fn place(&self) -> u64 {
        self.place
    }

    /// The next chunk with the store it belongs to, the recording's or its blueprint's; `None` at the end.
    ///
    /// # Errors
    /// The defect of the bytes; the rest of the file cannot be read either.
    pub(crate) fn next_chunk(&mut self) -> Result<Option<(StoreId, Chunk)>, String> {
        if self.place == 0 {
            let head = self
                .take(StreamHeader::ENCODED_SIZE_BYTES as u64)?
                .ok_or("it is too short to be a recording")?;
            let head = guarded(|| {
                StreamHeader::from_rrd_bytes(&head).and_then(StreamHeader::to_version_and_options)
            })?;
            head.map_err(|error| error.to_string())?;
        }
        while let Some(head) = self.take(MessageHeader::ENCODED_SIZE_BYTES as u64)? {
            let MessageHeader { kind, len } =
                MessageHeader::from_rrd_bytes(&head).map_err(|error| error.to_string())?;
            let Some(body) = (if kind == MessageKind::End {
                None
            } else {
                self.take(len)?
            }) else {
                break;
            };
            if kind == MessageKind::ArrowMsg
                && let Some(chunk) = guarded(|| chunk(&body))??
            {
                return Ok(Some(chunk));
            }
        }
        Ok(None)
    }

    /// So many bytes; `None` where the file ends before.
    fn take(&mut self, bytes: u64) -> Result<Option<Vec<u8>>, String> {
        if bytes > self.size.saturating_sub(self.place) {
            return Ok(None);
        }
        let mut taken = vec![0; bytes as usize];
        match self.file.read_exact(&mut taken) {
            Ok(()) => {
                self.place += bytes;
                Ok(Some(taken))
            }
            // It has been cut since.
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// The chunk of a message and its store; `None` where it names none.
fn chunk(message: &[u8]) -> Result<Option<(StoreId, Chunk)>, String> {
    let mut message = ArrowMsg::from_rrd_bytes(message).map_err(|error| error.to_string())?;
    let Some(store) = message.store_id.take() else {
        return Ok(None);
    };
    let store = StoreId::try_from(store).map_err(|error| error.to_string())?;
    let message = believable(message)?
        .to_application(())
        .map_err(|error| error.to_string())?;
    let chunk = Chunk::from_arrow_msg(&message).map_err(|error| error.to_string())?;
    Ok(Some((store, chunk)))
}

thread_local! {
    /// The message of a panic in guarded work; `None` where no work is guarded.
    static SAID: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Does work that panics on damaged bytes: its panic is an error without a stack trace.
///
/// State touched by the work may be half done then, and must not be used again.
///
/// # Errors
/// The panic's message.
pub(crate) fn guarded<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |info: &PanicHookInfo| {
            let is_guarded = SAID.with_borrow_mut(|said| {
                said.as_mut()
                    .map(|said| {
                        *said = info
                            .payload_as_str()
                            .unwrap_or("its decoder failed")
                            .to_owned()
                    })
                    .is_some()
            });
            if !is_guarded {
                usual(info);
            }
        }));
    });
    SAID.set(Some(String::new()));
    let done = catch_unwind(AssertUnwindSafe(work));
    let said = SAID.take().unwrap_or_default();
    done.map_err(|_| said)
}

/// A message, unpacked, where the lengths in it agree with what there is.
///
/// # Errors
/// The difference.
fn believable(message: ArrowMsg) -> Result<ArrowMsg, String> {
    /// No byte of an LZ4 block stands for more.
    const MOST_EXPANSION: u64 = 255;
    let ArrowMsg {
        ref payload,
        uncompressed_size,
        ..
    } = message;
    let message = match message.compression() {
        Compression::Lz4 if uncompressed_size > MOST_EXPANSION * payload.len() as u64 => {
            return Err(format!(
                "{} bytes cannot be {uncompressed_size} bytes packed",
                payload.len()
            ));
        }
        Compression::Lz4 => {
            let unpacked = decompress(payload, uncompressed_size as usize)
                .map_err(|error| error.to_string())?;
            ArrowMsg {
                payload: unpacked.into(),
                compression: Compression::None as i32,
                ..message
            }
        }
        _ => message,
    };
    // An Arrow IPC stream: a marker, the length of what describes the next message, the description, its body; all padded to 8 bytes.
    let mut rest = &message.payload[..];
    while let Some((head, after)) = rest.split_first_chunk::<8>() {
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as usize;
        if head[..4] != [0xff; 4] || length == 0 {
            break;
        }
        let described = after
            .split_at_checked(length)
            .ok_or_else(|| format!("a description of {length} bytes"))?;
        let body = root_as_message(described.0)
            .map_err(|error| error.to_string())?
            .bodyLength();
        let size = usize::try_from(body)
            .ok()
            .filter(|size| *size <= described.1.len());
        rest = &described.1[size.ok_or_else(|| {
            format!(
                "a table of {body} bytes where {} are left",
                described.1.len()
            )
        })?..];
    }
    Ok(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_and_the_next_one_is_none() {
        let bytes = [1, 2, 3];
        assert!(guarded(|| bytes[bytes.len() + 4]).is_err());
        assert_eq!(guarded(|| bytes[2]), Ok(3));
    }
}
