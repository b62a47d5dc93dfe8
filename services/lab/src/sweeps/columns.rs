//! The table: columns, and rows of named values, as a Parquet file (zstd) and back. A value that is not in a row is absent.

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray};
use bytes::Bytes;
use parquet::arrow::ArrowWriter;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use parquet::schema::types::Type;
use shared_types::topics::TOPICS;
use toml::{Table, Value};

use super::units::unit_of;
use crate::row::Row;

/// The number of a run.
pub(super) const RUN: &str = "run";
pub(super) const OUTCOME: &str = "outcome";
pub(super) const REASON: &str = "reason";
/// The outcome of a run that a cycle refused before its first tick.
pub(super) const REFUSED: &str = "refused";
/// The outcome of a run that ended in a defect of this program.
pub(super) const FAILED: &str = "failed";

/// A column of the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    /// A value of its type.
    pub(super) example: Value,
    /// Unit of its numbers; empty where there is none.
    pub(super) unit: String,
    /// Its meaning.
    pub(super) about: &'static str,
}

/// The meanings of the columns.
const ABOUT: [(&str, &str); 39] = [
    (RUN, "number of the run, from 0"),
    (
        OUTCOME,
        "goal reached, followed to the boundary, goal missed, stopped, refused (before the first tick) or failed",
    ),
    (REASON, "why, in one sentence"),
    ("law", "the control law"),
    ("ticks", "ticks of the plant"),
    ("completed", "whether the task ran to its end"),
    ("s1", "success by the strict bar of `armplane compare`"),
    ("s2", "success by its bar for lines that are not along ζ"),
    ("missed", "the conditions of s2 that failed"),
    ("position_max_mm", "largest position error"),
    ("position_rms_mm", "root mean square position error"),
    ("orientation_max_deg", "largest orientation error"),
    (
        "orthogonal_max_mm",
        "largest position error orthogonal to ζ",
    ),
    (
        "orthogonal_max_deg",
        "largest orientation error orthogonal to ζ",
    ),
    ("along_max_mm", "largest position error along ζ"),
    ("along_max_deg", "largest orientation error along ζ"),
    ("final_position_mm", "position error at the end"),
    ("final_orientation_deg", "orientation error at the end"),
    ("time_stretch", "ticks of the plant over those planned"),
    ("has_speed_limit", "whether a joint's speed has a limit"),
    ("has_torque_limit", "whether a joint's torque has a limit"),
    ("speed_max_ratio", "largest joint speed over its limit"),
    (
        "torque_max_ratio",
        "largest torque that the drives applied over its limit",
    ),
    (
        "torque_commanded_max_ratio",
        "largest torque that was commanded over its limit",
    ),
    (
        "torque_step_max_ratio",
        "largest change of a torque in one tick over its limit",
    ),
    ("torque_step_p95_ratio", "95th percentile of that change"),
    ("torque_step_p99_ratio", "99th percentile of it"),
    (
        "contact_ticks",
        "ticks in which the arm touched the floor, or itself",
    ),
    ("contact_max_n", "largest sum of contact forces on the arm"),
    ("saturated_ticks", "ticks with any torque at its limit"),
    (
        "rate_limited_ticks",
        "ticks at which the law asked for a faster change of a torque than its drive accepts",
    ),
    (
        "rejected_estimate_ticks",
        "ticks for which the controller set the estimate aside",
    ),
    ("chatter", "torque jumps back within 10 ms"),
    ("jump_energy_j", "½ΔΓᵀA⁻¹ΔΓ/k_v² over the torque jumps"),
    (
        "stopped_ticks",
        "ticks with a joint against its stop, or with the drives not active",
    ),
    ("switches", "changes of mode"),
    ("switch_energy_j", "energy put in at changes of mode"),
    ("s_min", "smallest |s| of any singularity"),
    (
        "inside_ticks",
        "ticks inside the neighbourhood of any singularity, each counted",
    ),
];

/// The columns of a table with these keys: name, a value, unit.
pub(super) fn columns<'a>(
    keys: impl Iterator<Item = (&'a str, Value, &'a str)>,
) -> Result<Vec<Column>, String> {
    let key = |(name, example, unit): (&str, Value, &str)| Column {
        name: name.to_owned(),
        example,
        unit: unit.to_owned(),
        about: "set by the sweep",
    };
    let whole = Row {
        law: "blended".to_owned(),
        s_min: Some(0.0),
        hash: TOPICS.map(|topic| (topic.to_owned(), String::new())).into(),
        ..Row::default()
    };
    let result = |(name, example): (String, Value)| Column {
        unit: unit_of(&name).unwrap_or_default().to_owned(),
        about: ABOUT.iter().find(|(known, _)| *known == name).map_or(
            "XXH3-64 over the topic, as in summary.json",
            |(_, about)| about,
        ),
        name,
        example,
    };
    let run = result((RUN.to_owned(), Value::Integer(0)));
    let results = cells(&whole)?.into_iter().map(result);
    Ok([run]
        .into_iter()
        .chain(keys.map(key))
        .chain(results)
        .collect())
}

/// The name of the column with a topic's hash.
pub(super) fn hash_column(topic: &str) -> String {
    format!("hash.{topic}")
}

/// The values of a row: its numbers, truth values and texts.
pub(super) fn cells(row: &Row) -> Result<Table, String> {
    let mut cells = Table::try_from(row).map_err(|error| error.to_string())?;
    cells.insert("missed".to_owned(), row.task.missed.join(", ").into());
    let hashes = row.hash.iter();
    cells.extend(hashes.map(|(topic, hash)| (hash_column(topic), hash.clone().into())));
    cells.retain(|_, value| !value.is_array() && !value.is_table());
    Ok(cells)
}

/// A value as a number, where it is one.
pub(super) fn number(value: Option<&Value>) -> Option<f64> {
    match value? {
        Value::Boolean(so) => Some(f64::from(u8::from(*so))),
        Value::Integer(number) => Some(*number as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    }
}

/// A value as text for people.
pub(super) fn shown(value: Option<&Value>) -> String {
    match value {
        None => "–".to_owned(),
        Some(Value::Float(number)) => viz::plot::digits(*number),
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
    }
}

/// Rows as the bytes of a Parquet file: the same rows are the same bytes.
pub(super) fn write(
    columns: &[Column],
    rows: &[Table],
    metadata: Vec<(String, String)>,
) -> Result<Vec<u8>, ParquetError> {
    let array = |Column { name, example, .. }: &Column| {
        let cells = rows.iter().map(|row| row.get(name));
        let array: ArrayRef = match example {
            Value::Boolean(_) => {
                Arc::new(BooleanArray::from_iter(cells.map(|cell| cell?.as_bool())))
            }
            Value::Integer(_) => {
                Arc::new(Int64Array::from_iter(cells.map(|cell| cell?.as_integer())))
            }
            Value::Float(_) => Arc::new(Float64Array::from_iter(cells.map(number))),
            _ => Arc::new(StringArray::from_iter(
                cells.map(|cell| cell.map(|_| shown(cell))),
            )),
        };
        (name.clone(), array, true)
    };
    let batch = RecordBatch::try_from_iter_with_nullable(columns.iter().map(array))?;
    let properties = Some(viz::parquet_properties(metadata));
    let mut writer = ArrowWriter::try_new(Vec::new(), batch.schema(), properties)?;
    writer.write(&batch)?;
    writer.into_inner()
}

/// A Parquet file that is read back.
pub(super) struct Part(SerializedFileReader<Bytes>);

impl Part {
    pub(super) fn open(bytes: Vec<u8>) -> Result<Self, ParquetError> {
        SerializedFileReader::new(Bytes::from(bytes)).map(Self)
    }

    /// A value of the file's metadata.
    pub(super) fn metadata(&self, key: &str) -> Option<&str> {
        let pairs = self.0.metadata().file_metadata().key_value_metadata()?;
        pairs.iter().find(|pair| pair.key == key)?.value.as_deref()
    }

    /// Adds the values of its rows to the columns that are asked for.
    ///
    /// # Errors
    /// Where there is no such column, or it is damaged.
    pub(super) fn read(&self, into: &mut Columns) -> Result<(), ParquetError> {
        let schema = self.0.metadata().file_metadata().schema();
        let fields = schema.get_fields().iter();
        let wanted = fields.filter(|field| into.0.contains_key(field.name()));
        let wanted: Vec<_> = wanted.cloned().collect();
        let is_known = |name: &&String| wanted.iter().any(|field| field.name() == *name);
        if let Some(unknown) = into.0.keys().find(|name| !is_known(name)) {
            return Err(ParquetError::General(format!(
                "there is no column `{unknown}`"
            )));
        }
        let projection = Type::group_type_builder(schema.name()).with_fields(wanted);
        for row in self.0.get_row_iter(Some(projection.build()?))? {
            for (name, field) in row?.get_column_iter() {
                let value = match field {
                    Field::Bool(so) => Some(Value::Boolean(*so)),
                    Field::Long(number) => Some(Value::Integer(*number)),
                    Field::Double(number) => Some(Value::Float(*number)),
                    Field::Str(text) => Some(Value::String(text.clone())),
                    _ => None,
                };
                into.0.entry(name.clone()).or_default().push(value);
            }
        }
        Ok(())
    }
}

/// Columns that have been read, by name.
#[derive(Default)]
pub(super) struct Columns(BTreeMap<String, Vec<Option<Value>>>);

impl Columns {
    /// Columns to be read.
    pub(super) fn named(names: &[&str]) -> Self {
        Self(
            names
                .iter()
                .map(|name| ((*name).to_owned(), Vec::new()))
                .collect(),
        )
    }

    pub(super) fn get(&self, name: &str) -> &[Option<Value>] {
        self.0.get(name).map_or(&[], Vec::as_slice)
    }

    pub(super) fn rows(&self) -> usize {
        self.0.values().next().map_or(0, Vec::len)
    }

    pub(super) fn value(&self, name: &str, row: usize) -> Option<&Value> {
        self.get(name)[row].as_ref()
    }

    pub(super) fn shown(&self, name: &str, row: usize) -> String {
        shown(self.value(name, row))
    }

    /// The numbers of a column, ordered.
    pub(super) fn ordered(&self, name: &str) -> Vec<f64> {
        let column = self.get(name).iter();
        let mut numbers: Vec<f64> = column.filter_map(|value| number(value.as_ref())).collect();
        numbers.sort_by(f64::total_cmp);
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_result_is_explained() {
        for column in columns([].into_iter()).unwrap() {
            let is_explained = ABOUT.iter().any(|(name, _)| *name == column.name);
            assert!(
                is_explained || column.name.starts_with("hash."),
                "{}",
                column.name
            );
        }
    }
}
