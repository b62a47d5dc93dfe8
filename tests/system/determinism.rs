//! Same scenario and seed, same bytes on every topic.

use serde_json::Value;
use shared_types::topics::{self, ByTopic, Each, Family, Topic};

use crate::command::Desk;

fn hashes(summary: &Value) -> Value {
    summary["topics"].clone()
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let desk = Desk::new();
    let first = desk.run(&["--seed", "5", "--no-record"]);
    let second = desk.run(&["--seed", "5", "--out", "recorded"]);
    assert_eq!(hashes(&first), hashes(&second), "recording or not");
    let third = desk.run(&["--seed", "6", "--no-record"]);
    assert_ne!(
        first["topics"]["sensor"]["hash"],
        third["topics"]["sensor"]["hash"]
    );
}

#[test]
fn one_thread_gives_the_bytes_that_five_processes_give() {
    let summary = Desk::new().run(&["--no-record"]);
    let scenario = shared_types::scenario::Scenario::parse(
        "built in",
        sim::scenarios::text("fig5-wrist-rotation").unwrap(),
        &[],
    )
    .unwrap();
    let robot = model::Robot::builtin(&scenario.robot).unwrap();
    struct Hashes;
    impl Family for Hashes {
        type Of<M: Topic> = message_log::TopicHash;
    }
    struct Add<'a>(&'a mut ByTopic<Hashes>, &'a chain::Tick);
    impl Each for Add<'_> {
        type Output = ();
        fn each<M: Topic>(&mut self) {
            M::of_mut(self.0).add(M::of(self.1));
        }
    }
    struct Compare<'a>(&'a ByTopic<Hashes>, &'a Value);
    impl Each for Compare<'_> {
        type Output = ();
        fn each<M: Topic>(&mut self) {
            let (topic, hash) = (M::TOPIC, M::of(self.0));
            if topics::STEERED.contains(&topic) {
                return;
            }
            assert_eq!(
                self.1["topics"][topic]["hash"],
                format!("{:016x}", hash.digest()),
                "{topic}"
            );
            assert_eq!(self.1["topics"][topic]["count"], hash.count(), "{topic}");
        }
    }
    let mut hashes = ByTopic::<Hashes>::default();
    chain::run(&robot, &scenario, |tick| {
        topics::each(&mut Add(&mut hashes, tick));
    })
    .unwrap();
    topics::each(&mut Compare(&hashes, &summary));
}

#[test]
fn two_runs_side_by_side_do_not_disturb_each_other() {
    let desk = Desk::new();
    let (one, two) = (
        desk.start(&[
            "run",
            "--seed",
            "9",
            "--no-record",
            "--json",
            "--out",
            "one",
        ]),
        desk.start(&[
            "run",
            "--seed",
            "9",
            "--no-record",
            "--json",
            "--out",
            "two",
        ]),
    );
    let (one, two) = (crate::command::finish(one), crate::command::finish(two));
    assert_eq!((one.code, two.code), (0, 0), "{}{}", one.err, two.err);
    let parsed = |text: &str| serde_json::from_str::<Value>(text).unwrap();
    assert_eq!(hashes(&parsed(&one.out)), hashes(&parsed(&two.out)));
}

#[test]
fn the_features_of_the_processor_change_no_byte() {
    let desk = Desk::new();
    let run = |masked: &str| {
        let ran = std::process::Command::new(env!("CARGO_BIN_EXE_armplane"))
            .args(["run", "ur5-wrist", "--no-record", "--json", "--out", "run"])
            .env("GLIBC_TUNABLES", format!("glibc.cpu.hwcaps={masked}"))
            .current_dir(desk.path())
            .output()
            .unwrap();
        hashes(&serde_json::from_slice(&ran.stdout).unwrap())
    };
    let all = run("");
    for masked in ["-AVX512F,-AVX512VL", "-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"] {
        assert_eq!(run(masked), all, "{masked}");
    }
}
