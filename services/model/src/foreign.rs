//! The size of a URDF, looked at before it is parsed; and elements and attributes of other programs in it: `<drake:…>`, `drake:…="…"`, `xmlns:…`.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, Writer};

/// Longest text, and longest tag, whose attributes are compared with one another; bytes.
const LONGEST: usize = 16 << 20;
const LONGEST_TAG: usize = 4096;
/// Most elements, and most of them inside one another: the URDF's parser takes stack for each, and time that grows faster than their number.
const MOST_ELEMENTS: usize = 20_000;
const DEEPEST: usize = 64;

/// The URDF without elements and attributes that carry a namespace prefix, which no URDF element has.
///
/// An element goes with all that it holds. Errors: what is no XML, a text larger than any robot's, and a xacro element, whose meaning is part of the robot.
pub(crate) fn without_foreign(text: &str) -> Result<String, String> {
    let mut reader = Reader::from_str(text);
    let within = |size: usize, most: usize, what: &str| match size > most {
        true => Err(format!(
            "it has more than {most} {what}: no robot needs them"
        )),
        false => Ok(()),
    };
    within(text.len(), LONGEST, "bytes")?;
    let mut writer = Writer::new(Vec::with_capacity(text.len()));
    let (mut elements, mut depth) = (0, 0_usize);
    loop {
        let position = reader.buffer_position();
        let no_xml = |error: quick_xml::Error| format!("{error}, near byte {position}");
        let event = match reader.read_event().map_err(no_xml)? {
            Event::Eof => break,
            event => event,
        };
        if let Event::Start(tag) | Event::Empty(tag) = &event {
            elements += 1;
            within(elements, MOST_ELEMENTS, "elements")?;
            within(tag.len(), LONGEST_TAG, "bytes in one tag")?;
        }
        match &event {
            Event::Start(tag) if !tag.name().0.contains(&b':') => depth += 1,
            Event::End(_) => depth = depth.saturating_sub(1),
            _ => {}
        }
        within(depth, DEEPEST, "elements inside one another")?;
        let own = match &event {
            Event::Start(tag) if is_foreign(tag)? => reader.read_to_end(tag.name()).map(|_| None),
            Event::Empty(tag) if is_foreign(tag)? => Ok(None),
            Event::Start(tag) => own_attributes(tag).map(|tag| Some(Event::Start(tag))),
            Event::Empty(tag) => own_attributes(tag).map(|tag| Some(Event::Empty(tag))),
            _ => Ok(Some(event)),
        };
        if let Some(event) = own.map_err(no_xml)? {
            writer
                .write_event(event)
                .map_err(|error| error.to_string())?;
        }
    }
    String::from_utf8(writer.into_inner()).map_err(|error| error.to_string())
}

fn is_foreign(tag: &BytesStart<'_>) -> Result<bool, String> {
    let name = String::from_utf8_lossy(tag.name().0).into_owned();
    if name.starts_with("xacro:") {
        return Err(format!(
            "<{name}> is a macro: expand the file first, `xacro FILE > robot.urdf`"
        ));
    }
    Ok(name.contains(':'))
}

fn own_attributes<'a>(tag: &BytesStart<'a>) -> quick_xml::Result<BytesStart<'a>> {
    let all = tag.attributes().collect::<Result<Vec<_>, _>>()?;
    let own = all
        .iter()
        .filter(|attribute| attribute.key.prefix().is_none());
    let mut stripped = tag.to_owned();
    stripped.clear_attributes();
    Ok(stripped.with_attributes(own.cloned()))
}

#[cfg(test)]
mod tests {
    use super::without_foreign;

    #[test]
    fn prefixed_elements_and_attributes_are_left_out() {
        let text = r#"<?xml version="1.0"?><robot name="a" xmlns:drake="http://drake.mit.edu" drake:x='1'>
<!-- <drake:kept/> --><drake:ignore/><link name="b"><drake:p a="/>" n=">"><drake:p/><drake:p>x</drake:p></drake:p><mass value="1" drake:v = "2"/></link>
</robot>"#;
        let expected = r#"<?xml version="1.0"?><robot name="a">
<!-- <drake:kept/> --><link name="b"><mass value="1"/></link>
</robot>"#;
        assert_eq!(without_foreign(text).unwrap(), expected);
        for odd in ["<a", "<a b=\"", "<a:b>", "<!-- x"] {
            assert!(without_foreign(odd).is_err(), "{odd}");
        }
        assert!(without_foreign("<robot><xacro:arm/></robot>").is_err());
    }

    #[test]
    fn a_text_larger_than_any_robots_is_refused_before_it_is_parsed() {
        let nested = |depth: usize| "<a>".repeat(depth) + &"</a>".repeat(depth);
        let wide = |count: usize| format!("<a>{}</a>", "<b/>".repeat(count - 1));
        let long = |bytes: usize| format!("<{}/>", "a".repeat(bytes));
        for (text, is_fine) in [
            (nested(64), true),
            (nested(65), false),
            (nested(100_000), false),
            (wide(20_000), true),
            (wide(20_001), false),
            (long(4096), true),
            (long(4097), false),
        ] {
            assert_eq!(without_foreign(&text).is_ok(), is_fine, "{}", text.len());
        }
    }
}
