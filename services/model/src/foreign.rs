//! The size of a URDF, looked at before it is parsed; elements and attributes of other programs in it: `<drake:…>`, `drake:…="…"`, `xmlns:…`; and what it
//! lacks without which the parser takes nothing of it.

use std::collections::BTreeSet;

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, Writer};

/// Longest text, and longest tag, whose attributes are compared with one another; bytes.
const LONGEST: usize = 16 << 20;
const LONGEST_TAG: usize = 4096;
/// Most elements, and most of them inside one another: the URDF's parser takes stack for each, and time that grows faster than their number.
const MOST_ELEMENTS: usize = 20_000;
const DEEPEST: usize = 64;

/// A URDF as its parser takes it.
pub(crate) struct Own {
    pub(crate) text: String,
    /// The links whose `<inertial>` lacks mass or inertia; it is left out.
    pub(crate) incomplete: BTreeSet<String>,
}

/// Attributes of `<inertia>`.
const INERTIA: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// The URDF without elements and attributes that carry a namespace prefix, which no URDF element has, and without an incomplete `<inertial>`; a `<limit>`
/// without a speed has the speed 0, which is none.
///
/// An element goes with all that it holds. Errors: what is no XML, a text larger than any robot's, and a xacro element, whose meaning is part of the robot.
pub(crate) fn without_foreign(text: &str) -> Result<Own, String> {
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
    let mut inertial = Inertial::default();
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
            inertial.see(tag, writer.get_ref().len());
        }
        match &event {
            Event::Start(tag) if !tag.name().0.contains(&b':') => depth += 1,
            Event::End(_) => depth = depth.saturating_sub(1),
            _ => {}
        }
        let ends = match &event {
            Event::End(tag) => tag.name().0 == b"inertial",
            Event::Empty(tag) => tag.name().0 == b"inertial",
            _ => false,
        };
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
        if ends && inertial.has != [true; 2] {
            writer.get_mut().truncate(inertial.begins);
            inertial.incomplete.insert(inertial.link.clone());
        }
    }
    let text = String::from_utf8(writer.into_inner()).map_err(|error| error.to_string())?;
    Ok(Own {
        text,
        incomplete: inertial.incomplete,
    })
}

/// The last `<inertial>`.
#[derive(Default)]
struct Inertial {
    /// The link around it.
    link: String,
    /// Bytes of the text before it.
    begins: usize,
    /// Whether it has mass, and inertia.
    has: [bool; 2],
    /// The links whose own lacks one of them.
    incomplete: BTreeSet<String>,
}

impl Inertial {
    /// Takes in the next element, which has so many bytes before it.
    fn see(&mut self, tag: &BytesStart<'_>, before: usize) {
        let given = |name: &str| tag.try_get_attribute(name).ok().flatten();
        match tag.name().0 {
            b"link" => {
                let name = given("name").map(|name| name.value.into_owned());
                self.link = String::from_utf8_lossy(&name.unwrap_or_default()).into_owned();
            }
            b"inertial" => (self.begins, self.has) = (before, [false; 2]),
            b"mass" => self.has[0] |= given("value").is_some(),
            b"inertia" => self.has[1] |= INERTIA.iter().all(|name| given(name).is_some()),
            _ => {}
        }
    }
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
    let stripped = stripped.with_attributes(own.cloned());
    let lacks_speed = tag.name().0 == b"limit" && tag.try_get_attribute("velocity")?.is_none();
    Ok(match lacks_speed {
        true => stripped.with_attributes([("velocity", "0")]),
        false => stripped,
    })
}

#[cfg(test)]
mod tests {
    use super::without_foreign;

    #[test]
    fn prefixed_elements_and_attributes_are_left_out() {
        let text = r#"<?xml version="1.0"?><robot name="a" xmlns:drake="http://drake.mit.edu" drake:x='1'>
<!-- <drake:kept/> --><drake:ignore/><link name="b"><drake:p a="/>" n=">"><drake:p/><drake:p>x</drake:p></drake:p><mass value="1" drake:v = "2"/></link>
<link name="c"><inertial><mass value="1"/></inertial></link><limit effort="1"/>
</robot>"#;
        let expected = r#"<?xml version="1.0"?><robot name="a">
<!-- <drake:kept/> --><link name="b"><mass value="1"/></link>
<link name="c"></link><limit effort="1" velocity="0"/>
</robot>"#;
        assert_eq!(without_foreign(text).unwrap().text, expected);
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
