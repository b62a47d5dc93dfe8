//! Small limits of the shell and small volumes: a run is refused in one sentence, or goes to its end; nothing is left of either.

use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, Said, assert_nothing_left, finish, skipped};
use crate::neighbours::{is_root, text};

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
    finish(command.spawn().expect("armplane starts"))
}

/// Whether a run under a limit went to its end; otherwise it was refused, before it made anything, in a sentence with this option of `ulimit`.
fn ends(desk: &Desk, resource: libc::__rlimit_resource_t, option: &str, limit: u64) -> bool {
    let said = run_within(desk, resource, limit, "");
    let case = format!(
        "ulimit {option}, limit {limit}: exit code {}: {}",
        said.code, said.err
    );
    assert_nothing_left(said.launcher);
    let results = desk.path().join("r");
    if said.code == 0 {
        let summary: Value =
            serde_json::from_slice(&std::fs::read(results.join("summary.json")).expect(&case))
                .expect(&case);
        assert!(
            summary["outcome"] == "goal reached"
                && summary["recorder"]["error"]
                    .as_str()
                    .unwrap_or_default()
                    .is_empty(),
            "{case}"
        );
        std::fs::remove_dir_all(&results).expect("the results");
        return true;
    }
    assert!(
        said.code == 1
            && said.err.lines().count() == 1
            && said.err.starts_with("armplane: this shell allows "),
        "{case}"
    );
    assert!(
        said.err
            .contains(&format!("raise the limit with `ulimit {option} ")),
        "{case}"
    );
    assert!(!results.exists(), "{case}");
    false
}

#[test]
fn each_limit_of_the_shell_is_enough_or_is_named_with_its_value_and_the_remedy() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    std::fs::set_permissions(desk.path(), std::fs::Permissions::from_mode(0o777))
        .expect("the folder is ours");
    let said = run_within(&desk, libc::RLIMIT_AS, 96 * MIB, "--json");
    let error: Value =
        serde_json::from_str(&said.err).unwrap_or_else(|error| panic!("{error}: {}", said.err));
    assert!(
        said.code == 1
            && error["error"]["message"]
                .as_str()
                .is_some_and(|text| text.contains("`ulimit -v ")),
        "{}",
        said.err
    );
    let cases = [
        (
            libc::RLIMIT_FSIZE,
            "-f",
            [0, 1, 64 << 10, 4 * MIB, 16 * MIB, 1024 * MIB],
        ),
        (
            libc::RLIMIT_AS,
            "-v",
            [
                80 * MIB,
                96 * MIB,
                112 * MIB,
                130 * MIB,
                144 * MIB,
                4096 * MIB,
            ],
        ),
        (
            libc::RLIMIT_DATA,
            "-d",
            [4 * MIB, 8 * MIB, 16 * MIB, 32 * MIB, 48 * MIB, 256 * MIB],
        ),
        (libc::RLIMIT_NOFILE, "-n", [4, 10, 40, 100, 128, 1024]),
        (
            libc::RLIMIT_STACK,
            "-s",
            [64 << 10, 128 << 10, 256 << 10, MIB, 8 * MIB, 64 * MIB],
        ),
        (libc::RLIMIT_NPROC, "-u", [1, 4, 8, 16, 64, 512]),
    ];
    for (resource, option, limits) in cases {
        let ended = limits.map(|limit| ends(&desk, resource, option, limit));
        // Other processes of the user that runs the tests count, too.
        let least_fits = ended[5] || resource == libc::RLIMIT_NPROC && !is_root();
        assert!(
            least_fits && ended.is_sorted(),
            "ulimit {option}: {ended:?}"
        );
        assert_eq!(ended[0], option == "-s", "ulimit {option}: {ended:?}");
    }
}

/// The names in a folder, hidden ones included.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect()
}

#[test]
fn a_small_volume_costs_the_recording_and_not_the_run() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    for kib in [16, 200, 300, 400, 600, 1024, 2048] {
        let script = format!(
            "mkdir -p v && mount -t tmpfs -o size={kib}k tmpfs v || exit 77; \"$0\" run short.toml --out v/o; code=$?
             cp -r v kept; exit $code"
        );
        let ran = Command::new("unshare")
            .args(["-m", "sh", "-c", &script, env!("CARGO_BIN_EXE_armplane")])
            .current_dir(desk.path())
            .output()
            .expect("unshare");
        let (code, said) = (ran.status.code(), text(&ran.stderr) + &text(&ran.stdout));
        if code == Some(77) || said.contains("unshare") {
            return skipped("this machine lets no test mount a file system");
        }
        let (kept, case) = (
            desk.path().join("kept"),
            format!("{kib} KiB: {code:?}: {said}"),
        );
        if code == Some(2) {
            assert!(
                said.contains("No space left on device")
                    && said.contains("--out")
                    && said.lines().count() == 1,
                "{case}"
            );
            assert_eq!(names(&kept), Vec::<String>::new(), "{case}");
        } else {
            let summary: Value =
                serde_json::from_slice(&std::fs::read(kept.join("o/summary.json")).expect(&case))
                    .expect(&case);
            assert_eq!(
                (&summary["outcome"], &summary["recorder"]["lost"]),
                (&"goal reached".into(), &0.into()),
                "{case}"
            );
            let (error, bytes) = (
                summary["recorder"]["error"].as_str().unwrap_or_default(),
                summary["recorder"]["bytes"].as_u64(),
            );
            let end = bytes
                .filter(|bytes| *bytes > 0)
                .map_or("cannot begin".to_owned(), |bytes| {
                    format!("the recording has {bytes} bytes")
                });
            assert!(
                error.is_empty() || error.contains(&end) || error.contains("messages.mcap"),
                "{case}"
            );
            assert!(!error.is_empty() || kib >= 1024, "{case}");
            let is_said = said.contains(&format!("armplane: the results are not whole: {error}"));
            assert_eq!(
                (code, is_said),
                if error.is_empty() {
                    (Some(0), false)
                } else {
                    (Some(1), true)
                },
                "{case}"
            );
            let is_left = |name: &String| {
                name.starts_with('.') || [".reserved", ".tmp"].iter().any(|end| name.ends_with(end))
            };
            assert!(
                !names(&kept.join("o")).iter().any(is_left),
                "{case}: {:?}",
                names(&kept.join("o"))
            );
        }
        std::fs::remove_dir_all(kept).expect("the copy of the volume");
    }
}
