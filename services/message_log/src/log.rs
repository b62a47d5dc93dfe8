//! Message logs of messages whose type is known.

use std::marker::PhantomData;
use std::path::Path;

use shared_types::Message;

use crate::error::LogError;
use crate::logs::Logs;
use crate::reader::RowReader;
use crate::rows::RowWriter;
use crate::shape::{Place, Shape};

/// Writes the messages of one type: as [`RowWriter`].
pub struct LogWriter<M>(RowWriter, PhantomData<M>);

impl<M: Message> LogWriter<M> {
    /// As [`RowWriter::create`].
    ///
    /// # Errors
    /// When the folder or the file cannot be made, or the run has no such log.
    pub fn create(folder: &Path, logs: &Logs) -> Result<Self, LogError> {
        RowWriter::create(folder, &Shape::of::<M>(), logs).map(|rows| Self(rows, PhantomData))
    }

    /// As [`RowWriter::resume`].
    ///
    /// # Errors
    /// As there.
    pub fn resume(
        folder: &Path,
        logs: &Logs,
        from: Place,
        mut each: impl FnMut(M),
    ) -> Result<Self, LogError> {
        let rows = RowWriter::resume(folder, &Shape::of::<M>(), logs, from, |row| {
            each(message(&row))
        })?;
        Ok(Self(rows, PhantomData))
    }

    /// Adds a message, stamps included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, message: &M) -> Result<(), LogError> {
        self.0
            .add(bytemuck::cast_slice(std::slice::from_ref(message)))
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

    /// As [`RowWriter::place`].
    #[must_use]
    pub fn place(&self) -> Place {
        self.0.place()
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

    /// As [`RowReader::open_of`].
    ///
    /// # Errors
    /// As there.
    pub fn open_of(folder: &Path, logs: &Logs) -> Result<Self, LogError> {
        RowReader::open_of(folder, &Shape::of::<M>(), logs).map(|rows| Self(rows, PhantomData))
    }

    /// The next message; `None` at the end.
    ///
    /// # Errors
    /// As [`RowReader::next_row`].
    pub fn next_message(&mut self) -> Result<Option<M>, LogError> {
        Ok(self.0.next_row()?.map(|row| message(&row)))
    }

    /// Its rows.
    pub fn rows(&mut self) -> &mut RowReader {
        &mut self.0
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
    use crate::error::Defect;
    use crate::head::FILE_HEAD;
    use shared_types::{Layout, PlantState, SensorSample};
    use tempfile::TempDir;

    fn logs() -> Logs {
        Logs::new(7, ["sensor", "plant_state"])
    }

    fn message(tick: u64) -> SensorSample {
        let mut message = SensorSample::default();
        message.header.tick = tick;
        message.header.stamps.sent_ns[0] = 1_000_000 * tick + tick % 7;
        message.q_encoder[2] = (0.1 * tick as f64).sin();
        message.tau_drive[5] = if tick.is_multiple_of(5) {
            f64::from_bits(0x7ff8_0000_0000_1234)
        } else {
            -0.0
        };
        message.stale_ticks = u32::MAX - tick as u32;
        message
    }

    fn bytes_of(folder: &Path) -> Vec<Vec<u8>> {
        let mut kept = LogReader::<SensorSample>::open_of(folder, &logs()).unwrap();
        std::iter::from_fn(|| kept.next_message().unwrap())
            .map(|message| bytemuck::bytes_of(&message).to_vec())
            .collect()
    }

    fn expected(n: u64) -> Vec<Vec<u8>> {
        (0..n)
            .map(|tick| bytemuck::bytes_of(&message(tick)).to_vec())
            .collect()
    }

    /// The ticks that a log gives, and what is wrong with it: the kind, and the messages lost.
    fn read(mut kept: LogReader<SensorSample>) -> (Vec<u64>, Vec<(Defect, u64)>) {
        let (mut ticks, mut defects) = (Vec::new(), Vec::new());
        loop {
            match kept.next_message() {
                Ok(Some(message)) => ticks.push(message.header.tick),
                Ok(None) => return (ticks, defects),
                Err(LogError::Place {
                    path,
                    defect,
                    lost,
                    reason,
                    ..
                }) => {
                    assert!(path.ends_with("sensor.log") && !reason.is_empty());
                    defects.push((defect, lost));
                }
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// A log of blocks that end at these ticks, as bytes, and where each block begins.
    fn written(folder: &Path, logs: &Logs, ends: &[u64]) -> (Vec<u8>, Vec<usize>) {
        let mut keep = LogWriter::create(folder, logs).unwrap();
        let (mut begin, mut places) = (0, vec![FILE_HEAD]);
        for end in ends {
            (begin..*end).for_each(|tick| keep.add(&message(tick)).unwrap());
            keep.flush().unwrap();
            begin = *end;
            places.push(keep.place().byte as usize);
        }
        keep.finish().unwrap();
        (std::fs::read(folder.join("sensor.log")).unwrap(), places)
    }

    #[test]
    fn messages_come_back_byte_for_byte_in_less_room() {
        let run = TempDir::new().unwrap();
        let folder = run.path().join("messages");
        let n = 3 * BLOCK as u64 + 5;
        let mut keep = LogWriter::create(&folder, &logs()).unwrap();
        (0..n).for_each(|tick| keep.add(&message(tick)).unwrap());
        let bytes = keep.finish().unwrap();
        assert_eq!(
            bytes,
            std::fs::metadata(folder.join("sensor.log")).unwrap().len()
        );
        assert!(
            bytes < n * size_of::<SensorSample>() as u64 / 5,
            "{bytes} bytes for {n} messages"
        );
        assert_eq!(bytes_of(&folder), expected(n));
    }

    #[test]
    fn a_torn_end_is_the_end_and_a_new_writer_goes_on_behind_it() {
        let run = TempDir::new().unwrap();
        let (whole, places) = written(run.path(), &logs(), &[BLOCK as u64, 2 * BLOCK as u64]);
        let path = run.path().join("sensor.log");
        for torn in [
            whole.len() - 1,
            places[2] - 1,
            places[1] + 60,
            places[1] + 1,
        ] {
            std::fs::write(&path, &whole[..torn]).unwrap();
            let n = if torn > places[2] { 2 } else { 1 };
            assert_eq!(bytes_of(run.path()), expected(n * BLOCK as u64), "{torn}");
        }
        let begin = Place::default();
        let mut left = Vec::new();
        let mut keep = LogWriter::resume(run.path(), &logs(), begin, |message: SensorSample| {
            left.push(message.header.tick)
        })
        .unwrap();
        assert_eq!(left, (0..BLOCK as u64).collect::<Vec<_>>());
        let end = BLOCK as u64 + 36;
        (BLOCK as u64..end).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.flush().unwrap();
        let place = keep.place();
        (end..end + 3).for_each(|tick| keep.add(&message(tick)).unwrap());
        keep.finish().unwrap();
        for _ in 0..2 {
            left.clear();
            // Behind the end that its predecessor gave the log, too.
            let keep = LogWriter::resume(run.path(), &logs(), place, |message: SensorSample| {
                left.push(message.header.tick)
            })
            .unwrap();
            assert_eq!(left, [end, end + 1, end + 2]);
            keep.finish().unwrap();
            assert_eq!(bytes_of(run.path()), expected(end + 3));
        }
        let wrong = Place {
            messages: place.messages + 1,
            ..place
        };
        assert!(
            LogWriter::resume(run.path(), &logs(), wrong, |_: SensorSample| ()).is_err(),
            "another number of messages"
        );
        let other = Logs::new(8, ["sensor", "plant_state"]);
        let error = LogWriter::resume(run.path(), &other, begin, |_: SensorSample| ())
            .err()
            .unwrap();
        assert!(matches!(error, LogError::OtherRun { .. }), "{error}");
    }

    #[test]
    fn a_writer_killed_before_it_has_made_its_file_costs_nothing() {
        let run = TempDir::new().unwrap();
        let folder = run.path().join("messages");
        for torn in [None, Some(&b"arm"[..])] {
            torn.into_iter()
                .for_each(|torn| std::fs::write(folder.join("sensor.log"), torn).unwrap());
            let begin = Place::default();
            let mut keep = LogWriter::resume(&folder, &logs(), begin, |_: SensorSample| {
                panic!("there is none")
            })
            .unwrap();
            (0..7).for_each(|tick| keep.add(&message(tick)).unwrap());
            keep.finish().unwrap();
            assert_eq!(bytes_of(&folder), expected(7));
        }
        std::fs::remove_dir_all(&folder).unwrap();
        let place = Place {
            byte: 100,
            messages: 1,
        };
        assert!(
            LogWriter::resume(&folder, &logs(), place, |_: SensorSample| ()).is_err(),
            "what was there before is missing"
        );
    }

    #[test]
    fn files_that_are_not_ours_are_refused() {
        let run = TempDir::new().unwrap();
        assert!(
            LogReader::<SensorSample>::open(run.path())
                .err()
                .unwrap()
                .is_absent()
        );
        let (whole, _) = written(run.path(), &logs(), &[10]);
        let path = run.path().join("sensor.log");
        std::fs::copy(&path, run.path().join("plant_state.log")).unwrap();
        let error = LogReader::<PlantState>::open(run.path())
            .err()
            .unwrap()
            .to_string();
        let both = [SensorSample::layout_hash(), PlantState::layout_hash()]
            .map(|hash| format!("{hash:016x}"));
        assert!(both.iter().all(|hash| error.contains(hash)), "{error}");
        let error = LogReader::<PlantState>::open_of(run.path(), &logs())
            .err()
            .unwrap();
        assert!(matches!(error, LogError::OtherLog { .. }), "{error}");
        let error = LogReader::<SensorSample>::open_of(
            run.path(),
            &Logs::new(8, ["sensor", "plant_state"]),
        )
        .err()
        .unwrap();
        assert!(matches!(error, LogError::OtherRun { .. }), "{error}");
        let mut old = whole.clone();
        old[7] -= 1;
        std::fs::write(&path, &old).unwrap();
        let error = LogReader::<SensorSample>::open(run.path())
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("another version of armplane"), "{error}");
        // A bit of the file's head costs nothing where the run is known.
        for (place, bit) in (0..FILE_HEAD).flat_map(|place| [(place, 1), (place, 0x80)]) {
            let mut damaged = whole.clone();
            damaged[place] ^= bit;
            std::fs::write(&path, &damaged).unwrap();
            let (ticks, defects) = read(LogReader::open_of(run.path(), &logs()).unwrap());
            assert_eq!(
                (ticks, defects),
                ((0..10).collect(), vec![(Defect::Damaged, 0)]),
                "byte {place}"
            );
        }
    }

    #[test]
    fn a_bit_that_is_flipped_makes_no_message_wrong_and_costs_only_those_of_its_block() {
        let run = TempDir::new().unwrap();
        let ends = [10, 25, 40_u64];
        let (whole, places) = written(run.path(), &logs(), &ends);
        let path = run.path().join("sensor.log");
        for (place, bit) in (FILE_HEAD..whole.len()).flat_map(|place| [(place, 1), (place, 0x80)]) {
            let mut damaged = whole.clone();
            damaged[place] ^= bit;
            std::fs::write(&path, &damaged).unwrap();
            let mut kept = LogReader::<SensorSample>::open_of(run.path(), &logs()).unwrap();
            // As another log tells.
            kept.rows().expect(40);
            let block = places
                .iter()
                .position(|end| place < *end)
                .map_or(3, |end| end - 1);
            let lost = if block == 3 {
                40..40
            } else {
                block.checked_sub(1).map_or(0, |before| ends[before])..ends[block]
            };
            let found = read(kept);
            assert_eq!(
                found.0,
                (0..40)
                    .filter(|tick| !lost.contains(tick))
                    .collect::<Vec<_>>(),
                "byte {place}"
            );
            assert_eq!(
                found.1,
                [(Defect::Damaged, lost.end - lost.start)],
                "byte {place}"
            );
        }
        std::fs::write(
            &path,
            [&whole[..places[1]], &[7; 5000], &whole[places[1]..]].concat(),
        )
        .unwrap();
        assert_eq!(
            read(LogReader::open_of(run.path(), &logs()).unwrap()),
            ((0..40).collect(), vec![(Defect::Damaged, 0)])
        );
    }

    #[test]
    fn blocks_that_are_missing_repeated_exchanged_or_foreign_are_named_and_what_is_left_comes_in_order()
     {
        let run = TempDir::new().unwrap();
        let ends = [10, 25, 40, 50_u64];
        let (other_run, _) = written(run.path(), &Logs::new(8, ["sensor", "plant_state"]), &ends);
        let (other_log, _) = written(run.path(), &Logs::new(7, ["plant_state", "sensor"]), &ends);
        let (whole, places) = written(run.path(), &logs(), &ends);
        let path = run.path().join("sensor.log");
        let of = |file: &[u8], block: usize| file[places[block]..places[block + 1]].to_vec();
        let ours = |block: usize| of(&whole, block);
        let all: Vec<u64> = (0..50).collect();
        let without = |lost: std::ops::Range<u64>| {
            all.iter()
                .copied()
                .filter(|tick| !lost.contains(tick))
                .collect::<Vec<_>>()
        };
        let end = whole[places[4]..].to_vec();
        let cases = [
            (
                vec![ours(0), ours(1), ours(2), ours(3)],
                all.clone(),
                vec![],
            ),
            (
                vec![ours(0), ours(2), ours(3)],
                without(10..25),
                vec![(Defect::Missing, 15)],
            ),
            (
                vec![ours(1), ours(2), ours(3)],
                without(0..10),
                vec![(Defect::Missing, 10)],
            ),
            (
                vec![ours(0), ours(1), ours(2)],
                without(40..50),
                vec![(Defect::Missing, 10)],
            ),
            (vec![ours(3)], without(0..40), vec![(Defect::Missing, 40)]),
            (vec![], vec![], vec![(Defect::Missing, 50)]),
            (
                vec![ours(0), ours(1), ours(1), ours(2), ours(3)],
                all.clone(),
                vec![(Defect::Repeated, 0)],
            ),
            (
                vec![ours(0), ours(1), ours(2), ours(3), ours(0)],
                all.clone(),
                vec![(Defect::Repeated, 0)],
            ),
            (
                vec![ours(0), ours(2), ours(1), ours(3)],
                all.clone(),
                vec![(Defect::Displaced, 0)],
            ),
            (
                vec![ours(3), ours(0), ours(1), ours(2)],
                all.clone(),
                vec![(Defect::Displaced, 0); 3],
            ),
            (
                vec![ours(0), ours(1), ours(1), ours(3)],
                without(25..40),
                vec![(Defect::Missing, 15), (Defect::Repeated, 0)],
            ),
            (
                vec![ours(0), of(&other_run, 1), ours(2), ours(3)],
                without(10..25),
                vec![(Defect::OtherRun, 15)],
            ),
            (
                vec![ours(0), ours(1), of(&other_run, 1), ours(2), ours(3)],
                all.clone(),
                vec![(Defect::OtherRun, 0)],
            ),
            (
                vec![ours(0), of(&other_log, 1), ours(2), ours(3)],
                without(10..25),
                vec![(Defect::OtherLog, 15)],
            ),
            (
                vec![ours(0), ours(1), ours(2), of(&other_run, 3)],
                without(40..50),
                vec![(Defect::OtherRun, 10)],
            ),
            (
                vec![of(&other_run, 0), ours(1), ours(2), ours(3)],
                without(0..10),
                vec![(Defect::OtherRun, 10)],
            ),
        ];
        for (number, (blocks, ticks, defects)) in cases.into_iter().enumerate() {
            std::fs::write(
                &path,
                [&whole[..FILE_HEAD], &blocks.concat(), &end].concat(),
            )
            .unwrap();
            let mut found = read(LogReader::open_of(run.path(), &logs()).unwrap());
            // At one place: the file holds one block where the other was.
            found.1.sort_unstable();
            assert_eq!(found, (ticks, defects.clone()), "case {number}");
            let resumed =
                LogWriter::resume(run.path(), &logs(), Place::default(), |_: SensorSample| ());
            assert_eq!(resumed.is_ok(), defects.is_empty(), "case {number}");
        }
    }

    #[test]
    fn each_log_tells_how_many_messages_the_others_had() {
        let run = TempDir::new().unwrap();
        let logs = logs();
        let mut states = LogWriter::create(run.path(), &logs).unwrap();
        (0..30).for_each(|_| states.add(&PlantState::default()).unwrap());
        states.flush().unwrap();
        let (_, places) = written(run.path(), &logs, &[10, 25]);
        let path = run.path().join("sensor.log");
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..places[2]]).unwrap();
        let mut left = LogReader::<SensorSample>::open_of(run.path(), &logs).unwrap();
        let rows = left.rows();
        assert_eq!(
            (rows.known(), rows.is_ended()),
            (&[10, 30][..], false),
            "as its last block tells"
        );
        states.finish().unwrap();
        let mut ended = LogReader::<PlantState>::open_of(run.path(), &logs).unwrap();
        let rows = ended.rows();
        assert_eq!((rows.known(), rows.is_ended()), (&[25, 30][..], true));
        left.rows().expect(25);
        assert_eq!(read(left).1, []);
        std::fs::write(&path, &whole[..places[1]]).unwrap();
        let mut cut = LogReader::<SensorSample>::open_of(run.path(), &logs).unwrap();
        cut.rows().expect(25);
        assert_eq!(read(cut), ((0..10).collect(), vec![(Defect::Missing, 15)]));
    }
}
