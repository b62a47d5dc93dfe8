//! Hostile input: random and broken files, messages of any bits; and access to a run's memory.

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use proptest::prelude::*;

use crate::command::{Desk, Known, Running, in_shared_memory, root, run_of, until};
use crate::neighbours::is_root;
use crate::properties;

/// A valid text with pieces cut out, doubled, moved and replaced.
fn broken(valid: Vec<String>) -> impl Strategy<Value = String> {
    let edit = (
        any::<prop::sample::Index>(),
        0_usize..40,
        any::<prop::sample::Index>(),
        0_u8..4,
        "[\\PC\n]{0,6}",
    );
    (
        prop::sample::select(valid),
        prop::collection::vec(edit, 0..6),
    )
        .prop_map(|(text, edits)| {
            let mut text: Vec<char> = text.chars().collect();
            for (from, length, to, kind, insert) in edits {
                if text.is_empty() {
                    break;
                }
                let from = from.index(text.len());
                let piece: Vec<char> = text[from..(from + length).min(text.len())].to_vec();
                if kind < 2 {
                    text.drain(from..from + piece.len());
                }
                let to = to.index(text.len() + 1);
                match kind {
                    0 => {}
                    1 | 2 => drop(text.splice(to..to, piece)),
                    _ => drop(text.splice(to..to, insert.chars())),
                }
            }
            text.into_iter().collect()
        })
}

/// The texts of a folder's files of one kind.
fn files(folder: &str, kind: &str) -> Vec<String> {
    let entries = std::fs::read_dir(root().join(folder)).unwrap().flatten();
    let paths = entries.map(|entry| entry.path());
    let paths = paths.filter(|path| path.extension().is_some_and(|end| end == kind));
    paths
        .map(|path| std::fs::read_to_string(path).unwrap())
        .collect()
}

/// A file of targets with a line of each kind.
const TARGETS: &str = "# armplane targets 1, length mm
0, twist, hand, 0.2, 5 0 0 0 0 0.1
0.1, pose, base, 1, 500 0 700 0 1 0 0, keep, 0.05
0.2, posture, joints, 1, 0.1 0.2 0.3 0.4 0.5 0.6, positive
0.3, twist, 7, 1, NaN 0 0 0 0 1e308
1, end
";

/// Numbers at the limits of their type, and ordinary ones.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        1 => any::<u64>().prop_map(f64::from_bits),
        1 => prop::sample::select(vec![0.0, -0.0, 1e-310, 1e308, -1e308, 1e18, f64::INFINITY, f64::NEG_INFINITY, f64::NAN]),
    ]
}

/// Bytes of messages: mostly plausible numbers, some of them poison.
fn bytes(words: usize) -> impl Strategy<Value = Vec<u8>> {
    let plausible = prop::collection::vec(number(), words)
        .prop_map(|numbers| numbers.into_iter().flat_map(f64::to_ne_bytes).collect());
    let tame = prop::collection::vec(-2.0..2.0, words);
    let spoiled =
        (tame, any::<prop::sample::Index>(), number()).prop_map(|(mut numbers, place, poison)| {
            let place = place.index(numbers.len());
            numbers[place] = poison;
            numbers.into_iter().flat_map(f64::to_ne_bytes).collect()
        });
    prop_oneof![
        plausible,
        spoiled,
        prop::collection::vec(any::<u8>(), 0..8 * words)
    ]
}

/// Random inputs of each property; `PROPTEST_CASES` for a longer search.
fn cases() -> u32 {
    std::env::var("PROPTEST_CASES")
        .ok()
        .and_then(|cases| cases.parse().ok())
        .unwrap_or(200)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn scenarios_are_valid_or_refused(text in broken(files("sim/scenarios", "toml"))) {
        properties::scenario(&text);
    }

    #[test]
    fn graphs_are_valid_or_refused(text in broken(files("shared-types", "toml"))) {
        properties::graph(&text);
    }

    #[test]
    fn robots_are_valid_or_refused(text in broken(files("services/model/robots", "urdf"))) {
        properties::urdf(&text);
    }

    #[test]
    fn target_files_are_read_or_refused(text in broken(vec![TARGETS.to_owned()])) {
        properties::target_file(&text);
    }

    #[test]
    fn every_poisoned_message_is_seen(bytes in bytes(200)) {
        properties::validation(&bytes);
    }

    #[test]
    fn no_input_makes_the_controller_unsafe(bytes in bytes(1200)) {
        properties::controller(&bytes);
    }

    #[test]
    fn no_finger_in_the_chain_makes_it_unsafe(bytes in prop::collection::vec(any::<u8>(), 0..1500)) {
        properties::fingers(&bytes);
    }

    #[test]
    fn kept_messages_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        properties::record(&bytes);
    }

    #[test]
    fn no_control_page_leads_astray(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        properties::control_page(&bytes);
    }

    #[test]
    fn manifests_are_valid_or_refused(text in broken(vec![properties::MANIFEST.to_owned()])) {
        properties::manifest(text.as_bytes());
    }

    #[test]
    fn jobs_are_valid_or_refused(text in broken(vec![properties::job()])) {
        properties::results(text.as_bytes());
    }
}

#[test]
fn a_runs_memory_is_its_users_alone() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --json");
    let names = || in_shared_memory(run.id());
    // The directory, the node counter, and a data segment for each of five topics.
    until("all segments", || names().len() >= 7);
    let inside = run_of(run.id()).unwrap();
    for name in names() {
        // A file of a passing moment may be gone.
        if let Ok(metadata) = std::fs::metadata(format!("/dev/shm/{name}")) {
            let mode = metadata.mode();
            assert_eq!(mode & 0o077, 0, "{name} has mode {mode:o}");
        }
    }
    let inside = ["", "/control_page", "/manifest.json", "/job.json", "/nodes"]
        .map(|name| format!("/dev/shm/{inside}{name}"));
    let exists = |path: &String| Path::new(path).exists();
    assert!(
        inside.iter().all(exists),
        "behind a door that only the user opens"
    );
    let segments = names().into_iter().map(|name| format!("/dev/shm/{name}"));
    // Only root can act as another user.
    for path in segments
        .chain(inside.clone())
        .filter(|path| is_root() && exists(path))
    {
        for attempt in [
            "cat \"$1\"",
            "ls \"$1/\"",
            "echo x >> \"$1\"",
            "touch \"$1/x\"",
            "rm -rf \"$1\"",
            "mv \"$1\" /dev/shm/mine",
        ] {
            let mut somebody = Command::new("sh");
            somebody.args(["-c", attempt, "sh", &path]).current_dir("/");
            let said = somebody.uid(65534).gid(65534).output().unwrap();
            let has_failed = !said.status.success() && said.stdout.is_empty();
            assert!(has_failed, "{attempt}: {path}: {said:?}");
        }
        assert!(exists(&path), "{path}");
    }
    run.interrupt();
}

/// Does something with all that it starts on one core.
fn on_one_core<T>(act: impl FnOnce() -> T) -> T {
    let all = runtime::realtime::allowed_cores();
    runtime::realtime::pin(all[0]).unwrap();
    let done = act();
    // SAFETY: a set of cores is plain numbers, and the calls read it.
    unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        all.iter().for_each(|core| libc::CPU_SET(*core, &mut set));
        let size = size_of::<libc::cpu_set_t>();
        assert_eq!(libc::sched_setaffinity(0, size, &raw const set), 0);
    }
    done
}

#[test]
fn two_graphs_that_compete_for_one_core_come_to_their_ends() {
    let desk = Desk::new();
    let both = |args: [&str; 2]| {
        let runs = on_one_core(|| args.map(|args| desk.start(args)));
        runs.map(|run| run.finish().json())
    };
    for json in both([
        "verify fig5-wrist-rotation --runs 2 --json",
        "verify fig1-pseudo-inverse --runs 2 --json",
    ]) {
        json.holds(r#"{"identical": true}"#);
    }
    for summary in both([
        "run --mode realtime --json --no-record --out a",
        "run --mode realtime --json --no-record --out b",
    ]) {
        let ratio = summary["joints"]["torque_max_ratio"].number();
        assert!(ratio <= 1.0 && summary["outcome"] != "failed", "{summary}");
    }
}

#[test]
fn a_live_fault_of_a_joint_that_the_arm_does_not_have_is_refused() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --json");
    let name = run_of(run.id()).unwrap();
    let fault = |joint: &str| format!("fault plant sensor --joint {joint} --run {name}");
    desk.refuses(2, &fault("7"), "7: puma560 6");
    until("the run to take a fault", || {
        desk.armplane(&fault("6")).code == 0
    });
    run.interrupt();
}
