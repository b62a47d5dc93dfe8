//! Gives every fuzz target something to begin with, in `tests/fuzz/corpus/TARGET`, which git ignores: built-in scenarios, the graph and the robots
//! as they are; messages and kept messages of a run on one thread.

use std::path::{Path, PathBuf};

use bytemuck::bytes_of;
use chain::{Chain, Tick};
use message_log::LogWriter;
use runtime::Manifest;
use shared_types::Message;
use shared_types::scenario::Scenario;
use shared_types::topics::{self, COUNT, Each, Topic};

use crate::properties;

type Done = Result<(), Box<dyn std::error::Error>>;

fn corpus(target: &str) -> std::io::Result<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus").join(target);
    std::fs::create_dir_all(&folder)?;
    Ok(folder)
}

fn seed(target: &str, name: &str, bytes: &[u8]) -> Done {
    Ok(std::fs::write(corpus(target)?.join(name), bytes)?)
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

/// A file of kept messages as the target takes it: a choice, then the file.
fn kept<M: Message>(choice: u8, messages: impl Iterator<Item = M>) -> Done {
    let folder = tempfile::tempdir()?;
    let mut keep = LogWriter::<M>::create(folder.path())?;
    for message in messages {
        keep.add(&message)?;
    }
    keep.finish()?;
    let file = std::fs::read(folder.path().join(format!("{}.log", M::TOPIC)))?;
    // Whole; and behind the head that the target puts before it.
    seed("message_log", &format!("{}-whole", M::TOPIC), &[&[choice], &file[..]].concat())?;
    let with_head = (8..16)
        .chain(24..32)
        .find(|with_head| usize::from(*with_head) % COUNT == usize::from(choice))
        .ok_or("one of sixteen leaves any rest")?;
    seed("message_log", &format!("{}-blocks", M::TOPIC), &[&[with_head], &file[24..]].concat())
}

#[test]
#[ignore = "it writes tests/fuzz/corpus, for the fuzz targets"]
fn every_fuzz_target_has_something_to_begin_with() -> Done {
    for (place, name) in sim::scenarios::names().enumerate() {
        let text = sim::scenarios::text(name).unwrap_or_default();
        seed("scenario", name, text.as_bytes())?;
        let fault = "\n[[fault]]\nprocess = \"controller\"\nkind = \"corrupt\"\nas = \"huge\"\nfield = \"tau[1]\"\nat_s = 0.5\nfor_s = 0.1\nprobability = 0.5\n";
        seed("scenario", &format!("{name}-fault"), [text, fault].concat().as_bytes())?;
        let place = place as u8;
        for law in 0..9 {
            // Nothing touched; then every message, in a run whose edges refuse what is not finite.
            seed("fingers", &format!("{name}-{law}"), &[place, law, 2])?;
            let touched: Vec<u8> = (0..400_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
            seed("fingers", &format!("{name}-{law}-touched"), &[&[place, law, 2][..], &touched].concat())?;
        }
        let Ok(ticks) = ticks(name) else { continue };
        let each = |part: fn(&Tick) -> Vec<u8>| ticks.iter().take(8).flat_map(part).collect::<Vec<u8>>();
        let inputs = each(|tick| [bytes_of(&tick.estimate), bytes_of(&tick.singularity)].concat());
        seed("controller", name, &[&[place, 0, 0], &inputs[..]].concat())?;
        seed("drive", name, &[&[place], &each(|tick| bytes_of(&tick.torque).to_vec())[..]].concat())?;
    }
    seed("target_file", "targets", crate::hostile::TARGETS.as_bytes())?;
    seed("graph", "graph", include_bytes!("../../services/graph.toml"))?;
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("services/model/robots");
    for entry in std::fs::read_dir(robots)?.flatten().filter(|entry| entry.path().extension().is_some_and(|is| is == "urdf")) {
        seed("urdf", &entry.file_name().to_string_lossy(), &std::fs::read(entry.path())?)?;
    }
    let ticks = ticks("fig5-wrist-rotation")?;
    struct SeedEach<'a>(&'a [Tick]);
    impl Each for SeedEach<'_> {
        type Output = Done;
        fn each<M: Topic>(&mut self) -> Done {
            seed("validation", M::TOPIC, bytes_of(M::of(&self.0[0])))?;
            kept::<M>(M::INDEX as u8, self.0.iter().map(|tick| *M::of(tick)))
        }
    }
    topics::try_each(&mut SeedEach(&ticks))?;
    seed("manifest", "manifest", properties::MANIFEST.as_bytes())?;
    serde_json::from_str::<Manifest>(properties::MANIFEST)?;
    // A planned kill in the first entry of the fault table: some words, each with its place.
    let words = [(4_u32, 1_u64), (8, 2), (9, 1)].map(|(place, word)| [&place.to_ne_bytes()[..], &word.to_ne_bytes()[..]].concat());
    seed("control_page", "words", &words.concat())?;
    seed("results", "job", properties::job().as_bytes())?;
    let summary = serde_json::to_vec(&shared_types::summary::Summary::default())?;
    seed("results", "summary", &summary)?;
    Ok(())
}
