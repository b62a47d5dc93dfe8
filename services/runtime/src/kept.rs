//! Messages in a file as they were on the wire, one after the other and nothing else: any language reads them with one call.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use shared_types::Message;

/// Why kept messages cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} the messages in {path}: {source}")]
pub struct KeepError {
    action: &'static str,
    path: PathBuf,
    source: std::io::Error,
}

fn path_in<M: Message>(folder: &Path) -> PathBuf {
    folder.join(format!("{}.bin", M::TOPIC))
}

/// Keeps the messages of a topic in a folder, as `TOPIC.bin`.
pub struct Keep<M> {
    path: PathBuf,
    file: BufWriter<File>,
    _messages: PhantomData<M>,
}

impl<M: Message> Keep<M> {
    /// An empty file in a folder, which is made if there is none.
    ///
    /// # Errors
    /// When the folder or the file cannot be made.
    pub fn create(folder: &Path) -> Result<Self, KeepError> {
        let path = path_in::<M>(folder);
        match std::fs::create_dir_all(folder).and_then(|()| File::create(&path)) {
            Ok(file) => Ok(Self { path, file: BufWriter::new(file), _messages: PhantomData }),
            Err(source) => Err(KeepError { action: "keep", path, source }),
        }
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, message: &M) -> Result<(), KeepError> {
        self.file.write_all(bytemuck::bytes_of(message)).map_err(|source| self.failed(source))
    }

    /// Writes what has not been written yet.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<(), KeepError> {
        self.file.flush().map_err(|source| self.failed(source))
    }

    fn failed(&self, source: std::io::Error) -> KeepError {
        KeepError { action: "keep", path: self.path.clone(), source }
    }
}

/// The kept messages of a topic, in order.
pub struct Kept<M> {
    path: PathBuf,
    file: BufReader<File>,
    _messages: PhantomData<M>,
}

impl<M: Message> Kept<M> {
    /// The file that [`Keep`] left in a folder.
    ///
    /// # Errors
    /// When there is none.
    pub fn open(folder: &Path) -> Result<Self, KeepError> {
        let path = path_in::<M>(folder);
        match File::open(&path) {
            Ok(file) => Ok(Self { path, file: BufReader::new(file), _messages: PhantomData }),
            Err(source) => Err(KeepError { action: "read", path, source }),
        }
    }

    /// The next message; `None` after the last whole one.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn next_message(&mut self) -> Result<Option<M>, KeepError> {
        let mut message = M::zeroed();
        match self.file.read_exact(bytemuck::bytes_of_mut(&mut message)) {
            Ok(()) => Ok(Some(message)),
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(None),
            Err(source) => Err(KeepError { action: "read", path: self.path.clone(), source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunDir;
    use shared_types::SensorSample;

    #[test]
    fn what_is_kept_comes_back_byte_for_byte_and_a_torn_end_is_the_end() {
        let run = RunDir::create().unwrap();
        let folder = run.path().join("messages");
        let message = |tick: u64| {
            let mut message = SensorSample::default();
            message.header.tick = tick;
            message.header.stamps.sent_ns[0] = 77;
            message.q_encoder[2] = 0.1 * tick as f64;
            message
        };
        let mut keep = Keep::create(&folder).unwrap();
        (0..3).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        let path = folder.join("sensor.bin");
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len(), 3 * size_of::<SensorSample>());
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        let mut kept = Kept::<SensorSample>::open(&folder).unwrap();
        assert_eq!(kept.next_message().unwrap(), Some(message(0)));
        assert_eq!(kept.next_message().unwrap(), Some(message(1)));
        assert_eq!(kept.next_message().unwrap(), None);
        assert!(Kept::<SensorSample>::open(run.path()).err().unwrap().to_string().contains("sensor.bin"));
    }
}
