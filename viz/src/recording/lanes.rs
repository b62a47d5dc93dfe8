//! Modes, states, faults and words, as they change.

use re_sdk_types::archetypes::{StateChange, StateConfiguration, TextDocument};
use shared_types::codes::{DRIVES, MODES, PHASES, name_of};
use shared_types::{MAX_SINGULARITIES, Message};

use super::{Level, Recording};
use crate::entity::{self, LIVES};
use crate::narration::{self, FAULT_COLOUR, Moment, NO_FAULT};
use crate::signals::TickRow;

/// A message that is missing for so many ticks is late, not absent.
const PATIENCE: u64 = 3;

/// Places of the lanes but the faults': the processes, drive, phase, and each singularity.
const DRIVE: usize = LIVES;
const PHASE: usize = LIVES + 1;
const FIRST_MODE: usize = LIVES + 2;
pub(super) const LANES: usize = FIRST_MODE + MAX_SINGULARITIES;

/// A fault in force: its number, its words for the lane and for the headline, and when it is over, as soon as that is known.
pub(super) struct Fault {
    number: usize,
    lane: String,
    headline: String,
    pub(super) until: Option<u64>,
}

impl Recording {
    /// A fault takes effect: its number, its words for the lane and for the headline.
    pub fn fault_begins(&mut self, tick: u64, number: usize, lane: &str, headline: &str) {
        let (lane, headline) = (lane.to_owned(), headline.to_owned());
        self.story.faults.push(Fault {
            number,
            lane,
            headline,
            until: None,
        });
        self.write_fault_lane(tick);
    }

    /// A fault is over at a tick, be it past or still to come.
    pub fn fault_ends(&mut self, tick: u64, number: usize) {
        let faults = self.story.faults.iter_mut();
        faults
            .filter(|fault| fault.number == number)
            .for_each(|fault| fault.until = Some(tick));
    }

    fn write_fault_lane(&mut self, tick: u64) {
        let text = self
            .story
            .faults
            .last()
            .map_or(NO_FAULT.0, |fault| fault.lane.as_str())
            .to_owned();
        if self.part.fault.as_ref() == Some(&text) {
            return;
        }
        if text != NO_FAULT.0 && !self.story.fault_states.contains(&text) {
            self.story.fault_states.push(text.clone());
            let states = self.story.fault_states.iter();
            let states = states.map(|state| (state.as_str(), FAULT_COLOUR));
            self.style(
                entity::state("fault"),
                &states.chain([NO_FAULT]).collect::<Vec<_>>(),
            );
        }
        self.log(
            tick,
            entity::state("fault"),
            &StateChange::single(text.as_str()),
        );
        self.part.fault = Some(text);
        self.part.told.clear();
    }

    pub(super) fn write_changes(&mut self, row: &TickRow) {
        let before = self.story.faults.len();
        self.story
            .faults
            .retain(|fault| fault.until.is_none_or(|until| row.tick < until));
        if self.part.fault.is_none() || self.story.faults.len() < before {
            self.write_fault_lane(row.tick);
        }
        let mut now = self.lives(row);
        if let Some(sensor) = row.sensor {
            now[DRIVE] = name_of(DRIVES, sensor.drive);
        }
        if let Some(torque) = row.torque {
            now[PHASE] = name_of(PHASES, torque.phase);
        }
        if let Some(command) = row.control_state {
            for i in 0..self.subject.singularities.len().min(MAX_SINGULARITIES) {
                now[FIRST_MODE + i] = name_of(MODES, command.mode[i]);
            }
        }
        for (place, state) in now.into_iter().enumerate() {
            let before = self.part.lanes[place];
            if state.is_empty() || state == before {
                continue;
            }
            self.part.lanes[place] = state;
            let name = self.lane(place);
            self.log(row.tick, name.as_str(), &StateChange::single(state));
            if place >= FIRST_MODE && !before.is_empty() {
                let text = format!("{}: {before} → {state}", name.trim_start_matches('/'));
                self.event(row.tick, Level::Info, &text);
            }
        }
        self.write_words(row);
    }

    /// The path of a lane.
    fn lane(&self, place: usize) -> String {
        match place {
            DRIVE => entity::state("drive"),
            PHASE => entity::state("phase"),
            FIRST_MODE.. => entity::state(&self.subject.singularities[place - FIRST_MODE].0),
            _ => entity::life((place, self.subject.lives.name(place))),
        }
    }

    fn write_words(&mut self, row: &TickRow) {
        // A tick or two without a command is not worth a line.
        self.story.unheard = match row.torque {
            Some(_) => 0,
            None => self.story.unheard + 1,
        };
        self.story.history.push(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.story.unheard >= 5;
        let is_due = self.part.told.is_empty() || self.is_pictured(row.tick);
        if !told || !is_due || self.rival.is_some() {
            return;
        }
        let task = self.run.task.iter().filter(|served| **served);
        let fault = self.story.faults.last();
        let moment = Moment {
            row,
            history: &self.story.history,
            title: &self.run.title,
            joints: self.subject.joints,
            rate_hz: self.run.rate_hz,
            directions: task.count().min(self.subject.joints),
            fault: fault.map(|fault| fault.headline.as_str()),
        };
        let words = moment.markdown();
        if self.part.told != words {
            self.log(
                row.tick,
                entity::NOW,
                &TextDocument::from_markdown(words.as_str()),
            );
            self.part.told = words;
        }
    }

    /// The states of the processes. A writer whose own input is missing waits; one that has its input and writes nothing is silent.
    fn lives(&mut self, row: &TickRow) -> [&'static str; LANES] {
        let plant = row
            .sensor
            .map(Message::header)
            .or(row.plant_state.map(Message::header));
        let headers = [
            plant,
            row.estimate.map(Message::header),
            row.singularity.map(Message::header),
            row.torque.map(Message::header),
        ];
        let has_sensor = row.sensor.is_some();
        let has_estimate = row.estimate.is_some();
        let has_input = [
            true,
            has_sensor,
            has_estimate,
            has_estimate && row.singularity.is_some(),
        ];
        let mut now = [""; LANES];
        for (i, lane) in now.iter_mut().enumerate().take(LIVES) {
            if self.subject.lives.name(i).is_empty() {
                continue;
            }
            let header = headers.get(i).copied().flatten();
            let incarnation = header.map_or(0, |header| header.incarnation);
            self.note_incarnation(row.tick, i, incarnation);
            let missing = &mut self.story.missing[i];
            *missing = if incarnation == 0 { *missing + 1 } else { 0 };
            *lane = match has_input.get(i) {
                Some(_)
                    if incarnation == 0
                        && *missing < PATIENCE
                        && !self.part.lanes[i].is_empty() =>
                {
                    ""
                }
                Some(true) if incarnation == 0 => "silent",
                Some(false) if incarnation == 0 => "waiting",
                // The recorder among them, which writes this.
                _ if row.tick < self.part.fresh_until[i] => "restarted",
                _ => "up",
            };
        }
        now
    }

    /// A process that has come again is told.
    fn note_incarnation(&mut self, tick: u64, i: usize, incarnation: u32) {
        let before = self.story.incarnations[i];
        self.story.incarnations[i] = before.max(incarnation);
        if before > 0 && incarnation > before {
            let name = self.subject.lives.name(i);
            let text = format!("{name} is back as incarnation {incarnation}");
            self.event(tick, Level::Warning, &text);
            self.part.fresh_until[i] = tick + self.every(0.5);
        }
    }

    /// The recorder that writes this part has taken up where one before it ended: its lane says so from tick `from` on.
    pub fn recorder_restarted(&mut self, from: u64) {
        self.part.fresh_until[LIVES - 1] = from + self.every(0.5);
    }

    pub(super) fn style_lanes(&self) {
        self.style(entity::state("fault"), &[NO_FAULT]);
        self.style(self.lane(DRIVE), narration::DRIVE_STATES);
        self.style(self.lane(PHASE), narration::PHASE_STATES);
        for life in self.subject.lives.named() {
            self.style(entity::life(life), narration::LIFE_STATES);
        }
    }

    /// A lane per singularity, known from a part's first report on.
    pub(super) fn style_modes(&self) {
        for (name, _) in &self.subject.singularities {
            self.style(entity::state(name), narration::MODE_STATES);
        }
    }

    fn style(&self, path: String, states: &[(&str, u32)]) {
        let names = || states.iter().map(|(name, _)| *name);
        let configuration = StateConfiguration::new()
            .with_values(names())
            .with_labels(names())
            .with_colors(states.iter().map(|(_, colour)| *colour));
        self.log_static(path, &configuration);
    }
}
