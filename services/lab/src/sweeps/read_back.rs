//! Columns of a sweep's table, read back.

use std::collections::BTreeMap;
use std::path::Path;

use session::Failure;

use super::cell::Cell;
use super::manifest::{Manifest, open, rows_file};

/// Results whose distributions are shown.
pub(super) const SHOWN: [&str; 8] = [
    "position_max_mm",
    "orthogonal_max_mm",
    "orientation_max_deg",
    "orthogonal_max_deg",
    "final_position_mm",
    "speed_max_ratio",
    "torque_max_ratio",
    "torque_step_max_ratio",
];

/// The columns of a sweep that the report needs.
pub(super) struct Table {
    columns: BTreeMap<String, Vec<Cell>>,
    /// How many rows.
    pub(super) rows: usize,
}

impl Table {
    /// Reads columns of all complete partitions.
    ///
    /// # Errors
    /// [`Failure::Input`] where there is no such column, or a file is damaged.
    pub(super) fn read(
        folder: &Path,
        manifest: &Manifest,
        names: &[&str],
    ) -> Result<Self, Failure> {
        let mut table = Self {
            columns: names
                .iter()
                .map(|name| ((*name).to_owned(), Vec::new()))
                .collect(),
            rows: 0,
        };
        for partition in manifest
            .own_partitions()
            .filter(|partition| rows_file(folder, *partition).exists())
        {
            let opened = open(folder, manifest, partition)?;
            for (name, cells) in &mut table.columns {
                cells.extend(opened.column(name).map_err(|sentence| {
                    Failure::Input(format!("{}: {sentence}", folder.display()))
                })?);
            }
            table.rows += opened.rows as usize;
        }
        Ok(table)
    }

    /// A column that was asked for.
    pub(super) fn column(&self, name: &str) -> &[Cell] {
        self.columns.get(name).map_or(&[], Vec::as_slice)
    }

    /// The numbers of a column, ordered.
    pub(super) fn ordered(&self, name: &str) -> Vec<f64> {
        let mut numbers: Vec<f64> = self.column(name).iter().filter_map(Cell::number).collect();
        numbers.sort_by(f64::total_cmp);
        numbers
    }
}
