//! The wire as programs in other languages see it: its C header and its Python module.

use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, Known, lacks, skipped, source};

pub(crate) fn wire(desk: &Desk, lang: &str) -> String {
    desk.succeeds(&format!("generate wire --lang {lang}")).out
}

/// Name, size and offset of every field of every structure, one to a line, as `armplane generate wire` says.
fn layouts(json: &str) -> Vec<String> {
    let document: Value = serde_json::from_str(json).expect("JSON");
    let structures = document["structures"].list();
    let lines = structures.iter().flat_map(|structure| {
        let fields = structure["fields"].list();
        fields.iter().map(|field| {
            // A keyword in C++ and Python.
            let name = field["name"].text();
            let name = if name == "class" { "class_" } else { name };
            format!(
                "{} {name} {} {}",
                structure["name"].text(),
                field["offset"],
                field["bytes"]
            )
        })
    });
    lines.collect()
}

/// `SensorSample` as `sensor_sample`.
fn snake(name: &str) -> String {
    let parts = name.char_indices().flat_map(|(i, c)| {
        (i > 0 && c.is_ascii_uppercase())
            .then_some('_')
            .into_iter()
            .chain([c.to_ascii_lowercase()])
    });
    parts.collect()
}

#[test]
fn the_c_header_compiles_in_c_and_cpp_and_has_the_layouts_of_the_wire() {
    let desk = Desk::new();
    let expected = layouts(&wire(&desk, "json"));
    assert!(expected.len() > 100, "{expected:?}");
    desk.file("armplane.h", wire(&desk, "c"));
    let print = |line: &String| {
        let words: Vec<&str> = line.split(' ').collect();
        let (name, field) = (snake(words[0]), words[1]);
        format!(
            "printf(\"{} {field} %zu %zu\\n\", offsetof(struct armplane_{name}, {field}), sizeof ((struct armplane_{name} *)0)->{field});",
            words[0]
        )
    };
    let lines: Vec<String> = expected.iter().map(print).collect();
    let code = format!(
        "#include \"armplane.h\"\nint main(void) {{\n{}\nreturn 0;\n}}\n",
        lines.join("\n")
    );
    let cpp = ["-std=c++11", "-Wno-invalid-offsetof"];
    for (compiler, file, options) in [
        ("cc", "layouts.c", &["-std=gnu11"][..]),
        ("c++", "layouts.cpp", &cpp),
    ] {
        desk.file(file, &code);
        let mut command = desk.program(compiler);
        command
            .args(options)
            .args(["-Wall", "-Wextra", "-Werror", "-o", "layouts", file]);
        let Ok(built) = command.output() else {
            skipped(format!("there is no {compiler}"));
            continue;
        };
        assert!(built.status.success(), "{compiler}: {built:?}");
        assert_eq!(
            printed(desk.program(desk.at("layouts"))),
            expected,
            "{compiler}"
        );
    }
}

/// The lines that a program prints.
fn printed(mut program: Command) -> Vec<String> {
    let said = program.output().expect("it runs");
    let text = String::from_utf8(said.stdout).expect("UTF-8");
    text.lines().map(str::to_owned).collect()
}

#[test]
fn the_python_module_is_that_of_this_program_and_has_the_layouts_of_the_wire() {
    let desk = Desk::new();
    assert_eq!(
        source("python/armplane/wire.py").trim_end(),
        wire(&desk, "python").trim_end(),
        "run: armplane generate wire --lang python > python/armplane/wire.py"
    );
    if lacks("ctypes") {
        return;
    }
    let code = "import ctypes, armplane.wire as w\nfor s in [v for v in vars(w).values() if isinstance(v, type)]:\n    for f in s._fields_:\n        \
                d = getattr(s, f[0])\n        print(s.__name__, f[0], d.offset, d.size)";
    let mut python = desk.program("python3");
    python.args(["-c", code]);
    assert_eq!(printed(python), layouts(&wire(&desk, "json")));
}
