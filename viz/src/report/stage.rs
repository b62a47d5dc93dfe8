//! The arm on the page: a few moments side by side, and any moment by hand, together with the plots.

use std::fmt::Write;

use model::Robot;
use serde_json::{Value, json};
use shared_types::job::Job;
use shared_types::summary::Summary;

use super::drawing::{Drawing, Picture, WIDTH};
use super::html::{Html, escaped};
use super::recorded::{Named, Recorded};
use crate::recording::floor_m;
use crate::tint::{hex, on_paper};

/// Most bytes of the pictures between which the slider moves, and most of them.
const BYTES: usize = 2_000_000;
const FRAMES: usize = 400;

/// The arm of a run.
pub(super) struct Stage<'a> {
    drawing: Drawing<'a>,
    picture: Picture,
    recorded: &'a Recorded,
}

impl<'a> Stage<'a> {
    /// `None` where there is no picture of this arm in the recording.
    pub(super) fn new(robot: &Robot, job: &Job, recorded: &'a Recorded) -> Option<Self> {
        let drawing = Drawing::new(robot, floor_m(&job.scenario), recorded)?;
        let picture = Picture::default();
        Some(Self {
            drawing,
            picture,
            recorded,
        })
    }

    /// The paths of a tick; of none those behind everything.
    fn paths(&mut self, tick: Option<u64>) -> Vec<(usize, String)> {
        match tick {
            Some(tick) => self.drawing.at(tick, &mut self.picture),
            None => self.drawing.ground(&mut self.picture),
        }
        std::mem::take(&mut self.picture.paths)
    }

    /// Some moments, each a picture with its caption.
    pub(super) fn moments(&mut self, page: &mut Html, summary: &Summary) {
        let recorded = self.recorded;
        let faults = summary.faults.iter().filter(|fault| fault.occurred);
        page.add("<div class=\"poses\">");
        let ground = self.paths(None);
        for (tick, name) in recorded.moments(faults.map(|fault| fault.tick).min()) {
            let mut svg = String::new();
            for (paint, path) in ground.iter().chain(&self.paths(Some(tick))) {
                let _ = write!(svg, "<path {} d=\"{path}\"/>", self.picture.paints[*paint]);
            }
            let fault = recorded.fault(tick).map_or(String::new(), |fault| {
                format!("<b class=\"bad\">{}</b>. ", escaped(fault))
            });
            let coloured = |(one, words): &(&Named, String)| {
                let (colour, name) = (hex(on_paper(one.colour)), escaped(&one.name));
                format!(
                    "<span><b style=\"color:{colour}\">{name}</b>: {}.</span> ",
                    escaped(words)
                )
            };
            let words: String = match &recorded.told(tick)[..] {
                [] if name == "End" => format!("{}.", escaped(&summary.outcome)),
                [] => "Free: the hand can move in every direction.".to_owned(),
                told => told.iter().map(coloured).collect(),
            };
            let (t_s, height) = (recorded.seconds(tick), self.drawing.height);
            page.add(format_args!(
                "<figure class=\"pose\" data-t=\"{t_s}\"><svg viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" \
                 stroke-linejoin=\"round\" stroke-linecap=\"round\">{svg}</svg>\
                 <figcaption><b>{name}</b> · {t_s:.2} s<br>{fault}{words}</figcaption></figure>"
            ));
        }
        page.add("</div>");
    }

    /// The picture that the slider moves.
    pub(super) fn slider(&self, page: &mut Html) {
        let (height, end_s) = (self.drawing.height, self.recorded.end_s());
        page.add(format_args!(
            "<div class=\"stage\" hidden><svg id=\"stage\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" aria-label=\"the arm\"></svg>\
             <p id=\"words\" aria-live=\"off\"></p><div class=\"bar\"><button id=\"play\" type=\"button\">Play</button>\
             <input id=\"at\" type=\"range\" min=\"0\" max=\"{end_s}\" step=\"any\" value=\"0\" aria-label=\"time\"><output id=\"time\"></output></div></div>"
        ));
    }

    /// The pictures between which it moves, and what moves them.
    pub(super) fn script(&mut self, page: &mut Html) {
        let recorded = self.recorded;
        let all: Vec<u64> = recorded.links[0].iter().map(|(tick, _)| *tick).collect();
        let ground = markup(&self.paths(None));
        let one = markup(&self.paths(Some(all[all.len() / 2]))).len().max(1);
        let most = (BYTES / one).clamp(2, FRAMES);
        let mut ticks: Vec<u64> = all
            .iter()
            .copied()
            .step_by(all.len().div_ceil(most))
            .collect();
        ticks.extend(all.last().filter(|last| ticks.last() != Some(last)));
        let frames = ticks.iter().map(|tick| markup(&self.paths(Some(*tick))));
        let frames: Vec<String> = frames.collect();
        let times: Vec<f64> = ticks.iter().map(|tick| recorded.seconds(*tick)).collect();
        let data = json!({
            "t": times, "p": self.picture.paints, "g": ground, "w": words(recorded, &ticks), "f": frames,
        });
        page.add(format_args!(
            "<script>\nconst D={};\n{}</script>",
            in_html(&data),
            include_str!("report.js")
        ));
    }
}

/// From when on which words hold: a time, and for each singularity colour, name and words.
fn words(recorded: &Recorded, ticks: &[u64]) -> Vec<Value> {
    let modes = recorded.singularities.iter().flat_map(|one| &one.modes);
    let changes = modes
        .map(|change| change.0)
        .chain(recorded.faults.iter().map(|change| change.0));
    let mut all: Vec<u64> = changes.chain(ticks.iter().copied()).chain([0]).collect();
    all.sort_unstable();
    let of = |tick: u64| {
        let fault = recorded
            .fault(tick)
            .map(|fault| json!(["var(--bad)", "fault", fault]));
        let told = recorded.told(tick).into_iter();
        let told = told.map(|(one, words)| json!([hex(on_paper(one.colour)), one.name, words]));
        (
            recorded.seconds(tick),
            Value::from_iter(fault.into_iter().chain(told)),
        )
    };
    let mut out: Vec<_> = all.into_iter().map(of).collect();
    out.dedup_by(|next, before| next.1 == before.1);
    out.into_iter().map(|words| json!(words)).collect()
}

/// Paths as the script reads them: the paint's number in two digits, then the path; a bar between.
fn markup(paths: &[(usize, String)]) -> String {
    let one = |(paint, path): &(usize, String)| format!("{:02}{path}", paint.min(&99));
    paths.iter().map(one).collect::<Vec<_>>().join("|")
}

/// Data that a script may hold in HTML.
fn in_html(data: &Value) -> String {
    let escape = |c: char| match c {
        '<' | '>' | '&' => format!("\\u{:04x}", c as u32),
        c => c.to_string(),
    };
    data.to_string().chars().map(escape).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_given_by_a_user_cannot_end_the_script() {
        let name = json!("a\"</script>\\\n");
        assert_eq!(in_html(&name), "\"a\\\"\\u003c/script\\u003e\\\\\\n\"");
    }
}
