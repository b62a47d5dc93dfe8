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

/// Appends bytes behind their number to a message of CDR.
pub(crate) fn put_bytes(out: &mut Vec<u8>, bytes: &[u8]) {
    out.resize(out.len().next_multiple_of(4), 0);
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
}

/// Appends a text to a message of CDR.
pub(crate) fn put_text(out: &mut Vec<u8>, text: &str) {
    put_bytes(out, &[text.as_bytes(), &[0]].concat());
}

/// The next number of a message of CDR; `None` where it ends.
pub(crate) fn number(message: &[u8], at: &mut usize) -> Option<usize> {
    let from = at.next_multiple_of(4);
    *at = from + 4;
    let bytes = message.get(from..)?.first_chunk()?;
    Some(u32::from_le_bytes(*bytes) as usize)
}

/// The next bytes behind their number.
pub(crate) fn bytes<'a>(message: &'a [u8], at: &mut usize) -> Option<&'a [u8]> {
    let length = number(message, at)?;
    let from = *at;
    *at = from.checked_add(length)?;
    message.get(from..*at)
}

/// The next text.
pub(crate) fn text(message: &[u8], at: &mut usize) -> Option<String> {
    let text = bytes(message, at)?.strip_suffix(&[0])?;
    std::str::from_utf8(text).ok().map(str::to_owned)
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
    let source = match &*text(message, &mut at)? {
        "judge" => Source::Judge,
        _ => Source::Faults,
    };
    Some(Event {
        tick,
        level,
        source,
        text: text(message, &mut at)?,
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
