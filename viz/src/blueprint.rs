//! How a recording is shown: one layout per purpose, as Rerun blueprint chunks.
//!
//! Written as the archetypes the viewer reads (containers, views, visualizer instructions), because several settings, such as the eye,
//! the grid, axes, legends and time ranges, have no other way in.

use glam::Vec3;
use re_chunk::{Chunk, ChunkResult, EntityPath, RowId, Timeline};
use re_log_types::StoreId;
use re_sdk_types::AsComponents;
use re_sdk_types::archetypes::SeriesLines;
use re_sdk_types::blueprint::archetypes::{
    ActiveVisualizers, Background, ContainerBlueprint, EyeControls3D, LineGrid3D, PanelBlueprint, PlotLegend, ScalarAxis, TextLogColumns,
    TimeAxis, TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint, VisibleTimeRanges, VisualizerInstruction,
};
use re_sdk_types::blueprint::components::{
    ActiveTab, BackgroundKind, ColumnShare, ContainerKind, Corner2D, IncludedContent, LinkAxis, LockRangeDuringZoom, PanelState,
    RootContainer, RowShare, TextLogColumn, TimelineName, VisibleTimeRange, VisualizerComponentMapping, VisualizerInstructionId,
};
use re_sdk_types::blueprint::datatypes::{ComponentSourceKind, TextLogColumnKind, VisualizerComponentMapping as Mapping};
use re_sdk_types::components::{Color, Name, Plane3D, Range1D, StrokeWidth, Visible};
use re_sdk_types::datatypes::{TimeInt, TimeRange, TimeRangeBoundary, VisibleTimeRange as Span};
use re_sdk_types::external::uuid::Uuid;
use shared_types::scenario::Layout;

use crate::entity;
use crate::signals::{HOP_NAMES, Signal};
use crate::sink::Sink;
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
const LIMITS: Option<[f64; 2]> = Some([-1.1, 1.1]);

/// The properties of a run that its blueprint depends on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subject {
    pub(crate) joints: usize,
    /// Name and colour of each singularity, in the report's order.
    pub(crate) singularities: Vec<(String, Rgba)>,
    /// Distinct thresholds (η_in, η_out).
    pub(crate) bands: usize,
    /// The largest η_out; 0 where none is known.
    pub(crate) widest: f64,
    /// Torque over its limit is undefined: some joint has no limit.
    pub(crate) unlimited_torque: bool,
    /// The same for speeds.
    pub(crate) unlimited_speed: bool,
    pub(crate) eye: Eye,
    pub(crate) floor_m: f32,
}

/// From where the arm is seen; base axes, m.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) up: Vec3,
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

/// Ids are made of what they are of: a layout is the same bytes in every file, and no view has the id of one of another class, be it in
/// another layout or in one of an earlier version. The viewer keeps layouts from one opening to the next, and what it knows of a view by its id.
const ID_BASE: u128 = 0xa6b1_0000_0000_4000_8000_0000_0000_0000;

/// A place in a layout with its share of the room.
type Cell = (f32, EntityPath);

/// The chunks of one blueprint store.
struct Sheet {
    layout: Layout,
    chunks: Vec<ChunkResult<Chunk>>,
    ids: u64,
    /// The last container made: in the end the outermost.
    root: Uuid,
}

impl Sheet {
    fn log(&mut self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let at = [(Timeline::new_sequence("blueprint"), 0)];
        self.chunks.push(Chunk::builder(path).with_archetype(RowId::new(), at, archetype).build());
    }

    /// The next id, of something of that class and name.
    fn id(&mut self, class: &str, name: &str) -> Uuid {
        self.ids += 1;
        let of = format!("{}/{class}/{name}/{}", self.layout.name(), self.ids);
        // FNV-1a, without the bits of the id's kind.
        let hash = of.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
        Uuid::from_u128(ID_BASE | u128::from(hash >> 4))
    }

    /// A view of `contents`; its path is what containers hold.
    fn view(&mut self, class: &str, name: &str, origin: &str, contents: &[String]) -> (Uuid, EntityPath) {
        let id = self.id(class, name);
        let path = EntityPath::from(format!("view/{id}"));
        self.log(path.join(&"ViewContents".into()), &ViewContents::new(contents.iter().map(|query| query.as_str())));
        self.log(path.clone(), &ViewBlueprint::new(class).with_display_name(Name(name.into())).with_space_origin(origin));
        (id, path)
    }

    /// `name` is the title of its tab, where it is in one.
    fn container(&mut self, kind: ContainerKind, name: &str, cells: Vec<Cell>) -> EntityPath {
        self.root = self.id("container", name);
        let path = EntityPath::from(format!("container/{}", self.root));
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
        if !name.is_empty() {
            container = container.with_display_name(Name(name.into()));
        }
        self.log(path.clone(), &container);
        path
    }

    fn row(&mut self, name: &str, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Horizontal, name, cells)
    }

    fn column(&mut self, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Vertical, "", cells)
    }

    fn tabs(&mut self, paths: Vec<EntityPath>) -> EntityPath {
        self.container(ContainerKind::Tabs, "", paths.into_iter().map(|path| (1.0, path)).collect())
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
                let instruction = self.id("lines", lines.component);
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

    fn states(&mut self, name: &str, lanes: &[&str]) -> EntityPath {
        let contents: Vec<String> = lanes.iter().map(|lane| format!("$origin/{lane}")).collect();
        let (_, path) = self.view("StateTimeline", name, entity::STATE, &contents);
        self.log(path.join(&"TimeAxis".into()), &TimeAxis::new().with_link(LinkAxis::LinkToGlobal));
        path
    }

    fn world(&mut self, subject: &Subject) -> EntityPath {
        let (id, path) =
            self.view("3D", "Arm: the coloured mark is the direction ζ it has lost", entity::WORLD, &[format!("{}/**", entity::WORLD)]);
        let Eye { position, look_at, up } = subject.eye;
        let eye = EyeControls3D::new().with_position(position.to_array()).with_look_target(look_at.to_array()).with_eye_up(up.to_array());
        self.log(path.join(&"EyeControls3D".into()), &eye);
        let background = Background::new(BackgroundKind::SolidColor).with_color(Color::from_rgb(24, 28, 36));
        self.log(path.join(&"Background".into()), &background);
        let floor = Plane3D::new([0.0, 0.0, 1.0], subject.floor_m);
        let grid = LineGrid3D::new().with_plane(floor).with_spacing(0.25).with_color(Color::from_unmultiplied_rgba(150, 165, 185, 45));
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
            let at = ViewContents::blueprint_base_visualizer_path_for_entity(id, &of.into());
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
    let mut sheet = Sheet { layout, chunks: Vec::new(), ids: 0, root: Uuid::nil() };
    arrange(&mut sheet, subject, layout);
    let root = RootContainer(sheet.root.into());
    sheet.log("viewport", &ViewportBlueprint::new().with_root_container(root));
    for panel in ["blueprint_panel", "selection_panel"] {
        sheet.log(panel, &PanelBlueprint::new().with_state(PanelState::Hidden));
    }
    // No loop: the viewer would not follow a live run then.
    let time = TimePanelBlueprint::new().with_state(PanelState::Collapsed).with_timeline(TimelineName("t".into()));
    sheet.log("time_panel", &time);
    sheet.chunks
}

fn arrange(sheet: &mut Sheet, subject: &Subject, layout: Layout) {
    let mut desk = Desk { sheet, subject };
    match layout {
        Layout::Control => {
            let left = [(3.2, desk.world()), (1.0, desk.now())];
            let torques = desk.torques();
            let more = [desk.errors(), desk.joints(), desk.governor(), desk.auxiliary(), desk.singular_values(), desk.latency()];
            let more = desk.sheet.tabs(more.into());
            let modes = [desk.modes(), desk.log()];
            let modes = desk.sheet.tabs(modes.into());
            let right = [(1.35, desk.measure()), (1.1, torques), (1.1, more), (1.15, modes)];
            let cells = vec![(1.0, desk.sheet.column(left.into())), (1.0, desk.sheet.column(right.into()))];
            desk.sheet.row("", cells);
        }
        Layout::Timing => {
            let upper = [(2.2, desk.latency()), (1.0, desk.world())];
            let middle = [(1.0, desk.lives()), (1.0, desk.modes()), (1.0, desk.log())];
            let lower = [(1.0, desk.errors()), (1.0, desk.governor())];
            let rows = [(2.0, upper.to_vec()), (1.3, middle.to_vec()), (1.0, lower.to_vec())];
            let cells = rows.map(|(share, row)| (share, desk.sheet.row("", row)));
            desk.sheet.column(cells.into());
        }
        Layout::Faults => {
            let left = [(1.6, desk.world()), (0.85, desk.now()), (1.05, desk.log())];
            let more = [desk.errors(), desk.joints(), desk.measure(), desk.governor(), desk.latency()];
            let more = desk.sheet.tabs(more.into());
            let right = [(1.5, desk.lives()), (1.0, desk.torques()), (1.1, more), (1.25, desk.modes())];
            let cells = vec![(1.0, desk.sheet.column(left.into())), (1.2, desk.sheet.column(right.into()))];
            desk.sheet.row("", cells);
        }
    }
}

/// The panes that layouts are made of.
struct Desk<'a> {
    sheet: &'a mut Sheet,
    subject: &'a Subject,
}

impl Desk<'_> {
    fn per_joint(&self, signal: Signal) -> Vec<Lines> {
        let names = (1..=self.subject.joints).map(|i| format!("q{i}")).collect();
        vec![Lines::of(signal, names, JOINTS)]
    }

    fn per_singularity(&self, signal: Signal, prefix: &str) -> Lines {
        let names = self.subject.singularities.iter().map(|(name, _)| format!("{prefix}{name}")).collect();
        Lines::of(signal, names, self.subject.singularities.iter().map(|(_, colour)| *colour))
    }

    fn world(&mut self) -> EntityPath {
        self.sheet.world(self.subject)
    }

    fn now(&mut self) -> EntityPath {
        self.sheet.text("TextDocument", "What is happening", entity::NOW)
    }

    fn log(&mut self) -> EntityPath {
        self.sheet.text("TextLog", "Log", entity::LOG)
    }

    fn modes(&mut self) -> EntityPath {
        self.sheet.states("Modes", &["mode/**", "phase"])
    }

    fn lives(&mut self) -> EntityPath {
        self.sheet.states("Processes and drive", &["process/**", "drive"])
    }

    /// s_i(q) between its thresholds, near enough to see them: what is far away matters less.
    fn measure(&mut self) -> EntityPath {
        let inner = Lines::guide("guide:eta_in", "± η in", 2 * self.subject.bands, [255, 64, 84, 255]);
        let outer = Lines::guide("guide:eta_out", "± η out", 2 * self.subject.bands, [190, 195, 205, 150]);
        let mut measures = self.per_singularity(Signal::Measure, "");
        measures.width = 2.5;
        let range = (self.subject.widest > 0.0).then(|| [-5.2 * self.subject.widest, 5.2 * self.subject.widest]);
        self.sheet.plot(
            "How near: s_i(q). 0 is singular, within ± η it is treated so",
            vec![inner, outer, measures],
            range,
            Some(Corner2D::RightBottom),
        )
    }

    fn errors(&mut self) -> EntityPath {
        let pane = |sheet: &mut Sheet, name, signal, unit: &str| {
            let names = vec![format!("orthogonal to ζ, {unit}"), format!("along ζ, {unit}")];
            sheet.plot(name, vec![Lines::of(signal, names, [ACROSS, ALONG])], None, Some(Corner2D::RightTop))
        };
        let position = pane(self.sheet, "Position error, mm", Signal::PositionError, "mm");
        let orientation = pane(self.sheet, "Orientation error, °", Signal::OrientationError, "°");
        self.sheet.row("Task errors", vec![(1.0, position), (1.0, orientation)])
    }

    fn torques(&mut self) -> EntityPath {
        let (task, null, of) = match self.subject.unlimited_torque {
            true => (Signal::TorqueTask, Signal::TorqueNull, ", N·m"),
            false => (Signal::TorqueTaskRatio, Signal::TorqueNullRatio, " / limit"),
        };
        let task = self.sheet.plot(&format!("Torque on the hand{of}"), self.per_joint(task), None, Some(Corner2D::LeftBottom));
        let null = self.sheet.plot(&format!("Torque in the null space{of}"), self.per_joint(null), None, None);
        self.sheet.row("Torques", vec![(1.0, task), (1.0, null)])
    }

    fn joints(&mut self) -> EntityPath {
        let range = self.per_joint(Signal::PositionInRange);
        let range = self.sheet.plot("Joints between limits ±1", range, LIMITS, Some(Corner2D::LeftBottom));
        let (speed, of) = match self.subject.unlimited_speed {
            true => (Signal::Speed, ", rad/s"),
            false => (Signal::SpeedRatio, " / limit"),
        };
        let speed = self.sheet.plot(&format!("Joint speeds{of}"), self.per_joint(speed), None, None);
        self.sheet.row("Joints", vec![(1.0, range), (1.0, speed)])
    }

    /// Modes of control and their rates.
    fn governor(&mut self) -> EntityPath {
        let names = ["time", "task torque", "null torque"].map(str::to_owned).to_vec();
        let scales = Lines::of(Signal::Scale, names, [[120, 190, 250, 255], [110, 215, 150, 255], [200, 200, 120, 255]]);
        let beta = self.per_singularity(Signal::Beta, "β ");
        self.sheet.plot("β (1 hand, 0 null space), governor", vec![scales, beta], Some([-0.05, 1.05]), Some(Corner2D::RightBottom))
    }

    fn auxiliary(&mut self) -> EntityPath {
        let mut reference = self.per_singularity(Signal::AuxiliaryReference, "reference ");
        reference.colours.iter_mut().for_each(|colour| colour[3] = 120);
        let actual = self.per_singularity(Signal::Auxiliary, "");
        self.sheet.plot("Auxiliary coordinates, rad", vec![reference, actual], None, Some(Corner2D::RightTop))
    }

    fn singular_values(&mut self) -> EntityPath {
        let names = (1..=self.subject.joints.min(6)).map(|i| format!("σ{i}")).collect();
        self.sheet.plot("Singular values", vec![Lines::of(Signal::SingularValues, names, JOINTS)], None, Some(Corner2D::RightTop))
    }

    fn latency(&mut self) -> EntityPath {
        let hops = Lines::of(Signal::Latency, HOP_NAMES.map(str::to_owned).to_vec(), JOINTS);
        self.sheet.plot("Latency per hop, µs", vec![hops], None, Some(Corner2D::RightTop))
    }
}

/// Writes a layout as a blueprint store into `sink` and activates it.
pub(crate) fn send(sink: &mut Sink, store: &StoreId, subject: &Subject, which: Layout) {
    sink.announce(store);
    for chunk in layout(subject, which) {
        sink.chunk(store, chunk);
    }
    sink.activate(store);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Ids of views, with their classes.
    fn views(layout: Layout) -> Vec<(String, String)> {
        let subject = Subject { joints: 6, singularities: vec![("wrist".to_owned(), [255; 4])], bands: 1, ..Subject::default() };
        let chunks: Vec<Chunk> = super::layout(&subject, layout).into_iter().map(|chunk| chunk.expect("a chunk")).collect();
        let class = |chunk: &Chunk| {
            let column = chunk.components().get(ViewBlueprint::descriptor_class_identifier().component)?;
            Some(format!("{:?}", column.list_array.value(0)))
        };
        chunks.iter().filter_map(|chunk| Some((chunk.entity_path().to_string(), class(chunk)?))).collect()
    }

    #[test]
    fn no_view_has_the_id_of_one_of_another_class_in_any_layout() {
        let mut classes = BTreeMap::new();
        let all: Vec<(String, String)> = Layout::ALL.into_iter().flat_map(views).collect();
        assert!(all.len() > 25, "{}", all.len());
        for (id, class) in &all {
            assert_eq!(classes.insert(id, class).unwrap_or(class), class, "{id}");
        }
        assert_eq!(classes.len(), all.len(), "each has its own");
        assert_eq!(views(Layout::Control), views(Layout::Control), "the same in every file");
    }
}
