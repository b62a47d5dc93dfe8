//! How a recording is shown: two layouts, of the SDK's containers and views.
//!
//! Settings that the SDK's views have no way in for (eyes, grids, axes, legends, time ranges) are added to its blueprint as the archetypes that the viewer reads.

use std::collections::BTreeSet;

use re_sdk_types::archetypes::SeriesLines;
use re_sdk_types::blueprint::archetypes::{
    EyeControls3D, LineGrid3D, PlotLegend, ScalarAxis, TextLogColumns, TimeAxis, ViewContents,
    VisibleTimeRanges,
};
use re_sdk_types::blueprint::components::{Corner2D, LinkAxis, LoopMode, PanelState, PlayState};
use re_sdk_types::blueprint::datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
use re_sdk_types::components::{Plane3D, Range1D};
use re_sdk_types::datatypes::{TimeRange, TimeRangeBoundary, VisibleTimeRange};
use re_sdk_types::external::uuid::Uuid;
use re_sdk_types::{Archetype, AsComponents, Visualizer};
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel,
    Spatial3DView, StateTimelineView, Tabs, TextDocumentView, TextLogView, TimePanel,
    TimeSeriesView, Vertical, VisualizerComponentMapping,
};
use rerun::external::re_log_types::TimeInt;
use rerun::log::{Chunk, ChunkResult, LogMsg};
use rerun::{EntityPath, RecordingStreamBuilder, StoreId, Timeline};
use shared_types::scenario::Layout;

use crate::entity;
use crate::eye::Eye;
use crate::facts::Facts;
use crate::picture::Scene;
use crate::pose::Rgba;
use crate::signals::{Signal, hop_names};
use crate::sink::{RecordError, defect};
use crate::story::Named;
use crate::tint::faded;

/// Colours of joints, in order: none is red, which is kept for what is bad.
pub(crate) const JOINTS: [Rgba; 8] = [
    0x569ce6ff, 0x40c8b4ff, 0xa0d25aff, 0xf5be50ff, 0xc89664ff, 0xbe8cf5ff, 0xc8c8cdff, 0x788291ff,
];
/// Colours of errors orthogonal to ζ and along it.
pub(crate) const ACROSS: Rgba = 0x6ed796ff;
pub(crate) const ALONG: Rgba = 0x78bef0ff;
/// Bounds, and what is treated as singular.
const BOUND: Rgba = 0xbec3cdff;
const SINGULAR: Rgba = 0x5a8fd01e;
const FAULT: Rgba = 0xc03030ff;
/// Lines that hatch the band of a plot in which the arm is treated as singular.
pub(crate) const BAND_LINES: usize = 32;
/// How much larger the way of a hand that should stand still is drawn.
pub(crate) const MAGNIFIED: f32 = 50.0;
/// Powers of ten of latencies, µs, and the least of errors, mm and degrees.
const LATENCIES: Option<[f64; 2]> = Some([-0.6, 4.3]);
const LEAST_ERROR: f64 = -3.2;

/// Errors for which plots have room as long as a run's own are not known, mm and degrees.
const MOST_ERRORS: [f64; 2] = [1000.0, 180.0];
/// How far guides go on after the last tick, as a share of the time before it. Plots are as long as what they hold: at the end of the lines
/// a legend of short names has room, and hides none of them.
pub(crate) const LEGEND: f64 = 0.3;
/// Seconds that a plot shows by itself: half of them before the cursor.
const PLOTTED_S: f64 = 60.0;
/// Places of a plot's legend.
const TOP: Option<Corner2D> = Some(Corner2D::RightTop);
const BOTTOM: Option<Corner2D> = Some(Corner2D::RightBottom);

/// The messages of a layout, and its store. `repeated`: the stretch of time to play again, ns, once the run is over; before, the viewer would not
/// follow a live one.
pub(crate) fn messages(
    facts: &Facts,
    scene: &Scene,
    layout: Layout,
    repeated: Option<[i64; 2]>,
) -> Result<(Vec<LogMsg>, StoreId), RecordError> {
    let mut desk = Desk {
        facts,
        scene,
        errors: repeated.map_or(MOST_ERRORS, |_| scene.errors),
        settings: Vec::new(),
    };
    let root = match layout {
        Layout::Control => desk.control(),
        Layout::Timing => desk.timing(),
    };
    let mut time = TimePanel::new()
        .with_state(PanelState::Collapsed)
        .with_timeline("t");
    if let Some(repeated) = repeated {
        let [first, last] = repeated.map(TimeInt::new_temporal);
        time = time
            .with_loop_mode(LoopMode::Selection)
            .with_time_selection(first..=last)
            .with_play_state(PlayState::Playing);
    }
    let blueprint = Blueprint::new(root)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Hidden))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Hidden))
        .with_time_panel(time);
    desk.send(&blueprint)
}

/// Lines of a plot: names and colours of the elements of a signal.
struct Lines {
    entity: &'static str,
    component: &'static str,
    lines: Vec<(String, Rgba)>,
    width: f32,
}

impl Lines {
    fn of(signal: Signal, lines: impl IntoIterator<Item = (String, Rgba)>) -> Self {
        Self {
            entity: signal.of().kept.entity().unwrap_or_default(),
            component: signal.component(),
            lines: lines.into_iter().collect(),
            width: 1.5,
        }
    }

    /// Lines that never move.
    fn guide(component: &'static str, name: &str, count: usize, colour: Rgba, width: f32) -> Self {
        Self {
            entity: entity::GUIDES,
            component,
            lines: vec![(name.to_owned(), colour); count],
            width,
        }
    }

    /// How they are drawn.
    fn visualizer(&self) -> Visualizer {
        let mapping =
            VisualizerComponentMapping::new_source_component("Scalars:scalars", self.component);
        let style = SeriesLines::new()
            .with_names(self.lines.iter().map(|line| line.0.as_str()))
            .with_colors(self.lines.iter().map(|line| line.1))
            .with_widths(self.lines.iter().map(|_| self.width));
        Visualizer::new("SeriesLines")
            .with_mappings([mapping.into()])
            .with_overrides(&style)
    }
}

/// A blueprint in the making.
struct Desk<'a> {
    facts: &'a Facts<'a>,
    scene: &'a Scene,
    /// The largest errors, mm and degrees.
    errors: [f64; 2],
    settings: Vec<ChunkResult<Chunk>>,
}

fn row(shares: &[f32], cells: impl IntoIterator<Item = ContainerLike>) -> ContainerLike {
    Horizontal::new(cells).with_column_shares(shares).into()
}

fn column(shares: &[f32], cells: impl IntoIterator<Item = ContainerLike>) -> ContainerLike {
    Vertical::new(cells).with_row_shares(shares).into()
}

impl Desk<'_> {
    /// The arm large; below it the hand from near by, and the words.
    fn control(&mut self) -> ContainerLike {
        let main = self.scene.room.eye(self.facts, 1.35);
        let below = row(&[1.0, 1.1], [self.close_up(&main), now()]);
        let left = column(&[3.2, 2.0], [self.arm(&main), below]);
        let (errors, measure, joints) = (self.errors(), self.measure(), self.joints());
        let others = [
            self.torques(),
            self.per_joint("Gravity torque", Signal::DrawnGravity, None),
            self.governor(),
            self.auxiliary(),
            self.singular_values(),
            self.latency(),
        ];
        let states = [self.modes(), self.lives(), self.log()];
        let right = match self.facts.stands_still {
            // No singularity is in play: the error first, the joints that move, and the rest in tabs.
            true => {
                let more = [measure].into_iter().chain(others).chain(states);
                column(&[1.3, 1.4, 1.6], [errors, joints, Tabs::new(more).into()])
            }
            false => {
                let more = [joints].into_iter().chain(others);
                let lanes = 1.2 + 0.1 * self.scene.story.named.len() as f32;
                let cells = [
                    measure,
                    errors,
                    Tabs::new(more).into(),
                    Tabs::new(states).into(),
                ];
                column(&[1.3, 1.2, 1.3, lanes], cells)
            }
        };
        row(&[1.12, 1.0], [left, right])
    }

    /// The work of the processes, and its duration.
    fn timing(&mut self) -> ContainerLike {
        let more = [
            self.latency(),
            self.errors(),
            self.torques(),
            self.joints(),
            self.measure(),
            self.governor(),
        ];
        let left = column(&[2.25, 2.35], [self.lives(), Tabs::new(more).into()]);
        let below = Tabs::new([self.log(), self.modes()]).into();
        let main = self.scene.room.eye(self.facts, 2.0);
        let right = column(&[1.8, 0.8, 0.9], [self.arm(&main), now(), below]);
        row(&[1.12, 1.0], [left, right])
    }

    /// A setting of a view.
    fn set<A: Archetype + AsComponents>(&mut self, view: &ContainerLike, setting: &A) {
        if let ContainerLike::View(view) = view {
            let name = A::name().short_name().into();
            self.add(view.blueprint_path().join(&name), setting);
        }
    }

    /// A setting at its place in the blueprint.
    fn add(&mut self, path: EntityPath, setting: &dyn AsComponents) {
        let at = [(Timeline::new_sequence("blueprint"), 0)];
        let chunk = Chunk::builder(path).with_archetype_auto_row(at, setting);
        self.settings.push(chunk.build());
    }

    /// A plot over the time axis that all plots share; `range`: fixed y range.
    fn plot(
        &mut self,
        name: &str,
        mut lines: Vec<Lines>,
        range: Option<[f64; 2]>,
        corner: Option<Corner2D>,
    ) -> ContainerLike {
        // Every plot is as long as the guides: one too thin to be seen, in the legend with the first line.
        let zero = lines
            .first()
            .and_then(|lines| lines.lines.first())
            .map(|(name, colour)| Lines::guide("guide:zero", name, 1, *colour, 0.02));
        lines.extend(zero);
        let faults = [
            self.facts.job.scenario.fault.len(),
            self.facts.happened.faults.len(),
        ];
        if faults != [0, 0] || self.facts.is_live {
            let bar = Lines::of(Signal::Fault, [("fault".to_owned(), FAULT)]);
            lines.push(Lines { width: 6.0, ..bar });
        }
        let contents: BTreeSet<&str> = lines.iter().map(|lines| lines.entity).collect();
        let mut view = TimeSeriesView::new(name)
            .with_origin("/")
            .with_contents(contents);
        for lines in &lines {
            view = view.with_override(lines.entity, lines.visualizer());
        }
        let view = view.into();
        // A linked axis is as long as the viewer wants it: a minute at most. A range of its own would be read as ticks on the other time line.
        let (start, end) = (TimeRangeBoundary::Infinite, TimeRangeBoundary::Infinite);
        let length_s = (1.0 + LEGEND) * self.facts.job.scenario.duration_s();
        let time = if length_s > PLOTTED_S && !self.facts.is_live {
            TimeAxis::new()
                .with_link(LinkAxis::Independent)
                .with_view_range(TimeRange { start, end })
        } else {
            TimeAxis::new().with_link(LinkAxis::LinkToGlobal)
        };
        self.set(&view, &time);
        let mut legend = PlotLegend::new().with_visible(corner.is_some());
        if let Some(corner) = corner {
            legend = legend.with_corner(corner);
        }
        self.set(&view, &legend);
        if let Some([low, high]) = range {
            let axis = ScalarAxis::new().with_range(Range1D::new(low, high));
            self.set(&view, &axis.with_zoom_lock(true));
        }
        view
    }

    /// A line per joint. A legend has room for few names: the second half of the joints share an entry with their first.
    fn per_joint(&mut self, name: &str, signal: Signal, range: Option<[f64; 2]>) -> ContainerLike {
        let count = self.facts.joints();
        let [speed, load] = self.facts.axis_units();
        let unit = match signal {
            Signal::DrawnPosition => "",
            Signal::DrawnSpeed => speed,
            _ => load,
        };
        let name_of = |i: usize| match i {
            0..4 => format!("q{}", i + 1),
            _ => format!("q5–q{count}"),
        };
        let lines = Lines::of(signal, (0..count).map(name_of).zip(JOINTS));
        self.plot(&format!("{name}{unit}"), vec![lines], range, BOTTOM)
    }

    /// A line per singularity, of its own name or all of one.
    fn per_singularity(&self, signal: Signal, name: Option<&str>, opacity: u8) -> Lines {
        let line = |one: &Named| {
            let name = name.unwrap_or(&one.name).to_owned();
            (name, faded(one.colour, opacity))
        };
        Lines::of(signal, self.scene.story.named.iter().map(line))
    }

    /// log₁₀(|s_i| / η_i), the band below 1 hatched.
    fn measure(&mut self) -> ContainerLike {
        // The legend has the colour of the first line: the band's would not be seen there.
        let zero = Lines::guide("guide:zero", "singular", 1, faded(SINGULAR, 255), 1.0);
        let band = Lines::guide("guide:band", "singular", BAND_LINES, SINGULAR, 5.0);
        let count = self.scene.story.named.len();
        let edges = Lines::guide("guide:edge", "singular", count, 0xbec3cd96, 1.0);
        let mut nearness = self.per_singularity(Signal::Nearness, None, 255);
        nearness.width = 2.5;
        let name = "How near: |s|/η in powers of ten. Locked below 0, free above the line";
        let lines = vec![zero, band, edges, nearness];
        self.plot(name, lines, Some([-3.1, 1.4]), BOTTOM)
    }

    /// The errors, each with what the goal allows.
    fn errors(&mut self) -> ContainerLike {
        // If no direction is lost there is one error, and the other line is not seen.
        let (names, along) = if self.facts.stands_still {
            (["error"; 2], 0)
        } else {
            (["orthogonal", "along ζ"], ALONG)
        };
        let turns = self.facts.turns();
        let mut pane = |i: usize, name, signal, guide, legend| {
            let names = names.map(str::to_owned).into_iter();
            let lines = vec![
                Lines::of(signal, names.zip([ACROSS, along])),
                Lines::guide(guide, "allowed", 1, BOUND, 1.5),
            ];
            // The bound and the largest error have room; few powers of ten have a number each.
            let most = self.errors[i].log10().max(0.0) + 0.4;
            self.plot(name, lines, Some([LEAST_ERROR, most]), legend)
        };
        let (name, guide) = ("Position error, log10 mm", "guide:goal_position");
        // Of two plots side by side the second has the legend of both.
        let legend = if turns { None } else { TOP };
        let position = pane(0, name, Signal::DrawnPositionError, guide, legend);
        let (name, guide) = ("Orientation error, log10 °", "guide:goal_orientation");
        let orientation = turns.then(|| pane(1, name, Signal::DrawnOrientationError, guide, TOP));
        let panes = [position].into_iter().chain(orientation);
        Horizontal::new(panes).with_name("Task errors").into()
    }

    fn torques(&mut self) -> ContainerLike {
        let hand = self.per_joint("Hand torque, no gravity", Signal::DrawnHand, None);
        let null = self.per_joint("Null-space torque", Signal::DrawnNull, None);
        Horizontal::new([hand, null]).with_name("Torques").into()
    }

    fn joints(&mut self) -> ContainerLike {
        let range = self.per_joint(
            "Joints between limits ±1",
            Signal::DrawnPosition,
            Some([-1.1, 1.1]),
        );
        let speed = self.per_joint("Joint speeds", Signal::DrawnSpeed, None);
        Horizontal::new([range, speed]).with_name("Joints").into()
    }

    /// The share of each torque, and the speed of the path's clock.
    fn governor(&mut self) -> ContainerLike {
        let scales = [
            ("time", 0x78befaff),
            ("task torque", 0x6ed796ff),
            ("null torque", 0xc8c878ff),
        ]
        .map(|(name, colour)| (name.to_owned(), colour));
        let shares = self.per_singularity(Signal::Beta, Some("β"), 255);
        let lines = vec![Lines::of(Signal::Scale, scales), shares];
        let name = "β (1 hand, 0 null space), governor";
        self.plot(name, lines, Some([-0.05, 1.05]), BOTTOM)
    }

    fn auxiliary(&mut self) -> ContainerLike {
        let reference = self.per_singularity(Signal::AuxiliaryReference, Some("reference"), 120);
        let actual = self.per_singularity(Signal::Auxiliary, None, 255);
        let lines = vec![reference, actual];
        self.plot("Auxiliary coordinates, rad", lines, None, TOP)
    }

    fn singular_values(&mut self) -> ContainerLike {
        let names = (1..=self.facts.joints().min(6)).map(|i| format!("σ{i}"));
        let lines = Lines::of(Signal::SingularValues, names.zip(JOINTS));
        self.plot("Singular values", vec![lines], None, TOP)
    }

    fn latency(&mut self) -> ContainerLike {
        let hops = Lines::of(Signal::Latency, hop_names().into_iter().zip(JOINTS));
        self.plot("Latency per hop, log10 µs", vec![hops], LATENCIES, TOP)
    }

    fn arm(&mut self, eye: &Eye) -> ContainerLike {
        let grid = LineGrid3D::new()
            .with_plane(Plane3D::new([0.0, 0.0, 1.0], self.facts.floor_m))
            .with_spacing(0.25)
            .with_color(0x8c9bb046);
        let view = Spatial3DView::new("Arm").with_origin(entity::WORLD);
        self.world(view, eye, entity::NAMES, &grid)
    }

    /// The hand from near by: its view goes with it. Instead of captions it has names alone.
    fn close_up(&mut self, main: &Eye) -> ContainerLike {
        let name = if self.facts.stands_still {
            "The hand's way, × 50"
        } else {
            "Close-up of the hand"
        };
        let grid = LineGrid3D::new().with_visible(false);
        let eye = self.scene.room.close_up(self.facts, main);
        let view = Spatial3DView::new(name).with_origin(entity::NEAR);
        self.world(view, &eye, entity::CAPTIONS, &grid)
    }

    /// A view of the arm; its ground is the viewer's, dark or light.
    fn world(
        &mut self,
        view: Spatial3DView,
        eye: &Eye,
        without: &str,
        grid: &LineGrid3D,
    ) -> ContainerLike {
        let controls = EyeControls3D::new()
            .with_position(eye.position.to_array())
            .with_look_target(eye.look_at.to_array())
            .with_eye_up(eye.up.to_array());
        // Paths are drawn in short pieces: all up to the cursor are shown.
        let range = TimeRange {
            start: TimeRangeBoundary::Infinite,
            end: TimeRangeBoundary::AT_CURSOR,
        };
        let ranges = VisibleTimeRanges::new(["t", "tick"].map(|timeline| VisibleTimeRange {
            timeline: timeline.into(),
            range,
        }));
        let view = view.with_contents([format!("{}/**", entity::WORLD), format!("- {without}")]);
        let view = view.into();
        self.set(&view, &controls);
        self.set(&view, grid);
        if let ContainerLike::View(view) = &view {
            let path = view.blueprint_path();
            let id = path
                .last()
                .and_then(|id| Uuid::parse_str(id.unescaped_str()).ok());
            for way in entity::WAYS {
                let path = ViewContents::blueprint_base_visualizer_path_for_entity(
                    id.unwrap_or_default(),
                    &way.into(),
                );
                self.add(path, &ranges);
            }
        }
        view
    }

    fn log(&mut self) -> ContainerLike {
        let visible = true.into();
        let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
            .map(|kind| TextLogColumn { kind, visible });
        // A column of times is as narrow as its head, which cuts them: each line begins with its time instead.
        let visible = false.into();
        let times = ["t", "tick"].map(|timeline| TimelineColumn {
            timeline: timeline.into(),
            visible,
        });
        let columns = TextLogColumns::new()
            .with_text_log_columns(columns)
            .with_timeline_columns(times);
        let view = TextLogView::new("Log").with_origin(entity::LOG).into();
        self.set(&view, &columns);
        view
    }

    fn modes(&mut self) -> ContainerLike {
        let lanes = self
            .scene
            .story
            .named
            .iter()
            .map(|one| format!("/{}", one.name));
        self.states("What control does at each singularity", lanes.collect())
    }

    fn lives(&mut self) -> ContainerLike {
        let mut lanes: Vec<String> = [entity::FAULT, entity::DRIVE].map(str::to_owned).into();
        lanes.extend(
            entity::lives(&self.facts.job.graph)
                .iter()
                .map(entity::life),
        );
        self.states("Fault, processes, drive", lanes)
    }

    /// Lanes by their paths, in the viewer's own order.
    fn states(&mut self, name: &str, lanes: Vec<String>) -> ContainerLike {
        let view = StateTimelineView::new(name)
            .with_origin("/")
            .with_contents(lanes)
            .into();
        self.set(&view, &TimeAxis::new().with_link(LinkAxis::LinkToGlobal));
        view
    }

    /// The blueprint's messages, with the settings.
    fn send(self, blueprint: &Blueprint) -> Result<(Vec<LogMsg>, StoreId), RecordError> {
        if !rerun::decide_logging_enabled(true) {
            let reason = "the environment variable RERUN switches Rerun off: unset it";
            return Err(RecordError::Rerun(reason.to_owned()));
        }
        let store = self.facts.store();
        let builder = RecordingStreamBuilder::from_store_id(&store).enabled(true);
        let (stream, storage) = builder.memory().map_err(defect)?;
        blueprint
            .send(&stream, BlueprintActivation::default())
            .map_err(defect)?;
        let mut messages = storage.take();
        let is_activation = |one: &LogMsg| matches!(one, LogMsg::BlueprintActivationCommand(_));
        messages.retain(|one| one.store_id().is_blueprint() && !is_activation(one));
        let store = messages
            .first()
            .map_or(store, |first| first.store_id().clone());
        for setting in self.settings {
            let message = setting
                .and_then(|chunk| chunk.to_arrow_msg())
                .map_err(defect)?;
            messages.push(LogMsg::ArrowMsg(store.clone(), message));
        }
        Ok((messages, store))
    }
}

fn now() -> ContainerLike {
    TextDocumentView::new("What is happening")
        .with_origin(entity::NOW)
        .into()
}
