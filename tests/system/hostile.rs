//! Hostile input: random and broken files, messages of any bits.

use proptest::prelude::*;

use crate::command::root;
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
