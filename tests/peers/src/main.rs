//! Half a round trip between two processes whose readers sleep: armplane's topics beside other middleware (docs/performance.md).
//!
//!     cargo run --release [PROGRAM [PYTHON]]      the `armplane` to measure, and a Python with cyclonedds and lcm
//!
//! In every round each peer starts anew, on one core and across two, so that all see the same machine. Whoever sends writes every byte, and whoever
//! receives reads them all. `chrt` and `taskset` of util-linux give both processes SCHED_FIFO and their core, `timeout` ends a peer that lost a message.

mod transports;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write, stdin, stdout};
use std::net::TcpListener;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use std::{env, fs, thread};

use transports::{Ends, Failure};

/// Bytes of a message, one of them the size that a topic of armplane has, and trips of a round.
const SIZES: [(usize, u64); 5] = [
    (64, 2000),
    (OURS, 2000),
    (1 << 10, 2000),
    (64 << 10, 1000),
    (4 << 20, 50),
];
const OURS: usize = 776;
const ROUNDS: usize = 5;
/// Trips before those that count.
const WARM: u64 = 20;
const PEERS: [&str; 6] = [
    "futex",
    "armplane",
    "iceoryx2",
    "zenoh",
    "cyclonedds",
    "lcm",
];
const PLACES: [(&str, [&str; 2]); 2] = [("one core", ["0", "0"]), ("across", ["0", "1"])];
/// Longest time of a peer in a round, s; and how long its two ends may take to find each other.
const LONGEST: &str = "6";
const DISCOVERY: Duration = Duration::from_millis(500);

/// Medians of the rounds, µs, by peer, place and bytes.
type Times = BTreeMap<(&'static str, &'static str, usize), Vec<f64>>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    if let [word, name, me] = &arguments[..]
        && word == "end"
    {
        return end(name, me.parse()?);
    }
    let argument = |index: usize, default: &str| {
        let given = arguments.get(index);
        given.cloned().unwrap_or_else(|| default.to_owned())
    };
    let (program, python) = (argument(0, "armplane"), argument(1, "python3"));
    let name = format!("peers-{}", std::process::id());
    let folder = format!("/dev/shm/{name}");
    let mut times = Times::new();
    for round in 0..ROUNDS {
        for (place, cores) in PLACES {
            for peer in PEERS {
                eprintln!("round {round}, {place}, {peer}");
                fs::create_dir_all(&folder)?;
                let measured = match peer {
                    "armplane" => ours(&program, place),
                    _ => pair(peer, cores, &python, &folder),
                };
                for (bytes, time) in measured.unwrap_or_else(|failure| {
                    eprintln!("{peer}: {failure}");
                    Vec::new()
                }) {
                    times.entry((peer, place, bytes)).or_default().push(time);
                }
                remove(&name)?;
            }
        }
    }
    zenoh::shm::cleanup_orphaned_shm_segments();
    print(&times);
    Ok(())
}

/// Removes what a peer has left: the folder of both ends, and iceoryx2's files beside it.
fn remove(name: &str) -> Result<(), Failure> {
    for entry in fs::read_dir("/dev/shm")? {
        let path = entry?.path();
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() && file == name {
            fs::remove_dir_all(path)?;
        } else if file.starts_with(&format!("{name}_")) {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// The time of a topic, as `armplane bench hop` measures it.
fn ours(program: &str, place: &str) -> Result<Vec<(usize, f64)>, Failure> {
    let place = if place == "across" { "cross" } else { "same" };
    let bytes = OURS.to_string();
    let arguments = ["bench", "hop", "--json", "--samples", "2000"];
    let only = ["--only", "topic", "--only", place, "--only", &bytes];
    let done = Command::new(program).args(arguments).args(only).output()?;
    let result: serde_json::Value = serde_json::from_slice(&done.stdout)?;
    let rows = result["rows"].as_array().ok_or("no rows")?;
    let row = rows.iter().find(|row| row["mechanism"] != "futex");
    let time = row.and_then(|row| row["p50_us"].as_f64());
    Ok(vec![(OURS, time.ok_or("no topic")?)])
}

/// One end of a peer: its process, what it hears and what it says.
struct Process(Child, ChildStdin, BufReader<ChildStdout>);

/// Both ends of a peer as processes on their cores, and the median of each size in µs.
fn pair(
    peer: &str,
    cores: [&str; 2],
    python: &str,
    folder: &str,
) -> Result<Vec<(usize, f64)>, Failure> {
    // A port that nobody listens on.
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let sizes = SIZES.map(|(bytes, trips)| format!("{bytes}:{}", WARM + trips));
    let start = |me: usize| -> Result<Process, Failure> {
        let mut command = Command::new("timeout");
        command.args([LONGEST, "chrt", "-f", "80", "taskset", "-c", cores[me]]);
        match peer {
            "cyclonedds" | "lcm" => {
                let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers.py");
                command.args([python, script, peer, &me.to_string()]);
                command.args(&sizes)
            }
            _ => command
                .arg(env::current_exe()?)
                .args(["end", peer, &me.to_string()]),
        };
        command.env("PEERS_FOLDER", folder);
        command.env("PEERS_PORT", port.to_string());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let into = child.stdin.take().ok_or("no input")?;
        let mut from = BufReader::new(child.stdout.take().ok_or("no output")?);
        let mut line = String::new();
        from.read_line(&mut line)?;
        if line != "ready\n" {
            return Err(format!("end {me} says {line:?} instead of ready").into());
        }
        Ok(Process(child, into, from))
    };
    let (mut first, mut second) = (start(0)?, start(1)?);
    thread::sleep(DISCOVERY);
    first.1.write_all(b"go\n")?;
    let mut measured = Vec::new();
    for line in first.2.lines() {
        let line = line?;
        let (bytes, time) = line.split_once(' ').ok_or("no time")?;
        measured.push((bytes.parse()?, time.parse()?));
    }
    drop(second.1);
    first.0.wait()?;
    second.0.wait()?;
    Ok(measured)
}

/// One end: the first sends and takes the time until the answer, the second answers.
fn end(name: &str, me: usize) -> Result<(), Failure> {
    let ends = transports::open(name, me)?;
    println!("ready");
    stdout().flush()?;
    let mut line = String::new();
    if me == 0 {
        stdin().read_line(&mut line)?;
    }
    for (
        (bytes, trips),
        Ends {
            mut send,
            mut receive,
        },
    ) in SIZES.into_iter().zip(ends)
    {
        let mut times = Vec::new();
        for number in 0..WARM + trips {
            let began = Instant::now();
            if me == 0 {
                send(number)?;
            }
            let came = receive()?;
            if came != number {
                return Err(format!("{name} handed over {came} instead of {number}").into());
            }
            if me == 1 {
                send(number)?;
            }
            times.push(began.elapsed().as_secs_f64() * 1e6 / 2.0);
        }
        if me == 0 {
            println!("{bytes} {}", median(&mut times[WARM as usize..]));
        }
    }
    // Nothing of the second is taken away before the first has its last answer.
    if me == 1 {
        stdin().read_line(&mut line)?;
    }
    Ok(())
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// The medians of each one's quickest round as a table, µs: the clock of a machine may change between rounds.
fn print(times: &Times) {
    println!("|bytes|cores|{}|", PEERS.join("|"));
    println!("|---|---|{}", "---|".repeat(PEERS.len()));
    for (bytes, _) in SIZES {
        for (place, _) in PLACES {
            let cells = PEERS.map(|peer| match times.get(&(peer, place, bytes)) {
                Some(rounds) if rounds.len() > ROUNDS / 2 => {
                    format!("{:.1}", rounds.iter().copied().fold(f64::MAX, f64::min))
                }
                _ => "–".to_owned(),
            });
            println!("|{bytes}|{place}|{}|", cells.join("|"));
        }
    }
}
