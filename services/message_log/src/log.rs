//! Message logs of messages whose type is known.

use std::marker::PhantomData;
use std::path::Path;

use shared_types::Message;

use crate::rows::{LogError, RowReader, RowWriter, Shape};

/// Writes the messages of one type: as [`RowWriter`].
pub struct LogWriter<M>(RowWriter, PhantomData<M>);

impl<M: Message> LogWriter<M> {
    /// As [`RowWriter::create`].
    ///
    /// # Errors
    /// When the folder or the file cannot be made.
    pub fn create(folder: &Path) -> Result<Self, LogError> {
        RowWriter::create(folder, &Shape::of::<M>()).map(|rows| Self(rows, PhantomData))
    }

    /// As [`RowWriter::resume`].
    ///
    /// # Errors
    /// When there is no such file, or it is not of this program's wire format.
    pub fn resume(folder: &Path, from: u64, mut each: impl FnMut(M)) -> Result<Self, LogError> {
        let rows = RowWriter::resume(folder, &Shape::of::<M>(), from, |row| each(message(&row)))?;
        Ok(Self(rows, PhantomData))
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, message: &M) -> Result<(), LogError> {
        self.0.add(bytemuck::cast_slice(std::slice::from_ref(message)))
    }

    /// As [`RowWriter::finish`].
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> Result<u64, LogError> {
        self.0.finish()
    }

    /// As [`RowWriter::flush`].
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.0.flush()
    }

    /// Bytes in the file so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.0.bytes()
    }
}

/// Reads the messages of one type: as [`RowReader`].
pub struct LogReader<M>(RowReader, PhantomData<M>);

impl<M: Message> LogReader<M> {
    /// As [`RowReader::open`].
    ///
    /// # Errors
    /// When there is none, or its messages are not this program's.
    pub fn open(folder: &Path) -> Result<Self, LogError> {
        RowReader::open(folder, &Shape::of::<M>()).map(|rows| Self(rows, PhantomData))
    }

    /// The next message; `None` after the last whole block.
    ///
    /// # Errors
    /// When the file cannot be read, or is damaged.
    pub fn next_message(&mut self) -> Result<Option<M>, LogError> {
        Ok(self.0.next_row()?.map(|row| message(&row)))
    }

    /// As [`RowReader::skip`].
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn skip(&mut self) -> Result<bool, LogError> {
        self.0.skip()
    }
}

/// The message of a row of its size.
fn message<M: Message>(row: &[u64]) -> M {
    bytemuck::pod_read_unaligned(bytemuck::cast_slice(row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::BLOCK;
    use shared_types::{Layout, PlantState, SensorSample};
    use tempfile::TempDir;

    fn message(tick: u64) -> SensorSample {
        let mut message = SensorSample::default();
        message.header.tick = tick;
        message.header.stamps.sent_ns[0] = 1_000_000 * tick + tick % 7;
        message.q_encoder[2] = (0.1 * tick as f64).sin();
        message.tau_drive[5] = if tick.is_multiple_of(5) { f64::from_bits(0x7ff8_0000_0000_1234) } else { -0.0 };
        message.stale_ticks = u32::MAX - tick as u32;
        message
    }

    fn bytes_of(folder: &Path) -> Vec<Vec<u8>> {
        let mut kept = LogReader::<SensorSample>::open(folder).unwrap();
        std::iter::from_fn(|| kept.next_message().unwrap()).map(|message| bytemuck::bytes_of(&message).to_vec()).collect()
    }

    fn expected(n: u64) -> Vec<Vec<u8>> {
        (0..n).map(|tick| bytemuck::bytes_of(&message(tick)).to_vec()).collect()
    }

    #[test]
    fn messages_come_back_byte_for_byte_in_less_room() {
        let run = TempDir::new().unwrap();
        let folder = run.path().join("messages");
        let n = 3 * BLOCK as u64 + 5;
        let mut keep = LogWriter::create(&folder).unwrap();
        (0..n).for_each(|tick| keep.add(&message(tick)).unwrap());
        let bytes = keep.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(folder.join("sensor.log")).unwrap().len());
        assert!(bytes < n * size_of::<SensorSample>() as u64 / 5, "{bytes} bytes for {n} messages");
        assert_eq!(bytes_of(&folder), expected(n));
    }

    #[test]
    fn a_torn_end_is_the_end_and_a_new_writer_goes_on_behind_it() {
        let run = TempDir::new().unwrap();
        let mut keep = LogWriter::create(run.path()).unwrap();
        (0..2 * BLOCK as u64).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        let path = run.path().join("sensor.log");
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(bytes_of(run.path()), expected(BLOCK as u64));
        let mut left = Vec::new();
        let mut keep = LogWriter::resume(run.path(), 0, |message: SensorSample| left.push(message.header.tick)).unwrap();
        assert_eq!(left, (0..BLOCK as u64).collect::<Vec<_>>());
        let end = BLOCK as u64 + 36;
        (BLOCK as u64..end).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.flush().unwrap();
        let place = keep.bytes();
        (end..end + 3).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.flush().unwrap();
        left.clear();
        let keep = LogWriter::resume(run.path(), place, |message: SensorSample| left.push(message.header.tick)).unwrap();
        assert_eq!(left, [end, end + 1, end + 2]);
        keep.finish().unwrap();
        assert_eq!(bytes_of(run.path()), expected(end + 3));
    }

    #[test]
    fn a_writer_killed_before_it_has_made_its_file_costs_nothing() {
        let run = TempDir::new().unwrap();
        let folder = run.path().join("messages");
        for torn in [None, Some(&b"arm"[..])] {
            torn.into_iter().for_each(|torn| std::fs::write(folder.join("sensor.log"), torn).unwrap());
            let mut keep = LogWriter::resume(&folder, 0, |_: SensorSample| panic!("there is none")).unwrap();
            (0..7).for_each(|tick| keep.add(&message(tick)).unwrap());
            keep.finish().unwrap();
            assert_eq!(bytes_of(&folder), expected(7));
        }
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(LogWriter::resume(&folder, 100, |_: SensorSample| ()).is_err(), "what was there before is missing");
    }

    #[test]
    fn files_that_are_not_ours_are_refused() {
        let run = TempDir::new().unwrap();
        assert!(LogReader::<SensorSample>::open(run.path()).err().unwrap().is_absent());
        let mut keep = LogWriter::create(run.path()).unwrap();
        (0..10).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        let path = run.path().join("sensor.log");
        std::fs::copy(&path, run.path().join("plant_state.log")).unwrap();
        let error = LogReader::<PlantState>::open(run.path()).err().unwrap().to_string();
        let both = [SensorSample::layout_hash(), PlantState::layout_hash()].map(|hash| format!("{hash:016x}"));
        assert!(both.iter().all(|hash| error.contains(hash)), "{error}");
        let mut old = std::fs::read(&path).unwrap();
        old[7] -= 1;
        std::fs::write(&path, &old).unwrap();
        let error = LogReader::<SensorSample>::open(run.path()).err().unwrap().to_string();
        assert!(error.contains("another version of armplane"), "{error}");
    }

    #[test]
    fn whatever_bit_is_flipped_no_message_is_wrong_and_only_those_of_its_block_are_lost() {
        let run = TempDir::new().unwrap();
        let mut keep = LogWriter::create(run.path()).unwrap();
        let ends = [10, 25, 40_u64];
        let mut places = vec![24];
        for (begin, end) in [(0, 10), (10, 25), (25, 40)] {
            (begin..end).for_each(|tick| keep.add(&message(tick)).unwrap());
            keep.flush().unwrap();
            places.push(keep.bytes() as usize);
        }
        keep.finish().unwrap();
        let (path, expected) = (run.path().join("sensor.log"), expected(40));
        let whole = std::fs::read(&path).unwrap();
        for (place, bit) in (24..whole.len()).flat_map(|place| [(place, 1), (place, 0x80)]) {
            let mut damaged = whole.clone();
            damaged[place] ^= bit;
            std::fs::write(&path, &damaged).unwrap();
            let (mut kept, mut found, mut errors) = (LogReader::<SensorSample>::open(run.path()).unwrap(), Vec::new(), 0);
            loop {
                match kept.next_message() {
                    Ok(Some(message)) => found.push(bytemuck::bytes_of(&message).to_vec()),
                    Ok(None) => break,
                    Err(error) => {
                        assert!(error.to_string().contains("sensor.log is damaged"), "{error}");
                        errors += 1;
                        kept.skip().unwrap();
                    }
                }
            }
            let block = places.iter().position(|end| place < *end).unwrap() - 1;
            let (begin, end) = (if block == 0 { 0 } else { ends[block - 1] as usize }, ends[block] as usize);
            assert_eq!(found, [&expected[..begin], &expected[end..]].concat(), "byte {place}");
            // The numbers of the last block may be so wrong that it looks like one that its writer was killed in.
            let may_be_torn = block == 2 && (places[2]..places[2] + 12).contains(&place);
            assert!(errors == 1 || may_be_torn && errors == 0, "byte {place}: {errors} errors");
        }
        std::fs::write(&path, [&whole[..places[1]], &[7; 5000], &whole[places[1]..]].concat()).unwrap();
        let mut kept = LogReader::<SensorSample>::open(run.path()).unwrap();
        (0..10).for_each(|_| assert!(kept.next_message().unwrap().is_some()));
        assert!(kept.next_message().is_err() && kept.skip().unwrap());
        assert_eq!(kept.next_message().unwrap().unwrap().header.tick, 10, "what lies between the blocks is passed over");
    }
}
