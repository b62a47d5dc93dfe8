//! The wire as a C header for C11 and C++11, with the functions of `libarmplane-process`.

use std::fmt::Write;

use shared_types::codes;

use super::{Structure, constants, snake, structures};

/// The header: a program includes it and needs nothing else.
pub(crate) fn c() -> String {
    let mut text = String::from(include_str!("header_begin.h").trim_start());
    text.push_str(armplane_process::HEADER);
    text.push_str("\n/* Numbers. */\n");
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
    let _ = writeln!(text, "\n/* {} */\nstruct {name} {{", structure.about);
    for field in &structure.fields {
        let element = match &*field.element {
            "u8" => "uint8_t".to_owned(),
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
        let process = "struct armplane_process *process";
        let _ = writeln!(
            text,
            "/* The message of the tick in hand, NULL where none has come. */\n\
             static inline const struct {name} *armplane_in_{topic}({process}) {{\n    \
             return (const struct {name} *)armplane_process_input(process, \"{topic}\", ARMPLANE_{upper}_LAYOUT);\n}}\n\
             /* The message to fill, once found: it stays where it is. */\n\
             static inline struct {name} *armplane_out_{topic}({process}) {{\n    \
             return (struct {name} *)armplane_process_output(process, \"{topic}\", ARMPLANE_{upper}_LAYOUT);\n}}"
        );
    }
}
