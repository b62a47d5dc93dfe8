//! The wire as a C header, with the program's side of an exchange page in C11 (or C++11).

use std::fmt::Write;

use shared_types::codes;

use super::{Structure, constants, snake, structures};

/// The words by which the two sides of a page tell each other that something is written.
const ATOMIC: [&str; 3] = ["requests", "answers", "program"];

/// The header: a program includes it and needs nothing else.
pub fn c() -> String {
    let mut text = String::from(include_str!("header_begin.h").trim_start());
    for (name, number, about) in constants() {
        let number = if number > u64::from(u32::MAX) {
            format!("{number:#x}")
        } else {
            number.to_string()
        };
        let _ = writeln!(
            text,
            "#define ARMPLANE_{name} UINT64_C({number}) /* {about} */"
        );
    }
    for (table, codes) in codes::TABLES {
        let _ = writeln!(text, "\n/* {table} */");
        for (name, code, meaning) in *codes {
            let _ = writeln!(text, "#define ARMPLANE_{name} {code}u{}", comment(meaning));
        }
    }
    for structure in structures() {
        print_structure(&mut text, &structure);
    }
    text.push_str(include_str!("header_end.h"));
    text
}

fn comment(about: &str) -> String {
    if about.is_empty() {
        String::new()
    } else {
        format!(" /* {} */", about.replace("*/", "* /"))
    }
}

fn print_structure(text: &mut String, structure: &Structure) {
    let name = format!("armplane_{}", snake(structure.name));
    let is_head = structure.name == "ExchangeHead";
    let _ = writeln!(text, "\n/* {} */\nstruct {name} {{", structure.about);
    for field in &structure.fields {
        let element = match &*field.element {
            "u8" => "uint8_t".to_owned(),
            "u32" if is_head && ATOMIC.contains(&&*field.name) => "ARMPLANE_ATOMIC_U32".to_owned(),
            "u32" => "uint32_t".to_owned(),
            "u64" => "uint64_t".to_owned(),
            "f64" => "double".to_owned(),
            nested => format!("struct armplane_{}", snake(nested)),
        };
        let array = field.count.map(|count| format!("[{count}]"));
        let (name, array) = (field.identifier(), array.unwrap_or_default());
        let _ = writeln!(
            text,
            "    {element} {name}{array};{}",
            comment(&field.remark())
        );
    }
    let _ = writeln!(
        text,
        "}};\nARMPLANE_ASSERT(sizeof(struct {name}) == {}, \"size of {name}\");",
        structure.bytes
    );
    for field in &structure.fields {
        let (field, offset) = (field.identifier(), field.offset);
        let _ = writeln!(
            text,
            "ARMPLANE_ASSERT(offsetof(struct {name}, {field}) == {offset}, \"{name}.{field}\");"
        );
    }
    if let Some((topic, type_name, hash)) = structure.message {
        let upper = topic.to_ascii_uppercase();
        let _ = writeln!(
            text,
            "#define ARMPLANE_{upper}_TYPE \"{type_name}\"\n#define ARMPLANE_{upper}_LAYOUT UINT64_C(0x{hash:016x})"
        );
    }
}
