//! The C header of `services/capi/src/lib.rs`, by cbindgen.

use cbindgen::{Builder, Config, Language};

const HEAD: &str = "/* Arms, their singularities and the control law as a C library: docs/c.md. Made by services/capi/header of services/capi/src/lib.rs.
 *
 * n is the number of an arm's joints, the first of which is at the base. SI units. */";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let capi = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let version = env!("CARGO_PKG_VERSION");
    let config = Config {
        language: Language::C,
        cpp_compat: true,
        usize_is_size_t: true,
        no_includes: true,
        sys_includes: ["stdbool.h", "stddef.h", "stdint.h"]
            .map(str::to_owned)
            .into(),
        include_guard: Some("LIBARMPLANE_H".to_owned()),
        header: Some(HEAD.to_owned()),
        after_includes: Some(format!(
            "\n/* Version of the library that this header came with. */\n#define ARMPLANE_VERSION \"{version}\""
        )),
        ..Config::default()
    };
    let source = Builder::new()
        .with_config(config)
        .with_src(format!("{capi}/src/lib.rs"));
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
    std::fs::write(format!("{capi}/include/libarmplane.h"), header)?;
    Ok(())
}
