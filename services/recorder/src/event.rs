//! Words on a run, on the topic `/events` of its record, as `rcl_interfaces/msg/Log`: viewers of ROS list them.

/// How much an event matters; the numbers are those of ROS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// As it should be.
    #[default]
    Info = 20,
    /// Noticed.
    Warning = 30,
    /// Something broke.
    Error = 40,
}

/// The author of a sentence about a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The judge: it says the same again when it judges the record again.
    #[default]
    Judge,
    /// The fault table.
    Faults,
}

/// A sentence about a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// The tick.
    pub tick: u64,
    /// How much it matters.
    pub level: Level,
    /// Its author.
    pub source: Source,
    /// The sentence.
    pub text: String,
}

/// Topic, type and definition of events.
pub(crate) const EVENTS: [&str; 3] = [
    "/events",
    "rcl_interfaces/msg/Log",
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n\
     ================================================================================\n\
     MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
];

/// Topic, type and definition of the arm's description.
pub(crate) const ROBOT: [&str; 3] = ["/robot_description", "std_msgs/msg/String", "string data\n"];

/// CDR, little endian.
pub(crate) const CDR: [u8; 4] = [0, 1, 0, 0];

/// Appends a text to a message of CDR.
pub(crate) fn put_text(out: &mut Vec<u8>, text: &str) {
    out.resize(out.len().next_multiple_of(4), 0);
    out.extend((text.len() as u32 + 1).to_le_bytes());
    out.extend(text.as_bytes());
    out.push(0);
}

impl Event {
    /// The event as a message of CDR; `time_ns`: the time of its tick.
    pub(crate) fn write(&self, time_ns: u64, out: &mut Vec<u8>) {
        let name = match self.source {
            Source::Judge => "judge",
            Source::Faults => "faults",
        };
        out.extend(CDR);
        out.extend(((time_ns / 1_000_000_000) as u32).to_le_bytes());
        out.extend(((time_ns % 1_000_000_000) as u32).to_le_bytes());
        out.push(self.level as u8);
        for text in [name, &self.text, "", ""] {
            put_text(out, text);
        }
        out.resize(out.len().next_multiple_of(4), 0);
        out.extend(0_u32.to_le_bytes());
    }

    /// The event of a tick from its message; `None` of other bytes.
    pub(crate) fn read(tick: u64, message: &[u8]) -> Option<Self> {
        let level = match message.get(12)? {
            40.. => Level::Error,
            30.. => Level::Warning,
            _ => Level::Info,
        };
        let mut at = 16;
        let mut text = || {
            let length = u32::from_le_bytes(message.get(at..at + 4)?.try_into().ok()?) as usize;
            let text = message.get(at + 4..)?.get(..length.checked_sub(1)?)?;
            at = (at + 4 + length).next_multiple_of(4);
            std::str::from_utf8(text).ok().map(str::to_owned)
        };
        let source = match text()?.as_str() {
            "judge" => Source::Judge,
            _ => Source::Faults,
        };
        Some(Self {
            tick,
            level,
            source,
            text: text()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_comes_back_and_other_bytes_are_none() {
        for text in ["", "abc", "joint 3 reached its upper stop", "ζ turned"] {
            let event = Event {
                tick: 7,
                level: Level::Warning,
                source: Source::Judge,
                text: text.to_owned(),
            };
            let mut bytes = Vec::new();
            event.write(1_500_000_000, &mut bytes);
            assert_eq!(bytes.len() % 4, 0);
            assert_eq!(Event::read(7, &bytes), Some(event));
            for end in 0..16 + "judge".len() {
                assert_eq!(Event::read(7, &bytes[..end]), None, "{end}");
            }
        }
    }
}
