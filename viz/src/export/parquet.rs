//! `signals.parquet` and `events.parquet`: columns as in the CSV, nulls where messages were missing, units and meaning as metadata.
//!
//! Parquet itself has metadata for a file only. Each column's `unit` and `description` are therefore in the Arrow schema that the file carries
//! (key `ARROW:schema`), where pyarrow, pandas and arrow in any language find them as field metadata, and in the file's own metadata under
//! `armplane:columns`, a JSON object that every Parquet tool shows.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use ::parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::Type;
use base64::Engine as _;
use re_chunk::external::arrow::datatypes::{DataType as ArrowType, Field, Schema};
use re_chunk::external::arrow::ipc::writer::{
    DictionaryTracker, IpcDataGenerator, IpcWriteOptions,
};
use serde_json::{Map, Value, json};

use super::format::{Block, Columns, Event, ExportError, Format};

/// Rows of a row group: about 16 MB of numbers.
const GROUP: usize = 50_000;

pub(super) struct Parquet {
    out: PathBuf,
    signals: Option<SerializedFileWriter<File>>,
    ticks: Vec<i64>,
    times: Vec<f64>,
    columns: Vec<Gathered>,
    events: Vec<(i64, f64, [String; 3])>,
}

/// A column of numbers, gathered: values that are there, and which are.
struct Gathered {
    wide: bool,
    values: Vec<f64>,
    present: Vec<i16>,
}

impl Parquet {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        Ok(Self {
            out: out.to_owned(),
            signals: None,
            ticks: vec![],
            times: vec![],
            columns: vec![],
            events: vec![],
        })
    }

    fn signals_path(&self) -> PathBuf {
        self.out.join("signals.parquet")
    }

    fn write_group(&mut self) -> Result<(), ExportError> {
        let path = self.signals_path();
        let Some(file) = self.signals.as_mut().filter(|_| !self.ticks.is_empty()) else {
            return Ok(());
        };
        let (ticks, times) = (
            std::mem::take(&mut self.ticks),
            std::mem::take(&mut self.times),
        );
        let columns = &mut self.columns;
        let mut write = || -> Result<(), ParquetError> {
            let mut group = file.next_row_group()?;
            column::<Int64Type>(&mut group, &ticks, None)?;
            column::<DoubleType>(&mut group, &times, None)?;
            for Gathered {
                wide,
                values,
                present,
            } in columns.iter_mut()
            {
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
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General("there is no such column".to_owned()));
    };
    writer.typed::<T>().write_batch(values, present, None)?;
    writer.close()
}

fn field(
    name: &str,
    physical: Physical,
    repetition: Repetition,
) -> Result<Arc<Type>, ParquetError> {
    let converted = if physical == Physical::BYTE_ARRAY {
        ConvertedType::UTF8
    } else {
        ConvertedType::NONE
    };
    Type::primitive_type_builder(name, physical)
        .with_repetition(repetition)
        .with_converted_type(converted)
        .build()
        .map(Arc::new)
}

fn file(
    path: &Path,
    fields: Result<Vec<Arc<Type>>, ParquetError>,
    metadata: Vec<KeyValue>,
) -> Result<SerializedFileWriter<File>, ExportError> {
    let failed = ExportError::write(path);
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(format!("armplane {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(metadata))
        .build();
    let file = File::create(path).map_err(|error| failed(&error))?;
    fields
        .and_then(|fields| Type::group_type_builder("run").with_fields(fields).build())
        .and_then(|schema| SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)))
        .map_err(|error| failed(&error))
}

/// Units and meaning of the columns, and the run's description.
fn metadata(columns: &Columns) -> Vec<KeyValue> {
    let fixed = [
        ("tick", "1", "Tick of the run", ArrowType::Int64),
        ("t_s", "s", "Time since the first tick", ArrowType::Float64),
    ];
    let all = fixed
        .map(|(name, unit, about, kind)| (name, unit, about, kind, false))
        .into_iter()
        .chain(columns.list.iter().map(|column| {
            let kind = if column.is_wide {
                ArrowType::Float64
            } else {
                ArrowType::Float32
            };
            (column.name.as_str(), column.unit, column.about, kind, true)
        }));
    let described: Vec<_> = all.collect();
    let fields = described.iter().map(|(name, unit, about, kind, nullable)| {
        let about = [("unit", *unit), ("description", *about)]
            .map(|(key, value)| (key.to_owned(), value.to_owned()));
        Field::new(*name, kind.clone(), *nullable).with_metadata(about.into())
    });
    let schema = Schema::new(fields.collect::<Vec<_>>())
        .with_metadata(columns.properties.iter().cloned().collect());
    let table: Map<String, Value> = described
        .iter()
        .map(|(name, unit, about, ..)| {
            (
                (*name).to_owned(),
                json!({"unit": unit, "description": about}),
            )
        })
        .collect();
    let of_run = columns
        .properties
        .iter()
        .map(|(key, value)| KeyValue::new(format!("armplane:{key}"), value.clone()));
    let of_columns = [
        KeyValue::new("ARROW:schema".to_owned(), encoded(&schema)),
        KeyValue::new(
            "armplane:columns".to_owned(),
            Value::Object(table).to_string(),
        ),
    ];
    of_columns.into_iter().chain(of_run).collect()
}

/// A schema as Parquet carries it: an Arrow IPC message (marker, length, description), in base64.
fn encoded(schema: &Schema) -> String {
    let description = IpcDataGenerator::default()
        .schema_to_bytes_with_dictionary_tracker(
            schema,
            &mut DictionaryTracker::new(true),
            &IpcWriteOptions::default(),
        )
        .ipc_message;
    let length = (description.len() as u32).to_le_bytes();
    let message = [&[0xff; 4], &length[..], &description].concat();
    base64::engine::general_purpose::STANDARD.encode(message)
}

impl Format for Parquet {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        let gathered = |wide| Gathered {
            wide,
            values: Vec::new(),
            present: Vec::new(),
        };
        self.columns = columns
            .list
            .iter()
            .map(|column| gathered(column.is_wide))
            .collect();
        let fixed = [("tick", Physical::INT64), ("t_s", Physical::DOUBLE)];
        let fields = fixed
            .into_iter()
            .map(|(name, physical)| field(name, physical, Repetition::REQUIRED))
            .chain(columns.list.iter().map(|column| {
                field(
                    &column.name,
                    if column.is_wide {
                        Physical::DOUBLE
                    } else {
                        Physical::FLOAT
                    },
                    Repetition::OPTIONAL,
                )
            }));
        self.signals = Some(file(
            &self.signals_path(),
            fields.collect(),
            metadata(columns),
        )?);
        Ok(())
    }

    fn rows(&mut self, columns: &Columns, block: &Block) -> Result<(), ExportError> {
        for (tick, values) in block.rows() {
            self.ticks.push(tick as i64);
            self.times.push(columns.t_s(tick));
            for (gathered, value) in self.columns.iter_mut().zip(values) {
                gathered.present.push(i16::from(value.is_some()));
                gathered.values.extend(value);
            }
        }
        if self.ticks.len() >= GROUP {
            self.write_group()
        } else {
            Ok(())
        }
    }

    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        self.events.push((
            event.tick as i64,
            event.t_s,
            [
                event.kind.to_owned(),
                event.subject.clone(),
                event.text.clone(),
            ],
        ));
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        self.write_group()?;
        let (signals_path, events_path) = (self.signals_path(), self.out.join("events.parquet"));
        if let Some(signals) = self.signals.take() {
            signals
                .close()
                .map_err(|error| ExportError::write(&signals_path)(&error))?;
        }
        let kinds = [("tick", Physical::INT64), ("t_s", Physical::DOUBLE)]
            .into_iter()
            .chain(["kind", "subject", "text"].map(|name| (name, Physical::BYTE_ARRAY)));
        let mut events = file(
            &events_path,
            kinds
                .map(|(name, physical)| field(name, physical, Repetition::REQUIRED))
                .collect(),
            vec![],
        )?;
        let mut write = || -> Result<(), ParquetError> {
            let mut group = events.next_row_group()?;
            column::<Int64Type>(
                &mut group,
                &self.events.iter().map(|event| event.0).collect::<Vec<_>>(),
                None,
            )?;
            column::<DoubleType>(
                &mut group,
                &self.events.iter().map(|event| event.1).collect::<Vec<_>>(),
                None,
            )?;
            for i in 0..3 {
                let texts: Vec<ByteArray> = self
                    .events
                    .iter()
                    .map(|event| ByteArray::from(event.2[i].as_str()))
                    .collect();
                column::<ByteArrayType>(&mut group, &texts, None)?;
            }
            group.close().map(drop)
        };
        write().map_err(|error| ExportError::write(&events_path)(&error))?;
        events
            .close()
            .map_err(|error| ExportError::write(&events_path)(&error))?;
        Ok(vec![signals_path, events_path])
    }
}
