//! The program stands at a fixed address: each of its processes would else write some 50 000 addresses into 300 pages of its own before it begins.

fn main() {
    println!("cargo::rerun-if-changed=services/build.rs");
    let of = |name: &str| std::env::var(name).unwrap_or_default();
    if of("CARGO_CFG_TARGET_OS") == "linux" && of("CARGO_CFG_TARGET_ENV") == "gnu" {
        println!("cargo::rustc-link-arg-bins=-no-pie");
    }
}
