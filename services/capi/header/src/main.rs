//! The C headers of `services/capi/src/lib.rs` and `services/capi-process/src/lib.rs`, by cbindgen.

use cbindgen::{Builder, Config, Language};

const LAW: &str = "/* Arms, their singularities and the control law as a C library: docs/c.md. Made by services/capi/header of services/capi/src/lib.rs.
 *
 * n is the number of an arm's joints, the first of which is at the base. SI units. */";

const PROCESS: &str = "/* A process of a run as a C library: docs/wire.md. Made by services/capi/header of services/capi-process/src/lib.rs.
 *
 * `armplane generate wire --lang c` gives the messages, with a function for each topic. */";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let version = env!("CARGO_PKG_VERSION");
    let version = format!(
        "\n/* Version of the library that this header came with. */\n#define ARMPLANE_VERSION \"{version}\""
    );
    make("capi", "libarmplane", LAW, Some(version))?;
    make("capi-process", "libarmplane-process", PROCESS, None)
}

fn make(
    folder: &str,
    name: &str,
    head: &str,
    after_includes: Option<String>,
) -> Result<(), Box<dyn std::error::Error>> {
    let folder = format!("{}/../../{folder}", env!("CARGO_MANIFEST_DIR"));
    let config = Config {
        language: Language::C,
        cpp_compat: true,
        usize_is_size_t: true,
        no_includes: true,
        sys_includes: ["stdbool.h", "stddef.h", "stdint.h"]
            .map(str::to_owned)
            .into(),
        include_guard: Some(name.to_ascii_uppercase().replace('-', "_") + "_H"),
        header: Some(head.to_owned()),
        after_includes,
        ..Config::default()
    };
    let mut source = Builder::new().with_config(config);
    source = source.with_src(format!("{folder}/src/lib.rs"));
    let mut made = Vec::new();
    source.generate()?.write(&mut made);
    // What a caller in Rust must ensure is said to a caller in C by the text before it.
    let (mut header, mut is_safety) = (String::new(), false);
    for line in String::from_utf8(made)?.lines() {
        is_safety = (is_safety || line.trim() == "* # Safety") && line.trim() != "*/";
        if !is_safety {
            header += line.trim_end();
            header += "\n";
        }
    }
    let header = header.replace(" *\n */", " */");
    std::fs::write(format!("{folder}/include/{name}.h"), header)?;
    Ok(())
}
