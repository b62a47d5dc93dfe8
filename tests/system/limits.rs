//! Small limits of the shell and small volumes: a run is refused in one sentence, or goes to its end; nothing is left of either.

use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;

use crate::command::{Desk, Known, Running, Said, skipped};
use crate::neighbours::{is_root, on_volume, text};

/// A short motion.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.1\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.2\n";

const MIB: u64 = 1 << 20;

/// A run under one limit, as another user where root is exempt from it.
fn run_within(desk: &Desk, resource: libc::__rlimit_resource_t, limit: u64, options: &str) -> Said {
    let mut command = desk.command(&format!("run short.toml --out r {options}"));
    if resource == libc::RLIMIT_NPROC && is_root() {
        command.uid(65534).gid(65534);
    }
    // SAFETY: between fork and exec one system call is made.
    unsafe {
        command.pre_exec(move || {
            let limit = libc::rlimit {
                rlim_cur: limit,
                rlim_max: limit,
            };
            if libc::setrlimit(resource, &raw const limit) == 0 {
                Ok(())
            } else {
                Err(std::io::Error::last_os_error())
            }
        });
    }
    command.spawn().expect("armplane starts").finish()
}

#[test]
fn each_limit_of_the_shell_is_enough_or_the_run_fails_in_words() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    std::fs::set_permissions(desk.path(), std::fs::Permissions::from_mode(0o777))
        .expect("the folder is ours");
    // Too little, and enough.
    for (resource, limits) in [
        (libc::RLIMIT_FSIZE, [64 << 10, 1024 * MIB]),
        (libc::RLIMIT_AS, [96 * MIB, 4096 * MIB]),
        (libc::RLIMIT_DATA, [4 * MIB, 256 * MIB]),
        (libc::RLIMIT_NOFILE, [10, 1024]),
        (libc::RLIMIT_STACK, [128 << 10, 8 * MIB]),
        (libc::RLIMIT_NPROC, [1, 4096]),
    ] {
        for (limit, is_enough) in limits.into_iter().zip([false, true]) {
            let said = run_within(&desk, resource, limit, "");
            let case = format!("{resource}, {limit}: {}: {}", said.code, said.err);
            if is_enough || said.code == 0 {
                assert_eq!(said.code, 0, "{case}");
                desk.read_json("r/summary.json")
                    .holds(r#"{"outcome": "goal reached", "recorder/error": ""}"#);
            } else {
                assert!(!said.err.is_empty(), "{case}");
            }
            let _ = std::fs::remove_dir_all(desk.at("r"));
        }
    }
}

#[test]
fn a_small_volume_costs_the_recording_and_not_the_run() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    std::fs::create_dir(desk.at("v")).expect("a folder");
    for kib in [16, 200, 300, 400, 600, 1024, 2048] {
        let script = "\"$0\" run short.toml --out v/o; code=$?\ncp -r v kept; exit $code";
        let Some(ran) = on_volume(&desk, "v", &format!("{kib}k"), script) else {
            return skipped("this machine lets no test mount a file system");
        };
        let (code, said) = (ran.status.code(), text(&ran.stderr) + &text(&ran.stdout));
        let case = format!("{kib} KiB: {code:?}: {said}");
        if code == Some(2) {
            let words = ["os error 28", "--out"];
            let is_said = words.iter().all(|words| said.contains(words));
            assert!(is_said && said.lines().count() == 1, "{case}");
            assert!(desk.names("kept").is_empty(), "{case}");
        } else {
            let summary = desk.read_json("kept/o/summary.json");
            summary.holds(r#"{"outcome": "goal reached", "recorder/lost": 0}"#);
            let recorder = &summary["recorder"];
            let error = recorder["error"].as_str().unwrap_or_default();
            let end = match recorder["bytes"].as_u64() {
                None | Some(0) => "--no-record".to_owned(),
                Some(bytes) => format!("{bytes} bytes"),
            };
            let is_whole = error.is_empty() && desk.has("kept/o/run.rrd");
            assert!(
                error.is_empty() || error.contains(&end) || error.contains("messages.mcap"),
                "{case}"
            );
            assert!(!is_whole || kib >= 1024, "{case}");
            assert!(
                code == Some(i32::from(!is_whole)) && said.contains(error),
                "{case}"
            );
            let is_left = |name: &String| {
                name.starts_with('.') || [".reserved", ".tmp"].iter().any(|end| name.ends_with(end))
            };
            let names = desk.names("kept/o");
            assert!(!names.iter().any(is_left), "{case}: {names:?}");
        }
        std::fs::remove_dir_all(desk.at("kept")).expect("the copy of the volume");
    }
}
