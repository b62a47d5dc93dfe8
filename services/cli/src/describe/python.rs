//! The wire as a Python module: `ctypes` structures, which also make `numpy` views without a copy.

use std::fmt::Write;

use shared_types::codes;

use super::{Structure, constants, structures};

/// The module `armplane/wire.py` of the Python package.
pub(crate) fn python() -> String {
    let mut text = String::from(
        "\"\"\"The wire of armplane: messages and codes. Written by `armplane generate wire --lang python`; do not edit.\"\"\"\n\n\
         import ctypes\n\n",
    );
    let _ = writeln!(text, "ARMPLANE_VERSION = \"{}\"", env!("CARGO_PKG_VERSION"));
    for (name, number, about) in constants() {
        let _ = writeln!(text, "{name} = {number}  # {about}");
    }
    for (table, codes) in codes::TABLES {
        text.push('\n');
        for (name, code, _) in *codes {
            let _ = writeln!(text, "{name} = {code}");
        }
        let entries: Vec<String> = codes
            .iter()
            .map(|(name, _, meaning)| format!("{name}: {meaning:?}"))
            .collect();
        let _ = writeln!(text, "{table} = {{{}}}", entries.join(", "));
    }
    let structures = structures();
    for structure in &structures {
        print_structure(&mut text, structure);
    }
    text.push_str("\n\n# Topic: structure, versioned type name, hash of the layout.\nTOPICS = {\n");
    for Structure { name, message, .. } in structures {
        if let Some((topic, type_name, hash)) = message {
            let _ = writeln!(
                text,
                "    \"{topic}\": ({name}, \"{type_name}\", 0x{hash:016x}),"
            );
        }
    }
    text.push_str("}\n");
    text
}

fn print_structure(text: &mut String, structure: &Structure) {
    let Structure {
        name,
        about,
        bytes,
        fields,
        ..
    } = structure;
    let _ = writeln!(
        text,
        "\n\nclass {name}(ctypes.Structure):\n    \"\"\"{about}\"\"\"\n\n    __slots__ = ()\n    _fields_ = ["
    );
    for field in fields {
        let element = match &*field.element {
            "u8" => "ctypes.c_uint8",
            "u32" => "ctypes.c_uint32",
            "u64" => "ctypes.c_uint64",
            "f64" => "ctypes.c_double",
            nested => nested,
        };
        let array = field.count.map(|count| format!(" * {count}"));
        let (name, array) = (field.identifier(), array.unwrap_or_default());
        let remark = field.remark();
        let _ = writeln!(text, "        (\"{name}\", {element}{array}),  # {remark}");
    }
    let _ = writeln!(text, "    ]\n\n\nassert ctypes.sizeof({name}) == {bytes}");
}
