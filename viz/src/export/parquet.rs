//! `signals.parquet` and `events.parquet`: columns as in the CSV, nulls where messages were missing, units and meaning as metadata.
//!
//! Each column's `unit` and `description` are metadata of its field, as pyarrow, pandas and arrow in any language read them, and in the file's own
//! metadata under `armplane:columns`, a JSON object that every Parquet tool shows.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::parquet::arrow::ArrowWriter;
use ::parquet::basic::{Compression, ZstdLevel};
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::WriterProperties;
use re_chunk::external::arrow::array::{
    ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch, StringArray,
};
use re_chunk::external::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use serde_json::{Map, Value, json};

use super::format::{Block, Columns, Event, ExportError, Format};

/// Rows of a row group: about 16 MB of numbers.
const GROUP: usize = 50_000;

pub(super) struct Parquet {
    out: PathBuf,
    signals: Option<Table>,
    events: Vec<Event>,
}

struct Table {
    path: PathBuf,
    schema: SchemaRef,
    writer: ArrowWriter<File>,
}

impl Table {
    fn create(path: PathBuf, schema: Schema, about: Vec<KeyValue>) -> Result<Self, ExportError> {
        let schema = Arc::new(schema);
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_created_by(format!("armplane {}", env!("CARGO_PKG_VERSION")))
            .set_max_row_group_row_count(Some(GROUP))
            .set_key_value_metadata(Some(about))
            .build();
        let failed = ExportError::write(&path);
        let file = files::create(&path).map_err(|error| failed(&error))?;
        let writer = ArrowWriter::try_new(file, Arc::clone(&schema), Some(properties));
        Ok(Self {
            writer: writer.map_err(|error| failed(&error))?,
            path,
            schema,
        })
    }

    fn write(&mut self, columns: Vec<ArrayRef>) -> Result<(), ExportError> {
        let failed = ExportError::write(&self.path);
        let batch = RecordBatch::try_new(Arc::clone(&self.schema), columns);
        let batch = batch.map_err(|error| failed(&error))?;
        self.writer.write(&batch).map_err(|error| failed(&error))
    }

    fn finish(self) -> Result<PathBuf, ExportError> {
        let failed = ExportError::write(&self.path);
        self.writer.close().map_err(|error| failed(&error))?;
        Ok(self.path)
    }
}

impl Parquet {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        Ok(Self {
            out: out.to_owned(),
            signals: None,
            events: vec![],
        })
    }
}

impl Format for Parquet {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        let mut table = Map::new();
        let mut field = |name: &str, unit: &str, about: &str, kind, nullable| {
            table.insert(name.to_owned(), json!({"unit": unit, "description": about}));
            let about = [("unit", unit), ("description", about)];
            let about = about.map(|(key, value)| (key.to_owned(), value.to_owned()));
            Field::new(name, kind, nullable).with_metadata(about.into())
        };
        let mut fields = vec![
            field("tick", "1", "Tick of the run", DataType::Int64, false),
            field(
                "t_s",
                "s",
                "Time since the first tick",
                DataType::Float64,
                false,
            ),
        ];
        fields.extend(columns.list.iter().map(|column| {
            let kind = match column.is_wide {
                true => DataType::Float64,
                false => DataType::Float32,
            };
            field(&column.name, column.unit, column.about, kind, true)
        }));
        let properties = columns.properties.iter().cloned();
        let schema = Schema::new_with_metadata(fields, properties.clone().collect());
        let of_run = properties.map(|(key, value)| KeyValue::new(format!("armplane:{key}"), value));
        let table = Value::Object(table).to_string();
        let about = [KeyValue::new("armplane:columns".to_owned(), table)];
        let about = about.into_iter().chain(of_run).collect();
        let path = self.out.join("signals.parquet");
        self.signals = Some(Table::create(path, schema, about)?);
        Ok(())
    }

    fn rows(&mut self, columns: &Columns, block: &Block) -> Result<(), ExportError> {
        let Some(signals) = &mut self.signals else {
            return Ok(());
        };
        let ticks = block.ticks.iter().map(|tick| *tick as i64);
        let times = block.ticks.iter().map(|tick| columns.t_s(*tick));
        let mut arrays: Vec<ArrayRef> = vec![
            Arc::new(Int64Array::from_iter_values(ticks)),
            Arc::new(Float64Array::from_iter_values(times)),
        ];
        for (i, column) in columns.list.iter().enumerate() {
            let values = block.rows().map(|(_, values)| values[i]);
            arrays.push(match column.is_wide {
                true => Arc::new(values.collect::<Float64Array>()),
                false => Arc::new(
                    values
                        .map(|value| value.map(|value| value as f32))
                        .collect::<Float32Array>(),
                ),
            });
        }
        signals.write(arrays)
    }

    fn event(&mut self, event: Event) -> Result<(), ExportError> {
        self.events.push(event);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        let mut paths = Vec::new();
        if let Some(signals) = self.signals {
            paths.push(signals.finish()?);
        }
        let kinds = [
            ("tick", DataType::Int64),
            ("t_s", DataType::Float64),
            ("kind", DataType::Utf8),
            ("subject", DataType::Utf8),
            ("text", DataType::Utf8),
        ];
        let fields = kinds.map(|(name, kind)| Field::new(name, kind, false));
        let path = self.out.join("events.parquet");
        let mut table = Table::create(path, Schema::new(fields.to_vec()), vec![])?;
        let events = || self.events.iter();
        let ticks = events().map(|event| event.tick as i64);
        let times = events().map(|event| event.t_s);
        let texts = |text: fn(&Event) -> &str| -> ArrayRef {
            Arc::new(StringArray::from_iter_values(events().map(text)))
        };
        table.write(vec![
            Arc::new(Int64Array::from_iter_values(ticks)),
            Arc::new(Float64Array::from_iter_values(times)),
            texts(|event| event.kind),
            texts(|event| &event.subject),
            texts(|event| &event.text),
        ])?;
        paths.push(table.finish()?);
        Ok(paths)
    }
}
