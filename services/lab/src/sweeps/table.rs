//! Rows as Parquet: one file for each partition, zstd, units and provenance in the file's metadata.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use session::Failure;
use xxhash_rust::xxh3::Xxh3Default;

use super::cell::{Cell, Kind};
use super::row::Column;

/// The file's own checksum among its metadata: the number of the bytes of its columns, and XXH3 of these and of the other metadata, of 64 bits, in
/// hexadecimal. Parquet has a checksum for each page, and the crate writes none.
const CHECKSUM: &str = "armplane.checksum";

/// The value of [`CHECKSUM`] for a file that begins with these `bytes`.
///
/// # Errors
/// The file system's own.
fn checksum<'a>(
    path: &Path,
    bytes: u64,
    metadata: impl Iterator<Item = (&'a str, &'a str)>,
) -> io::Result<String> {
    let mut sum = Xxh3Default::new();
    io::copy(&mut files::open(path)?.take(bytes), &mut sum)?;
    for (key, value) in metadata {
        sum.update(key.as_bytes());
        sum.update(value.as_bytes());
    }
    Ok(format!("{bytes} {:016x}", sum.digest()))
}

/// Writes rows into `draft`, which gets its name `path` when it is whole.
///
/// # Errors
/// [`Failure::Work`] where it cannot be written.
pub(super) fn write(
    path: &Path,
    draft: &Path,
    columns: &[Column],
    rows: &[Vec<Cell>],
    metadata: &[(String, String)],
) -> Result<(), Failure> {
    let written = write_draft(draft, columns, rows, metadata)
        .map_err(|error| error.to_string())
        .and_then(|file| {
            file.sync_all()
                .and_then(|()| std::fs::rename(draft, path))
                .map_err(|error| error.to_string())
        });
    written.map_err(|error| {
        let _ = std::fs::remove_file(draft);
        Failure::Work(format!("cannot write {}: {error}", path.display()))
    })
}

fn write_draft(
    path: &Path,
    columns: &[Column],
    rows: &[Vec<Cell>],
    metadata: &[(String, String)],
) -> Result<File, ParquetError> {
    let file = File::create(path).map_err(|error| ParquetError::External(error.into()))?;
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Type::group_type_builder("sweep")
        .with_fields(fields)
        .build()?;
    let pairs = metadata
        .iter()
        .map(|(key, value)| KeyValue::new(key.clone(), value.clone()))
        .collect();
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(format!("armplane {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(pairs));
    let mut writer = SerializedFileWriter::new(
        file.try_clone()?,
        Arc::new(schema),
        Arc::new(properties.build()),
    )?;
    let mut group = writer.next_row_group()?;
    for (place, column) in columns.iter().enumerate() {
        let cells = || rows.iter().map(|row| &row[place]);
        let present: Vec<i16> = cells()
            .map(|cell| i16::from(*cell != Cell::Absent))
            .collect();
        match column.kind {
            Kind::Boolean => {
                let values = cells().filter_map(|cell| {
                    if let Cell::Boolean(so) = cell {
                        Some(*so)
                    } else {
                        None
                    }
                });
                write_column::<BoolType>(&mut group, &values.collect::<Vec<_>>(), &present)?;
            }
            Kind::Whole => {
                let values = cells().filter_map(|cell| {
                    if let Cell::Whole(number) = cell {
                        Some(*number)
                    } else {
                        None
                    }
                });
                write_column::<Int64Type>(&mut group, &values.collect::<Vec<_>>(), &present)?;
            }
            Kind::Number => {
                let values = cells().filter_map(|cell| {
                    if let Cell::Number(number) = cell {
                        Some(*number)
                    } else {
                        None
                    }
                });
                write_column::<DoubleType>(&mut group, &values.collect::<Vec<_>>(), &present)?;
            }
            Kind::Text => {
                let values = cells().filter_map(|cell| {
                    if let Cell::Text(text) = cell {
                        Some(ByteArray::from(text.as_str()))
                    } else {
                        None
                    }
                });
                write_column::<ByteArrayType>(&mut group, &values.collect::<Vec<_>>(), &present)?;
            }
        }
    }
    group.close()?;
    writer.flush()?;
    let sum = checksum(
        path,
        writer.bytes_written() as u64,
        metadata.iter().map(|(key, value)| (&key[..], &value[..])),
    )?;
    writer.append_key_value_metadata(KeyValue::new(CHECKSUM.to_owned(), sum));
    writer.close()?;
    Ok(file)
}

fn field(column: &Column) -> Result<Arc<Type>, ParquetError> {
    let (physical, converted) = match column.kind {
        Kind::Boolean => (Physical::BOOLEAN, ConvertedType::NONE),
        Kind::Whole => (Physical::INT64, ConvertedType::NONE),
        Kind::Number => (Physical::DOUBLE, ConvertedType::NONE),
        Kind::Text => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
    };
    let builder = Type::primitive_type_builder(&column.name, physical);
    builder
        .with_repetition(Repetition::OPTIONAL)
        .with_converted_type(converted)
        .build()
        .map(Arc::new)
}

fn write_column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    present: &[i16],
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General("there is no such column".to_owned()));
    };
    writer
        .typed::<T>()
        .write_batch(values, Some(present), None)?;
    writer.close()
}

/// A partition that is read back.
pub(super) struct Partition {
    reader: SerializedFileReader<File>,
    /// How many rows.
    pub(super) rows: u64,
}

impl Partition {
    /// Opens a file of [`write`].
    ///
    /// # Errors
    /// The defect.
    pub(super) fn open(path: &Path) -> Result<Self, String> {
        let unreadable = |error: String| format!("cannot read {}: {error}", path.display());
        let file = files::open(path).map_err(|error| unreadable(error.to_string()))?;
        let reader =
            SerializedFileReader::new(file).map_err(|error| unreadable(error.to_string()))?;
        let rows = reader.metadata().file_metadata().num_rows() as u64;
        let partition = Self { reader, rows };
        partition.check(path).map_err(unreadable)?;
        Ok(partition)
    }

    /// Whether the bytes are those of the checksum; a file of an earlier version has none.
    fn check(&self, path: &Path) -> Result<(), String> {
        let Some(sum) = self.metadata(CHECKSUM) else {
            return Ok(());
        };
        let pairs = self
            .reader
            .metadata()
            .file_metadata()
            .key_value_metadata()
            .into_iter()
            .flatten();
        let others = pairs
            .filter_map(|pair| Some((&pair.key[..], pair.value.as_deref()?)))
            .filter(|(key, _)| *key != CHECKSUM);
        let bytes = sum
            .split_once(' ')
            .and_then(|(bytes, _)| bytes.parse().ok())
            .unwrap_or_default();
        match checksum(path, bytes, others) {
            Ok(found) if found == sum => Ok(()),
            Ok(_) => Err("it is not as it was written: its checksum differs".to_owned()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// A value of the file's metadata.
    pub(super) fn metadata(&self, key: &str) -> Option<&str> {
        let pairs = self
            .reader
            .metadata()
            .file_metadata()
            .key_value_metadata()?;
        pairs.iter().find(|pair| pair.key == key)?.value.as_deref()
    }

    /// All cells of a column.
    ///
    /// # Errors
    /// Where there is no such column, or it is damaged.
    pub(super) fn column(&self, name: &str) -> Result<Vec<Cell>, String> {
        let schema = self.reader.metadata().file_metadata().schema_descr();
        let place = schema
            .columns()
            .iter()
            .position(|column| column.name() == name || column.path().string() == name);
        let place = place.ok_or_else(|| format!("there is no column `{name}`"))?;
        let mut cells = Vec::with_capacity(self.rows as usize);
        for group in 0..self.reader.num_row_groups() {
            let group = self
                .reader
                .get_row_group(group)
                .map_err(|error| error.to_string())?;
            let rows = group.metadata().num_rows() as usize;
            let read = group
                .get_column_reader(place)
                .and_then(|reader| read_column(reader, rows));
            cells.extend(read.map_err(|error| error.to_string())?);
        }
        Ok(cells)
    }
}

fn read_column(reader: ColumnReader, rows: usize) -> Result<Vec<Cell>, ParquetError> {
    macro_rules! cells {
        ($reader:ident, $cell:expr) => {{
            let (mut values, mut present, mut read) = (Vec::new(), Vec::new(), 0);
            while read < rows {
                let (records, ..) =
                    $reader.read_records(rows - read, Some(&mut present), None, &mut values)?;
                if records == 0 {
                    return Err(ParquetError::General("rows are missing".to_owned()));
                }
                read += records;
            }
            let mut values = values.into_iter();
            present
                .iter()
                .map(|is| if *is == 0 { None } else { values.next() })
                .map(|value| value.map_or(Cell::Absent, $cell))
                .collect()
        }};
    }
    Ok(match reader {
        ColumnReader::BoolColumnReader(mut reader) => cells!(reader, Cell::Boolean),
        ColumnReader::Int64ColumnReader(mut reader) => cells!(reader, Cell::Whole),
        ColumnReader::DoubleColumnReader(mut reader) => cells!(reader, Cell::Number),
        ColumnReader::ByteArrayColumnReader(mut reader) => {
            cells!(reader, |text: ByteArray| Cell::Text(
                String::from_utf8_lossy(text.data()).into_owned()
            ))
        }
        _ => return Err(ParquetError::General("a column of another type".to_owned())),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_and_the_same_rows_are_the_same_bytes() {
        let column = |name: &str, kind| Column {
            name: name.into(),
            kind,
            unit: String::new(),
            about: String::new(),
        };
        let columns = [
            column("run", Kind::Whole),
            column("control.k_p", Kind::Number),
            column("s1", Kind::Boolean),
            column("reason", Kind::Text),
        ];
        let rows: Vec<Vec<Cell>> = (0..300)
            .map(|run| {
                let absent = run % 7 == 3;
                let or = |cell| if absent { Cell::Absent } else { cell };
                vec![
                    Cell::Whole(run),
                    or(Cell::Number(0.1 * run as f64)),
                    or(Cell::Boolean(run % 2 == 0)),
                    or(Cell::Text(format!("ζ {}", run % 5))),
                ]
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one.parquet", "other.parquet"].map(|name| folder.path().join(name));
        let metadata = [("armplane.units".to_owned(), "{}".to_owned())];
        for path in [&one, &other] {
            write(
                path,
                &folder.path().join("draft"),
                &columns,
                &rows,
                &metadata,
            )
            .unwrap();
        }
        assert_eq!(std::fs::read(&one).unwrap(), std::fs::read(&other).unwrap());
        let partition = Partition::open(&one).unwrap();
        assert_eq!(
            (partition.rows, partition.metadata("armplane.units")),
            (300, Some("{}"))
        );
        for (place, column) in columns.iter().enumerate() {
            let cells = partition.column(&column.name).unwrap();
            assert!(
                cells.iter().eq(rows.iter().map(|row| &row[place])),
                "{}",
                column.name
            );
        }
        assert!(partition.column("nothing").is_err());
        let bytes = std::fs::read(&one).unwrap();
        std::fs::write(&other, &bytes[..bytes.len() - 9]).unwrap();
        assert!(
            Partition::open(&other)
                .err()
                .unwrap()
                .contains("cannot read")
        );
        let covered: usize = partition
            .metadata(CHECKSUM)
            .unwrap()
            .split_once(' ')
            .unwrap()
            .0
            .parse()
            .unwrap();
        assert!(covered > bytes.len() / 2, "{covered} of {}", bytes.len());
        for at in (0..covered).step_by(7) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            std::fs::write(&other, &flipped).unwrap();
            assert!(
                Partition::open(&other)
                    .err()
                    .is_some_and(|error| error.contains("its checksum differs")),
                "byte {at}"
            );
        }
    }
}
