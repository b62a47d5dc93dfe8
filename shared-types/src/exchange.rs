//! The exchange page: how a program in any language takes part in a run.
//!
//! A process with `exchange = true` in the graph runs armplane's own shell (topics, lockstep,
//! faults, checkpoints); the user's program does the step of each tick. They share only one file,
//! the exchange page: an [`ExchangeHead`], one [`ExchangeTopic`] for each topic of the process, the
//! messages as on the wire, and room for the program's checkpoint. `docs/wire.md` has the state
//! machine; `armplane generate wire` prints the layouts for other languages.
//!
//! Both sides write only their own fields. A side fills its fields, then stores its count with release order and wakes the other side by a futex
//! on that count; the other side reads the count with acquire order before anything else.

use crate::wire::wire;

/// Version of the contract: of the two structures below and of the order in which their fields are written.
pub const EXCHANGE_VERSION: u32 = 1;

/// The first eight bytes of an exchange page: "armplane" in ASCII.
pub const EXCHANGE_MARK: u64 = u64::from_le_bytes(*b"armplane");

/// Room for a text on the page, its final zero included; bytes of UTF-8.
pub const EXCHANGE_TEXT: usize = 256;

/// Room for the name of a topic, its final zero included; bytes.
pub const EXCHANGE_NAME: usize = 40;

/// Room for the name of a type, its final zero included; bytes.
pub const EXCHANGE_TYPE: usize = 136;

/// Room for a program's checkpoint; bytes.
pub const EXCHANGE_STATE: usize = 4096;

/// The environment variable with the path of the exchange page.
pub const EXCHANGE_VARIABLE: &str = "ARMPLANE_EXCHANGE";

wire! {
    /// The beginning of an exchange page. *armplane* or *program* says which of the two writes the field. The fields up to `program` keep their
    /// places in every version, so that two versions can name each other.
    ExchangeHead {
        /// armplane: `EXCHANGE_MARK`, written last when the page is made.
        mark: u64,
        /// armplane: the version of the contract, `EXCHANGE_VERSION`.
        version: u32,
        /// armplane: the size of the page; bytes.
        bytes: u32,
        /// program: the version of the contract that it was written for.
        program_version: u32,
        /// program: one of `codes::PROGRAMS`.
        program: u32,
        /// armplane: its process id; a program that waits and no longer finds this process ends itself.
        armplane_pid: u32,
        /// armplane: 1 in lockstep, 0 in real time.
        lockstep: u32,
        /// armplane: ticks per second of the arm's time; Hz.
        rate_hz: u32,
        /// armplane: joints of the arm; the first so many elements of an array of joints.
        dof: u32,
        /// armplane: how often the process has been started in this run, from 1.
        incarnation: u32,
        /// armplane: how many topics follow.
        topics: u32,
        /// armplane: the first `ExchangeTopic`; bytes from the start of the page, multiple of 8.
        topics_at: u32,
        /// armplane: the room for the checkpoint; bytes from the start of the page, multiple of 8.
        state_at: u32,
        /// armplane: how many bytes of checkpoint a predecessor left, 0 without one; bytes.
        state_left: u32,
        /// armplane: how much it may hold, `EXCHANGE_STATE`; bytes.
        state_room: u32,
        /// armplane: counts requests; the futex word on which the program sleeps.
        requests: u32,
        /// armplane: one of `codes::REQUESTS`.
        request: u32,
        /// armplane: the tick of the request.
        tick: u64,
        /// armplane: why it stops the program, UTF-8 ended by 0; empty at the ordinary end of a run.
        reason: [u8; EXCHANGE_TEXT],
        /// program: its process id.
        program_pid: u32,
        /// program: one of `codes::ANSWERS`.
        answer: u32,
        /// program: the count of the request that it has answered; the futex word on which armplane sleeps.
        answers: u32,
        /// program: how many bytes of checkpoint it has written, 0 for none; bytes.
        state_bytes: u32,
        /// program: the tick that it has answered; any other than that of the request is refused.
        answer_tick: u64,
        /// program: why it cannot go on, UTF-8 ended by 0.
        complaint: [u8; EXCHANGE_TEXT],
    }
}

wire! {
    /// One topic of an exchange page.
    ExchangeTopic {
        /// armplane: its name, ended by 0.
        name: [u8; EXCHANGE_NAME],
        /// armplane: the versioned name of its message's type, ended by 0.
        type_name: [u8; EXCHANGE_TYPE],
        /// armplane: the hash of the layout of its message.
        layout: u64,
        /// armplane: where the message lies; bytes from the start of the page, multiple of 64.
        at: u32,
        /// armplane: the size of the message; bytes.
        bytes: u32,
        /// armplane: one of `codes::USES`.
        usage: u32,
        /// armplane: 1 where the message belongs to the request, 0 where none has come and the bytes are those of an earlier one.
        fresh: u32,
        /// program: the name of the type that it uses for this topic, ended by 0; empty where it does not use the topic.
        program_type: [u8; EXCHANGE_TYPE],
        /// program: the hash of the layout of that type.
        program_layout: u64,
    }
}
