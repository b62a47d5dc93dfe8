//! The named integers that travel in messages: no Rust enum crosses a process boundary.

use std::fmt::{Display, from_fn};

use crate::MAX_SINGULARITIES;

/// A code with its name, for tables, recordings and errors.
pub type Named = (u32, &'static str);

/// The name of `code` in `table`, or `"unknown"`.
#[must_use]
pub fn name_of(table: &[Named], code: u32) -> &'static str {
    table
        .iter()
        .find(|(known, _)| *known == code)
        .map_or("unknown", |(_, name)| name)
}

/// The name of a singularity: its kind, or, for one found numerically, its place in the report.
#[must_use]
pub fn singularity_name(kind: u32, place: usize) -> &'static str {
    const NUMBERED: [&str; MAX_SINGULARITIES] = ["s1", "s2", "s3", "s4"];
    match kind {
        KIND_NUMERIC => NUMBERED.get(place).copied().unwrap_or("unknown"),
        kind => name_of(KINDS, kind),
    }
}

/// How a steered arm follows its target, in words: the reason, and the joint where it is one; `joint` counts from 1, 0 is none.
#[must_use]
pub fn reason_text(reason: u32, joint: u32, upper: u32) -> impl Display {
    let side = if upper > 0 { "upper" } else { "lower" };
    from_fn(move |f| {
        f.write_str(name_of(REASONS, reason))?;
        match joint {
            0 => Ok(()),
            joint => write!(f, ": joint {joint} at its {side} limit"),
        }
    })
}

macro_rules! codes {
    ($( $(#[$meta:meta])* $table:ident { $( $(#[$doc:meta])* $name:ident = $value:literal $text:literal ),* $(,)? } )*) => {
        $( $( $(#[$doc])* pub const $name: u32 = $value; )*
        $(#[$meta])*
        pub const $table: &[Named] = &[ $( ($name, $text) ),* ]; )*

        /// All tables: the name of each, and of each code its constant's name, value and text.
        pub const TABLES: &[(&str, &[(&str, u32, &str)])] = &[ $( (stringify!($table), &[ $( (stringify!($name), $name, $text) ),* ]) ),* ];
    };
}

codes! {
    /// The name of a singularity.
    KINDS {
        /// Found numerically; its place in the report is its name.
        KIND_NUMERIC = 0 "numeric",
        /// The arm is stretched or folded: translation towards the shoulder is lost.
        KIND_ELBOW = 1 "elbow",
        /// Axes 4 and 6 are parallel: rotation about z4 × z5 is lost.
        KIND_WRIST = 2 "wrist",
        /// The wrist centre is on the waist axis: translation normal to the arm plane is lost.
        KIND_OVERHEAD = 3 "overhead",
        /// Axes 1 and 3 of a seven-joint arm are parallel: a translation across the line from shoulder to wrist is lost.
        KIND_SHOULDER = 4 "shoulder",
    }

    /// Chang & Khatib's types.
    TYPES {
        /// Not classified (yet).
        TYPE_UNKNOWN = 0 "unknown",
        /// Null-space motion moves the end-effector along the singular direction.
        TYPE_1 = 1 "type 1",
        /// Null-space motion only turns the singular direction.
        TYPE_2 = 2 "type 2",
        /// Both: κ₁ and κ₂ give the share of each.
        TYPE_MIXED = 3 "mixed",
    }

    /// The reported state of the control law at one singularity.
    MODES {
        /// Outside the neighbourhood: plain operational-space control.
        MODE_REGULAR = 0 "regular",
        /// Between η_in and η_out.
        MODE_BLEND = 1 "blend",
        /// Inside, following the auxiliary coordinate's reference.
        MODE_TRACK = 2 "track",
        /// Inside, passing through with ζ held off the direction of travel.
        MODE_PASS = 3 "pass",
        /// Inside, ζ held.
        MODE_HOLD = 4 "hold",
        /// Inside, ζ being turned to ζ_d by null-space motion.
        MODE_REORIENT = 5 "reorient",
        /// Inside, goal beyond reach: sliding along the boundary.
        MODE_SLIDE = 6 "slide",
        /// Outside again, auxiliary error still being removed.
        MODE_RECOVER = 7 "recover",
    }

    /// Why the controller refuses to go on, as the end of a sentence.
    REFUSALS {
        /// It goes on.
        REFUSAL_NONE = 0 "",
        /// A position, velocity or disturbance is a NaN or an infinity.
        REFUSAL_STATE = 1 "the estimated state is not a finite number",
        /// A code in the analyzer's report has no name.
        REFUSAL_REPORT = 2 "the singularity report is of another version of the wire",
        /// The law's system of equations has no answer here.
        REFUSAL_SINGULAR = 3 "the arm is singular in a way that the law does not handle; start or lead the path elsewhere",
        /// Even the slowest clock asks joints for far more speed than they have.
        REFUSAL_SPEED = 4 "the path passes so near to a singularity that even at its slowest it needs far more joint speed than there is",
        /// ζ cannot be turned so far, either way round.
        REFUSAL_ROOM = 5 "the singular direction cannot be turned as asked: the joints have no room for it; ask for less, or start elsewhere",
        /// The torque is not a finite number.
        REFUSAL_TORQUE = 6 "the torque is not a finite number",
        /// No route follows the path within the joint limits.
        REFUSAL_ROUTE = 7 "the path cannot be followed within the joint limits from this start posture; start in another posture, or lead the path elsewhere",
        /// A joint is about to reach its limit.
        REFUSAL_LIMIT = 8 "a joint came too near to its limit and the arm was stopped before it; start in another posture, or end the path earlier",
        /// rank J and the singularities inside their neighbourhoods do not add up.
        REFUSAL_UNLISTED = 9 "the arm has lost a direction that no listed singularity explains: start elsewhere, or lead the path around that posture",
        /// The estimate has moved as no arm can for too long.
        REFUSAL_ESTIMATE = 10 "the estimated state moves as no torque within the limits can move the arm; see to the encoders",
        /// The arm is far from the reference arm of its steered run.
        REFUSAL_PARTED = 11 "the arm was held back or thrown",
        /// The checkpoint that it was restored from is damaged.
        REFUSAL_CHECKPOINT = 12 "the checkpoint of the process before it is damaged; start the run again",
        /// In the direction of a force nothing was met.
        REFUSAL_CONTACT = 13 "the hand met nothing in the direction of its force; put a surface in the way, or raise force.reach_m",
        /// The hand met a surface and left it again and again.
        REFUSAL_BOUNCE = 14 "the hand bounced off the surface that it met; state the surface's stiffness in force.stiffness_n_m, or approach more slowly",
        /// The force did not come about.
        REFUSAL_PRESSING = 15 "the hand could not press as asked; a lost direction bears the force, something else holds the hand, or the force swings about its set-point",
    }

    /// The drive's state.
    DRIVES {
        /// Fresh torque is applied.
        DRIVE_ACTIVE = 0 "active",
        /// The last torque is held: none came this tick.
        DRIVE_HOLDING = 1 "holding",
        /// The stop law brakes the arm to rest.
        DRIVE_STOPPING = 2 "stopping",
        /// At rest, brakes engaged.
        DRIVE_BRAKED = 3 "braked",
    }

    /// The drive's changes to the commanded torque: bits, added up.
    DRIVE_FLAGS {
        /// No torque came this tick.
        DRIVE_ABSENT = 1 "absent",
        /// A torque with a NaN or an infinity came, and was refused whole: it counts as absent.
        DRIVE_REFUSED = 2 "refused",
        /// A torque was beyond the joint's effort limit.
        DRIVE_EFFORT = 4 "effort",
        /// A torque changed faster than the drive allows.
        DRIVE_RATE = 8 "rate",
        /// A torque would have driven a joint further beyond its speed limit.
        DRIVE_SPEED = 16 "speed",
        /// A torque came that was computed from too old a state, and was refused: it counts as absent.
        DRIVE_STALE = 64 "stale",
        /// An encoder reports another position than the drives' own sensors: the torque computed from it was refused, and counts as absent.
        DRIVE_ENCODER = 128 "encoder",
        /// The simulated motion left the finite numbers; the arm was stopped where it last was.
        DRIVE_DIVERGED = 32 "diverged",
    }

    /// Where the task is.
    PHASES {
        /// Following the path.
        PHASE_RUNNING = 0 "running",
        /// Path finished, holding the last pose.
        PHASE_SETTLING = 1 "settling",
        /// Finished.
        PHASE_DONE = 2 "done",
        /// The controller refused to go on; the torque brings the arm to rest.
        PHASE_REFUSED = 3 "refused",
    }

    /// The kind of a target.
    TARGETS {
        /// None yet: the arm rests.
        TARGET_NONE = 0 "none",
        /// A twist of E.
        TARGET_TWIST = 1 "twist",
        /// A pose of E in B.
        TARGET_POSE = 2 "pose",
        /// Positions of all joints.
        TARGET_POSTURE = 3 "posture",
        /// The end of the session: the arm comes to rest and the run ends.
        TARGET_END = 4 "end",
        /// It held a NaN or an infinity where it was read; its numbers are zero.
        TARGET_UNREADABLE = 5 "unreadable",
    }

    /// The axes in which a twist is given.
    FRAMES {
        /// Those of the base.
        FRAME_BASE = 0 "base",
        /// Those of the end-effector.
        FRAME_HAND = 1 "hand",
        /// Those of the nearest singularity's frame, x along ζ.
        FRAME_SINGULAR = 2 "singular",
    }

    /// The side in which a Type 1 singularity is left.
    SIDES {
        /// The present one.
        SIDE_KEEP = 0 "keep",
        /// s < 0.
        SIDE_NEGATIVE = 1 "negative",
        /// s > 0.
        SIDE_POSITIVE = 2 "positive",
    }

    /// Why a target is refused, as the end of a sentence.
    TARGET_REFUSALS {
        /// None was.
        TARGET_REFUSAL_NONE = 0 "",
        /// A NaN or an infinity.
        TARGET_REFUSAL_NUMBER = 1 "it holds a NaN or an infinity",
        /// A frame without a name, or one in which this kind cannot be given.
        TARGET_REFUSAL_FRAME = 2 "its frame is unknown, or not one for its kind (a pose is in base, a force in base or hand)",
        /// A kind or a side without a name.
        TARGET_REFUSAL_KIND = 3 "its kind or its side is unknown",
        /// A quaternion whose norm is not 1, or a matrix that is no rotation.
        TARGET_REFUSAL_ROTATION = 4 "its rotation is none: a quaternion has norm 1, a matrix determinant 1",
        /// A stamp later than the present tick, or a validity that is negative.
        TARGET_REFUSAL_TIME = 5 "its time stamp is in the future, or its validity is negative",
        /// A number no arm has a use for.
        TARGET_REFUSAL_RANGE = 6 "a number is beyond 1000, or its position beyond 100 m",
        /// A posture of another number of joints.
        TARGET_REFUSAL_JOINTS = 7 "its posture has not one value for each joint of the arm",
        /// A force where there is no surface, one that no joint holds, below 0.1 N, or with a posture.
        TARGET_REFUSAL_FORCE = 8 "its force has nothing to press on, is below 0.1 N or beyond what the joints hold, or comes with a posture",
    }

    /// How the controller follows its target, and why not faster.
    REASONS {
        /// At the speed asked for.
        REASON_FOLLOWING = 0 "follows",
        /// There has been no target, or it asks for rest.
        REASON_RESTING = 1 "rests",
        /// The target is older than its validity.
        REASON_STALE = 2 "rests: the target is older than its validity",
        /// The target asks for more speed than the session allows.
        REASON_FAST = 3 "slowed: the target is faster than the session allows",
        /// Near a singularity the joints would need more speed than they have.
        REASON_SINGULARITY = 4 "slowed near a singularity",
        /// A joint would need more speed, or torque, than it has.
        REASON_EFFORT = 5 "slowed: a joint is at its speed or torque limit",
        /// A joint is near its limit.
        REASON_LIMIT = 6 "slowed before a joint limit",
        /// The target leads beyond reach: the arm slides along the boundary, or rests there.
        REASON_REACH = 7 "at the boundary of reach",
        /// The law gave no torque: the arm is brought to rest, and goes on from there.
        REASON_STOPPED = 8 "stopped, goes on from rest",
        /// The session is over.
        REASON_OVER = 9 "over",
        /// The hand is far behind that of the reference arm.
        REASON_HELD = 10 "held back: something is in the arm's way",
        /// A twist has a share in axes that are not of the arm's task.
        REASON_AXES = 11 "leaves out axes that the arm does not serve",
        /// In a lock no joint moves the hand as asked, and no self-motion leads on.
        REASON_LOST = 12 "held: the motion asked for is lost in a singularity",
    }
}
