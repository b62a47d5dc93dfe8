//! The operator of a steered run: publishes the target of each tick, from the session's text or
//! from lines sent to it during the run.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod cycle;
mod kept;
mod keys;

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::{Duration, Instant};

use bytemuck::bytes_of;
use process::{Inputs, Step};
use runtime::{Mode, Outside, ProcessError, Shell, drive};
use shared_types::scenario::{Scenario, Servo};
use shared_types::target_file::{live, unreadable};
use shared_types::{Message, Target, TargetContent};

pub use keys::Keys;

use cycle::Cycle;
use kept::Kept;

/// A message of this length is cut off, or may be; bytes.
pub const LONGEST: usize = 2048;

/// Largest delay behind the clock that is made up for. After a longer one, the session continues
/// from there.
const BEHIND: Duration = Duration::from_millis(20);

/// Publishes targets until the run stops.
///
/// A live session in lockstep runs at the speed of the clock, because this process waits for it at each tick and all others wait for this one: so its
/// targets, kept with their ticks, repeat it byte for byte. After a roll-back they come from the file `kept`, as fast as the others can follow, and then
/// the session goes on at the speed of the clock.
///
/// # Errors
/// [`ProcessError`] if the socket cannot be made or the graph breaks.
pub fn run(shell: &Shell, scenario: &Scenario, kept: &Path) -> Result<(), ProcessError> {
    let session = scenario.servo.clone().unwrap_or_default();
    let after_end = session.after_end(scenario.rate_hz);
    if after_end > 0 && shell.incarnation() == 1 {
        tracing::warn!("targets that follow the `end` of the session have no effect: {after_end}");
    }
    let mut process = Cycle::begin(&session, scenario.rate_hz);
    if !session.live {
        return drive(shell, &mut process, &mut ());
    }
    let mut live = Live::open(shell, scenario.rate_hz, kept)?;
    drive(shell, &mut process, &mut live)
}

/// The process of a steered run whose targets stand in its scenario. PURE.
#[must_use]
pub fn process(scenario: &Scenario) -> Box<dyn Step> {
    let session = scenario.servo.clone().unwrap_or_default();
    Box::new(Cycle::begin(&session, scenario.rate_hz))
}

fn unusable(path: &Path, error: &io::Error) -> ProcessError {
    ProcessError::setup(format_args!("{}: {error}", path.display()))
}

/// Targets that come while the run lasts, a line each, without its time: `twist, base, 0.2, 0.01 0 0 0 0 0`.
struct Live {
    socket: UnixDatagram,
    rate_hz: u32,
    /// In lockstep: when tick 0 was, or would have been.
    began: Option<Instant>,
    /// In lockstep, where this process sets the pace.
    kept: Option<Kept>,
    /// Lines that were no target.
    complaints: u32,
    /// First tick after the target in force.
    is_over: u64,
    /// The tick at which the session ends, once its input has ended.
    ends: Option<u64>,
    /// The last target that came in the tick in hand.
    given: Option<Target>,
}

impl Outside for Live {
    fn add<'a>(&'a mut self, inputs: &mut Inputs<'a>) {
        self.wait(inputs.tick);
        self.given = None;
        self.take_all(inputs.tick);
        let given = self.given.iter();
        given.for_each(|given| inputs.add(Target::TOPIC, bytes_of(given)));
    }
}

/// Lines that are no targets.
const COMPLAINTS: u32 = 5;

impl Live {
    fn open(shell: &Shell, rate_hz: u32, kept: &Path) -> Result<Self, ProcessError> {
        let path = shell.run_dir().join(Servo::SOCKET);
        // That of a predecessor.
        let _ = std::fs::remove_file(&path);
        let refused = |error: io::Error| unusable(&path, &error);
        let from = shell.manifest().from;
        let keeps = (shell.mode() == Mode::Lockstep).then(|| Kept::open(kept, from));
        let kept = keeps.transpose().map_err(|error| unusable(kept, &error))?;
        let socket = UnixDatagram::bind(&path).map_err(refused)?;
        socket.set_nonblocking(true).map_err(refused)?;
        Ok(Self {
            socket,
            rate_hz,
            began: None,
            kept,
            complaints: 0,
            is_over: 0,
            ends: None,
            given: None,
        })
    }

    /// Waits for the time of a tick, if nothing else paces the run.
    fn wait(&mut self, tick: u64) {
        if self.kept.as_ref().is_none_or(|kept| kept.has(tick)) {
            return;
        }
        let (now, offset) = (
            Instant::now(),
            Duration::from_secs_f64(tick as f64 / f64::from(self.rate_hz)),
        );
        let due = *self
            .began
            .get_or_insert_with(|| now.checked_sub(offset).unwrap_or(now))
            + offset;
        if let Some(early) = due.checked_duration_since(now) {
            std::thread::sleep(early);
        } else if now.duration_since(due) > BEHIND {
            self.began = now.checked_sub(offset);
        }
    }

    /// Names the first lines that are no target; the others are counted with the refused ones.
    fn complain(&mut self, line: &str, defect: &str) {
        let earlier = self.complaints;
        self.complaints = earlier.saturating_add(1);
        if earlier < COMPLAINTS {
            let line: String = line.chars().take(60).collect();
            let last = if earlier + 1 == COMPLAINTS {
                "; more such lines are only counted"
            } else {
                ""
            };
            tracing::warn!("not a target: `{}`: {defect}{last}", line.escape_debug());
        }
    }

    /// A target takes effect at a tick.
    fn feed(&mut self, target: TargetContent, tick: u64) {
        if let Some(kept) = &mut self.kept {
            kept.add(tick, &target);
        }
        self.give(target);
    }

    /// Takes in the targets of a tick: those of a start before a roll-back, or what has come since the tick before.
    fn take_all(&mut self, tick: u64) {
        while let Some(target) = self.kept.as_mut().and_then(|kept| kept.take(tick)) {
            self.give(target);
        }
        if self.kept.as_ref().is_none_or(|kept| !kept.has(tick)) {
            self.receive(tick);
        }
        if let Some(kept) = &mut self.kept {
            kept.close(tick);
        }
    }

    fn give(&mut self, target: TargetContent) {
        self.given = Some(Target {
            target,
            ..Target::default()
        });
    }

    fn take(&mut self, target: Result<TargetContent, (&str, String)>, tick: u64) {
        let target = target.unwrap_or_else(|(line, defect)| {
            self.complain(line, &defect);
            unreadable(tick)
        });
        let rest_s = target.valid_s.clamp(0.0, Servo::LONGEST_REST_S);
        self.is_over = tick + (rest_s * f64::from(self.rate_hz)).ceil() as u64;
        self.feed(target, tick);
    }

    /// Takes in received lines, up to one that is no target. That line is published for a tick as
    /// unreadable, so that the controller counts it.
    fn receive(&mut self, tick: u64) {
        let mut message = [0; LONGEST];
        let before = self.complaints;
        while self.complaints == before
            && let Ok(length) = self.socket.recv(&mut message)
        {
            // A line that is no text has a character in it that stands for what is none, so it is no target either.
            let text = &*String::from_utf8_lossy(&message[..length]);
            if text == Servo::CLOSE {
                self.ends = Some(self.is_over.max(tick));
                continue;
            }
            if length == LONGEST {
                self.take(Err((text, "it is too long".to_owned())), tick);
                continue;
            }
            for target in live(text, tick, self.rate_hz) {
                self.take(target, tick);
            }
        }
        if self.ends.is_some_and(|ends| ends <= tick) {
            let end = live(Servo::END, tick, self.rate_hz);
            end.flatten().for_each(|end| self.feed(end, tick));
            self.ends = None;
        }
    }
}
