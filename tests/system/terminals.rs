//! Tables, sentences and live lines in terminals of several sizes.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::os::unix::process::CommandExt;
use std::process::Stdio;

use crate::command::{Desk, Known, Running};
use crate::outputs::pseudo_terminal;

/// Columns and rows; the first is for live lines only, the last is wide enough for every line as it is.
const SIZES: [[u16; 2]; 5] = [[60, 24], [80, 24], [100, 30], [120, 40], [2000, 40]];

/// The streams of a command that go to the terminal.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shows {
    /// Standard output.
    Results,
    /// Standard output, whose last lines, on leftovers, say what other programs do meanwhile.
    Moments,
    /// Standard error, too.
    All,
}

/// The output of a command on a terminal of its own; as soon as it has written `until`, `keys` are pressed.
fn on_terminal(
    desk: &Desk,
    args: &str,
    size: [u16; 2],
    [until, keys]: [&str; 2],
    shows: Shows,
) -> String {
    let (mut terminal, end) = pseudo_terminal(size);
    let mut command = desk.command(args);
    let stream = || end.try_clone().expect("a descriptor");
    command.stdin(stream()).stdout(stream());
    if shows == Shows::All {
        command.stderr(stream());
    } else {
        command.stderr(Stdio::null());
    }
    // Its size is asked of the terminal of the session.
    // SAFETY: both may be called between fork and exec.
    unsafe {
        command.pre_exec(|| {
            libc::setsid();
            libc::ioctl(0, libc::TIOCSCTTY, 0);
            Ok(())
        });
    }
    let mut child = command.spawn().expect("armplane starts");
    drop((command, end));
    let (mut written, mut part, mut is_pressed) = (Vec::new(), [0; 4096], false);
    // The terminal is gone when the last program has closed it.
    while let Ok(bytes @ 1..) = terminal.read(&mut part) {
        written.extend_from_slice(&part[..bytes]);
        let is_there = !is_pressed && String::from_utf8_lossy(&written).contains(until);
        if is_there && !keys.is_empty() {
            terminal.write_all(keys.as_bytes()).expect("keys");
            is_pressed = true;
        }
    }
    assert!(child.wait().is_ok(), "{args}");
    String::from_utf8(written).expect("UTF-8")
}

/// Lines as they stand on a terminal, without colours.
fn lines(written: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    let mut letters = written.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\r' | '\n' => lines.push(String::new()),
            '\x1b' => {
                let code = letters
                    .by_ref()
                    .skip(1)
                    .find(|letter| !matches!(letter, ' '..='?'));
                if matches!(code, Some('H' | 'J')) {
                    lines.push(String::new());
                }
            }
            letter => lines.last_mut().expect("a line").push(letter),
        }
    }
    lines
}

/// The words that have no number: those of a clock are others each time.
fn words(lines: &[String]) -> BTreeSet<&str> {
    let words = lines.iter().flat_map(|line| line.split_whitespace());
    words
        .filter(|word| word.chars().all(char::is_alphabetic))
        .collect()
}

/// Every line fits each size. Of results alone: each word of a narrow terminal stands on the widest as well.
fn fits(desk: &Desk, args: &str, keys: [&str; 2], shows: Shows) {
    let mut all = Vec::new();
    let sizes = &SIZES[usize::from(shows != Shows::All)..];
    for (number, size) in sizes.iter().enumerate() {
        let args = args.replace("OUT", &format!("out-{number}-{}", args.len()));
        let written = on_terminal(desk, &args, *size, keys, shows);
        let bare = written.bytes().zip(written.bytes().skip(1));
        assert!(
            bare.clone()
                .all(|(before, byte)| byte != b'\n' || before == b'\r'),
            "{args}: a line begins in mid-screen"
        );
        all.push(lines(&written));
    }
    let is_of_the_moment = |line: &String| shows == Shows::Moments && line.contains("leftovers");
    let settled = |lines: &'_ [String]| {
        let moment = lines.iter().position(is_of_the_moment);
        moment.unwrap_or(lines.len())
    };
    let widest = &all[sizes.len() - 1];
    let wide = words(&widest[..settled(widest)]);
    assert!(wide.len() > 2, "{args}: {wide:?}");
    for ([columns, _], lines) in sizes.iter().zip(&all) {
        let too_wide: Vec<_> = lines
            .iter()
            .filter(|line| line.chars().count() > usize::from(*columns))
            .collect();
        assert!(
            too_wide.is_empty(),
            "{args} at {columns} columns: {too_wide:#?}"
        );
        let narrow = words(&lines[..settled(lines)]);
        let broken: Vec<_> = narrow
            .difference(&wide)
            .filter(|_| shows != Shows::All)
            .collect();
        assert!(broken.is_empty(), "{args} at {columns} columns: {broken:?}");
    }
}

#[test]
fn every_table_and_live_line_fits_the_terminal() {
    let desk = Desk::new();
    for args in [
        "run --out OUT",
        "servo panda --random 1 --duration 1 --out OUT",
        "verify --runs 1",
        "run nonsense",
        "new nothing --robot nonsense",
    ] {
        fits(&desk, args, ["", ""], Shows::All);
    }
    let keyboard = "servo ur5 --from keyboard --out OUT";
    fits(&desk, keyboard, ["of its bound", "q"], Shows::All);
    fits(&desk, "doctor", ["", ""], Shows::Moments);
    for args in [
        "list",
        "--help",
        "graph",
        "graph --format topics",
        "fault --list",
        "inspect --robot panda",
        "inspect --robot puma560 --q ready",
        "diff out-0-13 out-1-13",
        "replay out-0-13 --set control.k_p=300",
        "compare fig5-wrist-rotation --out OUT",
        "compare sweep --count 6 --out OUT",
        "compare sweep --robot ur5 --count 1 --out OUT",
        "bench steps",
        "bench hop --samples 1000 --only topic",
    ] {
        fits(&desk, args, ["", ""], Shows::Results);
    }
}

#[test]
fn a_run_is_found_by_its_folder_and_seen_at_every_size() {
    let desk = Desk::new();
    let run = desk.begin("run --set segment.1.duration_s=500 --no-record --out mine");
    let listed = desk.json("ps");
    let mut all = listed.list().iter();
    let own = all
        .find(|one| one["launcher_pid"] == run.id())
        .expect("it is listed");
    let folder = desk.at("mine").canonicalize().expect("a folder");
    own.holds(r#"{"scenario": "fig5-wrist-rotation"}"#);
    assert_eq!(own["folder"], folder.display().to_string());
    fits(&desk, "ps", ["", ""], Shows::All);
    fits(&desk, "top --once --run mine", ["", ""], Shows::All);
    let live = "top --every-ms 50 --run mine";
    fits(&desk, live, ["q quits", "q"], Shows::All);
    run.interrupt();
}
