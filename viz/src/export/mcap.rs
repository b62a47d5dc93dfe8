//! `run.mcap`: one JSON channel per group of quantities (`/joint`, `/singularity`, …), `/state`, and for Foxglove's panels `/log`, `/tf` (where each
//! link, the hand and the desired hand are), `/arm` and `/zeta` (scenes: the arm's figure, singular directions), `/pose/hand` and `/pose/desired`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::read::Solid;
use ::mcap::records::MessageHeader;
use ::mcap::{WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::format::{Block, Columns, Event, ExportError, Format, Place};
use super::foxglove;

pub(super) struct Mcap {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Channel of each topic.
    channels: BTreeMap<String, u16>,
    sequence: u32,
    /// Solids that are written: every part of a recording has them.
    solids: BTreeSet<String>,
    /// The largest extent of a solid; m.
    extent: f32,
}

/// The topics that every file has, with the names of their schemas.
const FIXED: [(&str, &str); 7] = [
    ("/log", "foxglove.Log"),
    ("/state", "armplane.State"),
    ("/tf", "foxglove.FrameTransform"),
    ("/arm", "foxglove.SceneUpdate"),
    ("/zeta", "foxglove.SceneUpdate"),
    ("/pose/hand", "foxglove.PoseInFrame"),
    ("/pose/desired", "foxglove.PoseInFrame"),
];

impl Mcap {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        let path = out.join("run.mcap");
        let failed = ExportError::write(&path);
        let file = File::create(&path).map_err(|error| failed(&error))?;
        let writer = WriteOptions::new()
            .compression(None)
            .library(format!("armplane {}", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::new(file));
        let schemas: Value =
            serde_json::from_str(include_str!("foxglove.json")).map_err(|error| failed(&error))?;
        let mut mcap = Self {
            writer: writer.map_err(|error| failed(&error))?,
            path,
            channels: BTreeMap::new(),
            sequence: 0,
            solids: BTreeSet::new(),
            extent: 0.0,
        };
        for (topic, name) in FIXED {
            mcap.open(topic, name, &schemas[name])?;
        }
        Ok(mcap)
    }

    fn open(&mut self, topic: &str, name: &str, schema: &Value) -> Result<(), ExportError> {
        let schema = schema.to_string();
        let channel = self
            .writer
            .add_schema(name, "jsonschema", schema.as_bytes())
            .and_then(|schema| {
                self.writer
                    .add_channel(schema, topic, "json", &BTreeMap::new())
            });
        let channel = channel.map_err(|error| ExportError::write(&self.path)(&error))?;
        self.channels.insert(topic.to_owned(), channel);
        Ok(())
    }

    fn put(&mut self, topic: &str, time: u64, message: &Value) -> Result<(), ExportError> {
        let Some(channel_id) = self.channels.get(topic).copied() else {
            return Ok(());
        };
        self.sequence += 1;
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: time,
            publish_time: time,
        };
        let text = message.to_string();
        self.writer
            .write_to_known_channel(&header, text.as_bytes())
            .map_err(|error| ExportError::write(&self.path)(&error))
    }
}

fn nanoseconds(t_s: f64) -> u64 {
    (t_s * 1e9).round() as u64
}

impl Format for Mcap {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        let mut properties: BTreeMap<&'static str, Map<String, Value>> = BTreeMap::new();
        for quantity in &columns.quantities {
            let unit = columns
                .list
                .get(quantity.columns.start)
                .map_or("1", |column| column.unit);
            let about = format!("{} [{}]", quantity.about, quantity.elements.join(", "));
            let array = json!({"type": "array", "items": {"type": "number"}, "description": about, "unit": unit});
            properties
                .entry(quantity.group)
                .or_default()
                .insert(quantity.name.to_owned(), array);
        }
        for (group, properties) in properties {
            let schema = json!({"type": "object", "properties": properties});
            self.open(&format!("/{group}"), &format!("armplane.{group}"), &schema)?;
        }
        Ok(())
    }

    fn rows(&mut self, columns: &Columns, block: &Block) -> Result<(), ExportError> {
        for (tick, values) in block.rows() {
            let mut messages: BTreeMap<&'static str, Map<String, Value>> = BTreeMap::new();
            for quantity in &columns.quantities {
                let number = |place: usize| {
                    let value = values[place]?;
                    // The shortest text that reads back as the same number, in the column's own width.
                    let short = || (value as f32).to_string().parse().unwrap_or(value);
                    Some(json!(if columns.list[place].is_wide {
                        value
                    } else {
                        short()
                    }))
                };
                let present: Vec<Value> = quantity.columns.clone().filter_map(number).collect();
                if !present.is_empty() {
                    messages
                        .entry(quantity.group)
                        .or_default()
                        .insert(quantity.name.to_owned(), Value::Array(present));
                }
            }
            for (group, message) in messages {
                let at = nanoseconds(columns.t_s(tick));
                self.put(&format!("/{group}"), at, &Value::Object(message))?;
            }
        }
        Ok(())
    }

    fn solid(&mut self, solid: &Solid) -> Result<(), ExportError> {
        let Some(frame) =
            foxglove::frame(solid.of).filter(|frame| self.solids.insert(frame.clone()))
        else {
            return Ok(());
        };
        let (scene, extent) = foxglove::solid(&frame, solid, 0);
        self.extent = self.extent.max(extent);
        self.put("/arm", 0, &scene)
    }

    fn place(&mut self, place: &Place) -> Result<(), ExportError> {
        let Some(frame) = foxglove::frame(place.of) else {
            return Ok(());
        };
        let at = nanoseconds(place.t_s);
        self.put("/tf", at, &foxglove::transform(&frame, place, at))?;
        match frame.as_str() {
            "hand" => self.put("/pose/hand", at, &foxglove::pose_in_base(place, at)),
            "desired" => self.put("/pose/desired", at, &foxglove::pose_in_base(place, at)),
            frame if frame.starts_with("singularity_") => self.put(
                "/zeta",
                at,
                &foxglove::direction(frame, 0.4 * self.extent, at),
            ),
            _ => Ok(()),
        }
    }

    fn event(&mut self, event: Event) -> Result<(), ExportError> {
        if event.kind == "state" {
            return self.put(
                "/state",
                nanoseconds(event.t_s),
                &json!({"lane": event.subject, "state": event.text}),
            );
        }
        // Foxglove's levels: 1 debug, 2 info, 3 warning, 4 error, 5 fatal.
        let level = match event.subject.as_str() {
            "ERROR" => 4,
            "WARN" => 3,
            _ => 2,
        };
        let time = nanoseconds(event.t_s);
        let message = json!({"timestamp": foxglove::time(time), "level": level, "message": event.text, "name": "armplane", "file": "", "line": 0});
        self.put("/log", time, &message)
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        self.writer
            .finish()
            .map_err(|error| ExportError::write(&self.path)(&error))?;
        Ok(vec![self.path])
    }
}
