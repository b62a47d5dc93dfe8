//! The rows of a tick in a recording: signals, states, words, and the picture's guides.

use glam::Vec3;
use nalgebra::SVector;
use re_chunk::EntityPath;
use re_chunk::external::arrow::array::{Array, ArrayRef, Float64Array, StringArray};
use re_log_types::{StoreId, StoreKind};
use re_sdk_types::archetypes::{Arrows3D, LineStrips3D, RecordingInfo, TextDocument};
use re_sdk_types::components::{Color, Radius, Timestamp};
use re_sdk_types::{AnyValues, DynamicArchetype};
use shared_types::messages::SingularityState;
use shared_types::scenario::Layout;

use super::ending::close_up;
use super::pieces::{Room, mesh3d, pose};
use super::state::Recording;
use crate::arm::{placement, vec3};
use crate::blueprint::{Ending, Eye};
use crate::manipulability::{Ellipsoid, Half, at_point};
use crate::scene::{Mark, Presence};
use crate::signals::{Signal, TickRow, Width};
use crate::solid::{Mesh, Placement};
use crate::{blueprint, entity, narration};

/// How far guides go on after the last tick, as a share of the time before it. Plots are as long as what they hold: at the end of the lines
/// a legend of short names has room, and hides none of them.
pub(super) const LEGEND: f64 = 0.3;

fn array(values: impl Array + 'static) -> ArrayRef {
    std::sync::Arc::new(values)
}

/// Components of our own.
fn numbers<const N: usize>(columns: [(&'static str, Vec<f64>); N]) -> AnyValues {
    let columns = columns.into_iter();
    columns.fold(AnyValues::default(), |all, (name, values)| {
        all.with_component_from_data(name, array(Float64Array::from(values)))
    })
}

impl Recording {
    // Constants.

    pub(super) fn write_properties(&self) {
        let info = RecordingInfo::new().with_name(self.run.title.name.as_str());
        // The first part holds the time of its beginning.
        let info = if self.before.parts == 0 {
            info.with_start_time(Timestamp::now())
        } else {
            info
        };
        self.log_static(EntityPath::properties(), &info);
        let mut properties = DynamicArchetype::new("run");
        for (name, value) in &self.run.title.properties {
            properties = properties
                .with_component_from_data(*name, array(StringArray::from_iter([Some(value)])));
        }
        self.log_static(EntityPath::properties().join(&"run".into()), &properties);
        let recorded = Signal::ALL
            .iter()
            .filter(|signal| signal.width() != Width::Derived);
        let about: Vec<String> = recorded
            .map(|signal| format!("`{}`: {}", signal.component(), signal.about().trim()))
            .collect();
        self.log_static(
            "/signals/about",
            &TextDocument::from_markdown(about.join("\n\n")),
        );
        let limits = &self.run.limits;
        let limits = [
            ("joint:qdot_limit", limits.speed.clone()),
            ("joint:torque_limit", limits.torque.clone()),
            ("joint:q_centre", limits.centre.clone()),
            ("joint:q_half_range", limits.half_range.clone()),
        ];
        self.log_static(entity::SIGNALS, &numbers(limits));
    }

    pub(super) fn write_figure(&mut self) {
        self.log_static(entity::BASE, &mesh3d(&self.run.figure.base, None));
        for i in 0..self.run.figure.links.len() {
            let solid = mesh3d(&self.run.figure.links[i], None);
            self.log_static(entity::link(i), &solid);
        }
        let triad = |length: f32, radius: f32, colours: [u32; 3]| {
            Arrows3D::from_vectors([[length, 0.0, 0.0], [0.0, length, 0.0], [0.0, 0.0, length]])
                .with_colors(colours)
                .with_radii([radius])
        };
        let size = 0.11 * self.run.figure.reach;
        self.log_static(
            entity::HAND,
            &triad(size, 0.03 * size, [0xf05050ff, 0x60d060ff, 0x5090ffff]),
        );
        self.log_static(
            entity::TARGET,
            &triad(1.35 * size, 0.018 * size, [0x90f0b0ff; 3]),
        );
        let mut ball = Mesh::default();
        ball.add_sphere(Placement::IDENTITY, 1.0, [255; 4]);
        self.log_static(entity::VELOCITY, &mesh3d(&ball, Some([90, 170, 255, 60])));
        let circle = |x: Vec3, y: Vec3| -> Vec<[f32; 3]> {
            (0..=48)
                .map(|k| {
                    (x * (std::f32::consts::TAU * k as f32 / 48.0).cos()
                        + y * (std::f32::consts::TAU * k as f32 / 48.0).sin())
                    .to_array()
                })
                .collect()
        };
        let net = LineStrips3D::new([
            circle(Vec3::X, Vec3::Y),
            circle(Vec3::Y, Vec3::Z),
            circle(Vec3::Z, Vec3::X),
        ]);
        let net = net
            .with_colors([Color::from_unmultiplied_rgba(150, 235, 225, 255)])
            .with_radii([Radius::new_ui_points(1.0)]);
        self.log_static(entity::MOBILITY, &net);
        self.style_lanes();
    }

    /// At a part's first report: names and thresholds, the eye's place, and with them the blueprint.
    pub(super) fn introduce(&mut self, row: &TickRow) {
        self.part.blueprint_sent = true;
        if self.subject.singularities.is_empty() {
            self.meet(row);
        }
        let names: Vec<String> = self
            .subject
            .singularities
            .iter()
            .map(|(name, _)| name.clone())
            .collect();
        let names = StringArray::from_iter_values(names);
        let names =
            AnyValues::default().with_component_from_data(entity::SINGULARITY_NAMES, array(names));
        self.log_static(entity::SIGNALS, &names);
        self.style_modes();
        let store = self.blueprint();
        blueprint::send(&self.sink, &store, &self.subject, self.run.layout);
    }

    pub(super) fn meet(&mut self, row: &TickRow) {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i);
            self.subject
                .singularities
                .push((name, narration::colour_of(one.kind, i)));
            let outer = one.eta_out / one.eta_in.max(1e-9);
            if !self.subject.outer.contains(&outer) {
                self.subject.outer.push(outer);
            }
        }
        let places = row.q().map(|q| {
            self.run
                .arm
                .link_poses(&SVector::from_column_slice(q))
                .map(|X| vec3(&X.p))
        });
        self.story.room = Room::of(places.map_or(vec![Vec3::X], |places| {
            places[..self.subject.joints].to_vec()
        }));
        self.subject.eye = self
            .story
            .room
            .eye(self.mark_size(), &self.subject, self.run.planar);
        self.subject.close_up = self.near_by(row);
    }

    /// An eye near the hand that stands still, or near the nearest singularity.
    fn near_by(&self, row: &TickRow) -> Eye {
        let (main, unit) = (self.subject.eye, self.mark_size());
        if self.subject.stands_still {
            // From where the arm is seen, onto the hand.
            let hand = row.q().map_or(Vec3::X, |q| {
                let q = SVector::from_column_slice(q);
                vec3(&self.run.arm.forward_kinematics(&q).p)
            });
            let away = (main.position - main.look_at).normalize_or(Vec3::Z) * (3.4 * unit);
            return Eye {
                position: hand + away,
                look_at: hand,
                up: main.up,
            };
        }
        let near = row.singularities().iter();
        let near = near.min_by(|a, b| (a.s.abs() / a.eta_in).total_cmp(&(b.s.abs() / b.eta_in)));
        let (Some(one), Some(report)) = (near, row.singularity) else {
            return main;
        };
        let mark = Mark::new(one, report.p_BC);
        close_up(mark.X_BS.p, [mark.zeta(); 2], Vec3::ZERO, unit, &main)
    }

    /// Settings known at the end only: the stretch to repeat, and the eye of the close-up. A viewer that follows a live run must not loop.
    pub(super) fn write_ending(&mut self, last: u64) {
        if self.run.is_live {
            return;
        }
        let unit = self.mark_size();
        let whole = Ending {
            loop_ns: (0, self.nanoseconds(last)),
            close_up: self.subject.close_up,
            main: None,
        };
        // A way that no plan told: an eye that sees all of it.
        let main = self.story.room.eye(unit, &self.subject, self.run.planar);
        let is_elsewhere = main.position.distance(self.subject.eye.position)
            > 0.05 * main.position.distance(main.look_at);
        let ending = match self.run.layout {
            Layout::Control if !self.subject.stands_still => {
                self.story
                    .stretches
                    .ending(|tick| self.nanoseconds(tick), last, unit, &main)
            }
            _ => None,
        };
        let ending = Ending {
            main: is_elsewhere.then_some(main),
            ..ending.unwrap_or(whole)
        };
        let store = self.blueprint();
        // Unplanned faults: the same views with a bar for them.
        let is_changed = !self.story.fault_states.is_empty()
            && !std::mem::replace(&mut self.subject.faults, true);
        blueprint::send_ending(
            &self.sink,
            &store,
            &self.subject,
            self.run.layout,
            &ending,
            is_changed,
        );
    }

    /// The blueprint's own store: one per recording, the same in every part.
    pub(super) fn blueprint(&self) -> StoreId {
        StoreId::new(
            StoreKind::Blueprint,
            self.store.application_id().clone(),
            format!("{}-blueprint", self.store.recording_id()),
        )
    }

    /// Lines that never move, as often as a plot needs to draw them.
    pub(super) fn write_guides(&self, tick: u64) {
        let band = |k: usize| -3.1 * k as f64 / entity::BAND_LINES as f64;
        let goal = self.subject.goal;
        let goal = goal.map(|goal| goal.map(f64::log10).into_iter().collect());
        let [position, orientation] = goal;
        let edges = self.subject.outer.iter().map(|ratio| ratio.log10());
        let guides = [
            ("guide:zero", vec![0.0]),
            ("guide:band", (0..entity::BAND_LINES).map(band).collect()),
            ("guide:edge", edges.collect()),
            ("guide:goal_position", position),
            ("guide:goal_orientation", orientation),
        ];
        self.log(tick, entity::GUIDES, &numbers(guides));
    }

    // The picture.

    pub(super) fn see(&mut self, row: &TickRow) {
        let Some(q) = row.q() else { return };
        let links = self
            .run
            .arm
            .link_poses(&SVector::from_column_slice(q))
            .map(|X| placement(&X));
        let desired = row
            .control_state
            .map(|command| pose(&command.p_BE_d, &command.R_BE_d));
        let hand = row
            .plant_state
            .map(|state| pose(&state.p_BE, &state.R_BE))
            .unwrap_or_else(|| {
                placement(
                    &self
                        .run
                        .arm
                        .forward_kinematics(&SVector::from_column_slice(q)),
                )
            });
        let marks: Vec<Mark> = row.singularity.map_or(Vec::new(), |report| {
            row.singularities()
                .iter()
                .map(|one| Mark::new(one, report.p_BC))
                .collect()
        });
        self.write_marks(row, q, &marks, &hand);
        self.write_target(row, &hand, desired.as_ref());
        if self.story.motion.update(row) {
            self.write_ghosts(row.tick, false);
        }
        if let Some(turned) = self.story.motion.turned(false) {
            self.write_turned(row.tick, &links, &turned);
        }
        let unit = self.mark_size();
        self.story.room.push(
            links[..self.subject.joints].iter().map(|X_BL| X_BL.p),
            hand.p,
        );
        self.story
            .stretches
            .push(row.tick, row.singularities(), &marks, &hand);
        self.picture.push(
            row.tick,
            &links,
            [Some(&hand), desired.as_ref()],
            &marks,
            unit,
            &self.story.sides,
        );
        if let Some(report) = row.singularity {
            self.see_manipulability(row.tick, q, report.p_BC, row.singularities(), &marks);
        }
    }

    /// The hand's mobility, at C, in the half of the twist that the nearest singularity is of.
    pub(super) fn see_manipulability(
        &mut self,
        tick: u64,
        q: &[f64],
        p_BC: [f64; 3],
        singularities: &[SingularityState],
        marks: &[Mark],
    ) {
        let near = singularities
            .iter()
            .zip(marks)
            .filter(|(_, mark)| mark.look.presence != Presence::Hidden);
        let nearest = near
            .map(|(one, _)| one)
            .min_by(|a, b| (a.s.abs() / a.eta_out).total_cmp(&(b.s.abs() / b.eta_out)));
        let half = if nearest.is_some_and(|one| one.angular == 1) {
            Half::Angular
        } else {
            Half::Linear
        };
        let (q, p_BC) = (SVector::from_column_slice(q), nalgebra::Vector3::from(p_BC));
        let J = at_point(
            self.run.arm.jacobian(&q),
            &(p_BC - self.run.arm.forward_kinematics(&q).p),
        );
        let unit = 0.62 * self.mark_size();
        let (velocity, mobility) = (
            Ellipsoid::velocity(&J, self.run.arm.velocity(), half),
            Ellipsoid::mobility(&J, &self.run.arm.mass_matrix(&q), half),
        );
        for (track, shape) in self
            .picture
            .abilities
            .iter_mut()
            .zip([Some(velocity), mobility])
        {
            let Some(Ellipsoid { axes, half_axes }) = shape else {
                continue;
            };
            track.push(
                tick,
                &Placement {
                    R: axes,
                    p: vec3(&p_BC),
                },
            );
            // Flat, but not so flat that it has no sides.
            track
                .sizes
                .push((half_axes.max(Vec3::splat(0.012)) * unit).to_array());
        }
    }
}
