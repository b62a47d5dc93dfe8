//! `armplane report`: a run as one HTML page that needs nothing else, for people without a viewer.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use shared_types::job::Job;
use shared_types::summary::{Machine, Summary};
use viz::{Piece, ReadError, Signal};

use super::ReportArgs;
use super::failure::Failure;
use super::out::say;
use super::plot::{Axis, Page, Panel, RED, Row, numbered};
use super::runs::Run;
use super::table::digits;

/// Times at which a plotted line has points: more would not be seen.
const POINTS: u64 = 3000;
/// Lines of the log that are shown.
const LOG_LINES: usize = 200;

pub(crate) fn report(args: &ReportArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let (summary, job) = (run.summary()?, run.job()?);
    let recorded = Recorded::read(&run.parts, &summary).map_err(Failure::work)?;
    let path = args.out.clone().unwrap_or_else(|| run.folder.join("report.html"));
    let text = html(&summary, &job, &recorded, &path)?;
    std::fs::write(&path, &text)
        .map_err(|error| Failure::Work(format!("cannot write {}: {error}; name another file with --out", path.display())))?;
    if as_json {
        say!("{}", serde_json::json!({"file": path, "bytes": text.len()}));
    } else {
        say!("{}  {:.1} MB; open it with any browser", path.display(), text.len() as f64 / 1e6);
    }
    Ok(ExitCode::SUCCESS)
}

/// What this machine is.
pub(crate) fn machine() -> Machine {
    let health = launcher::doctor::examine();
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cpu = text.lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim().to_owned()));
    Machine { cpu: cpu.unwrap_or_default(), cores: health.cores.len(), kernel: health.kernel }
}

/// A recording as far as a page shows it.
#[derive(Default)]
struct Recorded {
    /// Of each signal its lines, element by element.
    lines: BTreeMap<&'static str, Vec<Line>>,
    /// Tick, level, text.
    log: Vec<(u64, String, String)>,
    /// Tick, lane, state.
    states: Vec<(u64, String, String)>,
    /// Of the last tick; s.
    end_s: f64,
}

/// A line of a plot: of so many successive values the least and the largest.
#[derive(Clone)]
struct Line {
    name: String,
    points: Vec<(f64, f64)>,
    stride: u64,
    gathered: u64,
    /// The time of the last value, and how much later the next may be without a gap; s.
    last_s: f64,
    patience_s: f64,
    least: (f64, f64),
    largest: (f64, f64),
}

impl Line {
    fn new(name: String, stride: u64, patience_s: f64) -> Self {
        Self {
            name,
            points: Vec::new(),
            stride,
            gathered: 0,
            last_s: f64::INFINITY,
            patience_s,
            least: (0.0, f64::INFINITY),
            largest: (0.0, f64::NEG_INFINITY),
        }
    }

    fn push(&mut self, t_s: f64, value: f64) {
        if t_s > self.last_s + self.patience_s {
            // Nothing is drawn across what was lost.
            self.flush();
            self.points.push((t_s, f64::NAN));
        }
        self.last_s = t_s;
        if value < self.least.1 {
            self.least = (t_s, value);
        }
        if value > self.largest.1 {
            self.largest = (t_s, value);
        }
        self.gathered += 1;
        if self.gathered >= self.stride {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let (a, b) = if self.least.0 <= self.largest.0 { (self.least, self.largest) } else { (self.largest, self.least) };
        if self.gathered > 0 && a.1.is_finite() {
            self.points.push(a);
            if a != b {
                self.points.push(b);
            }
        }
        let name = std::mem::take(&mut self.name);
        *self = Self { points: std::mem::take(&mut self.points), last_s: self.last_s, ..Self::new(name, self.stride, self.patience_s) };
    }
}

impl Recorded {
    fn read(parts: &[PathBuf], summary: &Summary) -> Result<Self, ReadError> {
        let stride = summary.ticks.div_ceil(POINTS).max(1);
        let mut recorded = Self::default();
        let mut rate_hz = f64::from(summary.rate_hz.max(1));
        let mut values = Vec::new();
        viz::read(parts, |piece| {
            match piece {
                Piece::About(about) => {
                    rate_hz = about.rate_hz();
                    for signal in Signal::ALL {
                        let lines = || {
                            signal
                                .elements(about.joints, &about.singularities)
                                .into_iter()
                                .map(|name| Line::new(name, stride, 2.5 / rate_hz))
                                .collect()
                        };
                        recorded.lines.entry(signal.name()).or_insert_with(lines);
                    }
                }
                Piece::Rows(rows) => {
                    for (row, tick) in rows.ticks.iter().enumerate() {
                        let t_s = *tick as f64 / rate_hz;
                        recorded.end_s = recorded.end_s.max(t_s);
                        for signal in Signal::ALL {
                            values.clear();
                            rows.values(*signal, row, &mut values);
                            let lines = recorded.lines.get_mut(signal.name()).into_iter().flatten();
                            lines.zip(&values).for_each(|(line, value)| line.push(t_s, *value));
                        }
                    }
                }
                Piece::Event { tick, level, text } => recorded.log.push((tick, level, text)),
                Piece::State { tick, lane, state } => recorded.states.push((tick, lane, state)),
                Piece::Damaged(damage) => eprintln!("{damage}"),
            }
            Ok::<(), ReadError>(())
        })?;
        recorded.lines.values_mut().flatten().for_each(Line::flush);
        Ok(recorded)
    }

    /// A diagram of a signal's lines; `names`: how the legend calls them.
    fn panel(&self, title: &str, signal: Signal, axis: Axis, name: impl Fn(&str) -> String) -> Panel {
        let mut panel = Panel::new(title, self.time_axis(), axis);
        self.draw(&mut panel, signal, name);
        panel
    }

    fn draw(&self, panel: &mut Panel, signal: Signal, name: impl Fn(&str) -> String) {
        for (i, line) in self.lines.get(signal.name()).into_iter().flatten().enumerate() {
            panel.line(&name(&line.name), numbered(i), &line.points);
        }
    }

    /// Signals over the joints' limits, with what their titles say; where the limits are infinite, hence all is 0, the signals themselves.
    fn over_limit<const K: usize>(&self, ratios: [Signal; K], values: [Signal; K], unit: &str) -> ([Signal; K], String) {
        let moves = |signal: &Signal| {
            self.lines.get(signal.name()).into_iter().flatten().any(|line| line.points.iter().any(|(_, value)| *value != 0.0))
        };
        match values.iter().any(moves) && !ratios.iter().any(moves) {
            true => (values, format!(", {unit}")),
            false => (ratios, " / limit".to_owned()),
        }
    }

    fn time_axis(&self) -> Axis {
        Axis::named("time, s").within(0.0..self.end_s.max(1e-3))
    }

    /// When a singularity's mode was not regular; s.
    fn stretches(&self, singularity: &str, rate_hz: f64) -> Vec<std::ops::Range<f64>> {
        let lane = format!("mode/{singularity}");
        let mut stretches = Vec::new();
        let mut since: Option<f64> = None;
        for (tick, _, state) in self.states.iter().filter(|(_, of, _)| *of == lane) {
            let t_s = *tick as f64 / rate_hz;
            match (since, state == "regular") {
                (None, false) => since = Some(t_s),
                (Some(from), true) => {
                    stretches.push(from..t_s);
                    since = None;
                }
                _ => {}
            }
        }
        stretches.extend(since.map(|from| from..self.end_s));
        stretches
    }
}

fn html(summary: &Summary, job: &Job, recorded: &Recorded, path: &Path) -> Result<String, Failure> {
    let mut page = Html::default();
    let title = if job.scenario.title.is_empty() { &summary.scenario } else { &job.scenario.title };
    let title = escaped(title);
    page.add(format_args!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{title} · armplane</title><style>{}</style></head><body>\n<h1>{title}</h1>",
        include_str!("report.css")
    ));
    let good = summary.outcome == "goal reached";
    page.add(format_args!(
        "<p class=\"outcome {}\">{} — {}</p>",
        if good { "good" } else { "bad" },
        escaped(&summary.outcome),
        escaped(&summary.reason)
    ));
    if !job.scenario.about.is_empty() {
        page.add(format_args!("<p>{}</p>", escaped(&job.scenario.about)));
    }
    let simulated_s = summary.ticks as f64 / f64::from(summary.rate_hz.max(1));
    page.facts(&[
        ("scenario", summary.scenario.clone()),
        ("robot", summary.robot.clone()),
        ("mode", format!("{}, seed {}", summary.mode, summary.seed)),
        (
            "length",
            format!("{} ticks at {} Hz: {simulated_s:.3} s of the arm's time in {:.2} s", summary.ticks, summary.rate_hz, summary.wall_s),
        ),
        ("run", summary.run.clone()),
    ]);
    tables(&mut page, summary);
    if recorded.lines.is_empty() {
        page.add(format_args!("<p class=\"soft\">There is no recording, hence no plots.</p>"));
    } else {
        plots(&mut page, job, recorded, path)?;
    }
    happened(&mut page, summary, recorded);
    provenance(&mut page, summary);
    page.add(format_args!("</body></html>"));
    Ok(page.text)
}

fn tables(page: &mut Html, summary: &Summary) {
    let task = &summary.task;
    page.heading("How well");
    let of = |values: [f64; 3]| values.map(digits);
    let row = |name: &str, values: [f64; 3]| [vec![name.to_owned()], of(values).to_vec()].concat();
    page.table(
        &["task error", "largest", "across ζ", "at the end"],
        &[
            row("position, mm", [task.position_max_mm, task.orthogonal_max_mm, task.final_position_mm]),
            row("orientation, °", [task.orientation_max_deg, task.orthogonal_max_deg, task.final_orientation_deg]),
        ],
    );
    let joints = &summary.joints;
    // Nothing of an infinite limit.
    let percent = |ratio: f64| if ratio > 0.0 { format!("{:.1} %", 100.0 * ratio) } else { "–".to_owned() };
    page.table(
        &["joint load, of the robot's limit", "largest"],
        &[
            vec!["torque".to_owned(), percent(joints.torque_max_ratio)],
            vec!["torque step in one tick".to_owned(), percent(joints.torque_step_max_ratio)],
            vec!["speed".to_owned(), percent(joints.speed_max_ratio)],
        ],
    );
    let singularities: Vec<Vec<String>> = summary
        .singularities
        .iter()
        .map(|one| {
            vec![
                one.name.clone(),
                one.class.clone(),
                digits(one.s_min),
                one.inside_ticks.to_string(),
                one.entries.to_string(),
                digits(one.zeta_turned_deg),
            ]
        })
        .collect();
    page.table(&["singularity", "type", "least |s|", "inside, ticks", "entries", "ζ turned, °"], &singularities);
}

fn plots(page: &mut Html, job: &Job, recorded: &Recorded, path: &Path) -> Result<(), Failure> {
    let rate_hz = f64::from(job.scenario.rate_hz.max(1));
    let own = |name: &str| name.to_owned();
    let joint = |name: &str| format!("q{name}");
    page.heading("What happened");

    let mut measure = Panel::new("s_i(q): 0 is singular", recorded.time_axis(), Axis::default());
    for (i, line) in recorded.lines.get(Signal::Measure.name()).into_iter().flatten().enumerate() {
        let mut shade = numbered(i);
        shade.3 = 0.12;
        recorded.stretches(&line.name, rate_hz).into_iter().for_each(|stretch| measure.band("", shade, stretch));
    }
    let eta: Vec<f64> = job.scenario.analysis.eta_in.named().iter().map(|(_, eta)| *eta).collect();
    let (least, largest) = (eta.iter().copied().fold(f64::INFINITY, f64::min), eta.iter().copied().fold(0.0, f64::max));
    for (i, level) in [least, -least, largest, -largest].into_iter().take(if least < largest { 4 } else { 2 }).enumerate() {
        measure.dashed(if i == 0 { "± η, entry" } else { "" }, RED, &[(0.0, level), (recorded.end_s, level)]);
    }
    recorded.draw(&mut measure, Signal::Measure, own);
    page.broad_figure(
        path,
        measure,
        "How near the arm is to each singularity. Within ± η it is treated as singular. Shaded: control there is not the regular one \
         (blending, tracking by null-space motion, reorienting, holding).",
    )?;

    let position = recorded.panel("position error, mm", Signal::PositionError, Axis::default(), |name| format!("{name} ζ"));
    let orientation = recorded.panel("orientation error, °", Signal::OrientationError, Axis::default(), |name| format!("{name} ζ"));
    page.figure(path, [position, orientation], "Desired against true pose, split at the singular directions ζ that the arm is inside of.")?;

    let (torque, of) =
        recorded.over_limit([Signal::TorqueTaskRatio, Signal::TorqueNullRatio], [Signal::TorqueTask, Signal::TorqueNull], "N·m");
    let task = recorded.panel(&format!("torque that acts at the hand{of}"), torque[0], Axis::default(), joint);
    let null = recorded.panel(&format!("torque in the null space{of}"), torque[1], Axis::default(), joint);
    let range = recorded.panel("joints between their limits ±1", Signal::PositionInRange, Axis::default().within(-1.05..1.05), joint);
    let ([speed], of) = recorded.over_limit([Signal::SpeedRatio], [Signal::Speed], "rad/s");
    let speed = recorded.panel(&format!("joint speeds{of}"), speed, Axis::default(), joint);
    page.figure(path, [task, null, range, speed], "The joints; colours are the same in all four.")?;

    let mut scale = Panel::new("β (1: hand, 0: null space) and governor", recorded.time_axis(), Axis::default().within(-0.05..1.05));
    recorded.draw(&mut scale, Signal::Beta, |name| format!("β {name}"));
    for (i, line) in recorded.lines.get(Signal::Scale.name()).into_iter().flatten().enumerate() {
        scale.dashed(&line.name, numbered(i + 4), &line.points);
    }
    let latency = recorded.panel("time per hop, µs", Signal::Latency, Axis::default().logarithmic(), own);
    page.figure(
        path,
        [scale, latency],
        "Who controls what, and how fast path time, task torque and null-space torque are let through; and the hops of each tick, the \
         whole chain among them: in lockstep they say how fast the machine is, not how punctual.",
    )
}

fn happened(page: &mut Html, summary: &Summary, recorded: &Recorded) {
    page.heading("Modes and faults");
    let modes: Vec<Vec<String>> =
        summary.modes.iter().map(|change| vec![change.tick.to_string(), change.singularity.clone(), change.mode.clone()]).collect();
    page.some("No mode changed.", &["tick", "singularity", "mode"], &modes);
    let faults: Vec<Vec<String>> = summary
        .faults
        .iter()
        .map(|fault| vec![fault.tick.to_string(), fault.process.clone(), fault.kind.clone(), fault.detail.clone()])
        .collect();
    page.some("No fault, refusal or loss.", &["tick", "process", "fault", "what happened"], &faults);
    if summary.deadlines.total > 0 {
        page.add(format_args!("<p>{} deadlines missed of {}.</p>", summary.deadlines.missed, summary.deadlines.total));
        let causes: Vec<Vec<String>> =
            summary.deadlines.by_cause.iter().map(|(cause, count)| vec![cause.clone(), count.to_string()]).collect();
        page.some("", &["cause", "missed"], &causes);
    }
    let latency: Vec<Vec<String>> = summary
        .latency_us
        .iter()
        .map(|(hop, l)| vec![hop.clone(), l.count.to_string(), digits(l.p50), digits(l.p99), digits(l.p999), digits(l.max)])
        .collect();
    page.some("", &["latency, µs", "samples", "p50", "p99", "p99.9", "max"], &latency);
    if !recorded.log.is_empty() {
        page.heading("Log");
        let lines: Vec<Vec<String>> =
            recorded.log.iter().take(LOG_LINES).map(|(tick, level, text)| vec![tick.to_string(), level.clone(), text.clone()]).collect();
        page.table(&["tick", "level", "what"], &lines);
        if recorded.log.len() > LOG_LINES {
            page.add(format_args!("<p class=\"soft\">{} more lines are in the recording.</p>", recorded.log.len() - LOG_LINES));
        }
    }
}

fn provenance(page: &mut Html, summary: &Summary) {
    page.heading("Where it comes from");
    let Machine { cpu, cores, kernel } = &summary.machine;
    let recording = match (summary.recorder.file.as_str(), summary.recorder.error.as_str()) {
        ("", "") => "none".to_owned(),
        (file, "") => format!("{file}, {:.1} MB, {} part(s)", summary.recorder.bytes as f64 / 1e6, summary.recorder.parts.max(1)),
        (_, error) => error.to_owned(),
    };
    page.facts(&[
        ("armplane", summary.version.clone()),
        ("machine", if cpu.is_empty() { "not recorded".to_owned() } else { format!("{cpu}, {cores} cores, {kernel}") }),
        ("recording", recording),
        ("messages", format!("{} received, {} lost", summary.recorder.messages, summary.recorder.lost)),
    ]);
    let processes: Vec<Vec<String>> = summary
        .processes
        .iter()
        .map(|one| vec![one.name.clone(), one.pid.to_string(), one.restarts.to_string(), one.exit.clone()])
        .collect();
    page.some("", &["process", "pid", "restarts", "exit"], &processes);
    let topics: Vec<Vec<String>> =
        summary.topics.iter().map(|(name, topic)| vec![name.clone(), topic.count.to_string(), topic.hash.clone()]).collect();
    page.some("", &["topic", "messages", "hash of the contents"], &topics);
}

/// A page in the making.
#[derive(Default)]
struct Html {
    text: String,
}

impl Html {
    fn add(&mut self, text: std::fmt::Arguments<'_>) {
        let _ = writeln!(self.text, "{text}");
    }

    fn heading(&mut self, text: &str) {
        self.add(format_args!("<h2>{}</h2>", escaped(text)));
    }

    fn facts(&mut self, facts: &[(&str, String)]) {
        self.add(format_args!("<dl>"));
        facts.iter().for_each(|(name, value)| self.add(format_args!("<dt>{name}</dt><dd>{}</dd>", escaped(value))));
        self.add(format_args!("</dl>"));
    }

    /// A table; columns of numbers are right-aligned.
    fn table(&mut self, headings: &[&str], rows: &[Vec<String>]) {
        let numeric =
            |column: usize| column > 0 && rows.iter().all(|row| row[column].starts_with(|c: char| c.is_ascii_digit() || c == '-'));
        let class: Vec<&str> = (0..headings.len()).map(|column| if numeric(column) { " class=\"n\"" } else { "" }).collect();
        self.add(format_args!("<div class=\"wide\"><table><tr>"));
        headings.iter().zip(&class).for_each(|(heading, class)| self.add(format_args!("<th{class}>{}</th>", escaped(heading))));
        self.add(format_args!("</tr>"));
        for row in rows {
            let cells: String = row.iter().zip(&class).map(|(cell, class)| format!("<td{class}>{}</td>", escaped(cell))).collect();
            self.add(format_args!("<tr>{cells}</tr>"));
        }
        self.add(format_args!("</table></div>"));
    }

    /// A table, or what to say where there is nothing in it.
    fn some(&mut self, none: &str, headings: &[&str], rows: &[Vec<String>]) {
        match (rows.is_empty(), none) {
            (true, "") => {}
            (true, none) => self.add(format_args!("<p>{}</p>", escaped(none))),
            (false, _) => self.table(headings, rows),
        }
    }

    /// Panels side by side, or below one another where the page is narrow.
    fn figure(&mut self, path: &Path, panels: impl IntoIterator<Item = Panel>, caption: &str) -> Result<(), Failure> {
        let panels: Vec<String> = panels.into_iter().map(|panel| picture(path, panel, [440.0, 210.0])).collect::<Result<_, _>>()?;
        self.add(format_args!(
            "<figure><div class=\"panels\">{}</div><figcaption>{}</figcaption></figure>",
            panels.concat(),
            escaped(caption)
        ));
        Ok(())
    }

    /// One panel as wide as the page, drawn anew for a narrow one.
    fn broad_figure(&mut self, path: &Path, panel: Panel, caption: &str) -> Result<(), Failure> {
        let (broad, slim) = (picture(path, panel.clone(), [900.0, 250.0])?, picture(path, panel, [440.0, 230.0])?);
        self.add(format_args!(
            "<figure><div class=\"broad\">{broad}</div><div class=\"slim\">{slim}</div><figcaption>{}</figcaption></figure>",
            escaped(caption)
        ));
        Ok(())
    }
}

/// A panel as an SVG element of a width and height; points.
fn picture(path: &Path, panel: Panel, [width, height]: [f64; 2]) -> Result<String, Failure> {
    let svg = Page { rows: vec![Row::of(height, [panel])], width, ..Page::default() }.svg(path).map_err(Failure::work)?;
    Ok(svg.trim_start_matches(|c| c != '<').to_owned())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_their_extremes_however_long_they_are() {
        let mut line = Line::new("x".to_owned(), 100, 2.5);
        (0..1000).for_each(|k| line.push(f64::from(k), if k == 555 { 9.0 } else { f64::from(k % 7) * 0.1 }));
        line.flush();
        assert!(line.points.len() <= 20 && line.points.contains(&(555.0, 9.0)), "{:?}", line.points);
        assert!(line.points.windows(2).all(|pair| pair[0].0 < pair[1].0));
        let mut whole = Line::new("x".to_owned(), 1, 2.5);
        (0..5).for_each(|k| whole.push(f64::from(k), 1.0));
        assert_eq!(whole.points.len(), 5);
        whole.push(9.0, 1.0);
        assert!(whole.points[5].1.is_nan() && whole.points[6] == (9.0, 1.0), "a gap is not drawn across: {:?}", whole.points);
    }

    #[test]
    fn stretches_end_where_the_mode_is_regular_again() {
        let state = |tick, state: &str| (tick, "mode/wrist".to_owned(), state.to_owned());
        let recorded = Recorded {
            states: vec![state(0, "reorient"), state(10, "hold"), state(20, "regular"), state(30, "blend")],
            end_s: 0.05,
            ..Recorded::default()
        };
        assert_eq!(recorded.stretches("wrist", 1000.0), [0.0..0.02, 0.03..0.05]);
        assert!(recorded.stretches("elbow", 1000.0).is_empty());
    }
}
