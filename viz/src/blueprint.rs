//! How a recording is shown: one layout per purpose, as Rerun blueprint chunks.
//!
//! Written as the archetypes the viewer reads (containers, views, visualizer instructions), because several settings, such as the eye,
//! the grid, axes, legends and time ranges, have no other way in.

mod desk;
mod sheet;
mod subject;

use re_chunk::{Chunk, ChunkResult};
use re_log_types::StoreId;
use re_sdk_types::blueprint::archetypes::{PanelBlueprint, TimePanelBlueprint, ViewportBlueprint};
use re_sdk_types::blueprint::components::{
    AbsoluteTimeRange, LoopMode, PanelState, PlayState, RootContainer, TimelineName,
};
use re_sdk_types::datatypes::TimeInt;
use shared_types::scenario::Layout;

use crate::sink::Sink;
use desk::{Desk, close_up_name, world_name};
use sheet::Sheet;
pub(crate) use subject::{ACROSS, ALONG, Eye, JOINTS, Subject, Way};

/// The chunks of a layout.
fn layout(subject: &Subject, layout: Layout) -> Vec<ChunkResult<Chunk>> {
    let mut sheet = Sheet::new(layout);
    Desk::new(&mut sheet, subject).arrange(layout);
    let root = RootContainer(sheet.root.into());
    sheet.log(
        "viewport",
        &ViewportBlueprint::new().with_root_container(root),
    );
    for panel in ["blueprint_panel", "selection_panel"] {
        sheet.log(panel, &PanelBlueprint::new().with_state(PanelState::Hidden));
    }
    // No loop: the viewer would not follow a live run then.
    sheet.log("time_panel", &time_panel());
    sheet.chunks
}

fn time_panel() -> TimePanelBlueprint {
    TimePanelBlueprint::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(TimelineName("t".into()))
}

/// Writes a layout as a blueprint store into `sink` and activates it.
pub(crate) fn send(sink: &Sink, store: &StoreId, subject: &Subject, which: Layout) {
    sink.send_blueprint(store, layout(subject, which));
}

/// Settings known at the end of a run only: the stretch of time to repeat, ns, and the eye of the close-up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ending {
    pub(crate) loop_ns: (i64, i64),
    pub(crate) close_up: Eye,
    /// From where all of the arm's way is seen, in views whose eye stands where it was placed at the beginning.
    pub(crate) main: Option<Eye>,
}

/// Adds the ending to a blueprint that has been sent, and activates it again: the viewer works on a copy made at activation. With
/// `is_changed`, because the subject is another than the blueprint was sent for, all of its views too.
pub(crate) fn send_ending(
    sink: &Sink,
    store: &StoreId,
    subject: &Subject,
    which: Layout,
    ending: &Ending,
    is_changed: bool,
) {
    // The ids of the same layout again, without its other chunks.
    let mut places = if is_changed {
        Sheet::new(which)
    } else {
        Sheet::without_chunks(which)
    };
    Desk::new(&mut places, subject).arrange(which);
    let views = [
        (
            places.view_named(close_up_name(subject)),
            Some(ending.close_up),
        ),
        (places.view_named(world_name(subject)), ending.main),
    ];
    places.make_chunks();
    if is_changed {
        let root = RootContainer(places.root.into());
        places.log(
            "viewport",
            &ViewportBlueprint::new().with_root_container(root),
        );
    }
    let (min, max) = ending.loop_ns;
    let range = AbsoluteTimeRange(re_sdk_types::datatypes::AbsoluteTimeRange {
        min: TimeInt(min),
        max: TimeInt(max),
    });
    let time = time_panel()
        .with_loop_mode(LoopMode::Selection)
        .with_time_selection(range)
        .with_play_state(PlayState::Playing);
    places.log("time_panel", &time);
    for (view, eye) in views.into_iter().filter_map(|(view, eye)| view.zip(eye)) {
        places.eye(&view, &eye);
    }
    sink.send_blueprint(store, places.chunks);
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_sdk_types::blueprint::archetypes::ViewBlueprint;
    use std::collections::BTreeMap;

    /// Ids of views, with their classes.
    fn views(layout: Layout) -> Vec<(String, String)> {
        let subject = Subject {
            joints: 6,
            singularities: vec![("wrist".to_owned(), [255; 4])],
            outer: vec![2.0],
            ..Subject::default()
        };
        let chunks: Vec<Chunk> = super::layout(&subject, layout)
            .into_iter()
            .map(|chunk| chunk.expect("a chunk"))
            .collect();
        let class = |chunk: &Chunk| {
            let column = chunk
                .components()
                .get(ViewBlueprint::descriptor_class_identifier().component)?;
            Some(format!("{:?}", column.list_array.value(0)))
        };
        chunks
            .iter()
            .filter_map(|chunk| Some((chunk.entity_path().to_string(), class(chunk)?)))
            .collect()
    }

    #[test]
    fn no_legend_has_more_entries_than_its_plot_has_room_for() {
        let singularities = ["elbow", "wrist", "overhead"]
            .map(|name| (name.to_owned(), [255; 4]))
            .to_vec();
        let tested = [3, 6, 7]
            .into_iter()
            .flat_map(|joints| [false, true].map(|faults| (joints, faults)));
        for ((joints, faults), which) in
            tested.flat_map(|run| Layout::ALL.map(|layout| (run, layout)))
        {
            let subject = Subject {
                joints,
                faults,
                singularities: singularities.clone(),
                outer: vec![2.0],
                goal: [Some(1.0); 2],
                ..Subject::default()
            };
            let mut sheet = Sheet::new(which);
            Desk::new(&mut sheet, &subject).arrange(which);
            assert!(!sheet.legends.is_empty());
            for (plot, entries) in &sheet.legends {
                let is_large = which == Layout::Faults
                    || (which == Layout::Timing && plot.starts_with("Latency"));
                let room = if is_large { 8 } else { 6 };
                assert!(
                    *entries <= room,
                    "{which:?}, {joints} joints: {plot:?} has {entries} entries"
                );
            }
        }
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
        assert_eq!(
            views(Layout::Control),
            views(Layout::Control),
            "the same in every file"
        );
    }
}
