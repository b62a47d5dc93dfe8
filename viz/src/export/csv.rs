//! `signals.csv`, one wide table, and `events.csv`.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::format::{Block, Columns, Event, ExportError, Format};

pub(super) struct Csv {
    signals: Sheet,
    events: Sheet,
}

struct Sheet {
    path: PathBuf,
    writer: ::csv::Writer<File>,
}

impl Sheet {
    fn create(path: PathBuf) -> Result<Self, ExportError> {
        let file = files::create(&path).map_err(|error| ExportError::write(&path)(&error))?;
        let writer = ::csv::Writer::from_writer(file);
        Ok(Self { path, writer })
    }

    fn line<T: AsRef<[u8]>>(
        &mut self,
        fields: impl IntoIterator<Item = T>,
    ) -> Result<(), ExportError> {
        self.writer
            .write_record(fields)
            .map_err(|error| ExportError::write(&self.path)(&error))
    }

    fn finish(mut self) -> Result<PathBuf, ExportError> {
        self.writer
            .flush()
            .map_err(|error| ExportError::write(&self.path)(&error))?;
        Ok(self.path)
    }
}

impl Csv {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        let mut events = Sheet::create(out.join("events.csv"))?;
        events.line(["tick", "t_s", "kind", "subject", "text"])?;
        Ok(Self {
            signals: Sheet::create(out.join("signals.csv"))?,
            events,
        })
    }
}

impl Format for Csv {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        self.signals.line(columns.names())
    }

    fn rows(&mut self, columns: &Columns, block: &Block) -> Result<(), ExportError> {
        for (tick, values) in block.rows() {
            let fixed = [tick.to_string(), columns.t_s(tick).to_string()];
            // The shortest text that reads back as the same number, in the column's own width.
            let text = |value: f64, is_wide| {
                if is_wide {
                    value.to_string()
                } else {
                    (value as f32).to_string()
                }
            };
            let fields = values.iter().zip(&columns.list).map(|(value, column)| {
                value.map_or(String::new(), |value| text(value, column.is_wide))
            });
            self.signals.line(fixed.into_iter().chain(fields))?;
        }
        Ok(())
    }

    fn event(&mut self, event: Event) -> Result<(), ExportError> {
        self.events.line([
            event.tick.to_string(),
            event.t_s.to_string(),
            event.kind.to_owned(),
            event.subject,
            event.text,
        ])
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        Ok(vec![self.signals.finish()?, self.events.finish()?])
    }
}
