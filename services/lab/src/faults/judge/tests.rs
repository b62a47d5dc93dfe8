use super::*;
use model::Robot;
use session::Results;
use session::load;
use shared_types::codes::DRIVE_STOPPING;
use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::{Summary, TopicSummary};

fn state(tick: u64, q: f64, drive: u32) -> PlantState {
    let mut state = PlantState {
        drive,
        ..PlantState::default()
    };
    (state.header.tick, state.q[0]) = (tick, q);
    state
}

/// The checks that a run of an arm at rest breaks in real time, after `corrupt`.
fn judged(corrupt: impl Fn(&mut Ran)) -> Vec<&'static str> {
    let robot = Robot::builtin("puma560").unwrap();
    let name = "fig5-wrist-rotation";
    let folder = tempfile::tempdir().unwrap();
    let results = Results::within(folder.path(), name).unwrap();
    let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap();
    let job = load::job(
        &robot,
        scenario,
        load::graph(None).unwrap(),
        Mode::Realtime,
        "nowhere".into(),
    );
    let stage = Stage {
        results,
        job: Job {
            record: false,
            ..job.clone()
        },
        robot: &robot,
        without: None,
    };
    let mut ran = Ran {
        job: stage.job.clone(),
        failure: None,
        summary: Summary {
            completed: true,
            ticks: 10_000,
            ..Summary::default()
        },
        truth: (0..100)
            .map(|tick| state(tick, 0.0, DRIVE_ACTIVE))
            .collect(),
        samples: vec![SensorSample::default()],
        left_behind: Vec::new(),
    };
    ran.summary.recorder.messages = 50_000;
    ran.summary.topics = (0..5)
        .map(|topic| (topic.to_string(), TopicSummary::default()))
        .collect();
    corrupt(&mut ran);
    let cell = stage.judge(&ran, None).unwrap();
    cell.broken.iter().map(|broken| broken.check).collect()
}

fn fault(fault: Fault, at: u64) -> FaultSummary {
    let plan = Fault {
        at_tick: Some(at),
        for_ticks: Some(10),
        ..fault
    };
    FaultSummary {
        tick: at,
        process: plan.process.clone(),
        occurred: true,
        plan: Some(plan),
        ..FaultSummary::default()
    }
}

fn died(process: &str) -> Option<Mishap> {
    Some(Mishap::Died {
        process: process.to_owned(),
        pid: 1,
        exit: launcher::Exit::Signal(9),
        tick: 1,
        restarts: 0,
        roll_backs: 0,
        suspect: None,
        last_words: Vec::new(),
    })
}

type Corrupt<'a> = &'a dyn Fn(&mut Ran);

#[test]
fn each_guarantee_that_is_broken_is_caught_and_nothing_else() {
    let of = |process: &str, kind, at| fault(Fault::new(process, kind), at);
    let detected = |kind: &str| FaultSummary {
        kind: kind.to_owned(),
        origin: "detected".to_owned(),
        ..of("analyzer", Kind::Kill, 50)
    };
    let full = || vec![of("recorder", Kind::DiskFull, 50)];
    let cases: &[(&[&str], Corrupt<'_>)] = &[
        (&[], &|_| ()),
        (&["finite", "speed"], &|ran| {
            ran.truth[50].qdot[3] = f64::NAN
        }),
        (&["torque", "step"], &|ran| ran.truth[50].tau[0] = -200.0),
        (&["step"], &|ran| ran.truth[50].tau[5] = 20.0),
        (&["speed"], &|ran| ran.truth[50].qdot[1] = 50.0),
        (&[], &|ran| {
            (ran.truth[50].qdot[1], ran.truth[50].tau[5]) = (50.0, 20.0);
            ran.summary.faults = vec![of("plant", Kind::Drive, 45)];
        }),
        (&["age"], &|ran| {
            (ran.samples[0].drive, ran.samples[0].stale_ticks) = (DRIVE_HOLDING, 4)
        }),
        (&[], &|ran| {
            (ran.samples[0].drive, ran.samples[0].stale_ticks) = (DRIVE_STOPPING, 400)
        }),
        (&["fresh"], &|ran| ran.truth[50].drive_flags = DRIVE_ABSENT),
        (&["end"], &|ran| {
            (ran.truth[99].qdot[0], ran.summary.task.final_position_mm) = (0.1, 9.0)
        }),
        (&["end"], &|ran| ran.failure = died("plant")),
        (&[], &|ran| {
            ran.failure = died("plant");
            ran.summary.faults = vec![of("plant", Kind::Kill, 9_000)];
        }),
        (&["end"], &|ran| {
            ran.summary.faults = vec![of("plant", Kind::Kill, 50)]
        }),
        (&["death"], &|ran| {
            ran.summary.faults = vec![of("controller", Kind::Kill, 50)]
        }),
        (&["follow"], &|ran| {
            let back = |one: &str| FaultSummary {
                detected_ms: Some(1.0),
                recovered_ms: Some(2.0),
                ..of(one, Kind::Kill, 50)
            };
            ran.summary.faults = vec![back("controller")];
            for state in &mut ran.truth[49..] {
                state.drive = DRIVE_BRAKED;
            }
        }),
        (&["unrequested-end"], &|ran| {
            ran.summary.faults = vec![detected("exit")]
        }),
        (&[], &|ran| {
            ran.summary.faults = vec![detected("exit"), of("plant", Kind::Corrupt, 1)]
        }),
        (&[], &|ran| {
            ran.summary.faults = vec![detected("kill"), of("analyzer", Kind::Hang, 9_000)]
        }),
        (&["lost"], &|ran| {
            (ran.summary.recorder.messages, ran.summary.recorder.lost) = (1, 1)
        }),
        (&["recording"], &|ran| {
            ran.summary.recorder.error = "full".to_owned()
        }),
        (&["volume"], &|ran| ran.summary.faults = full()),
        (&[], &|ran| {
            ran.summary.faults = full();
            ran.summary.recorder.error = "full".to_owned();
        }),
        (&["left-behind"], &|ran| {
            ran.left_behind.push("armplane-0".to_owned())
        }),
    ];
    for (place, (expected, corrupt)) in cases.iter().enumerate() {
        assert_eq!(judged(corrupt), *expected, "case {place}");
    }
}

#[test]
fn time_lost_is_no_excursion_and_a_detour_is() {
    let at = |k: u64, q: u64| state(k, q as f64, DRIVE_ACTIVE);
    let base: Vec<_> = (0..100).map(|k| at(k, k)).collect();
    // Ten ticks late from tick 50 on.
    let late: Vec<_> = (0..110)
        .map(|k| at(k, if k < 50 { k } else { (k - 10).max(50) }))
        .collect();
    assert_eq!(farthest(&base, &late, joints_apart), 0.0);
    let mut detour = base.clone();
    detour[99].q[0] = 102.5;
    assert_eq!(farthest(&base, &detour, joints_apart), 3.5);
}

#[test]
fn it_is_settled_when_the_drives_follow_again_or_brake() {
    let (active, holding, braked) = (DRIVE_ACTIVE, DRIVE_HOLDING, DRIVE_BRAKED);
    for (drives, at, expected) in [
        ([active; 4], 2, None),
        ([active, holding, holding, active], 1, Some(2)),
        ([active, holding, braked, braked], 1, Some(1)),
    ] {
        let truth: Vec<_> = (0..)
            .zip(drives)
            .map(|(k, drive)| state(k, 0.0, drive))
            .collect();
        assert_eq!(settled(&truth, at), expected);
    }
}
