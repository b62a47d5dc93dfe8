//! `libarmplane` as programs in C and C++ use it: the examples of `examples/cpp`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command::{Desk, lacks, root, skipped};
use crate::wire::wire;

/// The library that cargo has built for the tests, laid out as `services/capi/install` does it.
fn library(desk: &Desk) -> PathBuf {
    let tests = std::env::current_exe().expect("this test");
    let built = tests.with_file_name("libarmplane.so");
    assert!(built.is_file(), "{}: not built", built.display());
    let folder = desk.at("lib");
    std::fs::create_dir(&folder).expect("a folder");
    for name in ["libarmplane.so", "libarmplane.so.1"] {
        std::os::unix::fs::symlink(&built, folder.join(name)).expect("a link");
    }
    folder
}

/// Compiles an example and gives the program; `None` where there is no compiler.
fn compiled(desk: &Desk, compiler: &str, example: &str, options: &[&str]) -> Option<PathBuf> {
    let (folder, program) = (library(desk), desk.at("program"));
    // A program of a run may use both headers.
    let wire = desk.file("wire.h", wire(desk, "c"));
    let built = Command::new(compiler)
        .arg(root().join("examples/cpp").join(example))
        .args(["-O2", "-Wall", "-Wextra", "-Werror", "-larmplane", "-I"])
        .arg(root().join("services/capi/include"))
        .arg(format!("-L{}", folder.display()))
        .arg(format!("-Wl,-rpath,{}", folder.display()))
        .args(options)
        .args([Path::new("-include"), &wire, Path::new("-o"), &program])
        .output();
    let Ok(built) = built else {
        skipped(format!("there is no {compiler}"));
        return None;
    };
    let errors = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{compiler}: {errors}");
    Some(program)
}

/// Runs it to a success.
fn succeeds(program: &mut Command) {
    let said = program.output().expect("it runs");
    let [out, errors] = [&said.stdout, &said.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(said.status.success(), "{out}{errors}");
}

#[test]
fn a_program_in_c_leads_arms_through_singularities() {
    let desk = Desk::new();
    if let Some(program) = compiled(&desk, "cc", "law.c", &["-std=gnu11", "-lm"]) {
        succeeds(&mut Command::new(program));
    }
}

#[test]
fn a_program_in_cpp_leads_mujocos_arm_through_its_wrist_lock() {
    if lacks("mujoco") {
        return;
    }
    let desk = Desk::new();
    let code = "import glob, mujoco, os; f = os.path.dirname(mujoco.__file__); print(f, *glob.glob(f + '/libmujoco.so*'))";
    let said = desk
        .program("python3")
        .args(["-c", code])
        .output()
        .expect("python3 runs");
    let said = String::from_utf8_lossy(&said.stdout);
    let [folder, library] = said.split_whitespace().collect::<Vec<_>>()[..] else {
        return skipped(format!("MuJoCo's folder has not one library: {said}"));
    };
    let include = format!("{folder}/include");
    let options = [
        "-std=c++17",
        "-isystem",
        &include,
        library,
        "-Wl,-rpath",
        folder,
    ];
    if let Some(program) = compiled(&desk, "c++", "mujoco.cpp", &options) {
        let example = |name: &str| root().join("examples/cpp").join(name);
        succeeds(Command::new(program).args([example("arm.xml"), example("arm.urdf")]));
    }
}
