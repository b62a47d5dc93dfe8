//! The views of a layout, as Rerun blueprint chunks.

use std::collections::BTreeSet;

use re_sdk_types::archetypes::SeriesLines;
use re_sdk_types::blueprint::archetypes::{
    ActiveVisualizers, Background, ContainerBlueprint, EyeControls3D, LineGrid3D, PlotLegend,
    ScalarAxis, TextLogColumns, TimeAxis, ViewBlueprint, ViewContents, VisibleTimeRanges,
    VisualizerInstruction,
};
use re_sdk_types::blueprint::components::{BackgroundKind, ContainerKind, Corner2D, LinkAxis};
use re_sdk_types::blueprint::datatypes::{
    TextLogColumn, TextLogColumnKind, TimelineColumn, VisualizerComponentMapping,
};
use re_sdk_types::components::{Plane3D, Range1D};
use re_sdk_types::datatypes::{TimeRange, TimeRangeBoundary, VisibleTimeRange};
use re_sdk_types::external::uuid::Uuid;
use rerun::AsComponents;
use rerun::log::{Chunk, ChunkResult, RowId};
use rerun::{EntityPath, Timeline};
use shared_types::scenario::Layout;
use xxhash_rust::xxh3::xxh3_64;

use super::{Eye, Subject};
use crate::entity;
use crate::signals::{Kept, Signal};
use crate::solid::Rgba;

/// Lines of a plot: names and colours of the elements of a signal.
pub(super) struct Lines {
    entity: &'static str,
    component: &'static str,
    pub(super) lines: Vec<(String, Rgba)>,
    pub(super) width: f32,
}

impl Lines {
    pub(super) fn of(signal: Signal, lines: impl IntoIterator<Item = (String, Rgba)>) -> Self {
        Self {
            entity: match signal.of().kept {
                Kept::Slow | Kept::Drawn => entity::DRAWN,
                _ => entity::SIGNALS,
            },
            component: signal.component(),
            lines: lines.into_iter().collect(),
            width: 1.5,
        }
    }

    /// Lines that never move.
    pub(super) fn guide(
        component: &'static str,
        name: &str,
        count: usize,
        colour: Rgba,
        width: f32,
    ) -> Self {
        let lines = vec![(name.to_owned(), colour); count];
        Self {
            entity: entity::GUIDES,
            component,
            lines,
            width,
        }
    }

    /// One name, hence one entry of the legend, for lines that are told apart by colours known from other plots.
    pub(super) fn named(mut self, name: &str) -> Self {
        self.lines
            .iter_mut()
            .for_each(|line| name.clone_into(&mut line.0));
        self
    }
}

/// Colour of a fault in force, as in its lane.
const FAULT: Rgba = 0xc03030ff;

/// Ids are made of what they are of: a layout is the same bytes in every file, and no view has the id of one of another class, be it in
/// another layout or in one of an earlier version. The viewer keeps layouts from one opening to the next, and what it knows of a view by its id.
const ID_BASE: u128 = 0xa6b1_0000_0000_4000_8000_0000_0000_0000;

/// A place in a layout with its share of the room.
pub(super) type Cell = (f32, EntityPath);

/// The chunks of one blueprint store.
pub(super) struct Sheet<'a> {
    pub(super) layout: Layout,
    pub(super) subject: &'a Subject,
    pub(super) chunks: Vec<ChunkResult<Chunk>>,
    ids: u64,
    /// The last container made: in the end the outermost.
    pub(super) root: Uuid,
}

impl<'a> Sheet<'a> {
    pub(super) fn new(layout: Layout, subject: &'a Subject) -> Self {
        let (chunks, ids, root) = (Vec::new(), 0, Uuid::nil());
        Self {
            layout,
            subject,
            chunks,
            ids,
            root,
        }
    }

    /// The archetypes of one place, in one chunk: each chunk costs a thousand bytes.
    pub(super) fn log(&mut self, path: impl Into<EntityPath>, archetypes: &[&dyn AsComponents]) {
        let at = [(Timeline::new_sequence("blueprint"), 0)];
        let components = archetypes
            .iter()
            .flat_map(|one| one.as_serialized_batches());
        let chunk = Chunk::builder(path).with_serialized_batches(RowId::new(), at, components);
        self.chunks.push(chunk.build());
    }

    /// A setting of a view.
    fn set(&mut self, view: &EntityPath, name: &str, setting: &dyn AsComponents) {
        self.log(view.join(&name.into()), &[setting]);
    }

    /// The next id, of something of that class and name.
    fn id(&mut self, class: &str, name: &str) -> Uuid {
        self.ids += 1;
        let of = format!("{}/{class}/{name}/{}", self.layout.name(), self.ids);
        // Without the bits of the id's kind.
        Uuid::from_u128(ID_BASE | u128::from(xxh3_64(of.as_bytes()) >> 4))
    }

    /// A view of `contents`; its path is what containers hold.
    fn view(
        &mut self,
        class: &str,
        name: &str,
        origin: &str,
        contents: &[String],
    ) -> (Uuid, EntityPath) {
        let id = self.id(class, name);
        let path = EntityPath::from(format!("view/{id}"));
        let queries = contents.iter().map(|query| query.as_str());
        self.set(&path, "ViewContents", &ViewContents::new(queries));
        let view = ViewBlueprint::new(class).with_display_name(name);
        self.log(path.clone(), &[&view.with_space_origin(origin)]);
        (id, path)
    }

    /// `name` is the title of its tab, where it is in one.
    fn container(&mut self, kind: ContainerKind, name: &str, cells: Vec<Cell>) -> EntityPath {
        self.root = self.id("container", name);
        let path = EntityPath::from(format!("container/{}", self.root));
        let shares = cells.iter().map(|(share, _)| *share);
        let contents = cells.iter().map(|(_, path)| path.to_string());
        let mut container = ContainerBlueprint::new(kind).with_contents(contents.clone());
        container = match kind {
            ContainerKind::Horizontal => container.with_col_shares(shares),
            ContainerKind::Vertical => container.with_row_shares(shares),
            _ => {
                let first = contents.take(1);
                first.fold(container, ContainerBlueprint::with_active_tab)
            }
        };
        if !name.is_empty() {
            container = container.with_display_name(name);
        }
        self.log(path.clone(), &[&container]);
        path
    }

    pub(super) fn row(&mut self, name: &str, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Horizontal, name, cells)
    }

    pub(super) fn column(&mut self, cells: Vec<Cell>) -> EntityPath {
        self.container(ContainerKind::Vertical, "", cells)
    }

    pub(super) fn tabs(&mut self, paths: Vec<EntityPath>) -> EntityPath {
        let cells = paths.into_iter().map(|path| (1.0, path)).collect();
        self.container(ContainerKind::Tabs, "", cells)
    }

    /// A plot of lines over the shared time axis; `range`: fixed y range.
    pub(super) fn plot(
        &mut self,
        name: &str,
        mut lines: Vec<Lines>,
        range: Option<[f64; 2]>,
        legend: Option<Corner2D>,
    ) -> EntityPath {
        // Every plot is as long as the guides: one too thin to be seen, in the legend with the first line.
        let first = lines.first().and_then(|lines| lines.lines.first());
        let zero = first.map(|(name, colour)| Lines::guide("guide:zero", name, 1, *colour, 0.02));
        lines.extend(zero);
        if self.subject.faults {
            let bar = Lines::of(Signal::Fault, [("fault".to_owned(), FAULT)]);
            lines.push(Lines { width: 6.0, ..bar });
        }
        let entities: BTreeSet<&str> = lines.iter().map(|lines| lines.entity).collect();
        let contents: Vec<String> = entities.iter().map(|entity| (*entity).to_owned()).collect();
        let (id, path) = self.view("TimeSeries", name, "/", &contents);
        for entity in entities {
            let base = ViewContents::blueprint_base_visualizer_path_for_entity(id, &entity.into());
            let lines = lines.iter().filter(|lines| lines.entity == entity);
            let instructions: Vec<_> = lines.map(|lines| self.series(&base, lines)).collect();
            self.log(base, &[&ActiveVisualizers::new(instructions)]);
        }
        self.axes(&path, range);
        let shown = PlotLegend::new().with_visible(legend.is_some());
        let shown = legend.map_or(shown.clone(), |corner| shown.with_corner(corner));
        self.set(&path, "PlotLegend", &shown);
        path
    }

    /// How lines of an entity are drawn.
    fn series(&mut self, base: &EntityPath, lines: &Lines) -> Uuid {
        let instruction = self.id("lines", lines.component);
        let at = base.join(&EntityPath::from_single_string(instruction.to_string()));
        let mapping =
            VisualizerComponentMapping::new_source_component("Scalars:scalars", lines.component);
        let instructed = VisualizerInstruction::new("SeriesLines").with_component_map([mapping]);
        let all = lines.lines.iter();
        let style = SeriesLines::new()
            .with_names(all.clone().map(|line| line.0.as_str()))
            .with_colors(all.clone().map(|line| line.1))
            .with_widths(all.map(|_| lines.width));
        self.log(at, &[&instructed, &style]);
        instruction
    }

    fn axes(&mut self, path: &EntityPath, range: Option<[f64; 2]>) {
        // A linked axis is as long as the viewer wants it: a minute at most. A range of its own would be read as ticks on the other time line.
        let (start, end) = (TimeRangeBoundary::Infinite, TimeRangeBoundary::Infinite);
        let axis = match self.subject.is_long {
            true => TimeAxis::new()
                .with_link(LinkAxis::Independent)
                .with_view_range(TimeRange { start, end }),
            false => TimeAxis::new().with_link(LinkAxis::LinkToGlobal),
        };
        self.set(path, "TimeAxis", &axis);
        if let Some([low, high]) = range {
            let axis = ScalarAxis::new().with_range(Range1D::new(low, high));
            self.set(path, "ScalarAxis", &axis.with_zoom_lock(true));
        }
    }

    pub(super) fn text(&mut self, class: &str, name: &str, origin: &str) -> EntityPath {
        let (_, path) = self.view(class, name, origin, &[format!("{origin}/**")]);
        if class == "TextLog" {
            let visible = true.into();
            let columns = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body];
            let columns = columns.map(|kind| TextLogColumn { kind, visible });
            // A column of times is as narrow as its head, which cuts them: each line begins with its time instead.
            let visible = false.into();
            let times = ["t", "tick"].map(|timeline| TimelineColumn {
                timeline: timeline.into(),
                visible,
            });
            let columns = TextLogColumns::new().with_text_log_columns(columns);
            self.set(
                &path,
                "TextLogColumns",
                &columns.with_timeline_columns(times),
            );
        }
        path
    }

    /// Lanes by their paths, in the viewer's own order.
    pub(super) fn states(&mut self, name: &str, lanes: Vec<String>) -> EntityPath {
        let (_, path) = self.view("StateTimeline", name, "/", &lanes);
        self.set(
            &path,
            "TimeAxis",
            &TimeAxis::new().with_link(LinkAxis::LinkToGlobal),
        );
        path
    }

    /// A view of the arm from `eye`, but for what is at a path.
    pub(super) fn world(&mut self, name: &str, eye: &Eye, without: Option<&str>) -> EntityPath {
        let mut contents = vec![format!("{}/**", entity::WORLD)];
        contents.extend(without.map(|path| format!("- {path}")));
        let (id, path) = self.view("3D", name, entity::WORLD, &contents);
        let controls = EyeControls3D::new()
            .with_position(eye.position.to_array())
            .with_look_target(eye.look_at.to_array())
            .with_eye_up(eye.up.to_array());
        self.set(&path, "EyeControls3D", &controls);
        let background = Background::new(BackgroundKind::SolidColor);
        self.set(&path, "Background", &background.with_color(0x181c24ff));
        let grid = LineGrid3D::new()
            .with_plane(Plane3D::new([0.0, 0.0, 1.0], self.subject.floor_m))
            .with_spacing(0.25)
            .with_color(0x96a5b92d);
        self.set(&path, "LineGrid3D", &grid);
        // Paths are drawn in short pieces: all up to the cursor are shown.
        let (start, end) = (TimeRangeBoundary::Infinite, TimeRangeBoundary::AT_CURSOR);
        let range = |timeline: &str| {
            let range = TimeRange { start, end };
            VisibleTimeRange {
                timeline: timeline.into(),
                range,
            }
        };
        let mut paths = vec![
            entity::PATH_ACTUAL,
            entity::PATH_DESIRED,
            entity::PATH_RIVAL,
            entity::PATH_ELBOW,
        ];
        paths.extend(self.subject.stands_still.then_some(entity::PATH_MAGNIFIED));
        for of in paths {
            let at = ViewContents::blueprint_base_visualizer_path_for_entity(id, &of.into());
            self.log(at, &[&VisibleTimeRanges::new([range("t"), range("tick")])]);
        }
        path
    }
}
