//! The panes that layouts are made of, and how each layout arranges them.

use re_chunk::EntityPath;
use re_sdk_types::blueprint::components::Corner2D;
use shared_types::scenario::Layout;

use super::sheet::{Cell, Lines, Sheet};
use super::subject::{ACROSS, ALONG, JOINTS, Subject};
use crate::entity;
use crate::signals::{Drawn, Signal, hop_names};
use crate::solid::Rgba;

const TOLERANCE: Rgba = [255, 64, 84, 255];
const LIMITS: Option<[f64; 2]> = Some([-1.1, 1.1]);
/// Name of the view from near by.
pub(super) const fn close_up_name(subject: &Subject) -> &'static str {
    if subject.stands_still {
        "The hand's way, × 50"
    } else {
        "Close-up, across ζ"
    }
}

/// Name of the view of the whole arm.
pub(super) const fn world_name(subject: &Subject) -> &'static str {
    if subject.stands_still {
        "Arm: its joints move"
    } else {
        "Arm: the coloured mark is the lost direction ζ"
    }
}

/// Powers of ten of errors, mm and degrees, and of latencies, µs.
const ERRORS: Option<[f64; 2]> = Some([-4.3, 2.3]);
const LATENCIES: Option<[f64; 2]> = Some([-0.6, 4.3]);

/// Joints that a plot's legend names.
#[derive(Clone, Copy)]
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
        let left = [(2.45, self.sheet.row("", views)), (1.15, self.now())];
        let torques = self.torques();
        let (errors, joints, measure) = (self.errors(), self.joints(), self.measure());
        let others = [
            self.gravity(),
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
            let lanes = match self.subject.singularities.len() {
                0..=3 => 1.35,
                _ => 1.6,
            };
            vec![(1.4, measure), (1.6, more), (lanes, modes)]
        };
        self.halves(left.into(), right)
    }

    fn arrange_timing(&mut self) -> EntityPath {
        let upper = [(2.2, self.latency(Named::All)), (1.0, self.small_world())];
        // Each lane takes 40 points: the processes' stand in a column of their own.
        let lives = self.lives();
        let modes = [self.modes(), self.log()].map(|view| (1.0, view));
        // Three plots side by side have no room for their titles.
        let plots = vec![self.errors(), self.governor()];
        let rows = vec![
            (1.0, self.sheet.row("", modes.to_vec())),
            (1.2, self.sheet.tabs(plots)),
        ];
        let lower = vec![(1.0, lives), (2.2, self.sheet.column(rows))];
        let cells = [(1.6, upper.to_vec()), (2.4, lower)]
            .map(|(share, row)| (share, self.sheet.row("", row)));
        self.sheet.column(cells.into())
    }

    fn arrange_faults(&mut self) -> EntityPath {
        let below = [self.log(), self.modes()];
        let below = self.sheet.tabs(below.into());
        let left = [(1.3, self.small_world()), (0.95, self.now()), (1.1, below)];
        let more = [
            self.errors(),
            self.torques(),
            self.joints(),
            self.measure(),
            self.governor(),
            self.latency(Named::Last),
        ];
        let more = self.sheet.tabs(more.into());
        let right = [(2.25, self.lives()), (2.35, more)];
        self.halves(left.into(), right.into())
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
    fn per_joint(&self, drawn: Drawn, named: Named) -> Vec<Lines> {
        let (count, first) = (self.subject.joints, self.subject.joints.div_ceil(2));
        let (own, others) = match named {
            _ if count <= 3 => (0..count, count..count),
            Named::First => (0..first, first..count),
            Named::All | Named::Last => (first..count, 0..first),
        };
        let others = format!("q{}–q{}", others.start + 1, others.end);
        let names = (0..count).map(|i| {
            if own.contains(&i) {
                format!("q{}", i + 1)
            } else {
                others.clone()
            }
        });
        vec![Lines::drawn(drawn, names.collect(), JOINTS)]
    }

    fn singularity_names(&self, prefix: &str) -> Vec<String> {
        self.subject
            .singularities
            .iter()
            .map(|(name, _)| format!("{prefix}{name}"))
            .collect()
    }

    fn per_singularity(&self, signal: Signal, prefix: &str) -> Lines {
        Lines::of(signal, self.singularity_names(prefix), self.colours())
    }

    fn colours(&self) -> Vec<Rgba> {
        self.subject
            .singularities
            .iter()
            .map(|(_, colour)| *colour)
            .collect()
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
        let lanes = self.singularity_names("mode/");
        self.sheet.states(
            "What control does at each singularity",
            lanes.iter().map(|lane| entity::state(lane)),
        )
    }

    fn lives(&mut self) -> EntityPath {
        let processes = self.subject.lives.named().map(entity::life);
        self.sheet.states(
            "Fault, processes, drive",
            ["fault", "drive"]
                .map(entity::state)
                .into_iter()
                .chain(processes),
        )
    }

    /// log₁₀(|s_i| / η_i), the band below 1 hatched.
    fn measure(&mut self) -> EntityPath {
        let band = Lines::guide(
            "guide:band",
            "singular",
            entity::BAND_LINES,
            [255, 64, 84, 30],
            5.0,
        );
        // In the legend with the band: it has room for few names.
        let edges = Lines::guide(
            "guide:edge",
            "singular",
            self.subject.outer.len(),
            [190, 195, 205, 150],
            1.0,
        );
        let mut nearness =
            Lines::drawn(Drawn::Nearness, self.singularity_names(""), self.colours());
        nearness.width = 2.5;
        self.sheet.plot(
            "How near: |s|/η in powers of ten. Below 0: treated as singular",
            vec![band, edges, nearness],
            Some([-3.1, 1.4]),
            Some(Corner2D::RightBottom),
        )
    }

    /// The errors, each with what the goal allows, in powers of ten.
    fn errors(&mut self) -> EntityPath {
        let (goal, stands_still) = (self.subject.goal, self.subject.stands_still);
        let pane = |sheet: &mut Sheet, name: &str, signal, guide, goal: Option<f64>, legend| {
            // Where no direction is lost there is one error.
            let names = if stands_still {
                ["error"; 2]
            } else {
                ["orthogonal", "along ζ"]
            };
            let mut lines = vec![Lines::of(
                signal,
                names.map(str::to_owned).to_vec(),
                [ACROSS, ALONG],
            )];
            lines.extend(goal.map(|_| Lines::guide(guide, "goal", 1, TOLERANCE, 1.0)));
            sheet.plot(name, lines, ERRORS, legend)
        };
        let (is_alone, corner) = (self.subject.without_orientation, Some(Corner2D::RightTop));
        // Of two plots side by side the second has the legend of both, and the room for it.
        let (name, legend) = (
            "Position error, log10 mm",
            if is_alone { corner } else { None },
        );
        let position = pane(
            self.sheet,
            name,
            Signal::PositionError,
            "guide:goal_position",
            goal[0],
            legend,
        );
        if is_alone {
            return self.sheet.row("Task errors", vec![(1.0, position)]);
        }
        let name = "Orientation error, log10 °";
        let orientation = pane(
            self.sheet,
            name,
            Signal::OrientationError,
            "guide:goal_orientation",
            goal[1],
            corner,
        );
        self.sheet
            .row("Task errors", vec![(1.0, position), (1.2, orientation)])
    }

    fn torque_unit(&self) -> &'static str {
        if self.subject.unlimited_torque {
            ", N·m"
        } else {
            " / limit"
        }
    }

    fn torques(&mut self) -> EntityPath {
        let of = self.torque_unit();
        let hand = self.per_joint(Drawn::Hand, Named::First);
        let hand = self.sheet.plot(
            &format!("Hand torque, no gravity{of}"),
            hand,
            None,
            Some(Corner2D::RightBottom),
        );
        let null = self.per_joint(Drawn::Null, Named::Last);
        let null = self.sheet.plot(
            &format!("Null-space torque{of}"),
            null,
            None,
            Some(Corner2D::RightBottom),
        );
        self.sheet.row("Torques", vec![(1.0, hand), (1.0, null)])
    }

    fn gravity(&mut self) -> EntityPath {
        let name = format!("Gravity torque{}", self.torque_unit());
        self.sheet.plot(
            &name,
            self.per_joint(Drawn::Gravity, Named::First),
            None,
            Some(Corner2D::RightBottom),
        )
    }

    fn joints(&mut self) -> EntityPath {
        let range = self.per_joint(Drawn::InRange, Named::First);
        let range = self.sheet.plot(
            "Joints between limits ±1",
            range,
            LIMITS,
            Some(Corner2D::RightBottom),
        );
        let of = if self.subject.unlimited_speed {
            ", rad/s"
        } else {
            " / limit"
        };
        let speed = self.per_joint(Drawn::Speed, Named::Last);
        let speed = self.sheet.plot(
            &format!("Joint speeds{of}"),
            speed,
            None,
            Some(Corner2D::RightBottom),
        );
        self.sheet.row("Joints", vec![(1.0, range), (1.0, speed)])
    }

    /// The share of each torque, and the speed of the path's clock.
    fn governor(&mut self) -> EntityPath {
        let names = ["time", "task torque", "null torque"]
            .map(str::to_owned)
            .to_vec();
        let scales = Lines::of(
            Signal::Scale,
            names,
            [
                [120, 190, 250, 255],
                [110, 215, 150, 255],
                [200, 200, 120, 255],
            ],
        );
        let mut beta = self.per_singularity(Signal::Beta, "");
        beta.name_all("β");
        self.sheet.plot(
            "β (1 hand, 0 null space), governor",
            vec![scales, beta],
            Some([-0.05, 1.05]),
            Some(Corner2D::RightBottom),
        )
    }

    fn auxiliary(&mut self) -> EntityPath {
        let mut reference = self.per_singularity(Signal::AuxiliaryReference, "reference ");
        reference.name_all("reference");
        reference
            .colours
            .iter_mut()
            .for_each(|colour| colour[3] = 120);
        let actual = self.per_singularity(Signal::Auxiliary, "");
        self.sheet.plot(
            "Auxiliary coordinates, rad",
            vec![reference, actual],
            None,
            Some(Corner2D::RightTop),
        )
    }

    fn singular_values(&mut self) -> EntityPath {
        let count = self.subject.joints.min(6);
        let between = format!("σ2 to σ{}", count.saturating_sub(1));
        let names = (1..=count)
            .map(|i| {
                if i == 1 || i == count {
                    format!("σ{i}")
                } else {
                    between.clone()
                }
            })
            .collect();
        self.sheet.plot(
            "Singular values",
            vec![Lines::of(Signal::SingularValues, names, JOINTS)],
            None,
            Some(Corner2D::RightTop),
        )
    }

    /// `named`: all hops, where there is room, or the whole way.
    fn latency(&mut self, named: Named) -> EntityPath {
        let mut names = hop_names().to_vec();
        if !matches!(named, Named::All) {
            let last = names.len() - 1;
            names[..last].fill("its parts".to_owned());
        }
        let hops = Lines::of(Signal::Latency, names, JOINTS);
        self.sheet.plot(
            "Latency per hop, log10 µs",
            vec![hops],
            LATENCIES,
            Some(Corner2D::RightTop),
        )
    }
}
