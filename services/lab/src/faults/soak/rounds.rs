//! The soak: real-time runs of the whole graph, one after the other, injected at random by every fault and by signals from outside; nothing lost
//! that should not be, and nothing left over.

use std::path::{Path, PathBuf};

use model::Robot;
use runtime::random;
use serde::Serialize;
use session::{Failure, Observer, Progress, load};
use shared_types::scenario::Scenario;

use super::draw::FaultDraw;
use super::round::{Round, Setting};
use super::tally::{Kind, Totals, kinds};
use crate::folder::Folder;
use crate::prolonged::prolonged;

/// How long a round is planned; s. The budget of restarts and the fault table are a run's.
const ROUND_S: f64 = 60.0;

/// A shorter rest is not worth another round; s.
const SHORTEST_S: f64 = 10.0;

/// Bound of the soak's own growth from its second round on; kB. The allocator keeps memory used to read a recording.
const GROWTH_KB: u64 = 16_384;

/// The soak's own use of resources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// Resident memory, kB.
    pub resident_kb: u64,
    /// Open files.
    pub open_files: u64,
    /// Threads.
    pub threads: u64,
}

impl Usage {
    fn now() -> Self {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let number = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            line.and_then(|rest| rest.split_whitespace().next()?.parse().ok())
                .unwrap_or_default()
        };
        let open_files = std::fs::read_dir("/proc/self/fd").map_or(0, |files| files.count() as u64);
        Self {
            resident_kb: number("VmRSS:"),
            open_files,
            threads: number("Threads:"),
        }
    }

    /// The growth since an earlier count.
    fn grown_since(self, earlier: Self) -> Vec<String> {
        let mut grown = Vec::new();
        let mut unless = |is_flat: bool, what: &str, before: u64, now: u64| {
            if !is_flat {
                grown.push(format!(
                    "the soak itself has grown from {before} to {now} {what}"
                ));
            }
        };
        let kb = self.resident_kb;
        unless(
            kb <= earlier.resident_kb + GROWTH_KB,
            "kB",
            earlier.resident_kb,
            kb,
        );
        unless(
            self.open_files <= earlier.open_files,
            "open files",
            earlier.open_files,
            self.open_files,
        );
        unless(
            self.threads <= earlier.threads,
            "threads",
            earlier.threads,
            self.threads,
        );
        grown
    }
}

/// All rounds.
#[derive(Clone, Debug, Serialize)]
pub struct Soak {
    /// Seed.
    pub seed: u64,
    /// Ticks per second.
    pub rate_hz: u32,
    /// Whether every round kept every guarantee.
    pub passed: bool,
    /// By which signal the soak was ended before its time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interrupted: Option<String>,
    /// By kind of fault.
    pub kinds: Vec<Kind>,
    /// Sums and maxima over all rounds.
    pub totals: Totals,
    /// Rounds.
    pub rounds: Vec<Round>,
    /// After each round.
    pub usage: Vec<Usage>,
    /// The folder that holds the rounds with a broken guarantee.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
}

/// Runs rounds until so many seconds of the arm's time are over; what is broken stays in `out`, or in a temporary folder that is named.
pub fn soak(
    robot: &Robot,
    scenario: &Scenario,
    rate_hz: u32,
    seconds: u64,
    seed: Option<u64>,
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Soak, Failure> {
    let mut signals = session::interrupts()?;
    let folder = Folder::create(out)?;
    let seed = seed.unwrap_or_else(|| runtime::now_ns() % 1_000_000);
    let (seconds, rate) = (seconds as f64, f64::from(rate_hz));
    let mut faults = FaultDraw::new(robot, load::graph(None)?, rate_hz, seed);
    observer(Progress::Begin {
        title: "round 1",
        length: (seconds * rate) as u64,
        unit: "ticks",
    });
    let (mut rounds, mut usage, mut interrupted) = (Vec::<Round>::new(), Vec::<Usage>::new(), None);
    let mut done = 0;
    for number in 1.. {
        // A round that ends early leaves time for another.
        let left_s = seconds - done as f64 / rate;
        if number > 1 && left_s < SHORTEST_S {
            break;
        }
        let scenario = prolonged(scenario, rate_hz, left_s.min(ROUND_S).ceil() as u64);
        let setting = Setting {
            robot,
            scenario: &scenario,
            seconds: scenario.duration_s(),
        };
        let out = folder.path().join(format!("round-{number:03}"));
        std::fs::create_dir_all(&out)
            .map_err(|error| Failure::Work(format!("cannot make {}: {error}", out.display())))?;
        let planned = faults.round(setting.seconds);
        let broken = rounds
            .iter()
            .filter(|round| !round.broken.is_empty())
            .count();
        observer(Progress::Title(&format!(
            "round {number}{}",
            if broken > 0 {
                format!(", {broken} BROKEN")
            } else {
                String::new()
            }
        )));
        let mut progress = |ticks: u64| observer(Progress::Position(done + ticks));
        let round = setting.round(
            number,
            random(seed, number as u64) % 1_000_000_000,
            planned,
            &out,
            &mut progress,
        );
        interrupted = signals.pending();
        let round = match round {
            Ok(round) => round,
            Err(_) if interrupted.is_some() => break,
            Err(failure) => return Err(failure),
        };
        for what in &round.broken {
            observer(Progress::Line(&format!(
                "round {number}, seed {}: {what} ({})",
                round.seed,
                out.display()
            )));
        }
        if round.broken.is_empty() {
            // Nothing to be looked at: twenty-five megabytes a minute.
            let _ = std::fs::remove_dir_all(&out);
        }
        done += round.ticks;
        let is_over = round.end == "interrupted";
        rounds.push(round);
        usage.push(Usage::now());
        if is_over || interrupted.is_some() {
            break;
        }
    }
    observer(Progress::End);
    let mut passed = rounds.iter().all(|round| round.broken.is_empty());
    if let (Some(second), Some(last), Some(round)) = (usage.get(1), usage.last(), rounds.last_mut())
    {
        let grown = last.grown_since(*second);
        passed &= grown.is_empty();
        round.broken.extend(grown);
    }
    let folder = (!passed).then(|| folder.keep());
    Ok(Soak {
        seed,
        rate_hz,
        passed,
        interrupted: interrupted.map(str::to_owned),
        kinds: kinds(&rounds),
        totals: Totals::of(&rounds),
        rounds,
        usage,
        folder,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_named_and_the_reserve_of_an_allocator_is_not() {
        let before = Usage {
            resident_kb: 50_000,
            open_files: 12,
            threads: 1,
        };
        assert!(
            Usage {
                resident_kb: 60_000,
                ..before
            }
            .grown_since(before)
            .is_empty()
        );
        for (grown, word) in [
            (
                Usage {
                    resident_kb: 70_000,
                    ..before
                },
                "70000 kB",
            ),
            (
                Usage {
                    open_files: 13,
                    ..before
                },
                "13 open files",
            ),
            (
                Usage {
                    threads: 2,
                    ..before
                },
                "2 threads",
            ),
        ] {
            let said = grown.grown_since(before);
            assert!(said.len() == 1 && said[0].ends_with(word), "{said:?}");
        }
        let now = Usage::now();
        assert!(
            now.resident_kb > 1_000 && now.open_files >= 3 && now.threads >= 1,
            "{now:?}"
        );
    }
}
