//! A file of one wide table: CSV, or Parquet with units and meaning as metadata, nulls where messages were missing.
//!
//! In Parquet each column's `unit` and `description` are metadata of its field, as pyarrow, pandas and arrow in any language read them; those of the run
//! are the schema's.

use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};

use files::Draft;
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;
use rerun::external::arrow::array::{Array, ArrayRef, AsArray, RecordBatch};
use rerun::external::arrow::datatypes::{DataType, Float64Type, Int64Type, SchemaRef};

use super::{ExportError, ExportFormat};

/// Rows of a row group: about 16 MB of numbers.
const GROUP: usize = 50_000;

pub(super) struct Table {
    path: PathBuf,
    draft: Draft,
    writer: Writer,
}

enum Writer {
    Csv(Box<csv::Writer<File>>),
    Parquet(Box<ArrowWriter<File>>),
}

type Done<T> = Result<T, Box<dyn Error>>;

impl Table {
    pub(super) fn create(
        format: ExportFormat,
        out: &Path,
        name: &str,
        schema: SchemaRef,
    ) -> Result<Self, ExportError> {
        let extension = match format {
            ExportFormat::Csv => "csv",
            ExportFormat::Parquet => "parquet",
        };
        let path = out.join(name).with_extension(extension);
        let create = || -> Done<_> {
            let (draft, file) = Draft::create(&path)?;
            if format == ExportFormat::Csv {
                let mut writer = csv::Writer::from_writer(file);
                writer.write_record(schema.fields().iter().map(|field| field.name()))?;
                return Ok((draft, Writer::Csv(Box::new(writer))));
            }
            let properties = WriterProperties::builder()
                .set_compression(Compression::ZSTD(ZstdLevel::default()))
                .set_created_by(format!("armplane {}", env!("CARGO_PKG_VERSION")))
                .set_max_row_group_row_count(Some(GROUP));
            let writer = ArrowWriter::try_new(file, schema, Some(properties.build()))?;
            Ok((draft, Writer::Parquet(Box::new(writer))))
        };
        let (draft, writer) = create().map_err(failed(&path))?;
        Ok(Self {
            path,
            draft,
            writer,
        })
    }

    /// Adds rows.
    pub(super) fn write(&mut self, batch: &RecordBatch) -> Result<(), ExportError> {
        let mut write = || -> Done<()> {
            match &mut self.writer {
                Writer::Csv(writer) => {
                    for row in 0..batch.num_rows() {
                        let columns = batch.columns().iter();
                        writer.write_record(columns.map(|column| text(column, row)))?;
                    }
                }
                Writer::Parquet(writer) => writer.write(batch)?,
            }
            Ok(())
        };
        write().map_err(failed(&self.path))
    }

    /// Puts the file into its place.
    pub(super) fn finish(self) -> Result<PathBuf, ExportError> {
        let finish = || -> Done<()> {
            match self.writer {
                Writer::Csv(mut writer) => writer.flush()?,
                Writer::Parquet(writer) => drop(writer.close()?),
            }
            Ok(self.draft.place()?)
        };
        finish().map_err(failed(&self.path))?;
        Ok(self.path)
    }
}

fn failed(path: &Path) -> impl FnOnce(Box<dyn Error>) -> ExportError + '_ {
    |reason| ExportError::Write {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

/// The shortest text that reads back as the same value; nothing where it is missing.
fn text(column: &ArrayRef, row: usize) -> String {
    match column.data_type() {
        _ if column.is_null(row) => String::new(),
        DataType::Int64 => column.as_primitive::<Int64Type>().value(row).to_string(),
        DataType::Float64 => column.as_primitive::<Float64Type>().value(row).to_string(),
        _ => column.as_string::<i32>().value(row).to_owned(),
    }
}
