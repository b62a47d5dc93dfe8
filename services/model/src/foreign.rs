//! Elements and attributes of other programs in a URDF: `<drake:…>`, `drake:…="…"`, `xmlns:…`.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, Writer};

/// The URDF without elements and attributes that carry a namespace prefix, which no URDF element has.
///
/// An element goes with all that it holds. A text that is no XML stays as it is: the URDF's parser names the fault.
/// Errors: a xacro element, whose meaning is part of the robot.
pub(crate) fn without_foreign(text: &str) -> Result<String, String> {
    let mut reader = Reader::from_str(text);
    let mut writer = Writer::new(Vec::with_capacity(text.len()));
    loop {
        let event = match reader.read_event() {
            Ok(Event::Eof) => break,
            Ok(event) => event,
            Err(_) => return Ok(text.to_owned()),
        };
        let own = match &event {
            Event::Start(tag) if is_foreign(tag)? => reader.read_to_end(tag.name()).map(|_| None),
            Event::Empty(tag) if is_foreign(tag)? => Ok(None),
            Event::Start(tag) => own_attributes(tag).map(|tag| Some(Event::Start(tag))),
            Event::Empty(tag) => own_attributes(tag).map(|tag| Some(Event::Empty(tag))),
            _ => Ok(Some(event)),
        };
        let written = own.map(|own| own.is_none_or(|event| writer.write_event(event).is_ok()));
        if !written.is_ok_and(|is_written| is_written) {
            return Ok(text.to_owned());
        }
    }
    String::from_utf8(writer.into_inner()).or_else(|_| Ok(text.to_owned()))
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
        for odd in [
            "",
            "no xml",
            "<a",
            "<a b=\"",
            "<a:b>",
            "<é ü:x='1' y=\"2\">",
            "<!-- x",
            "a = b",
        ] {
            without_foreign(odd).unwrap();
        }
        assert!(without_foreign("<robot><xacro:arm/></robot>").is_err());
    }
}
