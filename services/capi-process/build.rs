//! The name under which a program finds the library at run time: one for each version of its ABI.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libarmplane-process.so.1");
}
