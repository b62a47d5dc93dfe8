//! Translates complaints of serde and the TOML reader into the terms of the file: the value found,
//! and the values allowed.

/// Lists and tables within each other that the TOML reader takes at most.
const MOST_NESTED: usize = 80;

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

/// Message and remedy.
pub(super) fn explain(message: &str) -> (String, String) {
    let message = message.trim();
    if let Some(field) = message.strip_prefix("missing field ") {
        return (
            format!("{field} is missing"),
            format!("add {} = …", field.trim_matches('`')),
        );
    }
    if message.contains("value was too large") || message.contains("number too large") {
        return (
            "the whole number is too large".to_owned(),
            format!("it must be {}", allowed("any valid TOML value")),
        );
    }
    if message.starts_with("cannot recurse further") {
        return (
            "lists and tables are nested too deeply".to_owned(),
            format!("at most {MOST_NESTED} are within each other"),
        );
    }
    let Some((wrong, expected)) = message.split_once(", expected ") else {
        return (message.to_owned(), String::new());
    };
    if let Some((_, found)) = wrong
        .split_once("invalid type: ")
        .or_else(|| wrong.split_once("invalid value: "))
    {
        return (
            format!("{} does not fit here", in_words(found)),
            format!("it must be {}", allowed(expected)),
        );
    }
    if let Some(length) = wrong.strip_prefix("invalid length ") {
        return (
            format!("a list of {length} does not fit here"),
            format!("it must be {}", allowed(expected)),
        );
    }
    let known: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    let written = wrong.split('`').nth(1).unwrap_or_default();
    match known
        .iter()
        .map(|name| (distance(written, name), name))
        .min()
    {
        Some((distance, name)) if distance <= 2 + name.len() / 4 => {
            (wrong.to_owned(), format!("did you mean `{name}`?"))
        }
        _ => (wrong.to_owned(), format!("expected {expected}")),
    }
}

/// Letters by which a written word differs from a known one. Of a long word it takes the beginning: to compare megabytes takes seconds.
#[must_use]
pub fn distance(written: &str, known: &str) -> usize {
    let beginning = &written[..written.floor_char_boundary(LONGEST_WORD)];
    strsim::levenshtein(beginning, known)
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
        return format!("a list of {length}");
    }
    match expected {
        "f64" | "f32" => "a number",
        "bool" | "a boolean" => "true or false",
        "a string" | "string" => "text in quotes",
        "a sequence" => "a list",
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
                "it must be a list of 3",
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
