//! A volume that fills up, for the tests of a recording.

use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use crate::sink::Storage;

/// A volume with so much room, which fills up in the middle of a write as real ones do.
#[derive(Clone)]
pub(super) struct Volume {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: usize,
}

impl Volume {
    pub(super) fn new(room: usize) -> Self {
        Self {
            bytes: Arc::default(),
            room,
        }
    }

    pub(super) fn content(&self) -> Vec<u8> {
        self.bytes.lock().expect("one thread").clone()
    }
}

impl Write for Volume {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let mut bytes = self.bytes.lock().expect("one thread");
        let fits = buffer.len().min(self.room - bytes.len());
        bytes.extend(&buffer[..fits]);
        if fits == 0 {
            Err(io::ErrorKind::StorageFull.into())
        } else {
            Ok(fits)
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Storage for Volume {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.bytes
            .lock()
            .expect("one thread")
            .truncate(bytes as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}
