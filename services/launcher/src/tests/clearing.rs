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
    let (mut node, mut is_cleared) = (None, None);
    let plan = plan(Mode::Lockstep, budget(1));
    let ran = run(plan, "controller", 20_000, |run, event| match event {
        Event::Progress { ticks: 51.. } if node.is_none() => {
            let folder = node_of(run, "controller");
            std::fs::write(folder.join("unfinished.service_tag"), "").unwrap();
            node = Some(folder);
            kill(run, "controller", Signal::KILL);
        }
        Event::Restarted { .. } => {
            is_cleared = node.as_ref().map(|folder: &PathBuf| !folder.exists());
        }
        _ => {}
    });
    assert_eq!(
        (ran.outcome.end, is_cleared),
        (End::Completed, Some(true)),
        "of {node:?}"
    );
    assert!(!is_left_behind(&ran.name));
}
