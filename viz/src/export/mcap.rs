//! `run.mcap`: one JSON channel per group of signals (`/joint`, `/singularity`, …), `/log` as Foxglove shows it, and `/state`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::read::Rows;
use crate::signals::Signal;
use ::mcap::records::MessageHeader;
use ::mcap::{McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::format::{Columns, Event, ExportError, Format};

pub(super) struct Mcap {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Channel of each group of signals.
    groups: BTreeMap<&'static str, u16>,
    log: u16,
    state: u16,
    sequence: u32,
}

/// The part of a signal's name before the colon, and the one after it.
fn split(signal: Signal) -> (&'static str, &'static str) {
    signal.name().split_once(':').unwrap_or(("run", signal.name()))
}

impl Mcap {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        let path = out.join("run.mcap");
        let failed = ExportError::write(&path);
        let file = BufWriter::new(File::create(&path).map_err(|error| failed(&error))?);
        let open = || -> Result<(Writer<BufWriter<File>>, u16, u16), McapError> {
            let library = format!("armplane {}", env!("CARGO_PKG_VERSION"));
            let mut writer = WriteOptions::new().compression(None).library(library).create(file)?;
            let text = json!({"type": "string"});
            let log = json!({"type": "object", "properties": {
                "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
                "level": {"type": "integer"}, "message": text, "name": text, "file": text, "line": {"type": "integer"},
            }});
            let state = json!({"type": "object", "properties": {"lane": text, "state": text}});
            let log = channel(&mut writer, "/log", "foxglove.Log", &log)?;
            let state = channel(&mut writer, "/state", "armplane.State", &state)?;
            Ok((writer, log, state))
        };
        let (writer, log, state) = open().map_err(|error| failed(&error))?;
        Ok(Self { path, writer, groups: BTreeMap::new(), log, state, sequence: 0 })
    }

    fn put(&mut self, channel: u16, t_s: f64, message: &Value) -> Result<(), ExportError> {
        let time = nanoseconds(t_s);
        self.sequence += 1;
        let header = MessageHeader { channel_id: channel, sequence: self.sequence, log_time: time, publish_time: time };
        let text = message.to_string();
        self.writer.write_to_known_channel(&header, text.as_bytes()).map_err(|error| ExportError::write(&self.path)(&error))
    }
}

fn nanoseconds(t_s: f64) -> u64 {
    (t_s * 1e9).round() as u64
}

fn channel(writer: &mut Writer<BufWriter<File>>, topic: &str, name: &str, schema: &Value) -> Result<u16, McapError> {
    let schema = writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
    writer.add_channel(schema, topic, "json", &BTreeMap::new())
}

impl Format for Mcap {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        let mut properties: BTreeMap<&'static str, Map<String, Value>> = BTreeMap::new();
        for (signal, elements) in &columns.signals {
            let (group, quantity) = split(*signal);
            let about = format!("{} [{}]", signal.about().trim(), elements.join(", "));
            let array = json!({"type": "array", "items": {"type": "number"}, "description": about});
            properties.entry(group).or_default().insert(quantity.to_owned(), array);
        }
        for (group, properties) in properties {
            let schema = json!({"type": "object", "properties": properties});
            let id = channel(&mut self.writer, &format!("/{group}"), &format!("armplane.{group}"), &schema);
            self.groups.insert(group, id.map_err(|error| ExportError::write(&self.path)(&error))?);
        }
        Ok(())
    }

    fn rows(&mut self, columns: &Columns, rows: &Rows) -> Result<(), ExportError> {
        let mut values = Vec::new();
        for (row, tick) in rows.ticks.iter().enumerate() {
            let mut messages: BTreeMap<&'static str, Map<String, Value>> = BTreeMap::new();
            for (signal, _) in &columns.signals {
                values.clear();
                rows.values(*signal, row, &mut values);
                if !values.is_empty() {
                    let (group, quantity) = split(*signal);
                    messages.entry(group).or_default().insert(quantity.to_owned(), json!(values));
                }
            }
            for (group, message) in messages {
                if let Some(channel) = self.groups.get(group).copied() {
                    self.put(channel, columns.t_s(*tick), &Value::Object(message))?;
                }
            }
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        if event.kind == "state" {
            return self.put(self.state, event.t_s, &json!({"lane": event.subject, "state": event.text}));
        }
        // Foxglove's levels: 1 debug, 2 info, 3 warning, 4 error, 5 fatal.
        let level = match event.subject.as_str() {
            "ERROR" => 4,
            "WARN" => 3,
            _ => 2,
        };
        let time = nanoseconds(event.t_s);
        let timestamp = json!({"sec": time / 1_000_000_000, "nsec": time % 1_000_000_000});
        let message = json!({"timestamp": timestamp, "level": level, "message": event.text, "name": "armplane", "file": "", "line": 0});
        self.put(self.log, event.t_s, &message)
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        self.writer.finish().map_err(|error| ExportError::write(&self.path)(&error))?;
        Ok(vec![self.path])
    }
}
