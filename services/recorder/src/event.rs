//! Words on a run, on the topic `/events` of its record, as `rcl_interfaces/msg/Log`: viewers of ROS list them.

use shared_types::event::{Event, Level, Source};

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

/// An event as a message of CDR; `time_ns`: the time of its tick.
pub(crate) fn write_event(event: &Event, time_ns: u64, out: &mut Vec<u8>) {
    let name = match event.source {
        Source::Judge => "judge",
        Source::Faults => "faults",
    };
    out.extend(CDR);
    out.extend(((time_ns / 1_000_000_000) as u32).to_le_bytes());
    out.extend(((time_ns % 1_000_000_000) as u32).to_le_bytes());
    out.push(event.level as u8);
    for text in [name, &event.text, "", ""] {
        put_text(out, text);
    }
    out.resize(out.len().next_multiple_of(4), 0);
    out.extend(0_u32.to_le_bytes());
}

/// The event of a tick from its message; `None` of other bytes.
pub(crate) fn read_event(tick: u64, message: &[u8]) -> Option<Event> {
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
    Some(Event {
        tick,
        level,
        source,
        text: text()?,
    })
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
            write_event(&event, 1_500_000_000, &mut bytes);
            assert_eq!(bytes.len() % 4, 0);
            assert_eq!(read_event(7, &bytes), Some(event));
            for end in 0..16 + "judge".len() {
                assert_eq!(read_event(7, &bytes[..end]), None, "{end}");
            }
        }
    }
}
