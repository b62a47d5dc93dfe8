//! Something for every fuzz target to begin with: built-in scenarios, the graph and the robots as they are; messages and kept messages of a run on one
//! thread; and in `tests/fuzz/seeds` inputs that the targets have found. All of them hold their property on every toolchain.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use bytemuck::bytes_of;
use chain::{Chain, Tick};
use recorder::{RecordError, RecordWriter};
use runtime::Manifest;
use shared_types::scenario::Scenario;
use shared_types::topics::{self, Each, Topic};

use crate::command::root;
use crate::properties;

type Done = Result<(), Box<dyn std::error::Error>>;

/// An input: its target, its name, its bytes.
type Seed = (&'static str, String, Vec<u8>);

/// Some ticks in the middle of a scenario.
fn ticks(name: &str) -> Result<Vec<Tick>, Box<dyn std::error::Error>> {
    let text = sim::scenarios::text(name).ok_or("it is built in")?;
    let scenario = Scenario::parse(name, text, &["plant.model=\"reference\"".to_owned()])?;
    let mut chain = Chain::new(&model::Robot::builtin(&scenario.robot)?, &scenario)?;
    let mut tick = Tick::default();
    let next = |_| {
        assert!(chain.step(&mut tick));
        tick
    };
    Ok((0..600).map(next).skip(400).collect())
}

/// A record as the target takes it: a choice, then the file; whole, and behind the head that the target puts before it.
fn kept(ticks: &[Tick]) -> Result<[Seed; 2], Box<dyn std::error::Error>> {
    struct Add<'a>(&'a mut RecordWriter, &'a Tick);
    impl Each for Add<'_> {
        type Output = Result<(), RecordError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            self.0.append(M::INDEX, bytes_of(M::of(self.1)))
        }
    }
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(recorder::MESSAGES);
    let mut record = RecordWriter::create(&path, &properties::contents())?;
    let head = record.bytes() as usize;
    for ticks in ticks.chunks(5) {
        for tick in ticks {
            topics::try_each(&mut Add(&mut record, tick))?;
        }
        record.close_chunk()?;
    }
    record.finish()?;
    let file = std::fs::read(&path)?;
    let seeds = [("whole", 0, 0), ("chunks", 1, head)];
    Ok(seeds.map(|(name, choice, from)| {
        let bytes = [&[choice], &file[from..]].concat();
        ("record", name.to_owned(), bytes)
    }))
}

/// The inputs that the repository has anyway.
fn built_in() -> Result<Vec<Seed>, Box<dyn std::error::Error>> {
    let mut seeds: Vec<Seed> = Vec::new();
    let mut seed =
        |target, name: &str, bytes: &[u8]| seeds.push((target, name.to_owned(), bytes.to_vec()));
    for (place, name) in sim::scenarios::names().enumerate() {
        let text = sim::scenarios::text(name).unwrap_or_default();
        let fault = "\n[[fault]]\nprocess = \"controller\"\nkind = \"corrupt\"\nas = \"huge\"\nfield = \"tau[1]\"\nat_s = 0.5\nfor_s = 0.1\nprobability = 0.5\n";
        seed("scenario", name, text.as_bytes());
        seed(
            "scenario",
            &format!("{name}-fault"),
            [text, fault].concat().as_bytes(),
        );
        let place = place as u8;
        let touch = |k: u32| (k.wrapping_mul(2_654_435_761) >> 13) as u8;
        let touched: Vec<u8> = (0..400).map(touch).collect();
        for law in 0..9 {
            // Nothing touched; then every message, in a run whose edges refuse what is not finite.
            let begin = [place, law, 2];
            seed("fingers", &format!("{name}-{law}"), &begin);
            seed(
                "fingers",
                &format!("{name}-{law}-touched"),
                &[&begin[..], &touched].concat(),
            );
        }
        let Ok(ticks) = ticks(name) else { continue };
        let inputs = |tick: &Tick| [bytes_of(&tick.estimate), bytes_of(&tick.singularity)].concat();
        let inputs: Vec<u8> = ticks.iter().take(8).flat_map(inputs).collect();
        seed("controller", name, &[&[place, 0, 0], &inputs[..]].concat());
    }
    seed("target_file", "targets", crate::hostile::TARGETS.as_bytes());
    seed(
        "graph",
        "graph",
        include_bytes!("../../shared-types/graph.toml"),
    );
    for path in entries("services/model/robots") {
        if path.extension().is_some_and(|end| end == "urdf") {
            seed("urdf", &name(&path), &std::fs::read(path)?);
        }
    }
    seed("urdf", "mjcf", include_bytes!("../golden/odd.xml"));
    seed("manifest", "manifest", properties::MANIFEST.as_bytes());
    serde_json::from_str::<Manifest>(properties::MANIFEST)?;
    // A planned kill in the first entry of the fault table: some words, each with its place.
    let words = [(4_u32, 1_u64), (8, 2), (9, 1)]
        .map(|(place, word)| [&place.to_ne_bytes()[..], &word.to_ne_bytes()].concat());
    seed("control_page", "words", &words.concat());
    seed("results", "job", properties::job().as_bytes());
    let summary = serde_json::to_vec(&shared_types::summary::Summary::default())?;
    seed("results", "summary", &summary);
    struct Messages<'a>(&'a Tick, Vec<Seed>);
    impl Each for Messages<'_> {
        type Output = ();
        fn each<M: Topic>(&mut self) {
            let bytes = bytes_of(M::of(self.0)).to_vec();
            self.1.push(("validation", M::TOPIC.to_owned(), bytes));
        }
    }
    let ticks = ticks("fig5-wrist-rotation")?;
    let mut messages = Messages(&ticks[0], Vec::new());
    topics::each(&mut messages);
    seeds.extend(messages.1);
    seeds.extend(kept(&ticks)?);
    Ok(seeds)
}

#[test]
#[ignore = "it writes tests/fuzz/corpus, for the fuzz targets"]
fn every_fuzz_target_has_something_to_begin_with() -> Done {
    for (target, name, bytes) in built_in()? {
        let folder = root().join("tests/fuzz/corpus").join(target);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}

/// The property of a target, tried on one input.
fn assert_holds(target: &str, bytes: &[u8]) {
    let on_text = |property: fn(&str)| std::str::from_utf8(bytes).map_or((), property);
    match target {
        "control_page" => properties::control_page(bytes),
        "controller" => properties::controller(bytes),
        "fingers" => properties::fingers(bytes),
        "graph" => on_text(properties::graph),
        "manifest" => properties::manifest(bytes),
        "record" => properties::record(bytes),
        "results" => properties::results(bytes),
        "scenario" => on_text(properties::scenario),
        "target_file" => on_text(properties::target_file),
        "urdf" => on_text(properties::urdf),
        "validation" => properties::validation(bytes),
        _ => panic!("there is no target {target}"),
    }
}

fn entries(folder: impl AsRef<Path>) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).into_iter().flatten();
    entries.flatten().map(|entry| entry.path())
}

fn name(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

#[test]
fn every_input_that_fuzzing_begins_with_or_has_found_holds_its_property() -> Done {
    let mut tried = BTreeSet::new();
    for (target, name, bytes) in built_in()? {
        // The chain of every arm under every law takes long: one arm stands for all.
        if target != "fingers" || name.starts_with("fig5") {
            assert_holds(target, &bytes);
            tried.insert(target.to_owned());
        }
    }
    for folder in entries("tests/fuzz/seeds") {
        for input in entries(&folder) {
            assert_holds(&name(&folder), &std::fs::read(input)?);
        }
    }
    let targets = entries("tests/fuzz/fuzz_targets").map(|path| name(&path));
    assert_eq!(tried, targets.collect(), "each target has an input");
    Ok(())
}
