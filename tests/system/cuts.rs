//! Runs that go on from a tick of another one: with the same bytes, as a branch, or after the death of their launcher.

use serde_json::Value;

use crate::command::{Desk, Known, Running, children_of_run, until};

/// A motion of three seconds, to be followed by faults.
const MOTION: &str = "name = \"motion\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 1.5\n\n[[segment]]\nby_m = [-0.05, 0.0, 0.0]\nduration_s = 1.5\n\n";

/// Messages held back and lost, a joint's drive that is weak, and a process that is absent.
const FAULTS: &str = "[[fault]]\nprocess = \"estimator\"\nkind = \"delay\"\nat_tick = 600\nfor_ticks = 40\ndelay_ticks = 3\n\n[[fault]]\nprocess = \"plant\"\nkind = \"drive\"\nas = \"friction\"\njoint = 2\namount = 0.01\nat_tick = 900\nfor_ticks = 1500\n\n[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 1300\n\n[[fault]]\nprocess = \"analyzer\"\nkind = \"drop\"\nat_tick = 2500\nfor_ticks = 5\n";

/// Which faults of a run happened.
fn occurred(run: &Value) -> Vec<(&Value, &Value)> {
    let faults = run["faults"].as_array().expect("faults");
    let faults = faults.iter().filter(|fault| !fault["plan"].is_null());
    faults
        .map(|fault| (&fault["tick"], &fault["occurred"]))
        .collect()
}

/// Goes on from these ticks of the run in `whole`, which has these results.
fn goes_on(desk: &Desk, whole: &Value, ticks: impl Iterator<Item = u64>) {
    for tick in ticks {
        let again = desk.run(&format!("--from whole@{tick} --out again"));
        assert_eq!(again["topics"], whole["topics"], "from {tick}");
        assert_eq!(again["task"], whole["task"], "from {tick}");
        assert_eq!(occurred(&again), occurred(whole), "from {tick}");
        again.holds(&format!(r#"{{"recorder/lost": 0, "from/tick": {tick}}}"#));
    }
}

#[test]
fn a_run_goes_on_from_any_tick_with_the_same_bytes() {
    let desk = Desk::new();
    desk.file("s.toml", [MOTION, FAULTS].concat());
    let whole = desk.run("s.toml --out whole");
    let last = whole["ticks"].count() - 1;
    let ticks = [1, 999, 1000, 1310, 2499, 2501, last];
    goes_on(&desk, &whole, ticks.into_iter());
    desk.succeeds("replay again");
    desk.succeeds("report again");
}

#[test]
#[ignore = "ten minutes: 300 ticks and 100 deaths of a launcher, drawn at random"]
fn every_tick_and_every_moment_will_do() {
    let desk = Desk::new();
    desk.file("s.toml", [MOTION, FAULTS].concat());
    let whole = desk.run("s.toml --out whole");
    let last = whole["ticks"].count() - 1;
    let tick = |i: u64| 1 + runtime::random(11, i) % last;
    goes_on(&desk, &whole, (0..300).map(tick));
    let moment = |i: u64| runtime::random(12, i) % last;
    let killed = survives(&desk, &whole, (0..100).map(moment));
    assert!(killed >= 90, "{killed} runs of 100 still lived");
}

#[test]
fn a_branch_has_the_bytes_of_its_run_until_its_tick() {
    let desk = Desk::new();
    desk.file("s.toml", [MOTION, FAULTS].concat());
    desk.run("s.toml --out whole");
    for (tick, setting) in [
        (1250, "control.k_p=300"),
        (2000, "control.k_p=300"),
        (2200, "fault.3.at_tick=2300"),
        (1250, "segment.1.by_m=[-0.05,0.02,0.0]"),
    ] {
        let from = format!("--from whole@{tick} --set {setting}");
        let branch = desk.run(&format!("{from} --out branch"));
        let again = desk.run(&format!("{from} --out again"));
        assert_eq!(branch["topics"], again["topics"], "{setting}");
        let differs = desk.armplane("diff whole branch --json");
        assert_eq!(differs.code, 1, "{}", differs.out);
        let first = differs.json()["difference"]["tick"].count();
        assert!(first >= tick, "{setting} from {tick} differs at {first}");
    }
}

#[test]
fn what_cannot_go_on_is_refused() {
    let desk = Desk::new();
    desk.file("s.toml", [MOTION, FAULTS].concat());
    desk.run("s.toml --out whole");
    desk.run("s.toml --out unkept --no-record");
    desk.refuses_each(&[
        ("run --from whole", "RUN@TICK"),
        ("run --from none@10", "none"),
        ("run --from whole@0", "ticks"),
        ("run --from whole@90000", "ticks"),
        ("run --from unkept@10", "record"),
        ("run --from whole@10 --out whole", "--out"),
        ("run --from whole@1000 --set rate_hz=500", "rate_hz"),
        (
            "run --from whole@1000 --set control.strategy=operational-space",
            "strategy",
        ),
        ("run --from whole@1000 --set fault.1.at_tick=650", "fault"),
        (
            "run --from whole@1000 --set segment.0.by_m=[0.06,0.0,0.05]",
            "segment 0",
        ),
    ]);
    let record = std::fs::read(desk.at("whole/messages.mcap")).unwrap();
    desk.file("whole/messages.mcap", &record[..record.len() / 100 * 35]);
    desk.refuses(
        2,
        "run --from whole@1290 --set control.k_p=300",
        "ends at tick",
    );
    let scenario = desk.read("whole/scenario.toml");
    let (_, edited) = scenario.split_once('\n').unwrap();
    desk.file("whole/scenario.toml", edited);
    desk.refuses(2, "run --from whole@1000", "edited");
}

/// Kills the launcher of the run in `whole` once it has done so many ticks, each time, and goes on. Returns how many were killed in time.
fn survives(desk: &Desk, whole: &Value, ticks: impl Iterator<Item = u64>) -> usize {
    let mut killed = 0;
    for least in ticks {
        let run = desk.start("run s.toml --out r");
        until("the tick", || {
            run.ticks() > least || desk.has("r/summary.json")
        });
        run.signal("KILL");
        let launcher = run.finish().launcher;
        until("the processes to go", || {
            children_of_run(launcher).is_empty()
        });
        if !desk.has("r/summary.json") {
            let said = desk.armplane("recover r --json");
            assert_eq!(said.code, 0, "{}", said.err);
            let summary = said.json();
            assert_eq!(summary["topics"], whole["topics"], "{least}");
            assert_eq!(summary["task"], whole["task"], "{least}");
            assert_eq!(occurred(&summary), occurred(whole), "{least}");
            killed += 1;
        }
        let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let of_run = format!("-{launcher}-");
        let left = left.filter(|one| one.file_name().to_string_lossy().contains(&of_run));
        assert_eq!(left.count(), 0, "{least}");
        std::fs::remove_dir_all(desk.at("r")).unwrap();
    }
    killed
}

#[test]
fn a_run_whose_launcher_was_killed_goes_on_to_the_bytes_of_the_undisturbed_run() {
    let desk = Desk::new();
    desk.file("s.toml", [MOTION, FAULTS].concat());
    let whole = desk.run("s.toml --out whole");
    let killed = survives(&desk, &whole, [0, 700, 1500, 2600].into_iter());
    assert!(killed > 1, "all but {killed} were quicker");
    desk.refuses(2, "recover whole", "summary.json");
}
