//! Remains of a process that died while it made something.

use super::*;

/// The folder of a process's node.
fn node_of(run: &str, process: &str) -> PathBuf {
    let entries = |folder: &Path| {
        std::fs::read_dir(folder)
            .unwrap()
            .flatten()
            .map(|entry| entry.path())
    };
    let is_it = |file: PathBuf| {
        let text = std::fs::read(&file).unwrap_or_default();
        file.extension()
            .is_some_and(|extension| extension == "details")
            && text
                .windows(process.len())
                .any(|part| part == process.as_bytes())
    };
    let nodes = entries(&Path::new(SHM).join(run).join("nodes"));
    nodes
        .filter(|node| node.is_dir())
        .find(|node| entries(node).any(is_it))
        .unwrap()
}

#[test]
fn a_process_that_dies_while_it_makes_a_tag_is_cleared_away() {
    let back_off = Duration::from_millis(1);
    let launcher =
        Launcher::prepare(plan(Mode::Lockstep, Restart::Budget { times: 1, back_off })).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let (mut node, mut is_cleared) = (None, None);
    let mut report = |event: Event<'_>| match event {
        Event::Progress { ticks } if ticks > 50 && node.is_none() => {
            let folder = node_of(&name, "controller");
            std::fs::write(folder.join("unfinished.service_tag"), "").unwrap();
            node = Some(folder);
            kill_process(pid_of(&name, "controller").unwrap(), Signal::KILL).unwrap();
        }
        Event::Restarted { .. } => is_cleared = node.as_ref().map(|folder| !folder.exists()),
        _ => {}
    };
    let outcome = launcher
        .run(&command("controller", 20_000), &mut report)
        .unwrap();
    assert_eq!(
        (outcome.end, is_cleared),
        (End::Completed, Some(true)),
        "of {node:?}"
    );
    assert!(!is_left_behind(&name));
}
