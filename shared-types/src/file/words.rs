//! Translates complaints of serde and the TOML reader into the terms of the file: the value found,
//! and the values allowed.

/// Longer than any key, bytes.
const LONGEST_WORD: usize = 200;

/// The whole numbers of the program's types.
const WHOLE: [(&str, &str); 8] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    // TOML's whole numbers are those of i64.
    ("u64", "a whole number from 0 to 9223372036854775807"),
    ("usize", "a whole number from 0 to 9223372036854775807"),
    ("i32", "a whole number from -2147483648 to 2147483647"),
    (
        "i64",
        "a whole number from -9223372036854775808 to 9223372036854775807",
    ),
    (
        "any valid TOML value",
        "a whole number from -9223372036854775808 to 9223372036854775807",
    ),
];

const OF_64_BITS: &str =
    "it must be a whole number from -9223372036854775808 to 9223372036854775807";

/// Parts of the TOML reader's complaints, each with message and remedy.
const SAYINGS: [(&str, &str, &str); 6] = [
    (
        "value was too large",
        "the whole number is too large",
        OF_64_BITS,
    ),
    (
        "number too large",
        "the whole number is too large",
        OF_64_BITS,
    ),
    (
        "key with no value",
        "this line is no TOML",
        "each line of TOML is key = value, [table], or # comment",
    ),
    (
        "duplicate key",
        "the key stands here twice",
        "leave one out; a list of tables has two brackets, as in [[segment]]",
    ),
    (
        "unexpected key or value",
        "something stands behind the value",
        "one key and one value a line; a number has a point, as in 2.5",
    ),
    (
        "cannot recurse further",
        "lists and tables are nested too deeply",
        // The reader's own limit.
        "at most 80 are within each other",
    ),
];

/// Message and remedy.
pub(super) fn explain(message: &str) -> (String, String) {
    let message = message.trim();
    if let Some(field) = message.strip_prefix("missing field ") {
        return (
            format!("{field} is missing"),
            format!("add {} = …", field.trim_matches('`')),
        );
    }
    let known = SAYINGS.iter().find(|(part, ..)| message.contains(part));
    if let Some((_, message, remedy)) = known {
        return ((*message).to_owned(), (*remedy).to_owned());
    }
    let Some((wrong, expected)) = message.split_once(", expected ") else {
        return (message.to_owned(), String::new());
    };
    if let Some((_, found)) = wrong
        .split_once("invalid type: ")
        .or_else(|| wrong.split_once("invalid value: "))
    {
        let remedy = match (found, expected) {
            ("map", "a sequence") => {
                "a list of tables has two brackets, as in [[segment]]".to_owned()
            }
            _ => format!("it must be {}", allowed(expected)),
        };
        return (format!("{} does not fit here", in_words(found)), remedy);
    }
    if let Some(length) = wrong.strip_prefix("invalid length ") {
        return (
            format!("a list of {length} does not fit here"),
            format!("it must be {}", allowed(expected)),
        );
    }
    // The words of Rust, as those of a file.
    let wrong = wrong
        .replace("unknown variant", "unknown value")
        .replace("unknown field", "unknown key");
    let known = || expected.split('`').skip(1).step_by(2);
    let written = wrong.split('`').nth(1).unwrap_or_default();
    let near = Some(written).filter(|written| !written.is_empty());
    let place = SECTIONS.iter().find(|(section, keys)| {
        known().any(|one| one == *section) && keys.split(' ').any(|key| key == written)
    });
    if let Some((section, _)) = place {
        return (wrong, format!("put it under [{section}]"));
    }
    let remedy = match near.and_then(|written| nearest(written, known())) {
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("expected {expected}"),
    };
    (wrong, remedy)
}

/// Sections of a scenario, with keys that people write outside of them.
const SECTIONS: [(&str, &str); 4] = [
    ("start", "q q_deg posture"),
    ("goal", "position_mm orientation_deg orthogonal_mm"),
    ("control", "strategy k_p k_v"),
    ("plant", "friction payload mass_factor"),
];

/// Letters by which the nearest name may differ.
const MOST_APART: usize = 3;

/// Words that people write, and the name that each stands for here.
const OTHER_WORDS: [(&str, &str); 8] = [
    (
        "hand tcp ee eef flange gripper tip end-effector end_effector",
        "tool",
    ),
    ("tip tool link tcp ee eef", "frame"),
    ("osc", "operational-space"),
    ("position pose goal target", "to_m"),
    ("simulate sim start exec launch", "run"),
    ("show open viewer", "view"),
    ("create init", "new"),
    ("robots scenarios ls", "list"),
];

/// The known name that a written one most likely means: by its initials, by a part of it, by a few letters, or by another word for it.
pub fn nearest<'a>(written: &str, known: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let written = written.to_lowercase();
    if written.is_empty() {
        return None;
    }
    let is_one = |words: &str| words.split(' ').any(|word| word == written);
    let others = OTHER_WORDS.iter().filter(|(words, _)| is_one(words));
    let mut words = std::iter::once(&*written).chain(others.map(|(_, word)| *word));
    words.find_map(|word| {
        let most = (1 + word.len() / 4).min(MOST_APART);
        let near = known
            .clone()
            .map(|name| (apart(word, &name.to_lowercase()), name));
        let (distance, name) = near.min_by_key(|(distance, _)| *distance)?;
        (distance <= most).then_some(name)
    })
}

/// How far a written word is from a known name: letters, 0 for its initials and its beginning, 1 for another part of it.
fn apart(written: &str, known: &str) -> usize {
    let mut parts = known.split(['-', '_']);
    let initials: String = parts
        .clone()
        .filter_map(|part| part.chars().next())
        .collect();
    if written.len() > 1 && (initials == written || known.starts_with(written)) {
        return 0;
    }
    if written.len() > 1 && parts.any(|part| part == written)
        || known.len() > 2 && written.starts_with(known)
    {
        return 1;
    }
    // People leave out the end of a name: `puma`, and `pumma` too.
    let beginning = |length| &known[..known.floor_char_boundary(length)];
    let lengths = [written.len(), written.len().saturating_sub(1)];
    let starts = lengths.map(|length| 1 + distance(written, beginning(length)));
    distance(written, known).min(starts[0]).min(starts[1])
}

/// Letters by which a written word differs from a known one, two that are swapped counted once. Of a long word it takes the beginning: to compare megabytes
/// takes seconds.
fn distance(written: &str, known: &str) -> usize {
    let beginning = &written[..written.floor_char_boundary(LONGEST_WORD)];
    strsim::osa_distance(beginning, known)
}

/// A value of the file.
fn in_words(found: &str) -> String {
    const KINDS: [(&str, &str); 6] = [
        ("integer ", "the whole number "),
        ("floating point ", "the number "),
        ("string ", "the text "),
        ("boolean ", "the value "),
        ("sequence", "a list"),
        ("map", "a table"),
    ];
    // Of a number beyond 64 bits serde names the type that it was read as.
    let found = found
        .trim_end_matches(" as i128")
        .trim_end_matches(" as u128");
    let known = KINDS
        .iter()
        .find_map(|(kind, words)| Some(format!("{words}{}", found.strip_prefix(kind)?)));
    known.unwrap_or_else(|| found.to_owned())
}

/// A type of the program, as values that a file may have.
fn allowed(expected: &str) -> String {
    if let Some((_, words)) = WHOLE.iter().find(|(name, _)| *name == expected) {
        return (*words).to_owned();
    }
    if let Some(length) = expected
        .strip_prefix("an array of length ")
        .or_else(|| expected.strip_prefix("an array of size "))
    {
        return format!("a list of {length} in square brackets");
    }
    match expected {
        "f64" | "f32" => "a number",
        "bool" | "a boolean" => "true or false",
        "a string" | "string" => "text in quotes",
        "a sequence" => "a list in square brackets",
        "a map" => "a table",
        // A Rust type of ours: in a file it is a table.
        other if other.starts_with("struct ") => "a table",
        other => other,
    }
    .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_word_is_found_and_a_far_one_is_not() {
        const LAWS: [&str; 3] = ["blended", "damped-least-squares", "operational-space"];
        let cases: [(&str, &[&str], Option<&str>); 11] = [
            ("dls", &LAWS, Some("damped-least-squares")),
            ("osc", &LAWS, Some("operational-space")),
            ("hand", &["base", "world", "start", "tool"], Some("tool")),
            (
                "hand",
                &["base_link", "wrist_3_link", "tool0"],
                Some("tool0"),
            ),
            ("hand", &["base_link", "wrist_3_link"], None),
            ("output", &["out", "set"], Some("out")),
            ("rnu", &["new", "run"], Some("run")),
            ("Panda", &["panda", "puma560"], Some("panda")),
            ("pumma", &["panda", "puma560"], Some("puma560")),
            ("kp", &["k_p", "k_v"], Some("k_p")),
            ("center_m", &["centre_m", "about"], Some("centre_m")),
        ];
        for (written, known, meant) in cases {
            assert_eq!(nearest(written, known.iter().copied()), meant, "{written}");
        }
    }

    #[test]
    fn types_of_the_program_are_told_as_values_of_a_file() {
        let cases = [
            (
                "invalid type: integer `1`, expected struct Fault",
                "the whole number `1` does not fit here",
                "it must be a table",
            ),
            (
                "invalid type: boolean `true`, expected a string",
                "the value `true` does not fit here",
                "it must be text in quotes",
            ),
            (
                "invalid value: integer `1000000000000`, expected u32",
                "the whole number `1000000000000` does not fit here",
                "it must be a whole number from 0 to 4294967295",
            ),
            (
                "invalid value: integer `99999999999999999999` as i128, expected any valid TOML value",
                "the whole number `99999999999999999999` does not fit here",
                "it must be a whole number from -9223372036854775808 to 9223372036854775807",
            ),
            (
                "invalid length 2, expected an array of length 3",
                "a list of 2 does not fit here",
                "it must be a list of 3 in square brackets",
            ),
            (
                "invalid type: map, expected a sequence",
                "a table does not fit here",
                "a list of tables has two brackets, as in [[segment]]",
            ),
            (
                "unknown variant `quick`, expected `lockstep` or `realtime`",
                "unknown value `quick`",
                "expected `lockstep` or `realtime`",
            ),
            (
                "key with no value, expected `=`",
                "this line is no TOML",
                "each line of TOML is key = value, [table], or # comment",
            ),
            (
                "duplicate key",
                "the key stands here twice",
                "leave one out; a list of tables has two brackets, as in [[segment]]",
            ),
            (
                "u64 value was too large",
                "the whole number is too large",
                "it must be a whole number from -9223372036854775808 to 9223372036854775807",
            ),
            (
                "cannot recurse further; max recursion depth met",
                "lists and tables are nested too deeply",
                "at most 80 are within each other",
            ),
        ];
        for (message, found, allowed) in cases {
            assert_eq!(
                explain(message),
                (found.to_owned(), allowed.to_owned()),
                "{message}"
            );
        }
    }
}
