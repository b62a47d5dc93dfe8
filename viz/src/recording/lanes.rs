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
        if let Some(command) = row.control_state {
            for i in 0..self.subject.singularities.len().min(MAX_SINGULARITIES) {
                let mode = command.mode[i];
                if self.part.lanes.modes[i] != Some(mode) {
                    let before = self.part.lanes.modes[i].replace(mode);
                    let name = self.subject.singularities[i].0.clone();
                    self.lane(row.tick, &format!("mode/{name}"), name_of(MODES, mode));
                    if let Some(before) = before {
                        self.event(
                            row.tick,
                            Level::Info,
                            &format!(
                                "{name}: {} → {}",
                                name_of(MODES, before),
                                name_of(MODES, mode)
                            ),
                        );
                    }
                }
            }
        }
        // A tick or two without a command is not worth a line.
        self.story.unheard = if row.torque.is_some() {
            0
        } else {
            self.story.unheard + 1
        };
        self.story.history.push(row);
        let situation = self.story.history.situation(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.story.unheard >= 5;
        if told && self.part.situation != Some(situation) && self.rival.is_none() {
            self.part.situation = Some(situation);
            let run = Run {
                title: &self.run.title.name,
                joints: self.subject.joints,
                rate_hz: self.run.rate_hz,
                directions: self.run.directions,
                fault: self
                    .story
                    .faults
                    .last()
                    .map(|fault| fault.headline.as_str()),
            };
            let words = situation.markdown(&run);
            self.log(row.tick, entity::NOW, &TextDocument::from_markdown(words));
        }
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
        let freshness = u64::from(self.run.rate_hz) / 2;
        let lives = self.subject.lives.clone();
        for (i, name) in lives.named() {
            let Some(&incarnation) = now.get(i) else {
                continue;
            };
            if incarnation > self.story.incarnations[i] {
                if self.story.incarnations[i] > 0 {
                    self.event(
                        row.tick,
                        Level::Warning,
                        &format!("{name} is back as incarnation {incarnation}"),
                    );
                    self.part.lanes.fresh_until[i] = row.tick + freshness;
                }
                self.story.incarnations[i] = incarnation;
            }
            self.part.lanes.missing[i] = if incarnation == 0 {
                self.part.lanes.missing[i] + 1
            } else {
                0
            };
            let text = match incarnation {
                0 if self.part.lanes.missing[i] < PATIENCE && self.part.lanes.life[i].is_some() => {
                    continue;
                }
                0 if has_input[i] => "silent",
                0 => "waiting",
                _ if row.tick < self.part.lanes.fresh_until[i] => "restarted",
                _ => "up",
            };
            if self.part.lanes.life[i] != Some(text) {
                self.part.lanes.life[i] = Some(text);
                self.log(
                    row.tick,
                    entity::life((i, name)),
                    &StateChange::single(text),
                );
            }
        }
        let text = if row.tick < self.part.lanes.fresh_until[WRITERS] {
            "restarted"
        } else {
            "up"
        };
        if let Some(recorder) = lives.named().find(|(place, _)| *place == WRITERS)
            && self.part.lanes.recorder != Some(text)
        {
            self.part.lanes.recorder = Some(text);
            self.log(row.tick, entity::life(recorder), &StateChange::single(text));
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
