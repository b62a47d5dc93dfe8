#![no_main]

#[path = "../../system/properties.rs"]
mod properties;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| properties::control_page(bytes));
