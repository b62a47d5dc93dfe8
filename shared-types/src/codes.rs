//! The named integers that travel in messages: no Rust enum crosses a process boundary.

/// A code with its name, for tables, recordings and errors.
pub type Named = (u32, &'static str);

/// The name of `code` in `table`, or `"unknown"`.
#[must_use]
pub fn name_of(table: &[Named], code: u32) -> &'static str {
    table.iter().find(|(known, _)| *known == code).map_or("unknown", |(_, name)| name)
}

/// The name of a singularity: its kind, or, for one found numerically, its place in the report (`s1`, `s2`, …).
#[must_use]
pub fn singularity_name(kind: u32, place: usize) -> String {
    match kind {
        KIND_NUMERIC => format!("s{}", place + 1),
        kind => name_of(KINDS, kind).to_owned(),
    }
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
        REFUSAL_DOUBT = 10 "the estimated state moves as no torque within the limits can move the arm; see to the encoders",
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

    /// How far the program of an exchange page is.
    PROGRAMS {
        /// It has not come yet.
        PROGRAM_AWAITED = 0 "awaited",
        /// It has mapped the page and said which layouts it uses; it waits for requests.
        PROGRAM_JOINED = 1 "joined",
        /// It refuses the page; the complaint says why.
        PROGRAM_REFUSED = 2 "refused",
    }

    /// What armplane requests of the program of an exchange page.
    REQUESTS {
        /// Nothing yet.
        REQUEST_NONE = 0 "none",
        /// Take up the predecessor's checkpoint, where there is one: the first tick is `tick`.
        REQUEST_START = 1 "start",
        /// Do the step of `tick`: the inputs are on the page, the outputs are to be written there.
        REQUEST_TICK = 2 "tick",
        /// Answer and end.
        REQUEST_STOP = 3 "stop",
    }

    /// What the program of an exchange page answers.
    ANSWERS {
        /// Done.
        ANSWER_DONE = 0 "done",
        /// Done, and the run ends with this tick: for the process that makes the ticks.
        ANSWER_OVER = 1 "over",
        /// It cannot go on; the complaint says why.
        ANSWER_FAILED = 2 "failed",
    }

    /// What a process does with a topic.
    USES {
        /// It reads the message of the tick.
        USE_READS = 0 "reads",
        /// It reads the message of the tick before, to get to this one.
        USE_FEEDBACK = 1 "feedback",
        /// It writes the message of the tick.
        USE_WRITES = 2 "writes",
    }
}
