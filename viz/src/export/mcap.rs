//! `run.mcap`: one JSON channel per group of quantities (`/joint`, `/singularity`, …), `/state`, and for Foxglove's panels `/log`, `/tf` (where each
//! link, the hand and the desired hand are), `/arm` and `/zeta` (scenes: the arm's figure, singular directions), `/pose/hand` and `/pose/desired`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::read::Solid;
use ::mcap::records::MessageHeader;
use ::mcap::{McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::format::{Block, Columns, Event, ExportError, Format, Place};
use super::foxglove;

pub(super) struct Mcap {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Channel of each group of signals.
    groups: BTreeMap<&'static str, u16>,
    fixed: Fixed,
    sequence: u32,
    /// Solids that are written: every part of a recording has them.
    solids: BTreeSet<String>,
    /// The largest extent of a solid; m.
    extent: f32,
}

/// The channels that every file has.
#[derive(Clone, Copy)]
struct Fixed {
    log: u16,
    state: u16,
    tf: u16,
    arm: u16,
    zeta: u16,
    hand: u16,
    desired: u16,
}

impl Mcap {
    pub(super) fn create(out: &Path) -> Result<Self, ExportError> {
        let path = out.join("run.mcap");
        let failed = ExportError::write(&path);
        let file = BufWriter::new(File::create(&path).map_err(|error| failed(&error))?);
        let open = || -> Result<(Writer<BufWriter<File>>, Fixed), McapError> {
            let library = format!("armplane {}", env!("CARGO_PKG_VERSION"));
            let mut writer = WriteOptions::new()
                .compression(None)
                .library(library)
                .create(file)?;
            let text = json!({"type": "string"});
            let state = json!({"type": "object", "properties": {"lane": text, "state": text}});
            let mut schema = |name: &str, schema: &Value| -> Result<u16, McapError> {
                writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())
            };
            let (log, state) = (
                schema("foxglove.Log", &foxglove::log_schema())?,
                schema("armplane.State", &state)?,
            );
            let transform = schema("foxglove.FrameTransform", &foxglove::transform_schema())?;
            let scene = schema("foxglove.SceneUpdate", &foxglove::scene_schema())?;
            let pose = schema("foxglove.PoseInFrame", &foxglove::pose_schema())?;
            let mut channel = |schema: u16, topic: &str| {
                writer.add_channel(schema, topic, "json", &BTreeMap::new())
            };
            let fixed = Fixed {
                log: channel(log, "/log")?,
                state: channel(state, "/state")?,
                tf: channel(transform, "/tf")?,
                arm: channel(scene, "/arm")?,
                zeta: channel(scene, "/zeta")?,
                hand: channel(pose, "/pose/hand")?,
                desired: channel(pose, "/pose/desired")?,
            };
            Ok((writer, fixed))
        };
        let (writer, fixed) = open().map_err(|error| failed(&error))?;
        Ok(Self {
            path,
            writer,
            groups: BTreeMap::new(),
            fixed,
            sequence: 0,
            solids: BTreeSet::new(),
            extent: 0.0,
        })
    }

    fn put(&mut self, channel: u16, time: u64, message: &Value) -> Result<(), ExportError> {
        self.sequence += 1;
        let header = MessageHeader {
            channel_id: channel,
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

fn channel(
    writer: &mut Writer<BufWriter<File>>,
    topic: &str,
    name: &str,
    schema: &Value,
) -> Result<u16, McapError> {
    let schema = writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
    writer.add_channel(schema, topic, "json", &BTreeMap::new())
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
            let id = channel(
                &mut self.writer,
                &format!("/{group}"),
                &format!("armplane.{group}"),
                &schema,
            );
            self.groups.insert(
                group,
                id.map_err(|error| ExportError::write(&self.path)(&error))?,
            );
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
                if let Some(channel) = self.groups.get(group).copied() {
                    self.put(
                        channel,
                        nanoseconds(columns.t_s(tick)),
                        &Value::Object(message),
                    )?;
                }
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
        self.put(self.fixed.arm, 0, &scene)
    }

    fn place(&mut self, place: &Place) -> Result<(), ExportError> {
        let Some(frame) = foxglove::frame(place.of) else {
            return Ok(());
        };
        let at = nanoseconds(place.t_s);
        self.put(self.fixed.tf, at, &foxglove::transform(&frame, place, at))?;
        match frame.as_str() {
            "hand" => self.put(self.fixed.hand, at, &foxglove::pose_in_base(place, at)),
            "desired" => self.put(self.fixed.desired, at, &foxglove::pose_in_base(place, at)),
            frame if frame.starts_with("singularity_") => self.put(
                self.fixed.zeta,
                at,
                &foxglove::direction(frame, 0.4 * self.extent, at),
            ),
            _ => Ok(()),
        }
    }

    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        if event.kind == "state" {
            return self.put(
                self.fixed.state,
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
        self.put(self.fixed.log, time, &message)
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        self.writer
            .finish()
            .map_err(|error| ExportError::write(&self.path)(&error))?;
        Ok(vec![self.path])
    }
}
