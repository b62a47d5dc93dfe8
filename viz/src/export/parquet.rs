//! `signals.parquet` and `events.parquet`: columns as in the CSV, nulls where messages were missing.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::read::Rows;
use ::parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use ::parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::Type;

use super::format::{Columns, Event, ExportError, Format};

/// Rows of a row group: about 16 MB of numbers.
const GROUP: usize = 50_000;

pub(super) struct Parquet {
    out: PathBuf,
    signals: Option<SerializedFileWriter<File>>,
    ticks: Vec<i64>,
    times: Vec<f64>,
    columns: Vec<Column>,
    events: Vec<(i64, f64, [String; 3])>,
}

/// A column of numbers, gathered: values that are there, and which are.
struct Column {
    wide: bool,
    values: Vec<f64>,
    present: Vec<i16>,
}

impl Parquet {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        Ok(Self { out: out.to_owned(), signals: None, ticks: vec![], times: vec![], columns: vec![], events: vec![] })
    }

    fn signals_path(&self) -> PathBuf {
        self.out.join("signals.parquet")
    }

    fn write_group(&mut self) -> Result<(), ExportError> {
        let path = self.signals_path();
        let Some(file) = self.signals.as_mut().filter(|_| !self.ticks.is_empty()) else { return Ok(()) };
        let (ticks, times) = (std::mem::take(&mut self.ticks), std::mem::take(&mut self.times));
        let columns = &mut self.columns;
        let mut write = || -> Result<(), ParquetError> {
            let mut group = file.next_row_group()?;
            column::<Int64Type>(&mut group, &ticks, None)?;
            column::<DoubleType>(&mut group, &times, None)?;
            for Column { wide, values, present } in columns.iter_mut() {
                if *wide {
                    column::<DoubleType>(&mut group, values, Some(present))?;
                } else {
                    let narrow: Vec<f32> = values.iter().map(|value| *value as f32).collect();
                    column::<FloatType>(&mut group, &narrow, Some(present))?;
                }
                values.clear();
                present.clear();
            }
            group.close().map(drop)
        };
        write().map_err(|error| ExportError::write(&path)(&error))
    }
}

/// The next column of a row group.
fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    present: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else { return Err(ParquetError::General("there is no such column".to_owned())) };
    writer.typed::<T>().write_batch(values, present, None)?;
    writer.close()
}

fn field(name: &str, physical: Physical, repetition: Repetition) -> Result<Arc<Type>, ParquetError> {
    let converted = if physical == Physical::BYTE_ARRAY { ConvertedType::UTF8 } else { ConvertedType::NONE };
    Type::primitive_type_builder(name, physical).with_repetition(repetition).with_converted_type(converted).build().map(Arc::new)
}

fn file(path: &Path, fields: Result<Vec<Arc<Type>>, ParquetError>) -> Result<SerializedFileWriter<File>, ExportError> {
    let failed = ExportError::write(path);
    let properties = WriterProperties::builder().set_compression(Compression::ZSTD(ZstdLevel::default())).build();
    let file = File::create(path).map_err(|error| failed(&error))?;
    fields
        .and_then(|fields| Type::group_type_builder("run").with_fields(fields).build())
        .and_then(|schema| SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)))
        .map_err(|error| failed(&error))
}

impl Format for Parquet {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        let wide = columns.signals.iter().flat_map(|(signal, elements)| elements.iter().map(|_| signal.is_wide()));
        self.columns = wide.map(|wide| Column { wide, values: Vec::new(), present: Vec::new() }).collect();
        let names = columns.names();
        let fixed = [(&names[0], Physical::INT64), (&names[1], Physical::DOUBLE)];
        let fields = fixed.into_iter().map(|(name, physical)| field(name, physical, Repetition::REQUIRED)).chain(
            names[2..]
                .iter()
                .zip(&self.columns)
                .map(|(name, column)| field(name, if column.wide { Physical::DOUBLE } else { Physical::FLOAT }, Repetition::OPTIONAL)),
        );
        self.signals = Some(file(&self.signals_path(), fields.collect())?);
        Ok(())
    }

    fn rows(&mut self, columns: &Columns, rows: &Rows) -> Result<(), ExportError> {
        let mut values = Vec::new();
        for (row, tick) in rows.ticks.iter().enumerate() {
            self.ticks.push(*tick as i64);
            self.times.push(columns.t_s(*tick));
            let gathered = &mut self.columns;
            columns.each_value(rows, row, &mut values, |column, _, value| {
                gathered[column].present.push(i16::from(value.is_some()));
                gathered[column].values.extend(value);
            });
        }
        if self.ticks.len() >= GROUP { self.write_group() } else { Ok(()) }
    }

    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        self.events.push((event.tick as i64, event.t_s, [event.kind.to_owned(), event.subject.clone(), event.text.clone()]));
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        self.write_group()?;
        let (signals_path, events_path) = (self.signals_path(), self.out.join("events.parquet"));
        if let Some(signals) = self.signals.take() {
            signals.close().map_err(|error| ExportError::write(&signals_path)(&error))?;
        }
        let kinds = [("tick", Physical::INT64), ("t_s", Physical::DOUBLE)]
            .into_iter()
            .chain(["kind", "subject", "text"].map(|name| (name, Physical::BYTE_ARRAY)));
        let mut events = file(&events_path, kinds.map(|(name, physical)| field(name, physical, Repetition::REQUIRED)).collect())?;
        let mut write = || -> Result<(), ParquetError> {
            let mut group = events.next_row_group()?;
            column::<Int64Type>(&mut group, &self.events.iter().map(|event| event.0).collect::<Vec<_>>(), None)?;
            column::<DoubleType>(&mut group, &self.events.iter().map(|event| event.1).collect::<Vec<_>>(), None)?;
            for i in 0..3 {
                let texts: Vec<ByteArray> = self.events.iter().map(|event| ByteArray::from(event.2[i].as_str())).collect();
                column::<ByteArrayType>(&mut group, &texts, None)?;
            }
            group.close().map(drop)
        };
        write().map_err(|error| ExportError::write(&events_path)(&error))?;
        events.close().map_err(|error| ExportError::write(&events_path)(&error))?;
        Ok(vec![signals_path, events_path])
    }
}
