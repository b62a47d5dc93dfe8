//! Results that are not whole: each command that reads or makes them says so, and its exit code does.

use recorder::{Contents, MESSAGES, RecordReader, RecordWriter};
use serde_json::Value;

use crate::command::{Desk, Known};

/// A short motion.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.3\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.5\n";

/// Ticks of a chunk.
const EACH: u64 = 50;

/// The record of a run, written again in chunks of some ticks; where each chunk begins, and where the last one ends.
fn in_chunks(desk: &Desk, run: &str) -> (Vec<u8>, Vec<usize>) {
    let job = serde_json::from_str(&desk.read(format!("{run}/job.json"))).unwrap();
    let (path, contents) = (desk.at(run).join(MESSAGES), Contents::of(&job));
    let topics = contents.layouts().iter();
    let open = |_| RecordReader::open(&path, &contents).unwrap();
    let mut readers: Vec<_> = topics.map(open).collect();
    let again = desk.at("again.mcap");
    let mut writer = RecordWriter::create(&again, &contents).unwrap();
    let mut places = vec![writer.bytes() as usize];
    let (mut tick, mut is_over) = (0, false);
    while !is_over {
        for (channel, reader) in readers.iter_mut().enumerate() {
            match reader.next_of(channel) {
                Some(message) => writer.append(channel, message).unwrap(),
                None => is_over = true,
            }
        }
        tick += 1;
        if tick % EACH == 0 || is_over {
            writer.close_chunk().unwrap();
            places.push(writer.bytes() as usize);
        }
    }
    places.dedup();
    writer.finish().unwrap();
    std::fs::rename(again, &path).unwrap();
    (std::fs::read(path).unwrap(), places)
}

/// A run in `r`: its folder, its files as they were, its messages in chunks.
struct Run {
    desk: Desk,
    summary: Value,
    files: Vec<(String, Vec<u8>)>,
    log: Vec<u8>,
    places: Vec<usize>,
}

impl Run {
    fn new() -> Self {
        let desk = Desk::new();
        desk.file("short.toml", SHORT);
        let summary = desk.run("short.toml --out r");
        let (log, places) = in_chunks(&desk, "r");
        let names = desk.names("r").into_iter();
        let files = names
            .map(|name| (name.clone(), desk.bytes(format!("r/{name}"))))
            .collect();
        Self {
            desk,
            summary,
            files,
            log,
            places,
        }
    }

    /// Makes the folder what it was, with these messages.
    fn with(&self, log: &[u8]) -> &Desk {
        let _ = std::fs::remove_dir_all(self.desk.at("r"));
        for (name, bytes) in &self.files {
            self.desk.file(format!("r/{name}"), bytes);
        }
        self.desk.file("r/messages.mcap", log);
        &self.desk
    }

    /// The same as a killed launcher leaves it.
    fn killed(&self, log: &[u8]) -> &Desk {
        let desk = self.with(log);
        for name in ["summary.json", "scenario.toml", "run.rrd"] {
            desk.remove(format!("r/{name}"));
        }
        desk
    }
}

#[test]
fn chunks_that_are_missing_repeated_or_exchanged_are_named_by_each_command() {
    let run = Run::new();
    let (file, places) = (&run.log, &run.places);
    run.desk.run("short.toml --out other");
    let (other, _) = in_chunks(&run.desk, "other");
    let last = places.len() - 2;
    let of = |chunks: &[usize]| {
        let chunks = chunks
            .iter()
            .map(|number| &file[places[*number]..places[number + 1]]);
        let parts = std::iter::once(&file[..places[0]]).chain(chunks);
        parts
            .chain([&file[places[last + 1]..]])
            .collect::<Vec<_>>()
            .concat()
    };
    let all: Vec<usize> = (0..=last).collect();
    let mut flipped = file.clone();
    flipped[(places[3] + places[4]) / 2] ^= 0x80;
    let of_chunk = |number: u64| format!("{} to {}", EACH * number, EACH * number + EACH - 1);
    // The last three of a run whose summary tells what there was.
    for (bytes, place, is_known) in [
        (of(&[&all[..2], &all[3..]].concat()), of_chunk(2), true),
        (of(&[&all[..2], &all[1..]].concat()), of_chunk(1), true),
        (of(&[&[0, 2, 1], &all[3..]].concat()), of_chunk(1), true),
        (flipped, of_chunk(3), true),
        (
            file[..places[last]].to_vec(),
            format!("tick {}", EACH * last as u64),
            false,
        ),
        (other, String::new(), false),
        (Vec::new(), String::new(), false),
    ] {
        let is_nothing = place.is_empty();
        let desk = run.with(&bytes);
        // One clause for each cause, and the same by each command.
        let said = desk.refuses(1, "report r", "").err;
        let (_, clause) = said.split_once(" r: ").unwrap();
        let clause = clause.split("; ").next().unwrap();
        let is_said = clause.contains(&place) && clause.starts_with(MESSAGES);
        assert!(is_said, "{clause}");
        let reader = if is_nothing && !bytes.is_empty() {
            MESSAGES
        } else {
            clause
        };
        for (command, words) in [
            ("replay r --process estimator", clause),
            ("replay r --process controller", clause),
            ("export r --out e", reader),
        ] {
            let said = desk.armplane(command);
            // Of nothing no table is made.
            let is_refused = command.starts_with("export") && is_nothing;
            assert!(
                said.code == 1 + i32::from(is_refused) && said.err.contains(words),
                "{command}: {words}: {}",
                said.err
            );
        }
        let said = desk.armplane("diff r r --json");
        let found = said.json();
        assert!(said.code == 1 && found["damage"][0].text().contains(clause));
        assert!(desk.read("r/report.html").contains(clause), "{clause}");
        if is_known {
            let said = run
                .killed(&bytes)
                .armplane("recover r --only-results --json");
            let error = said.json()["recorder"]["error"].text().to_owned();
            assert_eq!((said.code, error.split("; ").next()), (1, Some(clause)));
        }
    }
    let again = run.killed(file).json("recover r --only-results");
    assert_eq!(again["topics"], run.summary["topics"]);
    run.killed(file).remove("r/messages.mcap");
    run.desk.refuses(1, "recover r --only-results", "");
    let exported = run.killed(&file[..places[last]]).json("export r --out e");
    assert_eq!(exported["last_tick"].count(), EACH * last as u64 - 1);
    let mut missing = Vec::new();
    for chunk in [1, last] {
        let mut flipped = file.clone();
        flipped[(places[chunk] + places[chunk + 1]) / 2] ^= 0x80;
        let made = run
            .killed(&flipped)
            .armplane("recover r --only-results --json");
        missing.push(made.json()["recorder"]["lost"].count());
        let again = run.killed(&flipped).json("recover r");
        assert_eq!(again["topics"], run.summary["topics"], "chunk {chunk}");
        assert_eq!(run.desk.json("diff r other")["same"], true);
    }
    // Nothing comes after the last chunk that could tell.
    let topics = run.summary["topics"].as_object().unwrap().len() as u64;
    assert_eq!(missing, [EACH * topics, 0]);
}
