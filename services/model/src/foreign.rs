//! Elements and attributes of other programs in a URDF: `<drake:…>`, `drake:…="…"`, `xmlns:…`.

/// The URDF without elements and attributes that carry a namespace prefix, which no URDF element has.
///
/// An element goes with all that it holds. Comments and text stay. Errors: a xacro element, whose meaning is part of the robot.
pub(crate) fn without_foreign(text: &str) -> Result<String, String> {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        let (before, tag) = rest.split_at(start);
        out.push_str(before);
        let opaque = [
            ("<!--", "-->"),
            ("<![CDATA[", "]]>"),
            ("<?", "?>"),
            ("<!", ">"),
        ]
        .into_iter()
        .find(|(open, _)| tag.starts_with(open));
        let length = match opaque {
            Some((open, close)) => tag[open.len()..]
                .find(close)
                .map(|at| open.len() + at + close.len()),
            None => tag_length(tag),
        };
        // A tag that never ends: the parser names the fault.
        let Some(length) = length else {
            out.push_str(tag);
            return Ok(out);
        };
        let (this, after) = tag.split_at(length);
        rest = after;
        let name = name_of(this);
        if opaque.is_some() || !name.contains(':') {
            if opaque.is_some() {
                out.push_str(this)
            } else {
                push_without_prefixed_attributes(&mut out, this)
            }
            continue;
        }
        if name.starts_with("xacro:") {
            return Err(format!(
                "<{name}> is a macro: expand the file first, `xacro FILE > robot.urdf`"
            ));
        }
        if !this.ends_with("/>") && !this.starts_with("</") {
            rest = after_element(after, name);
        }
    }
    out.push_str(rest);
    Ok(out)
}

/// Length of a tag up to its `>`, quoted values skipped.
fn tag_length(tag: &str) -> Option<usize> {
    let mut quote = None;
    for (at, c) in tag.char_indices() {
        match (quote, c) {
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), c) if c == open => quote = None,
            (None, '>') => return Some(at + 1),
            _ => {}
        }
    }
    None
}

fn name_of(tag: &str) -> &str {
    let name = tag.trim_start_matches('<').trim_start_matches('/');
    name.split(|c: char| c.is_whitespace() || c == '>' || c == '/')
        .next()
        .unwrap_or_default()
}

/// The text after the end tag of an element `name` that is open; nothing where it never ends.
fn after_element<'a>(mut rest: &'a str, name: &str) -> &'a str {
    let mut depth = 1;
    while let Some(start) = rest.find('<') {
        let tag = &rest[start..];
        let Some(length) = tag_length(tag) else { break };
        let (this, after) = tag.split_at(length);
        rest = after;
        if name_of(this) == name && !this.ends_with("/>") {
            depth = if this.starts_with("</") {
                depth - 1
            } else {
                depth + 1
            };
        }
        if depth == 0 {
            return rest;
        }
    }
    ""
}

/// Adds a tag, without its attributes `prefix:name="value"`.
fn push_without_prefixed_attributes(out: &mut String, tag: &str) {
    let mut rest = tag;
    while let Some(equals) = rest.find('=') {
        let before = rest[..equals].trim_end();
        let begin = before.rfind(char::is_whitespace).map_or(0, |at| {
            at + before[at..].chars().next().map_or(1, char::len_utf8)
        });
        let value = rest[equals + 1..].trim_start();
        let skipped = rest.len() - value.len();
        let end = match value.chars().next() {
            Some(quote @ ('"' | '\'')) => value[1..].find(quote).map(|at| skipped + at + 2),
            _ => None,
        };
        let Some(end) = end else { break };
        out.push_str(if before[begin..].contains(':') {
            rest[..begin].trim_end()
        } else {
            &rest[..end]
        });
        rest = &rest[end..];
    }
    out.push_str(rest);
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
        assert!(
            without_foreign("<robot><xacro:arm/></robot>")
                .unwrap_err()
                .contains("expand")
        );
    }
}
