//! Contents of a log: its run, topics and layouts.

use std::fmt::Write as _;
use std::mem::offset_of;

use shared_types::job::Job;
use shared_types::layout::MessageLayout;
use shared_types::topics::{self, Each, Topic};
use shared_types::wire::{Field, Header};
use shared_types::{SingularityState, TargetContent};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::record::{CHANNEL, HEADER, MAGIC, SCHEMA, record, sized, text};

/// The run and the topics of a log. A topic's channel is its place in the list.
#[derive(Clone, Debug)]
pub struct Contents {
    run: u64,
    rate_hz: u32,
    format: u64,
    pub(crate) layouts: Vec<MessageLayout>,
}

impl Contents {
    /// Contents for the run with this identity, at a tick rate.
    pub fn new(run: u64, rate_hz: u32, layouts: Vec<MessageLayout>) -> Self {
        let format = layouts.iter().fold(0, |format, layout| {
            xxh3_64_with_seed(layout.topic.as_bytes(), format) ^ layout.hash
        });
        Self {
            run,
            rate_hz,
            format,
            layouts,
        }
    }

    /// Contents for a job's run: the topics that its graph writes, with the graph's own topics
    /// last.
    pub fn of(job: &Job) -> Self {
        let known = known()
            .into_iter()
            .filter(|layout| job.graph.writer(&layout.topic).is_some());
        Self::new(
            job.id,
            job.scenario.rate_hz,
            known.chain(job.graph.own_messages()).collect(),
        )
    }

    /// Contents with all topics that this program knows.
    pub fn of_all(run: u64, rate_hz: u32) -> Self {
        Self::new(run, rate_hz, known().into())
    }

    /// The layouts of the messages, by channel.
    pub fn layouts(&self) -> &[MessageLayout] {
        &self.layouts
    }

    /// The channel of a topic.
    pub fn channel(&self, topic: &str) -> Option<usize> {
        self.layouts.iter().position(|layout| layout.topic == topic)
    }

    /// Run and format, which every block must match.
    pub(crate) fn identity(&self) -> [u64; 2] {
        [self.format, self.run]
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

    /// The bytes of a file before its first block.
    pub(crate) fn head(&self) -> Vec<u8> {
        let mut head = MAGIC.to_vec();
        record(&mut head, HEADER, |out| {
            text(out, "ros2");
            text(out, "armplane");
        });
        self.channels(&mut head);
        head
    }

    /// Appends the schema and the channel of each topic.
    pub(crate) fn channels(&self, out: &mut Vec<u8>) {
        for (id, layout) in (1_u16..).zip(&self.layouts) {
            record(out, SCHEMA, |out| {
                out.extend(id.to_le_bytes());
                let [package, name] = ros_name(&layout.type_name);
                text(out, &format!("{package}/msg/{name}"));
                text(out, "ros2msg");
                text(out, &schema(layout));
            });
            record(out, CHANNEL, |out| {
                out.extend(id.to_le_bytes());
                out.extend(id.to_le_bytes());
                text(out, &format!("/{}", layout.topic));
                text(out, "cdr");
                sized(out, |_| ());
            });
        }
    }
}

fn known() -> [MessageLayout; topics::COUNT] {
    struct Known;
    impl Each for Known {
        type Output = MessageLayout;
        fn each<M: Topic>(&mut self) -> MessageLayout {
            MessageLayout::of::<M>()
        }
    }
    topics::each(&mut Known)
}

/// The tick of a message.
pub fn tick_of(message: &[u8]) -> u64 {
    crate::record::u64_at(message, offset_of!(Header, tick))
}

/// The fields and the size of a structure inside messages; `None` of a number.
pub(crate) fn structure(element: &str) -> Option<(&'static [Field], usize)> {
    match element {
        "Header" => Some((Header::LAYOUT, size_of::<Header>())),
        "SingularityState" => Some((SingularityState::LAYOUT, size_of::<SingularityState>())),
        "TargetContent" => Some((TargetContent::LAYOUT, size_of::<TargetContent>())),
        _ => None,
    }
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

/// The layout as a ROS 2 message definition, with those of its structures.
fn schema(layout: &MessageLayout) -> String {
    let [package, _] = ros_name(&layout.type_name);
    let (mut out, mut parts) = (String::new(), Vec::new());
    fields(&package, &layout.fields, &mut out, &mut parts);
    for part in parts {
        let _ = writeln!(out, "{:=<80}\nMSG: {package}/{part}", "");
        let inside = structure(part).map_or(&[][..], |(inside, _)| inside);
        fields(&package, inside, &mut out, &mut Vec::new());
    }
    out
}

fn fields<'a>(package: &str, layout: &'a [Field], out: &mut String, parts: &mut Vec<&'a str>) {
    for field in layout {
        let (kind, size) = match &*field.element {
            "f64" => ("float64".to_owned(), 8),
            "u64" => ("uint64".to_owned(), 8),
            "u32" => ("uint32".to_owned(), 4),
            "u8" => ("uint8".to_owned(), 1),
            part => {
                if !parts.contains(&part) {
                    parts.push(part);
                }
                let size = structure(part).map_or(field.size, |(_, size)| size);
                (format!("{package}/{part}"), size)
            }
        };
        let count = match field.type_name.starts_with('[') {
            true => format!("[{}]", field.size / size.max(1)),
            false => String::new(),
        };
        // ROS refuses capitals in the names of fields.
        let name = field.name.to_ascii_lowercase();
        let _ = writeln!(out, "{kind}{count} {name} # {}", field.about);
    }
}
