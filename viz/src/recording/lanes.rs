//! Modes, states, faults and words, as they change.

use re_sdk_types::archetypes::{StateChange, StateConfiguration, TextDocument};
use shared_types::codes::{DRIVES, MODES, PHASES, name_of};
use shared_types::{MAX_SINGULARITIES, Message};

use super::state::{Fault, Level, Recording, WRITERS};
use crate::narration::{FAULT_COLOUR, NO_FAULT, Run};
use crate::signals::TickRow;
use crate::{entity, narration};

/// A message that is missing for so many ticks is late, not absent.
const PATIENCE: u64 = 3;

impl Recording {
    /// A fault takes effect: its number, its words for the lane and for the headline.
    pub fn fault_begins(&mut self, tick: u64, number: usize, lane: &str, headline: &str) {
        self.story.faults.push(Fault {
            number,
            lane: lane.to_owned(),
            headline: headline.to_owned(),
            until: None,
        });
        self.write_fault_lane(tick);
    }

    /// A fault is over at a tick, be it past or still to come.
    pub fn fault_ends(&mut self, tick: u64, number: usize) {
        self.story
            .faults
            .iter_mut()
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
        if self.part.lanes.fault.as_deref() == Some(text.as_str()) {
            return;
        }
        if text != NO_FAULT.0 && !self.story.fault_states.contains(&text) {
            self.story.fault_states.push(text.clone());
            let all = self.story.fault_states.clone();
            let styles: Vec<(&str, u32)> = all
                .iter()
                .map(|state| (state.as_str(), FAULT_COLOUR))
                .chain([NO_FAULT])
                .collect();
            self.style(entity::state("fault"), &styles);
        }
        self.lane(tick, "fault", &text);
        self.part.lanes.fault = Some(text);
        self.part.situation = None;
    }

    pub(super) fn write_changes(&mut self, row: &TickRow) {
        let before = self.story.faults.len();
        self.story
            .faults
            .retain(|fault| fault.until.is_none_or(|until| row.tick < until));
        if self.part.lanes.fault.is_none() || self.story.faults.len() < before {
            self.write_fault_lane(row.tick);
        }
        self.write_lives(row);
        if let Some(sensor) = row.sensor
            && self.part.lanes.drive != Some(sensor.drive)
        {
            self.part.lanes.drive = Some(sensor.drive);
            self.lane(row.tick, "drive", name_of(DRIVES, sensor.drive));
        }
        if let Some(torque) = row.torque
            && self.part.lanes.phase != Some(torque.phase)
        {
            self.part.lanes.phase = Some(torque.phase);
            self.lane(row.tick, "phase", name_of(PHASES, torque.phase));
        }
        self.write_modes(row);
        self.write_words(row);
    }

    fn write_modes(&mut self, row: &TickRow) {
        let Some(command) = row.control_state else {
            return;
        };
        for i in 0..self.subject.singularities.len().min(MAX_SINGULARITIES) {
            let mode = command.mode[i];
            if self.part.lanes.modes[i] == Some(mode) {
                continue;
            }
            let before = self.part.lanes.modes[i].replace(mode);
            let (name, mode) = (
                self.subject.singularities[i].0.clone(),
                name_of(MODES, mode),
            );
            self.lane(row.tick, &format!("mode/{name}"), mode);
            if let Some(before) = before {
                let text = format!("{name}: {} → {mode}", name_of(MODES, before));
                self.event(row.tick, Level::Info, &text);
            }
        }
    }

    fn write_words(&mut self, row: &TickRow) {
        // A tick or two without a command is not worth a line.
        self.story.unheard = match row.torque {
            Some(_) => 0,
            None => self.story.unheard + 1,
        };
        self.story.history.push(row);
        let situation = self.story.history.situation(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.story.unheard >= 5;
        if !told || self.part.situation == Some(situation) || self.rival.is_some() {
            return;
        }
        self.part.situation = Some(situation);
        let fault = self.story.faults.last();
        let words = situation.markdown(&Run {
            title: &self.run.title.name,
            joints: self.subject.joints,
            rate_hz: self.run.rate_hz,
            directions: self.run.directions,
            fault: fault.map(|fault| fault.headline.as_str()),
        });
        self.log(row.tick, entity::NOW, &TextDocument::from_markdown(words));
    }

    /// A writer whose own input is missing waits; one that has its input and writes nothing is silent.
    fn write_lives(&mut self, row: &TickRow) {
        let life =
            |header: Option<&shared_types::Header>| header.map_or(0, |header| header.incarnation);
        let plant = row
            .sensor
            .map(Message::header)
            .or(row.plant_state.map(Message::header));
        let now = [
            life(plant),
            life(row.estimate.map(Message::header)),
            life(row.singularity.map(Message::header)),
            life(row.torque.map(Message::header)),
        ];
        let has_input = [
            true,
            row.sensor.is_some(),
            row.estimate.is_some(),
            row.estimate.is_some() && row.singularity.is_some(),
        ];
        let lives = self.subject.lives.clone();
        for (i, name) in lives.named().filter(|(i, _)| *i < WRITERS) {
            self.note_incarnation(row.tick, i, name, now[i]);
            let lanes = &mut self.part.lanes;
            let missing = &mut lanes.missing[i];
            *missing = if now[i] == 0 { *missing + 1 } else { 0 };
            let text = match now[i] {
                0 if *missing < PATIENCE && lanes.life[i].is_some() => continue,
                0 if has_input[i] => "silent",
                0 => "waiting",
                _ if row.tick < lanes.fresh_until[i] => "restarted",
                _ => "up",
            };
            if lanes.life[i].replace(text) != Some(text) {
                let path = entity::life((i, name));
                self.log(row.tick, path, &StateChange::single(text));
            }
        }
        let text = match row.tick < self.part.lanes.fresh_until[WRITERS] {
            true => "restarted",
            false => "up",
        };
        if let Some(recorder) = lives.named().find(|(place, _)| *place == WRITERS)
            && self.part.lanes.recorder.replace(text) != Some(text)
        {
            self.log(row.tick, entity::life(recorder), &StateChange::single(text));
        }
    }

    /// A process that has come again is told.
    fn note_incarnation(&mut self, tick: u64, i: usize, name: &str, incarnation: u32) {
        let before = self.story.incarnations[i];
        if incarnation <= before {
            return;
        }
        self.story.incarnations[i] = incarnation;
        if before > 0 {
            let text = format!("{name} is back as incarnation {incarnation}");
            self.event(tick, Level::Warning, &text);
            self.part.lanes.fresh_until[i] = tick + u64::from(self.run.rate_hz) / 2;
        }
    }

    /// The recorder that writes this part has taken up where one before it ended: its lane says so from tick `from` on.
    pub fn recorder_restarted(&mut self, from: u64) {
        self.part.lanes.fresh_until[WRITERS] = from + u64::from(self.run.rate_hz) / 2;
    }

    pub(super) fn lane(&mut self, tick: u64, lane: &str, state: &str) {
        self.log(tick, entity::state(lane), &StateChange::single(state));
    }

    pub(super) fn style_lanes(&mut self) {
        self.style(entity::state("fault"), &[NO_FAULT]);
        for (lane, states) in [
            ("drive", narration::DRIVE_STATES),
            ("phase", narration::PHASE_STATES),
        ] {
            self.style(entity::state(lane), states);
        }
        for life in self.subject.lives.clone().named() {
            self.style(entity::life(life), narration::LIFE_STATES);
        }
    }

    /// A lane per singularity, known from a part's first report on.
    pub(super) fn style_modes(&mut self) {
        for (name, _) in self.subject.singularities.clone() {
            self.style(
                entity::state(&format!("mode/{name}")),
                narration::MODE_STATES,
            );
        }
    }

    fn style(&mut self, path: String, states: &[(&str, u32)]) {
        let names = || states.iter().map(|(name, _)| *name);
        self.log_static(
            path,
            &StateConfiguration::new()
                .with_values(names())
                .with_labels(names())
                .with_colors(states.iter().map(|(_, colour)| *colour)),
        );
    }
}
