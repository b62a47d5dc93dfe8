//! How a recording is shown: one layout per purpose, as Rerun blueprint chunks.
//!
//! Written as the archetypes the viewer reads (containers, views, visualizer instructions), because several settings, such as the eye,
//! the grid, axes, legends and time ranges, have no other way in.

mod desk;
mod sheet;

use glam::Vec3;
use re_sdk_types::blueprint::archetypes::{PanelBlueprint, TimePanelBlueprint, ViewportBlueprint};
use re_sdk_types::blueprint::components::{LoopMode, PanelState, PlayState};
use re_sdk_types::datatypes::TimeInt;
use rerun::StoreId;
use rerun::external::re_log_types::{SetStoreInfo, StoreInfo};
use rerun::external::re_tuid::Tuid;
use rerun::log::{Chunk, ChunkResult, LogMsg};
use shared_types::scenario::{Layout, Segment};

use crate::entity::Lives;
use crate::sink::{RecordError, source};
use crate::solid::Rgba;
use sheet::Sheet;

/// Colours of joints, in order.
pub(crate) const JOINTS: [Rgba; 8] = [
    0x569ce6ff, 0x40c8b4ff, 0xa0d25aff, 0xf5be50ff, 0xf06e69ff, 0xbe8cf5ff, 0xc8c8cdff, 0x788291ff,
];

/// Colours of errors orthogonal to ζ and along it.
pub(crate) const ACROSS: Rgba = 0x6ed796ff;
pub(crate) const ALONG: Rgba = 0xfa96d2ff;
/// Lines that hatch the band of a plot in which the arm is treated as singular.
pub(crate) const BAND_LINES: usize = 32;
/// How much larger the way of a hand that should stand still is drawn.
pub(crate) const MAGNIFIED: f32 = 50.0;

/// The properties of a run that its blueprint depends on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subject {
    pub(crate) joints: usize,
    /// Units of a speed and of a load, where joints have no limits.
    pub(crate) units: [&'static str; 2],
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
    /// Width over height of the pane that shows the whole arm.
    pub(crate) pane: f32,
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

pub(crate) use desk::pane;

/// The messages of a layout. `repeated`: the stretch of time to play again, ns, once the run is over; before, the viewer would not follow a live one.
pub(crate) fn messages(
    store: &StoreId,
    subject: &Subject,
    which: Layout,
    repeated: Option<(i64, i64)>,
) -> Result<Vec<LogMsg>, RecordError> {
    let info = LogMsg::SetStoreInfo(SetStoreInfo {
        row_id: Tuid::new(),
        info: StoreInfo::new(store.clone(), source()),
    });
    let chunks = layout(subject, which, repeated).into_iter().map(|chunk| {
        let message = chunk.and_then(|chunk| chunk.to_arrow_msg())?;
        Ok(LogMsg::ArrowMsg(store.clone(), message))
    });
    let all: ChunkResult<Vec<_>> = std::iter::once(Ok(info)).chain(chunks).collect();
    all.map_err(|error| RecordError::Rerun(error.to_string()))
}

/// The chunks of a layout.
fn layout(
    subject: &Subject,
    layout: Layout,
    repeated: Option<(i64, i64)>,
) -> Vec<ChunkResult<Chunk>> {
    let mut sheet = Sheet::new(layout, subject);
    sheet.arrange();
    let viewport = ViewportBlueprint::new().with_root_container(sheet.root);
    sheet.log("viewport", &[&viewport]);
    for panel in ["blueprint_panel", "selection_panel"] {
        sheet.log(
            panel,
            &[&PanelBlueprint::new().with_state(PanelState::Hidden)],
        );
    }
    let mut time = TimePanelBlueprint::new()
        .with_state(PanelState::Collapsed)
        .with_timeline("t");
    if let Some((first, last)) = repeated {
        let (min, max) = (TimeInt(first), TimeInt(last));
        let range = re_sdk_types::datatypes::AbsoluteTimeRange { min, max };
        time = time
            .with_loop_mode(LoopMode::Selection)
            .with_time_selection(range)
            .with_play_state(PlayState::Playing);
    }
    sheet.log("time_panel", &[&time]);
    sheet.chunks
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_sdk_types::blueprint::archetypes::ViewBlueprint;
    use std::collections::BTreeMap;

    /// The viewer keeps what it knows of a view by its id.
    #[test]
    fn no_view_has_the_id_of_one_of_another_class_in_any_layout() {
        let class = ViewBlueprint::descriptor_class_identifier().component;
        let view = |chunk: ChunkResult<Chunk>| {
            let chunk = chunk.expect("a chunk");
            let column = chunk.components().get(class)?;
            Some((
                chunk.entity_path().to_string(),
                format!("{:?}", column.list_array.value(0)),
            ))
        };
        let views = |which| {
            layout(&Subject::default(), which, None)
                .into_iter()
                .filter_map(view)
        };
        let all: Vec<(String, String)> = Layout::ALL.into_iter().flat_map(views).collect();
        assert!(all.len() > 20, "{}", all.len());
        assert_eq!(
            all.iter().cloned().collect::<BTreeMap<_, _>>().len(),
            all.len()
        );
        assert!(views(Layout::Control).eq(views(Layout::Control)));
    }
}
