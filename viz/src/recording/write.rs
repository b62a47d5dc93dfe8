//! The rows of a tick in a recording: signals, states, words, and the picture's guides.

use glam::Vec3;
use nalgebra::SVector;
use re_chunk::external::arrow::array::{ArrayRef, Float64Array};
use re_chunk::{Chunk, EntityPath, RowId, TimePoint};
use re_log_types::{StoreId, StoreKind};
use re_sdk_types::archetypes::{Arrows3D, LineStrips3D, RecordingInfo, StateChange, StateConfiguration, TextDocument};
use re_sdk_types::components::{Color, Radius, Timestamp};
use shared_types::codes::{DRIVES, MODES, PHASES, name_of};
use shared_types::messages::SingularityState;
use shared_types::{MAX_SINGULARITIES, Message};

use super::pieces::{custom, eye, mesh3d, pose};
use super::state::{Level, PROCESSES, Recording};
use crate::arm::{placement, vec3};
use crate::manipulability::{Ellipsoid, Half, at_point};
use crate::narration::{Situation, States};
use crate::scene::{Mark, Presence};
use crate::signals::{Signal, TickRow};
use crate::solid::{Mesh, Placement};
use crate::{blueprint, entity, narration};

impl Recording {
    // Constants.

    pub(super) fn write_properties(&mut self) {
        let info = RecordingInfo::new().with_name(self.title.name.as_str());
        // The first part holds the time of its beginning.
        let info = if self.before.parts == 0 { info.with_start_time(Timestamp::now()) } else { info };
        self.log_static(EntityPath::properties(), &info);
        let columns = self.title.properties.clone().map(|(name, value)| {
            (custom(name, Some("run")), std::sync::Arc::new(re_chunk::external::arrow::array::StringArray::from(vec![value])) as ArrayRef)
        });
        let chunk = Chunk::builder(EntityPath::properties().join(&"run".into())).with_row(RowId::new(), TimePoint::default(), columns);
        self.sink.chunk(&self.store, chunk.build());
        let about: Vec<String> = Signal::ALL.iter().map(|signal| format!("`{}`: {}", signal.name(), signal.about().trim())).collect();
        self.log_static("/signals/about", &TextDocument::from_markdown(about.join("\n\n")));
        let limits = [("joint:qdot_limit", &self.limits.speed), ("joint:torque_limit", &self.limits.torque)];
        let columns =
            limits.map(|(name, values)| (custom(name, None), std::sync::Arc::new(Float64Array::from(values.clone())) as ArrayRef));
        let chunk = Chunk::builder(entity::SIGNALS).with_row(RowId::new(), TimePoint::default(), columns);
        self.sink.chunk(&self.store, chunk.build());
    }

    pub(super) fn write_figure(&mut self) {
        self.log_static(entity::BASE, &mesh3d(&self.figure.base, None));
        for i in 0..self.figure.links.len() {
            let (solid, pale) = (mesh3d(&self.figure.links[i], None), mesh3d(&self.figure.links[i], Some([150, 205, 255, 70])));
            self.log_static(entity::link(i), &solid);
            self.log_static(entity::ghost(i), &pale);
        }
        let triad = |length: f32, radius: f32, colours: [u32; 3]| {
            Arrows3D::from_vectors([[length, 0.0, 0.0], [0.0, length, 0.0], [0.0, 0.0, length]]).with_colors(colours).with_radii([radius])
        };
        let size = 0.11 * self.figure.reach;
        self.log_static(entity::HAND, &triad(size, 0.03 * size, [0xf05050ff, 0x60d060ff, 0x5090ffff]));
        self.log_static(entity::TARGET, &triad(1.35 * size, 0.018 * size, [0x90f0b0ff; 3]));
        let mut ball = Mesh::default();
        ball.add_sphere(Placement::IDENTITY, 1.0, [255; 4]);
        self.log_static(entity::VELOCITY, &mesh3d(&ball, Some([90, 170, 255, 60])));
        let circle = |x: Vec3, y: Vec3| -> Vec<[f32; 3]> {
            (0..=48)
                .map(|k| {
                    (x * (std::f32::consts::TAU * k as f32 / 48.0).cos() + y * (std::f32::consts::TAU * k as f32 / 48.0).sin()).to_array()
                })
                .collect()
        };
        let net = LineStrips3D::new([circle(Vec3::X, Vec3::Y), circle(Vec3::Y, Vec3::Z), circle(Vec3::Z, Vec3::X)]);
        let net = net.with_colors([Color::from_unmultiplied_rgba(150, 235, 225, 255)]).with_radii([Radius::new_ui_points(1.0)]);
        self.log_static(entity::MOBILITY, &net);
        for (lane, states) in [("drive", narration::DRIVE_STATES), ("phase", narration::PHASE_STATES)] {
            self.style(entity::state(lane), states);
        }
        for process in PROCESSES {
            self.style(entity::state(&format!("process/{process}")), narration::LIFE_STATES);
        }
    }

    pub(super) fn style(&mut self, path: String, states: States) {
        let names = || states.iter().map(|(name, _)| *name);
        self.log_static(
            path,
            &StateConfiguration::new().with_values(names()).with_labels(names()).with_colors(states.iter().map(|(_, colour)| *colour)),
        );
    }

    /// At a part's first report: names and thresholds, the eye's place, and with them the blueprint.
    pub(super) fn introduce(&mut self, row: &TickRow) {
        self.blueprint_sent = true;
        if self.subject.singularities.is_empty() {
            self.meet(row);
        }
        let names: Vec<String> = self.subject.singularities.iter().map(|(name, _)| name.clone()).collect();
        let column: ArrayRef = std::sync::Arc::new(re_chunk::external::arrow::array::StringArray::from(names.clone()));
        let components = [(custom(entity::SINGULARITY_NAMES, None), column)];
        let chunk = Chunk::builder(entity::SIGNALS).with_row(RowId::new(), TimePoint::default(), components);
        self.sink.chunk(&self.store, chunk.build());
        for name in names {
            self.style(entity::state(&format!("mode/{name}")), narration::MODE_STATES);
        }
        let store = self.blueprint();
        blueprint::send(&mut self.sink, &store, &self.subject, self.layout);
    }

    pub(super) fn meet(&mut self, row: &TickRow) {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i);
            self.subject.singularities.push((name, narration::colour_of_kind(one.kind, i)));
            if !self.thresholds.contains(&(one.eta_in, one.eta_out)) {
                self.thresholds.push((one.eta_in, one.eta_out));
            }
        }
        self.subject.bands = self.thresholds.len();
        self.subject.widest = self.thresholds.iter().map(|(_, eta_out)| *eta_out).fold(0.0, f64::max);
        let places = row.q().map(|q| self.arm.link_poses(&SVector::from_column_slice(q)).map(|X| vec3(&X.p)));
        self.subject.eye =
            eye(places.as_ref().map_or(&[Vec3::X], |places| &places[..self.subject.joints]), self.mark_size(), &self.subject, self.planar);
    }

    /// The blueprint's own store: one per recording, the same in every part.
    pub(super) fn blueprint(&self) -> StoreId {
        StoreId::new(StoreKind::Blueprint, self.store.application_id().clone(), format!("{}-blueprint", self.store.recording_id()))
    }

    // Numbers.

    pub(super) fn write_signals(&mut self) {
        if let Some((ticks, components)) = self.signals.take() {
            let chunk = self.chunk_of(entity::SIGNALS, &ticks, components);
            self.sink.chunk(&self.store, chunk);
            self.written.signals = ticks.last().map_or(self.written.signals, |last| last + 1);
        }
    }

    /// Lines that never move, as often as a plot needs to draw them.
    pub(super) fn write_guides(&mut self, tick: u64) {
        let both = |values: Vec<f64>| -> ArrayRef {
            std::sync::Arc::new(Float64Array::from(values.iter().flat_map(|value| [*value, -value]).collect::<Vec<_>>()))
        };
        let columns = [
            (custom("guide:eta_in", None), both(self.thresholds.iter().map(|(eta_in, _)| *eta_in).collect())),
            (custom("guide:eta_out", None), both(self.thresholds.iter().map(|(_, eta_out)| *eta_out).collect())),
        ];
        let chunk = Chunk::builder(entity::GUIDES).with_row(RowId::new(), self.at(tick), columns).build();
        self.sink.chunk(&self.store, chunk);
    }

    // Modes, states and words, as they change.

    pub(super) fn write_changes(&mut self, row: &TickRow) {
        let life = |header: Option<&shared_types::Header>| header.map_or(0, |header| header.incarnation);
        let plant = row.sensor.map(Message::header).or(row.plant_state.map(Message::header));
        let now = [
            life(plant),
            life(row.estimate.map(Message::header)),
            life(row.singularity.map(Message::header)),
            life(row.torque.map(Message::header)),
        ];
        for (i, incarnation) in now.into_iter().enumerate() {
            let text = match incarnation {
                0 => "silent",
                1 => "up",
                _ => "restarted",
            };
            if incarnation > self.incarnations[i] {
                if self.incarnations[i] > 0 {
                    self.event(row.tick, Level::Warning, &format!("{} is back as incarnation {incarnation}", PROCESSES[i]));
                }
                self.incarnations[i] = incarnation;
            }
            if self.lanes.life[i] != Some(text) {
                self.lanes.life[i] = Some(text);
                self.lane(row.tick, &format!("process/{}", PROCESSES[i]), text);
            }
        }
        if let Some(sensor) = row.sensor
            && self.lanes.drive != Some(sensor.drive)
        {
            self.lanes.drive = Some(sensor.drive);
            self.lane(row.tick, "drive", name_of(DRIVES, sensor.drive));
        }
        if let Some(torque) = row.torque
            && self.lanes.phase != Some(torque.phase)
        {
            self.lanes.phase = Some(torque.phase);
            self.lane(row.tick, "phase", name_of(PHASES, torque.phase));
        }
        if let Some(command) = row.control_state {
            for i in 0..self.subject.singularities.len().min(MAX_SINGULARITIES) {
                let mode = command.mode[i];
                if self.lanes.modes[i] != Some(mode) {
                    let before = self.lanes.modes[i].replace(mode);
                    let name = self.subject.singularities[i].0.clone();
                    self.lane(row.tick, &format!("mode/{name}"), name_of(MODES, mode));
                    if let Some(before) = before {
                        self.event(row.tick, Level::Info, &format!("{name}: {} → {}", name_of(MODES, before), name_of(MODES, mode)));
                    }
                }
            }
        }
        // A tick or two without a command is not worth a line.
        self.unheard = if row.torque.is_some() { 0 } else { self.unheard + 1 };
        let situation = Situation::of(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.unheard >= 5;
        if told && self.situation != Some(situation) {
            self.situation = Some(situation);
            self.log(row.tick, entity::NOW, &TextDocument::from_markdown(situation.markdown()));
        }
    }

    pub(super) fn lane(&mut self, tick: u64, lane: &str, state: &str) {
        self.log(tick, entity::state(lane), &StateChange::single(state));
    }

    // The picture.

    pub(super) fn see(&mut self, row: &TickRow) {
        let Some(q) = row.q() else { return };
        let links = self.arm.link_poses(&SVector::from_column_slice(q)).map(|X| placement(&X));
        let desired = row.control_state.map(|command| pose(&command.p_BE_d, &command.R_BE_d));
        let hand = row
            .plant_state
            .map(|state| pose(&state.p_BE, &state.R_BE))
            .unwrap_or_else(|| placement(&self.arm.forward_kinematics(&SVector::from_column_slice(q))));
        let marks: Vec<Mark> =
            row.singularity.map_or(Vec::new(), |report| row.singularities().iter().map(|one| Mark::new(one, report.p_BC)).collect());
        self.write_marks(row.tick, row.singularities(), &marks);
        if self.motion.update(row) {
            self.write_ghosts(row.tick, false);
        }
        if let Some(turned) = self.motion.turned(false) {
            self.write_turned(row.tick, &links, &turned);
        }
        let unit = self.mark_size();
        self.picture.push(row.tick, &links, &hand, desired.as_ref(), &marks, unit);
        if let Some(report) = row.singularity {
            self.see_manipulability(row.tick, q, report.p_BC, row.singularities(), &marks);
        }
    }

    /// The hand's mobility, at C, in the half of the twist that the nearest singularity is of.
    pub(super) fn see_manipulability(&mut self, tick: u64, q: &[f64], p_BC: [f64; 3], singularities: &[SingularityState], marks: &[Mark]) {
        let near = singularities.iter().zip(marks).filter(|(_, mark)| mark.look.presence != Presence::Hidden);
        let nearest = near.map(|(one, _)| one).min_by(|a, b| (a.s.abs() / a.eta_out).total_cmp(&(b.s.abs() / b.eta_out)));
        let half = if nearest.is_some_and(|one| one.angular == 1) { Half::Angular } else { Half::Linear };
        let (q, p_BC) = (SVector::from_column_slice(q), nalgebra::Vector3::from(p_BC));
        let J = at_point(self.arm.jacobian(&q), &(p_BC - self.arm.forward_kinematics(&q).p));
        let unit = 0.62 * self.mark_size();
        let (velocity, mobility) =
            (Ellipsoid::velocity(&J, self.arm.velocity(), half), Ellipsoid::mobility(&J, &self.arm.mass_matrix(&q), half));
        for (track, shape) in self.picture.abilities.iter_mut().zip([Some(velocity), mobility]) {
            let Some(Ellipsoid { axes, half_axes }) = shape else { continue };
            track.push(tick, &Placement { R: axes, p: vec3(&p_BC) });
            // Flat, but not so flat that it has no sides.
            track.sizes.push((half_axes.max(Vec3::splat(0.012)) * unit).to_array());
        }
    }
}
