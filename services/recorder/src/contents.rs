//! The contents of a record: its run, a channel for each topic, and the files that describe the run.

use std::fmt::Write as _;
use std::mem::offset_of;

use mcap::Compression;
use shared_types::job::{JOB, Job, Mode};
use shared_types::layout::{MessageLayout, structure};
use shared_types::topics::OfTopic;
use shared_types::wire::{Field, Header};

/// A file that is attached to the record.
#[derive(Clone, Debug)]
pub(crate) struct Attached {
    pub(crate) name: &'static str,
    pub(crate) media_type: &'static str,
    pub(crate) text: String,
}

/// The run and the topics of a record. A topic's channel is its place in the list.
#[derive(Clone, Debug)]
pub struct Contents {
    run: u64,
    rate_hz: u32,
    layouts: Vec<MessageLayout>,
    pub(crate) files: Vec<Attached>,
    /// The arm, for the topic from which viewers of ROS draw it; may be empty.
    pub(crate) urdf: String,
    pub(crate) compression: Option<Compression>,
}

impl Contents {
    /// Contents for the run with this identity, at a tick rate.
    pub fn new(run: u64, rate_hz: u32, layouts: Vec<MessageLayout>) -> Self {
        Self {
            run,
            rate_hz,
            layouts,
            files: Vec::new(),
            urdf: String::new(),
            compression: None,
        }
    }

    /// Contents for a job's run: the topics that its graph writes, with the graph's own topics last, and job, scenario and arm as files. In real time
    /// chunks are compressed: there a tick leaves the time for it.
    pub fn of(job: &Job) -> Self {
        let known = MessageLayout::all()
            .into_iter()
            .filter(|layout| job.graph.writer(&layout.topic).is_some());
        let attached = |name, media_type, text: &str| Attached {
            name,
            media_type,
            text: text.to_owned(),
        };
        // Neither fails for a job that was itself read from a file.
        let job_text = serde_json::to_string_pretty(job).unwrap_or_default();
        let scenario = toml::to_string(&job.scenario).unwrap_or_default();
        Self {
            files: vec![
                attached(JOB, "application/json", &job_text),
                attached("scenario.toml", "application/toml", &scenario),
                attached("robot.urdf", "application/xml", &job.robot.urdf),
                attached("arm.toml", "application/toml", &job.robot.description),
            ],
            urdf: job.robot.urdf.clone(),
            compression: (job.mode == Mode::Realtime).then_some(Compression::Lz4),
            ..Self::new(
                job.id,
                job.scenario.rate_hz,
                known.chain(job.graph.own_messages()).collect(),
            )
        }
    }

    /// Contents with the topics that this program knows and that `is_in` chooses.
    pub fn of_topics(run: u64, rate_hz: u32, is_in: impl Fn(&str) -> bool) -> Self {
        let known = MessageLayout::all()
            .into_iter()
            .filter(|layout| is_in(&layout.topic));
        Self::new(run, rate_hz, known.collect())
    }

    /// The channels of events, of the arm and of cuts, behind those of topics.
    pub(crate) fn extra(&self) -> [usize; 3] {
        [0, 1, 2].map(|place| self.layouts.len() + place)
    }

    /// The layouts of the messages, by channel.
    pub fn layouts(&self) -> &[MessageLayout] {
        &self.layouts
    }

    /// The channel of a topic.
    pub fn channel(&self, topic: &str) -> Option<usize> {
        self.layouts.iter().position(|layout| layout.topic == topic)
    }

    /// The run, as every channel of its record names it.
    pub(crate) fn run(&self) -> String {
        format!("{:016x}", self.run)
    }

    /// Time of a tick, from the run's begin; ns.
    pub(crate) fn time_ns(&self, tick: u64) -> u64 {
        let rate_hz = u128::from(self.rate_hz.max(1));
        u64::try_from(u128::from(tick) * 1_000_000_000 / rate_hz).unwrap_or(u64::MAX)
    }

    /// The tick of such a time.
    pub(crate) fn tick_at(&self, time_ns: u64) -> u64 {
        let ticks = u128::from(time_ns) * u128::from(self.rate_hz);
        u64::try_from((ticks + 500_000_000) / 1_000_000_000).unwrap_or(u64::MAX)
    }
}

/// The tick of a message; 0 of one without a header.
pub fn tick_of(message: &[u8]) -> u64 {
    let at = offset_of!(Header, tick);
    let tick = message.get(at..at + size_of::<u64>());
    tick.and_then(|tick| tick.try_into().ok())
        .map_or(0, u64::from_le_bytes)
}

/// `armplane.Energy.v1` as ROS names it: package and message.
fn ros_name(type_name: &str) -> [String; 2] {
    let is_plain = |c: &char| c.is_ascii_alphanumeric();
    let mut parts = type_name
        .split('.')
        .map(|part| part.chars().filter(is_plain).collect::<String>());
    let package = parts.next().unwrap_or_default().to_ascii_lowercase();
    let mut name = parts.next().unwrap_or_else(|| package.clone());
    if let Some(first) = name.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    [package, name]
}

/// The name of a layout as a ROS 2 message, and its definition with those of its structures.
pub(crate) fn schema(layout: &MessageLayout) -> (String, String) {
    let [package, name] = ros_name(&layout.type_name);
    let mut out = String::new();
    let mut parts = Vec::new();
    fields(&package, &layout.fields, &mut out, &mut parts);
    for part in parts {
        let _ = writeln!(out, "{:=<80}\nMSG: {package}/{part}", "");
        let inside = structure(part).map_or(&[][..], |(inside, _)| inside);
        fields(&package, inside, &mut out, &mut Vec::new());
    }
    (format!("{package}/msg/{name}"), out)
}

fn fields<'a>(package: &str, layout: &'a [Field], out: &mut String, parts: &mut Vec<&'a str>) {
    for field in layout {
        let kind = match &*field.element {
            "f64" => "float64".to_owned(),
            "u64" => "uint64".to_owned(),
            "u32" => "uint32".to_owned(),
            "u8" => "uint8".to_owned(),
            part => {
                if !parts.contains(&part) {
                    parts.push(part);
                }
                format!("{package}/{part}")
            }
        };
        let count = field.count().map_or(String::new(), |n| format!("[{n}]"));
        // ROS refuses capitals in the names of fields.
        let name = field.name.to_ascii_lowercase();
        let _ = writeln!(out, "{kind}{count} {name} # {}", field.about);
    }
}
