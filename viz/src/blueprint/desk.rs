//! The panes that layouts are made of, and how each layout arranges them.

use re_chunk::EntityPath;
use re_sdk_types::blueprint::components::Corner2D::{self, RightBottom, RightTop};
use shared_types::scenario::Layout;

use super::sheet::{Cell, Lines, Sheet};
use super::{ACROSS, ALONG, BAND_LINES, JOINTS, Subject};
use crate::entity;
use crate::signals::{Signal, hop_names};
use crate::solid::Rgba;

const TOLERANCE: Rgba = [255, 64, 84, 255];
/// Powers of ten of errors, mm and degrees, and of latencies, µs.
const ERRORS: Option<[f64; 2]> = Some([-4.3, 2.3]);
const LATENCIES: Option<[f64; 2]> = Some([-0.6, 4.3]);

/// Name of the view from near by.
pub(super) const fn close_up_name(subject: &Subject) -> &'static str {
    match subject.stands_still {
        true => "The hand's way, × 50",
        false => "Close-up, across ζ",
    }
}

/// Name of the view of the whole arm.
pub(super) const fn world_name(subject: &Subject) -> &'static str {
    match subject.stands_still {
        true => "Arm: its joints move",
        false => "Arm: the coloured mark is the lost direction ζ",
    }
}

/// Joints that a plot's legend names.
#[derive(Clone, Copy, PartialEq)]
enum Named {
    All,
    First,
    Last,
}

/// The panes of one layout.
pub(super) struct Desk<'a> {
    sheet: &'a mut Sheet,
    subject: &'a Subject,
}

impl<'a> Desk<'a> {
    pub(super) fn new(sheet: &'a mut Sheet, subject: &'a Subject) -> Self {
        sheet.marks_faults = subject.faults;
        sheet.shows_all = subject.is_long;
        Self { sheet, subject }
    }

    pub(super) fn arrange(&mut self, layout: Layout) {
        match layout {
            Layout::Control => self.arrange_control(),
            Layout::Timing => self.arrange_timing(),
            Layout::Faults => self.arrange_faults(),
        };
    }

    fn arrange_control(&mut self) -> EntityPath {
        let views = vec![(1.35, self.world()), (1.0, self.close_up())];
        let left = vec![(2.45, self.sheet.row("", views)), (1.15, self.now())];
        let torques = self.torques();
        let (errors, joints, measure) = (self.errors(), self.joints(), self.measure());
        let others = [
            self.per_joint("Gravity torque", Signal::DrawnGravity, Named::First, None),
            self.governor(),
            self.auxiliary(),
            self.singular_values(),
            self.latency(Named::Last),
        ];
        let modes = [self.modes(), self.log()];
        // Three rows: fewer and taller plots have ticks that can be read, and room for a legend of six names.
        let right = if self.subject.stands_still {
            // No singularity is in play: the error first, the joints that move, and the rest in tabs.
            let more = [torques, measure].into_iter().chain(others).chain(modes);
            let more = self.sheet.tabs(more.collect());
            vec![(1.3, errors), (1.4, joints), (1.6, more)]
        } else {
            let more = [errors, torques, joints].into_iter().chain(others);
            let more = self.sheet.tabs(more.collect());
            let modes = self.sheet.tabs(modes.into());
            // A lane for each singularity.
            let lanes = if self.subject.singularities.len() > 3 {
                1.6
            } else {
                1.35
            };
            vec![(1.4, measure), (1.6, more), (lanes, modes)]
        };
        self.halves(left, right)
    }

    fn arrange_timing(&mut self) -> EntityPath {
        let upper = vec![(2.2, self.latency(Named::All)), (1.0, self.small_world())];
        // Each lane takes 40 points: the processes' stand in a column of their own.
        let lives = self.lives();
        let modes = [self.modes(), self.log()].map(|view| (1.0, view));
        // Three plots side by side have no room for their titles.
        let plots = vec![self.errors(), self.governor()];
        let rows = vec![
            (1.0, self.sheet.row("", modes.into())),
            (1.2, self.sheet.tabs(plots)),
        ];
        let lower = vec![(1.0, lives), (2.2, self.sheet.column(rows))];
        let cells =
            [(1.6, upper), (2.4, lower)].map(|(share, row)| (share, self.sheet.row("", row)));
        self.sheet.column(cells.into())
    }

    fn arrange_faults(&mut self) -> EntityPath {
        let below = [self.log(), self.modes()];
        let below = self.sheet.tabs(below.into());
        let left = vec![(1.3, self.small_world()), (0.95, self.now()), (1.1, below)];
        let more = vec![
            self.errors(),
            self.torques(),
            self.joints(),
            self.measure(),
            self.governor(),
            self.latency(Named::Last),
        ];
        let more = self.sheet.tabs(more);
        let right = vec![(2.25, self.lives()), (2.35, more)];
        self.halves(left, right)
    }

    /// Two columns: the table of singularities and lines of the log are as wide in each layout.
    fn halves(&mut self, left: Vec<Cell>, right: Vec<Cell>) -> EntityPath {
        let cells = vec![
            (1.12, self.sheet.column(left)),
            (1.0, self.sheet.column(right)),
        ];
        self.sheet.row("", cells)
    }

    /// A line per joint. A legend beside the lines has room for few names: of two plots side by side the one names the first joints, the
    /// other the last, and the others share an entry.
    fn per_joint(
        &mut self,
        name: &str,
        signal: Signal,
        named: Named,
        range: Option<[f64; 2]>,
    ) -> EntityPath {
        let unit = match signal {
            Signal::DrawnPosition => "",
            Signal::DrawnSpeed if self.subject.unlimited_speed => ", rad/s",
            Signal::DrawnSpeed => " / limit",
            _ if self.subject.unlimited_torque => ", N·m",
            _ => " / limit",
        };
        let (count, first) = (self.subject.joints, self.subject.joints.div_ceil(2));
        let (own, others) = match named {
            _ if count <= 3 => (0..count, count..count),
            Named::First => (0..first, first..count),
            _ => (first..count, 0..first),
        };
        let others = format!("q{}–q{}", others.start + 1, others.end);
        let name_of = |i: usize| match own.contains(&i) {
            true => format!("q{}", i + 1),
            false => others.clone(),
        };
        let lines = Lines::of(signal, (0..count).map(name_of), JOINTS);
        self.sheet.plot(
            &format!("{name}{unit}"),
            vec![lines],
            range,
            Some(RightBottom),
        )
    }

    fn per_singularity(&self, signal: Signal) -> Lines {
        let all = self.subject.singularities.iter();
        Lines::of(
            signal,
            all.clone().map(|one| one.0.clone()),
            all.map(|one| one.1),
        )
    }

    fn world(&mut self) -> EntityPath {
        self.sheet
            .world(world_name(self.subject), self.subject, &self.subject.eye)
    }

    /// The same, small: without the angles of joints, whose labels would hide each other.
    fn small_world(&mut self) -> EntityPath {
        let world = self.world();
        self.sheet.leave_out(&world, entity::WORLD, entity::TURNED);
        world
    }

    fn close_up(&mut self) -> EntityPath {
        self.sheet.world(
            close_up_name(self.subject),
            self.subject,
            &self.subject.close_up,
        )
    }

    fn now(&mut self) -> EntityPath {
        self.sheet
            .text("TextDocument", "What is happening", entity::NOW)
    }

    fn log(&mut self) -> EntityPath {
        self.sheet.text("TextLog", "Log", entity::LOG)
    }

    fn modes(&mut self) -> EntityPath {
        let lanes = self
            .subject
            .singularities
            .iter()
            .map(|(name, _)| entity::state(name));
        self.sheet
            .states("What control does at each singularity", lanes)
    }

    fn lives(&mut self) -> EntityPath {
        let lanes = ["fault", "drive"].map(entity::state).into_iter();
        let processes = self.subject.lives.named().map(entity::life);
        self.sheet
            .states("Fault, processes, drive", lanes.chain(processes))
    }

    /// log₁₀(|s_i| / η_i), the band below 1 hatched.
    fn measure(&mut self) -> EntityPath {
        let band = Lines::guide("guide:band", "singular", BAND_LINES, [255, 64, 84, 30], 5.0);
        // In the legend with the band: it has room for few names.
        let edges = self.subject.outer.len();
        let edges = Lines::guide("guide:edge", "singular", edges, [190, 195, 205, 150], 1.0);
        let mut nearness = self.per_singularity(Signal::Nearness);
        nearness.width = 2.5;
        let name = "How near: |s|/η in powers of ten. Below 0: treated as singular";
        self.sheet.plot(
            name,
            vec![band, edges, nearness],
            Some([-3.1, 1.4]),
            Some(RightBottom),
        )
    }

    /// The errors, each with what the goal allows, in powers of ten.
    fn errors(&mut self) -> EntityPath {
        // Where no direction is lost there is one error.
        let names = match self.subject.stands_still {
            true => ["error"; 2],
            false => ["orthogonal", "along ζ"],
        };
        let mut pane = |name: &str, signal, guide, goal: Option<f64>, legend: Option<Corner2D>| {
            let mut lines = vec![Lines::of(signal, names.map(str::to_owned), [ACROSS, ALONG])];
            lines.extend(goal.map(|_| Lines::guide(guide, "goal", 1, TOLERANCE, 1.0)));
            self.sheet.plot(name, lines, ERRORS, legend)
        };
        let (goal, is_alone) = (self.subject.goal, self.subject.without_orientation);
        // Of two plots side by side the second has the legend of both, and the room for it.
        let (name, legend) = ("Position error, log10 mm", is_alone.then_some(RightTop));
        let mut panes = vec![(
            1.0,
            pane(
                name,
                Signal::PositionError,
                "guide:goal_position",
                goal[0],
                legend,
            ),
        )];
        if !is_alone {
            let name = "Orientation error, log10 °";
            let guide = "guide:goal_orientation";
            panes.push((
                1.2,
                pane(
                    name,
                    Signal::OrientationError,
                    guide,
                    goal[1],
                    Some(RightTop),
                ),
            ));
        }
        self.sheet.row("Task errors", panes)
    }

    fn torques(&mut self) -> EntityPath {
        let hand = self.per_joint(
            "Hand torque, no gravity",
            Signal::DrawnHand,
            Named::First,
            None,
        );
        let null = self.per_joint("Null-space torque", Signal::DrawnNull, Named::Last, None);
        self.sheet.row("Torques", vec![(1.0, hand), (1.0, null)])
    }

    fn joints(&mut self) -> EntityPath {
        let name = "Joints between limits ±1";
        let range = self.per_joint(name, Signal::DrawnPosition, Named::First, Some([-1.1, 1.1]));
        let speed = self.per_joint("Joint speeds", Signal::DrawnSpeed, Named::Last, None);
        self.sheet.row("Joints", vec![(1.0, range), (1.0, speed)])
    }

    /// The share of each torque, and the speed of the path's clock.
    fn governor(&mut self) -> EntityPath {
        let names = ["time", "task torque", "null torque"].map(str::to_owned);
        let colours = [
            [120, 190, 250, 255],
            [110, 215, 150, 255],
            [200, 200, 120, 255],
        ];
        let scales = Lines::of(Signal::Scale, names, colours);
        let beta = self.per_singularity(Signal::Beta).named("β");
        let name = "β (1 hand, 0 null space), governor";
        self.sheet.plot(
            name,
            vec![scales, beta],
            Some([-0.05, 1.05]),
            Some(RightBottom),
        )
    }

    fn auxiliary(&mut self) -> EntityPath {
        let mut reference = self
            .per_singularity(Signal::AuxiliaryReference)
            .named("reference");
        reference
            .colours
            .iter_mut()
            .for_each(|colour| colour[3] = 120);
        let lines = vec![reference, self.per_singularity(Signal::Auxiliary)];
        self.sheet
            .plot("Auxiliary coordinates, rad", lines, None, Some(RightTop))
    }

    fn singular_values(&mut self) -> EntityPath {
        let count = self.subject.joints.min(6);
        let name = |i| match i == 1 || i == count {
            true => format!("σ{i}"),
            false => format!("σ2 to σ{}", count.saturating_sub(1)),
        };
        let lines = Lines::of(Signal::SingularValues, (1..=count).map(name), JOINTS);
        self.sheet
            .plot("Singular values", vec![lines], None, Some(RightTop))
    }

    /// `named`: all hops, where there is room, or the whole way.
    fn latency(&mut self, named: Named) -> EntityPath {
        let mut names = hop_names();
        if named != Named::All {
            let last = names.len() - 1;
            names[..last].fill("its parts".to_owned());
        }
        let hops = Lines::of(Signal::Latency, names, JOINTS);
        self.sheet.plot(
            "Latency per hop, log10 µs",
            vec![hops],
            LATENCIES,
            Some(RightTop),
        )
    }
}
