#![no_main]

#[path = "../../system/properties/mod.rs"]
mod properties;

libfuzzer_sys::fuzz_target!(|text: &str| properties::target_file(text));
