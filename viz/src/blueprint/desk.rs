//! The panes that layouts are made of, and how each layout arranges them.

use re_sdk_types::blueprint::components::Corner2D::{RightBottom, RightTop};
use rerun::EntityPath;
use shared_types::scenario::Layout;

use super::sheet::{Cell, Lines, Sheet};
use super::{ACROSS, ALONG, BAND_LINES, JOINTS};
use crate::entity;
use crate::signals::{Signal, hop_names};
use crate::solid::Rgba;
use crate::tint::faded;

const TOLERANCE: Rgba = 0xff4054ff;
/// Powers of ten of latencies, µs.
const LATENCIES: Option<[f64; 2]> = Some([-0.6, 4.3]);

/// Width over height of the pane in which a layout shows the whole arm, in a window of 1280 × 720.
pub(crate) fn pane(layout: Layout) -> f32 {
    match layout {
        Layout::Control => 0.52,
        Layout::Timing => 2.0,
    }
}

/// Joints that a plot's legend names.
#[derive(Clone, Copy, PartialEq)]
enum Named {
    All,
    First,
    Last,
}

impl Sheet<'_> {
    pub(super) fn arrange(&mut self) {
        match self.layout {
            Layout::Control => self.arrange_control(),
            Layout::Timing => self.arrange_timing(),
        };
    }

    fn arrange_control(&mut self) -> EntityPath {
        let views = vec![(1.4, self.close_up()), (1.0, self.whole_arm())];
        let left = vec![(5.6, self.row("", views)), (1.15, self.now())];
        let torques = self.torques();
        let (errors, joints, measure) = (self.errors(), self.joints(), self.measure());
        let others = [
            self.per_joint("Gravity torque", Signal::DrawnGravity, Named::First, None),
            self.governor(),
            self.auxiliary(),
            self.singular_values(),
            self.latency(Named::Last),
        ];
        let modes = [self.modes(), self.lives(), self.log_lines()];
        // Three rows: fewer and taller plots have ticks that can be read, and room for a legend of six names.
        let right = if self.subject.stands_still {
            // No singularity is in play: the error first, the joints that move, and the rest in tabs.
            let more = [torques, measure].into_iter().chain(others).chain(modes);
            let more = self.tabs(more.collect());
            vec![(1.3, errors), (1.4, joints), (1.6, more)]
        } else {
            let more = [errors, torques, joints].into_iter().chain(others);
            let more = self.tabs(more.collect());
            let modes = self.tabs(modes.into());
            vec![(1.4, measure), (1.6, more), (self.lanes(1.35), modes)]
        };
        self.halves(left, right)
    }

    /// The work of the processes, and its duration.
    fn arrange_timing(&mut self) -> EntityPath {
        let more = vec![
            self.latency(Named::All),
            self.errors(),
            self.torques(),
            self.joints(),
            self.measure(),
            self.governor(),
        ];
        let more = self.tabs(more);
        let left = vec![(2.25, self.lives()), (2.35, more)];
        let below = [self.log_lines(), self.modes()];
        let below = self.tabs(below.into());
        let right = vec![(1.8, self.arm(None)), (0.8, self.now()), (0.9, below)];
        self.halves(left, right)
    }

    /// The share of a pane with a lane for each singularity; `usual`: of up to three.
    fn lanes(&self, usual: f32) -> f32 {
        match self.subject.singularities.len() {
            0..=3 => usual,
            _ => 1.7,
        }
    }

    /// Two columns: the table of singularities and lines of the log are as wide in each layout.
    fn halves(&mut self, left: Vec<Cell>, right: Vec<Cell>) -> EntityPath {
        let cells = vec![(1.12, self.column(left)), (1.0, self.column(right))];
        self.row("", cells)
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
        let [speed, load] = self.subject.units;
        let unit = match signal {
            Signal::DrawnPosition => "",
            Signal::DrawnSpeed if self.subject.unlimited_speed => speed,
            Signal::DrawnSpeed => " / limit",
            _ if self.subject.unlimited_torque => load,
            _ => " / limit",
        };
        let (count, first) = (self.subject.joints, self.subject.joints.div_ceil(2));
        let (own, others) = match named {
            _ if count <= 3 => (0..count, count..count),
            Named::First => (0..first, first..count),
            _ => (first..count, 0..first),
        };
        let name_of = |i: usize| match own.contains(&i) {
            true => format!("q{}", i + 1),
            false => format!("q{}–q{}", others.start + 1, others.end),
        };
        let lines = Lines::of(signal, (0..count).map(name_of).zip(JOINTS));
        let name = format!("{name}{unit}");
        self.plot(&name, vec![lines], range, Some(RightBottom))
    }

    fn per_singularity(&self, signal: Signal) -> Lines {
        Lines::of(signal, self.subject.singularities.iter().cloned())
    }

    fn arm(&mut self, without: Option<&str>) -> EntityPath {
        self.world("Arm", &self.subject.eye, without)
    }

    /// The same beside a close-up: only one of them has the captions.
    fn whole_arm(&mut self) -> EntityPath {
        let is_beside = !self.subject.stands_still;
        self.arm(is_beside.then_some(entity::CAPTIONS))
    }

    fn close_up(&mut self) -> EntityPath {
        let (name, without) = match self.subject.stands_still {
            true => ("The hand's way, × 50", Some(entity::CAPTIONS)),
            false => ("Close-up: ζ, the lost direction", None),
        };
        self.world(name, &self.subject.close_up, without)
    }

    fn now(&mut self) -> EntityPath {
        self.text("TextDocument", "What is happening", entity::NOW)
    }

    fn log_lines(&mut self) -> EntityPath {
        self.text("TextLog", "Log", entity::LOG)
    }

    fn modes(&mut self) -> EntityPath {
        let all = self.subject.singularities.iter();
        let lanes = all.map(|(name, _)| format!("/{name}")).collect();
        self.states("What control does at each singularity", lanes)
    }

    fn lives(&mut self) -> EntityPath {
        let mut lanes: Vec<String> = [entity::FAULT, entity::DRIVE].map(str::to_owned).into();
        lanes.extend(self.subject.lives.named().map(entity::life));
        self.states("Fault, processes, drive", lanes)
    }

    /// log₁₀(|s_i| / η_i), the band below 1 hatched.
    fn measure(&mut self) -> EntityPath {
        // The legend has the colour of the first line: the band's would not be seen there.
        let zero = Lines::guide("guide:zero", "singular", 1, TOLERANCE, 1.0);
        let band = Lines::guide("guide:band", "singular", BAND_LINES, 0xff40541e, 5.0);
        let edges = self.subject.outer.len();
        let edges = Lines::guide("guide:edge", "singular", edges, 0xbec3cd96, 1.0);
        let mut nearness = self.per_singularity(Signal::Nearness);
        nearness.width = 2.5;
        let name = "How near: |s|/η in powers of ten. Below 0: treated as singular";
        let lines = vec![zero, band, edges, nearness];
        self.plot(name, lines, Some([-3.1, 1.4]), Some(RightBottom))
    }

    /// The errors, each with what the goal allows.
    fn errors(&mut self) -> EntityPath {
        // Where no direction is lost there is one error, and the other line is not seen.
        let (names, along) = match self.subject.stands_still {
            true => (["error"; 2], 0),
            false => (["orthogonal", "along ζ"], ALONG),
        };
        let [position, orientation] = self.subject.goal;
        let all = [
            (
                "Position error, mm",
                Signal::PositionError,
                "guide:goal_position",
                position,
            ),
            (
                "Orientation error, °",
                Signal::OrientationError,
                "guide:goal_orientation",
                orientation,
            ),
        ];
        let count = if self.subject.without_orientation {
            1
        } else {
            2
        };
        let mut panes = Vec::new();
        for (i, (name, signal, guide, goal)) in all.into_iter().take(count).enumerate() {
            let names = names.map(str::to_owned).into_iter();
            let mut lines = vec![Lines::of(signal, names.zip([ACROSS, along]))];
            lines.extend(goal.map(|_| Lines::guide(guide, "allowed", 1, TOLERANCE, 1.5)));
            // Of two plots side by side the second has the legend of both, and the room for it.
            let legend = (i + 1 == count).then_some(RightTop);
            panes.push((1.0 + 0.2 * i as f32, self.plot(name, lines, None, legend)));
        }
        self.row("Task errors", panes)
    }

    fn torques(&mut self) -> EntityPath {
        let name = "Hand torque, no gravity";
        let hand = self.per_joint(name, Signal::DrawnHand, Named::First, None);
        let null = self.per_joint("Null-space torque", Signal::DrawnNull, Named::Last, None);
        self.row("Torques", vec![(1.0, hand), (1.0, null)])
    }

    fn joints(&mut self) -> EntityPath {
        let name = "Joints between limits ±1";
        let range = self.per_joint(name, Signal::DrawnPosition, Named::First, Some([-1.1, 1.1]));
        let speed = self.per_joint("Joint speeds", Signal::DrawnSpeed, Named::Last, None);
        self.row("Joints", vec![(1.0, range), (1.0, speed)])
    }

    /// The share of each torque, and the speed of the path's clock.
    fn governor(&mut self) -> EntityPath {
        let scales = [
            ("time", 0x78befaff),
            ("task torque", 0x6ed796ff),
            ("null torque", 0xc8c878ff),
        ];
        let scales = scales.map(|(name, colour)| (name.to_owned(), colour));
        let scales = Lines::of(Signal::Scale, scales);
        let lines = vec![scales, self.per_singularity(Signal::Beta).named("β")];
        let name = "β (1 hand, 0 null space), governor";
        self.plot(name, lines, Some([-0.05, 1.05]), Some(RightBottom))
    }

    fn auxiliary(&mut self) -> EntityPath {
        let mut reference = self
            .per_singularity(Signal::AuxiliaryReference)
            .named("reference");
        reference
            .lines
            .iter_mut()
            .for_each(|line| line.1 = faded(line.1, 120));
        let lines = vec![reference, self.per_singularity(Signal::Auxiliary)];
        self.plot("Auxiliary coordinates, rad", lines, None, Some(RightTop))
    }

    fn singular_values(&mut self) -> EntityPath {
        let count = self.subject.joints.min(6);
        let name = |i| match i == 1 || i == count {
            true => format!("σ{i}"),
            false => format!("σ2 to σ{}", count.saturating_sub(1)),
        };
        let lines = Lines::of(Signal::SingularValues, (1..=count).map(name).zip(JOINTS));
        self.plot("Singular values", vec![lines], None, Some(RightTop))
    }

    /// `named`: all hops, where there is room, or the whole way.
    fn latency(&mut self, named: Named) -> EntityPath {
        let mut names = hop_names();
        if named != Named::All {
            let last = names.len() - 1;
            names[..last].fill("its parts".to_owned());
        }
        let hops = Lines::of(Signal::Latency, names.into_iter().zip(JOINTS));
        self.plot(
            "Latency per hop, log10 µs",
            vec![hops],
            LATENCIES,
            Some(RightTop),
        )
    }
}
