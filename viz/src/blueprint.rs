//! How a recording is shown: one layout per purpose, as Rerun blueprint chunks.
//!
//! Written as the archetypes the viewer reads (containers, views, visualizer instructions), because several settings, such as the eye,
//! the grid, axes, legends and time ranges, have no other way in.

mod desk;
mod sheet;

use glam::Vec3;
use re_chunk::{Chunk, ChunkResult};
use re_sdk_types::blueprint::archetypes::{PanelBlueprint, TimePanelBlueprint, ViewportBlueprint};
use re_sdk_types::blueprint::components::{
    AbsoluteTimeRange, LoopMode, PanelState, PlayState, RootContainer, TimelineName,
};
use re_sdk_types::datatypes::TimeInt;
use shared_types::scenario::{Layout, Segment};

use crate::entity::Lives;
use crate::solid::Rgba;
use desk::{Desk, close_up_name, world_name};
use sheet::Sheet;

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

/// Colours of errors orthogonal to ζ and along it.
pub(crate) const ACROSS: Rgba = [110, 215, 150, 255];
pub(crate) const ALONG: Rgba = [250, 150, 210, 255];
/// Lines that hatch the band of a plot in which the arm is treated as singular.
pub(crate) const BAND_LINES: usize = 32;
/// How much larger the way of a hand that should stand still is drawn.
pub(crate) const MAGNIFIED: f32 = 50.0;

/// The properties of a run that its blueprint depends on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subject {
    pub(crate) joints: usize,
    /// Name and colour of each singularity, in the report's order.
    pub(crate) singularities: Vec<(String, Rgba)>,
    /// Distinct ratios η_out / η_in.
    pub(crate) outer: Vec<f64>,
    /// The goal's tolerances: mm and degrees; `None` where it does not judge.
    pub(crate) goal: [Option<f64>; 2],
    /// Faults are planned, or have come: plots have a bar for them.
    pub(crate) faults: bool,
    /// The run is longer than the minute around the cursor that plots show by themselves.
    pub(crate) is_long: bool,
    /// The task is to stand still with the hand while the joints move.
    pub(crate) stands_still: bool,
    /// The task has no orientation, hence no error of it.
    pub(crate) without_orientation: bool,
    /// Torque over its limit is undefined: some joint has no limit.
    pub(crate) unlimited_torque: bool,
    /// The same for speeds.
    pub(crate) unlimited_speed: bool,
    /// Where each segment of the task takes the hand, as far as the scenario itself says it.
    pub(crate) ways: Vec<Way>,
    pub(crate) eye: Eye,
    /// Near the singular frame, across ζ.
    pub(crate) close_up: Eye,
    pub(crate) floor_m: f32,
    /// The processes that have lanes.
    pub(crate) lives: Lives,
}

/// The end of a segment of the task; base axes, m.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Way {
    To(Vec3),
    By(Vec3),
}

impl Way {
    /// That of a segment which gives a place or a way in base axes.
    pub(crate) fn of(segment: &Segment) -> Option<Self> {
        let vector = |v: [f64; 3]| Vec3::from(v.map(|x| x as f32));
        let slide = segment.slide.as_ref().and_then(|slide| {
            let axis = ["x", "y", "z"]
                .iter()
                .position(|axis| *axis == slide.along)?;
            Some(Vec3::AXES[axis] * slide.by_m as f32)
        });
        let by = segment.by_m.map(vector).or(slide).map(Self::By);
        segment.to_m.map(|place| Self::To(vector(place))).or(by)
    }

    /// The hand's place after it.
    pub(crate) fn after(self, place: Vec3) -> Vec3 {
        match self {
            Self::To(end) => end,
            Self::By(way) => place + way,
        }
    }
}

/// From where the arm is seen; base axes, m.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) up: Vec3,
}

/// The chunks of a layout.
pub(crate) fn layout(subject: &Subject, layout: Layout) -> Vec<ChunkResult<Chunk>> {
    let mut sheet = Sheet::new(layout, true);
    Desk::new(&mut sheet, subject).arrange(layout);
    log_root(&mut sheet);
    for panel in ["blueprint_panel", "selection_panel"] {
        sheet.log(
            panel,
            &[&PanelBlueprint::new().with_state(PanelState::Hidden)],
        );
    }
    // No loop: the viewer would not follow a live run then.
    sheet.log("time_panel", &[&time_panel()]);
    sheet.chunks
}

fn log_root(sheet: &mut Sheet) {
    let root = RootContainer(sheet.root.into());
    sheet.log(
        "viewport",
        &[&ViewportBlueprint::new().with_root_container(root)],
    );
}

fn time_panel() -> TimePanelBlueprint {
    TimePanelBlueprint::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(TimelineName("t".into()))
}

/// Settings known at the end of a run only: the stretch of time to repeat, ns, and the eye of the close-up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ending {
    pub(crate) loop_ns: (i64, i64),
    pub(crate) close_up: Eye,
    /// From where all of the arm's way is seen, in views whose eye stands where it was placed at the beginning.
    pub(crate) main: Option<Eye>,
}

/// What the ending adds to a blueprint that has been sent, to be activated again: the viewer works on a copy made at activation. With
/// `is_changed`, because the subject is another than the blueprint was sent for, all of its views too.
pub(crate) fn ending(
    subject: &Subject,
    which: Layout,
    ending: &Ending,
    is_changed: bool,
) -> Vec<ChunkResult<Chunk>> {
    // The ids of the same layout again, without its other chunks.
    let mut places = Sheet::new(which, is_changed);
    Desk::new(&mut places, subject).arrange(which);
    if is_changed {
        log_root(&mut places);
    }
    places.makes_chunks = true;
    let range = AbsoluteTimeRange(re_sdk_types::datatypes::AbsoluteTimeRange {
        min: TimeInt(ending.loop_ns.0),
        max: TimeInt(ending.loop_ns.1),
    });
    let time = time_panel()
        .with_loop_mode(LoopMode::Selection)
        .with_time_selection(range)
        .with_play_state(PlayState::Playing);
    places.log("time_panel", &[&time]);
    let eyes = [
        (close_up_name(subject), Some(ending.close_up)),
        (world_name(subject), ending.main),
    ];
    for (name, eye) in eyes {
        if let Some((view, eye)) = places.views.get(name).cloned().zip(eye) {
            places.eye(&view, &eye);
        }
    }
    places.chunks
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_sdk_types::blueprint::archetypes::ViewBlueprint;
    use std::collections::BTreeMap;

    fn subject(joints: usize, faults: bool) -> Subject {
        let singularities = ["elbow", "wrist", "overhead"].map(|name| (name.to_owned(), [255; 4]));
        Subject {
            joints,
            faults,
            singularities: singularities.to_vec(),
            outer: vec![2.0],
            goal: [Some(1.0); 2],
            ..Subject::default()
        }
    }

    #[test]
    fn no_legend_has_more_entries_than_its_plot_has_room_for() {
        let runs = [(3, false), (3, true), (6, false), (6, true), (7, true)];
        for ((joints, faults), which) in runs
            .into_iter()
            .flat_map(|run| Layout::ALL.map(|layout| (run, layout)))
        {
            let mut sheet = Sheet::new(which, true);
            Desk::new(&mut sheet, &subject(joints, faults)).arrange(which);
            assert!(!sheet.legends.is_empty());
            for (plot, entries) in &sheet.legends {
                let is_large = which == Layout::Faults
                    || (which == Layout::Timing && plot.starts_with("Latency"));
                assert!(
                    *entries <= if is_large { 8 } else { 6 },
                    "{which:?}, {joints} joints: {plot:?}"
                );
            }
        }
    }

    /// The viewer keeps what it knows of a view by its id.
    #[test]
    fn no_view_has_the_id_of_one_of_another_class_in_any_layout() {
        let views = |which: Layout| -> Vec<(String, String)> {
            let class = ViewBlueprint::descriptor_class_identifier().component;
            let view = |chunk: ChunkResult<Chunk>| {
                let chunk = chunk.expect("a chunk");
                let column = chunk.components().get(class)?;
                Some((
                    chunk.entity_path().to_string(),
                    format!("{:?}", column.list_array.value(0)),
                ))
            };
            layout(&subject(6, false), which)
                .into_iter()
                .filter_map(view)
                .collect()
        };
        let all: Vec<(String, String)> = Layout::ALL.into_iter().flat_map(views).collect();
        assert!(all.len() > 25, "{}", all.len());
        assert_eq!(
            all.iter().cloned().collect::<BTreeMap<_, _>>().len(),
            all.len()
        );
        assert_eq!(views(Layout::Control), views(Layout::Control));
    }
}
