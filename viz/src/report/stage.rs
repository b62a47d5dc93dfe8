//! The arm on the page: a few moments side by side, and any moment by hand, together with the plots.

use std::fmt::Write;

use model::Robot;
use serde_json::{Value, json};
use shared_types::job::Job;
use shared_types::summary::Summary;

use super::drawing::{Drawing, Named, WIDTH};
use super::html::{Html, escaped};
use super::moments::Course;
use super::path::Path;
use super::recorded::Recorded;
use crate::signals::Signal;
use crate::tint::{hex, on_paper};

/// Most bytes of the pictures between which the slider moves, and most of them.
const BYTES: usize = 2_000_000;
const FRAMES: usize = 400;

/// The arm of a run.
pub(super) struct Stage<'a> {
    drawing: Drawing<'a>,
    course: Course<'a>,
    /// The ticks of the recorded picture.
    ticks: Vec<u64>,
    rate_hz: f64,
}

impl<'a> Stage<'a> {
    /// `None` where there is no picture of this arm in the recording.
    pub(super) fn new(
        robot: &Robot,
        job: &Job,
        recorded: &'a Recorded,
        singularities: &'a [Named],
    ) -> Option<Self> {
        let ticks: Vec<u64> = recorded.poses.ticks().collect();
        let floor_m = job
            .scenario
            .plant
            .floor_m
            .map_or(0.0, |height| height as f32);
        let drawing = Drawing::new(robot, floor_m, &recorded.poses, singularities, &ticks)?;
        let rate_hz = f64::from(job.scenario.rate_hz.max(1));
        Some(Self {
            drawing,
            course: Course::new(recorded, singularities, rate_hz),
            ticks,
            rate_hz,
        })
    }

    /// Some moments, each a picture with its caption.
    pub(super) fn moments(
        &mut self,
        page: &mut Html,
        job: &Job,
        summary: &Summary,
        recorded: &Recorded,
        singularities: &[Named],
    ) {
        let fault = summary
            .faults
            .iter()
            .filter(|fault| fault.occurred)
            .map(|fault| fault.tick)
            .min();
        let nearest =
            |from: u64, to: u64| nearest(job, recorded, singularities, self.rate_hz, from, to);
        let moments = self.course.moments(nearest, fault);
        page.add("<div class=\"poses\">");
        let ground = self.drawing.ground();
        for moment in moments {
            let t_s = moment.tick as f64 / self.rate_hz;
            let paths: Vec<(usize, Path)> = ground
                .iter()
                .cloned()
                .chain(self.drawing.at(moment.tick))
                .collect();
            let fault = self
                .course
                .fault(moment.tick)
                .map_or(String::new(), |fault| {
                    format!("<b class=\"bad\">{}</b>. ", escaped(fault))
                });
            let words: String = match &self.course.at(moment.tick)[..] {
                [] if moment.name == "End" => format!("{}.", escaped(&summary.outcome)),
                [] => "Free: the hand can move in every direction.".to_owned(),
                at => at
                    .iter()
                    .map(|(one, words)| {
                        format!("<span>{}: {}.</span> ", coloured(one), escaped(words))
                    })
                    .collect(),
            };
            page.add(format_args!(
                "<figure class=\"pose\" data-t=\"{t_s}\">{}<figcaption><b>{}</b> · {t_s:.2} s<br>{fault}{words}</figcaption></figure>",
                self.svg(&paths),
                moment.name
            ));
        }
        page.add("</div>");
    }

    /// The picture that the slider moves.
    pub(super) fn slider(&self, page: &mut Html, end_s: f64) {
        page.add(format_args!(
            "<div class=\"stage\" hidden><svg id=\"stage\" viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"the arm\"></svg>\
             <p id=\"words\" aria-live=\"off\"></p><div class=\"bar\"><button id=\"play\" type=\"button\">Play</button>\
             <input id=\"at\" type=\"range\" min=\"0\" max=\"{end_s}\" step=\"any\" value=\"0\" aria-label=\"time\"><output id=\"time\"></output></div></div>",
            self.drawing.height
        ));
    }

    /// The pictures between which it moves, and what moves them.
    pub(super) fn script(&mut self, page: &mut Html) {
        let ground = markup(&self.drawing.ground());
        let middle = self.ticks[self.ticks.len() / 2];
        let one = markup(&self.drawing.at(middle)).len().max(1);
        let most = (BYTES / one).clamp(2, FRAMES);
        let mut ticks: Vec<u64> = self
            .ticks
            .iter()
            .copied()
            .step_by(self.ticks.len().div_ceil(most).max(1))
            .collect();
        ticks.extend(self.ticks.last().filter(|last| ticks.last() != Some(last)));
        let frames = ticks.iter().map(|tick| markup(&self.drawing.at(*tick)));
        let frames: Vec<String> = frames.collect();
        let times = ticks.iter().map(|tick| *tick as f64 / self.rate_hz);
        let data = json!({
            "t": times.collect::<Vec<_>>(), "p": self.drawing.paints, "g": ground, "w": self.words(&ticks), "f": frames,
        });
        page.add(format_args!(
            "<script>\nconst D={};\n{}</script>",
            in_html(&data),
            include_str!("report.js")
        ));
    }

    /// From when on which words hold: a time, and for each singularity colour, name and words.
    fn words(&self, ticks: &[u64]) -> Vec<Value> {
        let mut all = self.course.turning_points();
        all.extend(ticks);
        all.sort_unstable();
        let mut out: Vec<(u64, Value)> = Vec::new();
        for tick in all {
            let fault = self.course.fault(tick);
            let fault = fault.map(|fault| json!(["#cb3234", "fault", fault]));
            let at = self.course.at(tick).into_iter();
            let at = at.map(|(one, words)| json!([hex(on_paper(one.colour)), one.name, words]));
            let words = Value::from_iter(fault.into_iter().chain(at));
            if out.last().is_none_or(|(_, before)| *before != words) {
                out.push((tick, words));
            }
        }
        let timed = out.into_iter();
        let timed = timed.map(|(tick, words)| json!([tick as f64 / self.rate_hz, words]));
        timed.collect()
    }

    fn svg(&self, paths: &[(usize, Path)]) -> String {
        let mut text = format!(
            "<svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" stroke-linejoin=\"round\" stroke-linecap=\"round\">",
            self.drawing.height
        );
        for (paint, path) in paths {
            let _ = write!(
                text,
                "<path {} d=\"{}\"/>",
                self.drawing.paints[*paint],
                path.text()
            );
        }
        text + "</svg>"
    }
}

/// A singularity's name in its colour.
fn coloured(one: &Named) -> String {
    format!(
        "<b style=\"color:{}\">{}</b>",
        hex(on_paper(one.colour)),
        escaped(&one.name)
    )
}

/// The tick of a stretch at which |s|/η of any singularity is least.
fn nearest(
    job: &Job,
    recorded: &Recorded,
    singularities: &[Named],
    rate_hz: f64,
    from: u64,
    to: u64,
) -> Option<u64> {
    let lines = recorded.lines.get(Signal::Measure.name())?;
    let mut least: Option<(f64, u64)> = None;
    for (line, one) in lines.iter().zip(singularities) {
        let eta = job.scenario.analysis.eta_in.of(one.kind).max(1e-12);
        for (t_s, s) in &line.points {
            let tick = (t_s * rate_hz).round() as u64;
            let value = s.abs() / eta;
            if (from..=to).contains(&tick)
                && value.is_finite()
                && least.is_none_or(|(known, _)| value < known)
            {
                least = Some((value, tick));
            }
        }
    }
    least.map(|(_, tick)| tick)
}

/// Paths as the script reads them: the paint's number in two digits, then the path; a bar between.
fn markup(paths: &[(usize, Path)]) -> String {
    let one = |(paint, path): &(usize, Path)| format!("{:02}{}", paint.min(&99), path.text());
    paths
        .iter()
        .filter(|(_, path)| !path.is_empty())
        .map(one)
        .collect::<Vec<_>>()
        .join("|")
}

/// Data that a script may hold in HTML.
fn in_html(data: &Value) -> String {
    let text = data.to_string();
    let escape = |c: char| format!("\\u{:04x}", c as u32);
    ['<', '>', '&']
        .iter()
        .fold(text, |text, c| text.replace(*c, &escape(*c)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn a_name_given_by_a_user_cannot_end_the_script() {
        assert_eq!(
            in_html(&json!("a\"</script>\\\n")),
            "\"a\\\"\\u003c/script\\u003e\\\\\\n\""
        );
        assert_eq!(
            markup(&[(3, Path::line([Vec2::ZERO, Vec2::X])), (0, Path::default())]),
            "03M0 0l1 0"
        );
    }
}
