//! How a recording is shown: one layout per purpose, as Rerun blueprint chunks.
//!
//! Written as the archetypes the viewer reads (containers, views, visualizer instructions), because several settings, such as the eye,
//! the grid, axes, legends and time ranges, have no other way in.

use glam::Vec3;
use re_chunk::{Chunk, ChunkResult, EntityPath, RowId, Timeline};
use re_log_types::{ApplicationId, StoreId, StoreKind};
use re_sdk_types::AsComponents;
use re_sdk_types::archetypes::SeriesLines;
use re_sdk_types::blueprint::archetypes::{
    ActiveVisualizers, ContainerBlueprint, EyeControls3D, LineGrid3D, PanelBlueprint, PlotLegend, ScalarAxis, TextLogColumns, TimeAxis,
    TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint, VisibleTimeRanges, VisualizerInstruction,
};
use re_sdk_types::blueprint::components::{
    ActiveTab, ColumnShare, ContainerKind, Corner2D, IncludedContent, LinkAxis, LockRangeDuringZoom, PanelState, RootContainer, RowShare,
    TextLogColumn, TimelineName, VisibleTimeRange, VisualizerComponentMapping, VisualizerInstructionId,
};
use re_sdk_types::blueprint::datatypes::{ComponentSourceKind, TextLogColumnKind, VisualizerComponentMapping as Mapping};
use re_sdk_types::components::{Color, Name, Plane3D, Range1D, StrokeWidth, Visible};
use re_sdk_types::datatypes::{TimeInt, TimeRange, TimeRangeBoundary, VisibleTimeRange as Span};
use re_sdk_types::external::uuid::Uuid;
use shared_types::scenario::Layout;

use crate::entity;
use crate::signals::{HOP_NAMES, Signal};
use crate::sink::{Sink, Storage};
use crate::solid::Rgba;

/// Colours of joints, in order.
pub(crate) const JOINTS: [Rgba; 8] = [
    [86, 156, 230, 255],
    [64, 200, 180, 255],
    [160, 210, 90, 255],
    [245, 190, 80, 255],
    [240, 110, 105, 255],
    [190, 140, 245, 255],
    [200, 200, 205, 255],
    [120, 130, 145, 255],
];
const ACROSS: Rgba = [110, 215, 150, 255];
const ALONG: Rgba = [250, 150, 210, 255];
const LIMIT: Rgba = [225, 70, 70, 160];

/// What a blueprint needs to know of its run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subject {
    pub(crate) joints: Vec<String>,
    /// Name and colour of each singularity, in the report's order.
    pub(crate) singularities: Vec<(String, Rgba)>,
    /// Distinct thresholds (η_in, η_out).
    pub(crate) bands: usize,
    pub(crate) eye: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) floor_m: f32,
}

/// Lines of a plot: one signal's elements, with names and colours; its source entity.
struct Lines {
    entity: &'static str,
    component: &'static str,
    names: Vec<String>,
    colours: Vec<Rgba>,
    width: f32,
}

impl Lines {
    fn of(signal: Signal, names: Vec<String>, colours: impl IntoIterator<Item = Rgba>) -> Self {
        Self {
            entity: entity::SIGNALS,
            component: signal.name(),
            colours: colours.into_iter().take(names.len()).collect(),
            names,
            width: 1.5,
        }
    }

    fn guide(component: &'static str, name: &str, count: usize, colour: Rgba) -> Self {
        Self { entity: entity::GUIDES, component, names: vec![name.to_owned(); count], colours: vec![colour; count], width: 1.0 }
    }
}

/// Ids are numbered: a layout is the same bytes in every file.
const ID_BASE: u128 = 0xa6b1_0000_0000_4000_8000_0000_0000_0000;

/// A place in a layout with its share of the room.
type Cell = (f32, EntityPath);

/// The chunks of one blueprint store.
struct Sheet {
    chunks: Vec<ChunkResult<Chunk>>,
    ids: u128,
}

impl Sheet {
    fn log(&mut self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let at = [(Timeline::new_sequence("blueprint"), 0)];
        self.chunks.push(Chunk::builder(path).with_archetype(RowId::new(), at, archetype).build());
    }

    fn id(&mut self) -> Uuid {
        self.ids += 1;
        Uuid::from_u128(ID_BASE + self.ids)
    }

    /// A view of `contents`; its path is what containers hold.
    fn view(&mut self, class: &str, name: &str, origin: &str, contents: &[String]) -> (Uuid, EntityPath) {
        let id = self.id();
        let path = EntityPath::from(format!("view/{id}"));
        self.log(path.join(&"ViewContents".into()), &ViewContents::new(contents.iter().map(|query| query.as_str())));
        self.log(path.clone(), &ViewBlueprint::new(class).with_display_name(Name(name.into())).with_space_origin(origin));
        (id, path)
    }

    fn container(&mut self, kind: ContainerKind, cells: Vec<Cell>) -> EntityPath {
        let path = EntityPath::from(format!("container/{}", self.id()));
        let shares: Vec<f32> = cells.iter().map(|(share, _)| *share).collect();
        let mut container =
            ContainerBlueprint::new(kind).with_contents(cells.iter().map(|(_, path)| IncludedContent(path.to_string().into())));
        match kind {
            ContainerKind::Horizontal => container = container.with_col_shares(shares.into_iter().map(|share| ColumnShare(share.into()))),
            ContainerKind::Vertical => container = container.with_row_shares(shares.into_iter().map(|share| RowShare(share.into()))),
            ContainerKind::Tabs => {
                if let Some((_, first)) = cells.first() {
                    container = container.with_active_tab(ActiveTab(first.to_string().as_str().into()));
                }
            }
            ContainerKind::Grid => {}
        }
        self.log(path.clone(), &container);
        path
    }

    fn row(&mut self, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Horizontal, cells)
    }

    fn column(&mut self, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Vertical, cells)
    }

    fn tabs(&mut self, paths: Vec<EntityPath>) -> EntityPath {
        self.container(ContainerKind::Tabs, paths.into_iter().map(|path| (1.0, path)).collect())
    }

    /// A plot of lines over the shared time axis; `range`: fixed y range.
    fn plot(&mut self, name: &str, lines: Vec<Lines>, range: Option<[f64; 2]>, legend: Option<Corner2D>) -> EntityPath {
        let mut entities: Vec<&str> = lines.iter().map(|lines| lines.entity).collect();
        entities.sort_unstable();
        entities.dedup();
        let contents: Vec<String> = entities.iter().map(|entity| (*entity).to_owned()).collect();
        let (id, path) = self.view("TimeSeries", name, "/", &contents);
        for entity in entities {
            let base = ViewContents::blueprint_base_visualizer_path_for_entity(id, &entity.into());
            let mut instructions = Vec::new();
            for lines in lines.iter().filter(|lines| lines.entity == entity) {
                let instruction = self.id();
                let at = base.join(&EntityPath::from_single_string(instruction.to_string()));
                let mapping = VisualizerComponentMapping(Mapping {
                    target: "Scalars:scalars".into(),
                    source_kind: ComponentSourceKind::SourceComponent,
                    source_component: Some(lines.component.into()),
                    selector: None,
                });
                self.log(at.clone(), &VisualizerInstruction::new("SeriesLines").with_component_map([mapping]));
                let style = SeriesLines::new()
                    .with_names(lines.names.iter().map(|name| name.as_str()))
                    .with_colors(lines.colours.iter().map(|[r, g, b, a]| Color::from_unmultiplied_rgba(*r, *g, *b, *a)))
                    .with_widths(lines.names.iter().map(|_| StrokeWidth(lines.width.into())));
                self.log(at, &style);
                instructions.push(VisualizerInstructionId(instruction.into()));
            }
            self.log(base, &ActiveVisualizers::new(instructions));
        }
        self.log(path.join(&"TimeAxis".into()), &TimeAxis::new().with_link(LinkAxis::LinkToGlobal));
        if let Some(range) = range {
            self.log(
                path.join(&"ScalarAxis".into()),
                &ScalarAxis::new().with_range(Range1D::new(range[0], range[1])).with_zoom_lock(LockRangeDuringZoom(true.into())),
            );
        }
        let shown = PlotLegend::new().with_visible(Visible(legend.is_some().into()));
        self.log(path.join(&"PlotLegend".into()), &legend.map_or(shown.clone(), |corner| shown.with_corner(corner)));
        path
    }

    fn text(&mut self, class: &str, name: &str, origin: &str) -> EntityPath {
        let (_, path) = self.view(class, name, origin, &[format!("{origin}/**")]);
        if class == "TextLog" {
            let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body]
                .map(|kind| TextLogColumn(re_sdk_types::blueprint::datatypes::TextLogColumn { kind, visible: true.into() }));
            self.log(path.join(&"TextLogColumns".into()), &TextLogColumns::new().with_text_log_columns(columns));
        }
        path
    }

    fn states(&mut self, name: &str, contents: &[String]) -> EntityPath {
        let (_, path) = self.view("StateTimeline", name, "/", contents);
        self.log(path.join(&"TimeAxis".into()), &TimeAxis::new().with_link(LinkAxis::LinkToGlobal));
        path
    }

    fn world(&mut self, subject: &Subject) -> EntityPath {
        let (_, path) =
            self.view("3D", "Arm: the coloured mark is the direction ζ it has lost", entity::WORLD, &[format!("{}/**", entity::WORLD)]);
        let eye = EyeControls3D::new()
            .with_position(subject.eye.to_array())
            .with_look_target(subject.look_at.to_array())
            .with_eye_up([0.0, 0.0, 1.0]);
        self.log(path.join(&"EyeControls3D".into()), &eye);
        let floor = Plane3D::new([0.0, 0.0, 1.0], subject.floor_m);
        let grid = LineGrid3D::new().with_plane(floor).with_spacing(0.25).with_color(Color::from_unmultiplied_rgba(150, 165, 185, 70));
        self.log(path.join(&"LineGrid3D".into()), &grid);
        // Paths are drawn in short pieces: all up to the cursor are shown, and the last seconds of ζ's turning.
        let mut span = |of: &str, start: TimeRangeBoundary| {
            let range = |timeline: &str, start: TimeRangeBoundary| {
                VisibleTimeRange(Span { timeline: timeline.into(), range: TimeRange { start, end: TimeRangeBoundary::AT_CURSOR } })
            };
            let in_ticks = match start {
                TimeRangeBoundary::CursorRelative(ns) => TimeRangeBoundary::CursorRelative(TimeInt(ns.0 / 1_000_000)),
                other => other,
            };
            let at = path.join(&"ViewContents/overrides".into()).join(&of.into());
            self.log(at, &VisibleTimeRanges::new([range("t", start), range("tick", in_ticks)]));
        };
        span(entity::PATH_ACTUAL, TimeRangeBoundary::Infinite);
        span(entity::PATH_DESIRED, TimeRangeBoundary::Infinite);
        for (name, _) in &subject.singularities {
            span(&entity::fan(name), TimeRangeBoundary::CursorRelative(TimeInt(-3_000_000_000)));
        }
        path
    }
}

/// The chunks of a layout.
fn layout(subject: &Subject, layout: Layout) -> Vec<ChunkResult<Chunk>> {
    let mut sheet = Sheet { chunks: Vec::new(), ids: 0 };
    arrange(&mut sheet, subject, layout);
    // The outermost container is the last made.
    let root = Uuid::from_u128(ID_BASE + sheet.ids);
    sheet.log("viewport", &ViewportBlueprint::new().with_root_container(RootContainer(root.into())));
    for panel in ["blueprint_panel", "selection_panel"] {
        sheet.log(panel, &PanelBlueprint::new().with_state(PanelState::Hidden));
    }
    let time = TimePanelBlueprint::new().with_state(PanelState::Collapsed).with_timeline(TimelineName("t".into()));
    sheet.log("time_panel", &time);
    sheet.chunks
}

fn arrange(sheet: &mut Sheet, subject: &Subject, layout: Layout) -> EntityPath {
    let joints = || subject.joints.clone();
    let (names, colours): (Vec<String>, Vec<Rgba>) = subject.singularities.iter().cloned().unzip();
    let per_singularity =
        |signal, prefix: &str| Lines::of(signal, names.iter().map(|name| format!("{prefix}{name}")).collect(), colours.iter().copied());
    let per_joint = |signal| Lines::of(signal, joints(), JOINTS);
    let limit = || Lines::guide("guide:limit", "limit", 2, LIMIT);

    let world = sheet.world(subject);
    let now = sheet.text("TextDocument", "What is happening", entity::NOW);
    let log = sheet.text("TextLog", "Log", entity::LOG);
    let states = sheet.states("States", &["/state/**".into()]);
    let mut bands = Lines::guide("guide:eta_in", "η: singular inside", 2 * subject.bands, [255, 120, 120, 170]);
    bands.width = 1.0;
    let outer = Lines::guide("guide:eta_out", "η: regular outside", 2 * subject.bands, [170, 175, 185, 110]);
    let measure = sheet.plot(
        "How near: s_i(q), 0 is singular",
        vec![bands, outer, per_singularity(Signal::Measure, "")],
        None,
        Some(Corner2D::RightTop),
    );
    let error_lines = |unit: &str| vec![format!("across ζ, {unit}"), format!("along ζ, {unit}")];
    let errors = [
        sheet.plot(
            "Position error",
            vec![Lines::of(Signal::PositionError, error_lines("mm"), [ACROSS, ALONG])],
            None,
            Some(Corner2D::RightTop),
        ),
        sheet.plot(
            "Orientation error",
            vec![Lines::of(Signal::OrientationError, error_lines("°"), [ACROSS, ALONG])],
            None,
            Some(Corner2D::RightTop),
        ),
    ];
    let torque_task = sheet.plot("Torque on the hand / limit", vec![limit(), per_joint(Signal::TorqueTaskRatio)], Some([-1.1, 1.1]), None);
    let torque_null = sheet.plot("Torque in the null space / limit", vec![limit(), per_joint(Signal::TorqueNullRatio)], None, None);
    let range =
        sheet.plot("Joints between limits", vec![limit(), per_joint(Signal::PositionInRange)], Some([-1.1, 1.1]), Some(Corner2D::LeftTop));
    let speed = sheet.plot("Joint speeds / limit", vec![limit(), per_joint(Signal::SpeedRatio)], Some([-1.1, 1.1]), None);
    let scale = vec!["time".into(), "task torque".into(), "null torque".into()];
    let governor = sheet.plot(
        "β: 1 hand, 0 null space; and scales of the governor",
        vec![
            Lines::of(Signal::Scale, scale, [[120, 190, 250, 255], [110, 215, 150, 255], [200, 200, 120, 255]]),
            per_singularity(Signal::Beta, "β "),
        ],
        Some([-0.05, 1.05]),
        Some(Corner2D::RightBottom),
    );
    let mut reference = per_singularity(Signal::AuxiliaryReference, "reference ");
    reference.colours.iter_mut().for_each(|colour| colour[3] = 120);
    let auxiliary =
        sheet.plot("Auxiliary coordinates, rad", vec![reference, per_singularity(Signal::Auxiliary, "")], None, Some(Corner2D::RightTop));
    let sigma = sheet.plot(
        "Singular values of the Jacobian",
        vec![Lines::of(Signal::SingularValues, (1..=subject.joints.len().min(6)).map(|i| format!("σ{i}")).collect(), JOINTS)],
        None,
        Some(Corner2D::RightTop),
    );
    let latency = sheet.plot(
        "Latency per hop, µs",
        vec![Lines::of(Signal::Latency, HOP_NAMES.map(str::to_owned).to_vec(), JOINTS)],
        None,
        Some(Corner2D::RightTop),
    );

    match layout {
        Layout::Control => {
            let left = sheet.column(vec![(3.4, world), (1.0, now)]);
            let row_errors = sheet.row(vec![(1.0, errors[0].clone()), (1.0, errors[1].clone())]);
            let row_torque = sheet.row(vec![(1.0, torque_task), (1.0, torque_null)]);
            let row_joints = sheet.row(vec![(1.0, range), (1.0, speed)]);
            let more = sheet.tabs(vec![states, log, governor, auxiliary, sigma, latency]);
            let right = sheet.column(vec![(1.25, measure), (1.0, row_errors), (1.0, row_torque), (1.0, row_joints), (1.15, more)]);
            sheet.row(vec![(1.0, left), (1.0, right)])
        }
        Layout::Timing => {
            let [position, _] = errors;
            let upper = sheet.row(vec![(2.2, latency), (1.0, world)]);
            let lower = sheet.row(vec![(1.0, states), (1.0, log)]);
            let middle = sheet.row(vec![(1.0, position), (1.0, governor)]);
            sheet.column(vec![(2.0, upper), (1.2, lower), (1.0, middle)])
        }
        Layout::Faults => {
            let left = sheet.column(vec![(1.6, world), (1.0, log)]);
            let row_torque = sheet.row(vec![(1.0, torque_task), (1.0, torque_null)]);
            let row_more = sheet.row(vec![(1.0, speed), (1.0, errors[0].clone())]);
            let tail = sheet.tabs(vec![latency, measure, now]);
            let right = sheet.column(vec![(1.5, states), (1.0, row_torque), (1.0, row_more), (1.0, tail)]);
            sheet.row(vec![(1.0, left), (1.25, right)])
        }
    }
}

/// Writes a layout as a blueprint store of its own into `sink` and activates it.
pub(crate) fn send<W: Storage>(sink: &mut Sink<W>, application: &ApplicationId, subject: &Subject, which: Layout) {
    let store = StoreId::random(StoreKind::Blueprint, application.clone());
    sink.announce(&store);
    for chunk in layout(subject, which) {
        sink.chunk(&store, chunk);
    }
    sink.activate(&store);
}
