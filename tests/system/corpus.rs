//! Something for every fuzz target to begin with: built-in scenarios, the graph and the robots as they are; messages and kept messages of a run on one
//! thread; and in `tests/fuzz/seeds` inputs that the targets have found. All of them hold their property on every toolchain.

use std::path::{Path, PathBuf};

use bytemuck::bytes_of;
use chain::{Chain, Tick};
use message_log::{LogError, Writer};
use runtime::Manifest;
use shared_types::scenario::Scenario;
use shared_types::topics::{self, Each, Topic};

use crate::properties;

type Done = Result<(), Box<dyn std::error::Error>>;

/// The folder with a folder of inputs for each target.
struct Corpus(PathBuf);

impl Corpus {
    fn seed(&self, target: &str, name: &str, bytes: &[u8]) -> Done {
        let folder = self.0.join(target);
        std::fs::create_dir_all(&folder)?;
        Ok(std::fs::write(folder.join(name), bytes)?)
    }
}

/// A file of `tests/fuzz`.
fn fuzz(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fuzz")
        .join(path)
}

/// Some ticks in the middle of a scenario.
fn ticks(name: &str) -> Result<Vec<Tick>, Box<dyn std::error::Error>> {
    let text = sim::scenarios::text(name).ok_or("it is built in")?;
    let scenario = Scenario::parse(name, text, &["plant.model=\"reference\"".to_owned()])?;
    let mut chain = Chain::new(&model::Robot::builtin(&scenario.robot)?, &scenario)?;
    let mut tick = Tick::default();
    let next = |_| {
        chain.step(&mut tick);
        tick
    };
    Ok((0..600).map(next).skip(400).collect())
}

/// A message log as the target takes it: a choice, then the file; whole, and behind the head that the target puts before it, with the checksums as they
/// are and with new ones.
fn kept(corpus: &Corpus, ticks: &[Tick]) -> Done {
    struct Add<'a>(&'a mut Writer, &'a Tick);
    impl Each for Add<'_> {
        type Output = Result<(), LogError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            self.0.add(M::INDEX, bytes_of(M::of(self.1)))
        }
    }
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(message_log::FILE);
    let mut log = Writer::create(&path, &properties::contents())?;
    let head = log.place().bytes as usize;
    for (number, tick) in ticks.iter().enumerate() {
        topics::try_each(&mut Add(&mut log, tick))?;
        if number % 5 == 4 {
            log.flush()?;
        }
    }
    log.finish()?;
    let file = std::fs::read(&path)?;
    for (name, choice, bytes) in [
        ("whole", 0, &file[..]),
        ("blocks", 1, &file[head..]),
        ("sealed", 3, &file[head..]),
    ] {
        corpus.seed("message_log", name, &[&[choice], bytes].concat())?;
    }
    Ok(())
}

fn begin(corpus: &Corpus) -> Done {
    for (place, name) in sim::scenarios::names().enumerate() {
        let text = sim::scenarios::text(name).unwrap_or_default();
        corpus.seed("scenario", name, text.as_bytes())?;
        let fault = "\n[[fault]]\nprocess = \"controller\"\nkind = \"corrupt\"\nas = \"huge\"\nfield = \"tau[1]\"\nat_s = 0.5\nfor_s = 0.1\nprobability = 0.5\n";
        corpus.seed(
            "scenario",
            &format!("{name}-fault"),
            [text, fault].concat().as_bytes(),
        )?;
        let place = place as u8;
        for law in 0..9 {
            // Nothing touched; then every message, in a run whose edges refuse what is not finite.
            corpus.seed("fingers", &format!("{name}-{law}"), &[place, law, 2])?;
            let touched: Vec<u8> = (0..400_u32)
                .map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8)
                .collect();
            corpus.seed(
                "fingers",
                &format!("{name}-{law}-touched"),
                &[&[place, law, 2][..], &touched].concat(),
            )?;
        }
        let Ok(ticks) = ticks(name) else { continue };
        let each =
            |part: fn(&Tick) -> Vec<u8>| ticks.iter().take(8).flat_map(part).collect::<Vec<u8>>();
        let inputs = each(|tick| [bytes_of(&tick.estimate), bytes_of(&tick.singularity)].concat());
        corpus.seed("controller", name, &[&[place, 0, 0], &inputs[..]].concat())?;
    }
    corpus.seed("target_file", "targets", crate::hostile::TARGETS.as_bytes())?;
    corpus.seed(
        "graph",
        "graph",
        include_bytes!("../../shared-types/graph.toml"),
    )?;
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("services/model/robots");
    for entry in std::fs::read_dir(robots)?
        .flatten()
        .filter(|entry| entry.path().extension().is_some_and(|is| is == "urdf"))
    {
        corpus.seed(
            "urdf",
            &entry.file_name().to_string_lossy(),
            &std::fs::read(entry.path())?,
        )?;
    }
    corpus.seed("urdf", "mjcf", include_bytes!("../golden/odd.xml"))?;
    let ticks = ticks("fig5-wrist-rotation")?;
    struct SeedEach<'a>(&'a Corpus, &'a [Tick]);
    impl Each for SeedEach<'_> {
        type Output = Done;
        fn each<M: Topic>(&mut self) -> Done {
            self.0
                .seed("validation", M::TOPIC, bytes_of(M::of(&self.1[0])))
        }
    }
    topics::try_each(&mut SeedEach(corpus, &ticks))?;
    kept(corpus, &ticks)?;
    corpus.seed("manifest", "manifest", properties::MANIFEST.as_bytes())?;
    serde_json::from_str::<Manifest>(properties::MANIFEST)?;
    // A planned kill in the first entry of the fault table: some words, each with its place.
    let words = [(4_u32, 1_u64), (8, 2), (9, 1)]
        .map(|(place, word)| [&place.to_ne_bytes()[..], &word.to_ne_bytes()[..]].concat());
    corpus.seed("control_page", "words", &words.concat())?;
    // Joins, answers, sends; then the same with a word of the head overwritten in between.
    corpus.seed(
        "exchange_page",
        "good",
        &[3, 4, 5, 7, 6, 8, 9, 0, 9, 1, 9, 2, 10],
    )?;
    corpus.seed(
        "exchange_page",
        "spoiled",
        &[
            3, 1, 20, 7, 0, 0, 0, 4, 5, 7, 6, 1, 90, 1, 0, 0, 0, 8, 2, 0, 8, 255, 200, 9, 0, 10,
            11, 255, 127, b'x', 9,
        ],
    )?;
    corpus.seed("results", "job", properties::job().as_bytes())?;
    let summary = serde_json::to_vec(&shared_types::summary::Summary::default())?;
    corpus.seed("results", "summary", &summary)?;
    Ok(())
}

#[test]
#[ignore = "it writes tests/fuzz/corpus, for the fuzz targets"]
fn every_fuzz_target_has_something_to_begin_with() -> Done {
    begin(&Corpus(fuzz("corpus")))
}

/// The property of a target, tried on one input; whether there is such a target.
fn holds(target: &str, bytes: &[u8]) -> bool {
    let on_text = |property: fn(&str)| std::str::from_utf8(bytes).map_or((), property);
    match target {
        "control_page" => properties::control_page(bytes),
        "controller" => properties::controller(bytes),
        "exchange_page" => properties::exchange_page(bytes),
        "fingers" => properties::fingers(bytes),
        "graph" => on_text(properties::graph),
        "manifest" => properties::manifest(bytes),
        "message_log" => properties::message_log(bytes),
        "results" => properties::results(bytes),
        "scenario" => on_text(properties::scenario),
        "target_file" => on_text(properties::target_file),
        "urdf" => on_text(properties::urdf),
        "validation" => properties::validation(bytes),
        _ => return false,
    }
    true
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect()
}

#[test]
fn every_input_that_fuzzing_begins_with_or_has_found_holds_its_property() -> Done {
    let built_in = tempfile::tempdir()?;
    begin(&Corpus(built_in.path().to_owned()))?;
    let name = |path: &Path| {
        path.file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    let mut tried = std::collections::BTreeMap::<String, u32>::new();
    for folder in [entries(built_in.path()), entries(&fuzz("seeds"))]
        .concat()
        .into_iter()
        .filter(|path| path.is_dir())
    {
        // The chain of every arm under every law takes long: one arm stands for all.
        let is_tried = |input: &PathBuf| {
            name(&folder) != "fingers"
                || !input.starts_with(built_in.path())
                || name(input).starts_with("fig5")
        };
        for input in entries(&folder).into_iter().filter(is_tried) {
            assert!(
                holds(&name(&folder), &std::fs::read(&input)?),
                "{} is of no target",
                input.display()
            );
            *tried.entry(name(&folder)).or_default() += 1;
        }
    }
    let without: Vec<String> = entries(&fuzz("fuzz_targets"))
        .iter()
        .map(|path| name(path))
        .filter(|target| !tried.contains_key(target))
        .collect();
    assert!(without.is_empty(), "targets without an input: {without:?}");
    Ok(())
}
