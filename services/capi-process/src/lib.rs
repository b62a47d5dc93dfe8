//! `libarmplane-process`: a process of a run, for programs in C and in every language that calls C. `services/capi/header` makes
//! `include/libarmplane-process.h` of this file.
//!
//! A panic becomes an error, and a process that has been forked from the one that joined is refused: it shares the topics' memory with its parent.
#![allow(non_camel_case_types)]

mod topics;

use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use runtime::{Joined, JoinedError, Mode};

use topics::Topics;

/// Version of this header. `armplane_process_join` refuses a program that was compiled with another one.
pub const ARMPLANE_PROCESS_ABI_VERSION: u32 = 1;

/// The header, for `armplane generate wire`.
#[doc(hidden)]
pub const HEADER: &str = include_str!("../include/libarmplane-process.h");

/// The process is given a tick.
pub const ARMPLANE_PROCESS_TICK: i32 = 1;
/// Done; of `armplane_process_wait`: the run is over for this process.
pub const ARMPLANE_PROCESS_OK: i32 = 0;
/// `armplane_process_error` says why the process cannot go on.
pub const ARMPLANE_PROCESS_ERROR: i32 = -1;
/// The function given to `armplane_process_look_out` has ended the wait.
pub const ARMPLANE_PROCESS_LOOKED: i32 = -2;

/// A process of a run. One thread at a time may use it, and no process that was forked from this one.
pub struct armplane_process {
    joined: Joined,
    topics: Topics,
    now: Box<armplane_process_now>,
    folder: CString,
    error: CString,
    /// A call has failed: `wait` and `send` do nothing more.
    has_failed: bool,
    has_looked: std::rc::Rc<std::cell::Cell<bool>>,
    owner: u32,
}

/// The process and the tick in hand.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct armplane_process_now {
    /// The tick in hand.
    pub tick: u64,
    /// Bit i: topic i, in the order of `armplane_process_topic_at`, has a message of this tick.
    pub fresh: u64,
    /// 1 in lockstep, 0 in real time.
    pub lockstep: u32,
    /// Ticks per second of the arm's time; Hz.
    pub rate_hz: u32,
    /// Joints of the arm: the first so many elements of an array of joints.
    pub dof: u32,
    /// How often the process has been started in this run, from 1.
    pub incarnation: u32,
    /// 1: a state that is given for this tick by `armplane_process_keep` is kept.
    pub keeps: u32,
    /// Zero.
    pub reserved: u32,
}

/// A topic of the process.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct armplane_process_topic {
    /// Its name.
    pub name: *const c_char,
    /// The versioned name of its messages' type.
    pub type_name: *const c_char,
    /// The hash of their layout.
    pub layout: u64,
    /// Bytes of a message.
    pub bytes: u64,
    /// 1 of a topic that the process writes, 0 of one that it reads.
    pub is_output: u32,
    /// Zero.
    pub reserved: u32,
}

/// Runs `work` for the process that has joined; a panic, and a forked child, end here.
///
/// # Safety
/// `process` is null, or from `armplane_process_join` and not left.
unsafe fn with<T>(
    process: *mut armplane_process,
    refused: T,
    work: impl FnOnce(&mut armplane_process) -> Result<T, JoinedError>,
) -> T {
    // SAFETY: the caller's.
    let Some(process) = (unsafe { process.as_mut() }) else {
        return refused;
    };
    if process.owner != std::process::id() {
        let why = "a forked process cannot use the run of its parent: join in the process that takes part, or start another program";
        process.fail(why);
        return refused;
    }
    match catch_unwind(AssertUnwindSafe(|| work(process))) {
        Ok(Ok(done)) => done,
        Ok(Err(error)) => {
            process.fail(&error.to_string());
            refused
        }
        Err(_) => {
            process.fail("a defect of armplane: standard error has its place");
            refused
        }
    }
}

impl armplane_process {
    /// Keeps the first reason.
    fn fail(&mut self, why: &str) {
        if !self.has_failed {
            let text: Vec<u8> = why.bytes().filter(|byte| *byte != 0).collect();
            self.error = CString::new(text).unwrap_or_default();
        }
        self.has_failed = true;
    }

    fn new(joined: Joined, dof: u32) -> Self {
        let shell = joined.shell();
        let folder = shell.run_dir().as_os_str().as_encoded_bytes();
        let now = armplane_process_now {
            tick: 0,
            fresh: 0,
            lockstep: u32::from(shell.mode() == Mode::Lockstep),
            rate_hz: shell.manifest().rate_hz,
            dof,
            incarnation: shell.incarnation(),
            keeps: u32::from(joined.keeps()),
            reserved: 0,
        };
        Self {
            now: Box::new(now),
            folder: CString::new(folder).unwrap_or_default(),
            error: CString::default(),
            has_failed: false,
            has_looked: std::rc::Rc::default(),
            owner: std::process::id(),
            topics: Topics::of(&joined),
            joined,
        }
    }
}

/// Joins a run.
///
/// `abi_version`: ARMPLANE_PROCESS_ABI_VERSION. `run`, `name`: the run's directory and the name of the process in its graph; NULL: those of the run that has
/// started this program. `error`: NULL, or room for `error_size` bytes; takes a sentence, empty on success. Returns NULL where the process cannot join.
///
/// # Safety
/// Texts end with a zero byte; `error` is null or has room for `error_size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_join(
    abi_version: u32,
    run: *const c_char,
    name: *const c_char,
    error: *mut c_char,
    error_size: usize,
) -> *mut armplane_process {
    // SAFETY: the caller's.
    let (run, name) = unsafe { (text(run), text(name)) };
    let join = || {
        if abi_version != ARMPLANE_PROCESS_ABI_VERSION {
            return Err(format!(
                "the program was compiled with ABI version {abi_version} of libarmplane-process.h, the library has {ARMPLANE_PROCESS_ABI_VERSION}: compile the program again"
            ));
        }
        let joined = Joined::join(run.map(Path::new), name);
        let joined = joined.map_err(|error| error.to_string())?;
        let dof = joined.shell().job().map_err(|error| error.to_string())?.dof;
        Ok(armplane_process::new(joined, dof))
    };
    let defect = || Err("a defect of armplane: standard error has its place".to_owned());
    let (handle, why) = match catch_unwind(AssertUnwindSafe(join)).unwrap_or_else(|_| defect()) {
        Ok(process) => (Box::into_raw(Box::new(process)), String::new()),
        Err(why) => (std::ptr::null_mut(), why),
    };
    if !error.is_null() && error_size > 0 {
        let end = why.floor_char_boundary(error_size - 1);
        // SAFETY: the caller's.
        unsafe {
            error.copy_from_nonoverlapping(why.as_ptr().cast(), end);
            error.add(end).write(0);
        }
    }
    handle
}

/// The text at a pointer; empty where it is no UTF-8, `None` for null.
///
/// # Safety
/// It is null or points to a text that ends with a zero byte, which nobody changes for `'a`.
unsafe fn text<'a>(at: *const c_char) -> Option<&'a str> {
    // SAFETY: the caller's.
    (!at.is_null()).then(|| unsafe { CStr::from_ptr(at) }.to_str().unwrap_or_default())
}

/// The process and the tick in hand: a place that stays until it leaves. NULL for NULL.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_about(
    process: *const armplane_process,
) -> *const armplane_process_now {
    // SAFETY: the caller's.
    unsafe { process.as_ref() }.map_or(std::ptr::null(), |process| &raw const *process.now)
}

/// A topic of the process, from 0: those that it reads in the order of its graph, then those that it writes. NULL behind the last.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_topic_at(
    process: *const armplane_process,
    index: usize,
) -> *const armplane_process_topic {
    // SAFETY: the caller's.
    let process = unsafe { process.as_ref() };
    let topic = process.and_then(|process| process.topics.described(index));
    topic.map_or(std::ptr::null(), |topic| &raw const *topic)
}

/// The directory of the run: `job.json` (scenario, robot, graph) and `arm.xml` (the arm in MJCF, its start posture as a key) lie there. NULL for NULL.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_folder(
    process: *const armplane_process,
) -> *const c_char {
    // SAFETY: the caller's.
    unsafe { process.as_ref() }.map_or(std::ptr::null(), |process| process.folder.as_ptr())
}

/// Waits for the next tick: ARMPLANE_PROCESS_TICK, ARMPLANE_PROCESS_OK when the run is over for this process, or an error below zero.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_wait(process: *mut armplane_process) -> i32 {
    // SAFETY: the caller's.
    unsafe {
        with(process, ARMPLANE_PROCESS_ERROR, |process| {
            if process.has_failed {
                return Ok(ARMPLANE_PROCESS_ERROR);
            }
            process.has_looked.set(false);
            let tick = match process.joined.wait() {
                Err(_) if process.has_looked.get() => return Ok(ARMPLANE_PROCESS_LOOKED),
                tick => tick?,
            };
            let Some(tick) = tick else {
                return Ok(ARMPLANE_PROCESS_OK);
            };
            (process.now.tick, process.now.fresh) = (tick, topics::fresh(&process.joined));
            process.now.keeps = u32::from(process.joined.keeps());
            Ok(ARMPLANE_PROCESS_TICK)
        })
    }
}

/// The result of `at` for a topic with a layout, of an output or an input; null on an error.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; `topic` ends with a zero byte.
unsafe fn place_of(
    process: *mut armplane_process,
    topic: *const c_char,
    layout: u64,
    is_output: bool,
    at: impl FnOnce(&mut Joined, usize) -> *mut c_void,
) -> *mut c_void {
    // SAFETY: the caller's.
    unsafe {
        let topic = text(topic).unwrap_or_default();
        with(process, std::ptr::null_mut(), |process| {
            let place = topics::find(&process.joined, topic, layout, is_output)?;
            Ok(at(&mut process.joined, place))
        })
    }
}

/// The message of the tick in hand, in shared memory where it was sent: valid until the next wait. NULL where none has come, which is no error, or the
/// process does not read the topic. `layout`: the hash that the program was compiled with, 0 for a topic that only the graph knows.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; `topic` ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_input(
    process: *mut armplane_process,
    topic: *const c_char,
    layout: u64,
) -> *const c_void {
    // SAFETY: the caller's.
    unsafe {
        place_of(process, topic, layout, false, |joined, place| {
            let message = joined.inputs()[place].message();
            message.map_or(std::ptr::null_mut(), |message| {
                message.as_ptr().cast_mut().cast()
            })
        })
    }
}

/// A place that stays, to which every later message of a topic that the process reads is copied; zeros before the first. NULL on an error.
///
/// # Safety
/// As for armplane_process_input.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_copy(
    process: *mut armplane_process,
    topic: *const c_char,
    layout: u64,
) -> *const c_void {
    // SAFETY: the caller's.
    unsafe {
        place_of(process, topic, layout, false, |joined, place| {
            joined.inputs_mut()[place]
                .copied()
                .as_ptr()
                .cast_mut()
                .cast()
        })
    }
}

/// The message of a topic that the process writes: a place that stays, keeps what was sent last, and is private until it is sent. The header is filled in
/// then. NULL on an error.
///
/// # Safety
/// As for armplane_process_input.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_output(
    process: *mut armplane_process,
    topic: *const c_char,
    layout: u64,
) -> *mut c_void {
    // SAFETY: the caller's.
    unsafe {
        place_of(process, topic, layout, true, |joined, place| {
            joined.outputs_mut()[place].place().as_mut_ptr().cast()
        })
    }
}

/// Answers the tick in hand: checks every output, then sends them. `last` other than 0, of the process that makes the ticks: the run ends with this tick.
/// ARMPLANE_PROCESS_OK, or an error, and nothing has been sent.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_send(process: *mut armplane_process, last: i32) -> i32 {
    // SAFETY: the caller's.
    unsafe {
        with(process, ARMPLANE_PROCESS_ERROR, |process| {
            if process.has_failed {
                return Ok(ARMPLANE_PROCESS_ERROR);
            }
            process.joined.send(last != 0)?;
            Ok(ARMPLANE_PROCESS_OK)
        })
    }
}

/// Gives the state after the tick in hand, before it is sent: a replacement of this process finds the bytes by armplane_process_previous.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; there are `size` bytes at `state`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_keep(
    process: *mut armplane_process,
    state: *const c_void,
    size: usize,
) -> i32 {
    if state.is_null() && size > 0 {
        return ARMPLANE_PROCESS_ERROR;
    }
    // SAFETY: the caller's.
    unsafe {
        let state: &[u8] = match size {
            0 => &[],
            _ => std::slice::from_raw_parts(state.cast(), size),
        };
        with(process, ARMPLANE_PROCESS_ERROR, |process| {
            process.joined.keep(state);
            Ok(ARMPLANE_PROCESS_OK)
        })
    }
}

/// The state that a predecessor of this process has left, and its size; NULL without one. Valid until the process leaves.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; `size` is null or takes a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_previous(
    process: *const armplane_process,
    size: *mut usize,
) -> *const c_void {
    // SAFETY: the caller's.
    let state = unsafe { process.as_ref() }.and_then(|process| process.joined.previous());
    if !size.is_null() {
        // SAFETY: the caller's.
        unsafe { size.write(state.map_or(0, <[u8]>::len)) };
    }
    state.map_or(std::ptr::null(), |state| state.as_ptr().cast())
}

/// Has `look` called with `argument` at least every 25 ms of every wait from now on, on the waiting thread. Where it returns other than 0, the wait ends with
/// ARMPLANE_PROCESS_LOOKED.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; `look` can be called until it leaves.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_look_out(
    process: *mut armplane_process,
    look: extern "C" fn(*mut c_void) -> i32,
    argument: *mut c_void,
) {
    // SAFETY: the caller's.
    unsafe {
        with(process, (), |process| {
            let has_looked = std::rc::Rc::clone(&process.has_looked);
            process.joined.look_out(move || {
                has_looked.set(look(argument) != 0);
                !has_looked.get()
            });
            Ok(())
        });
    }
}

/// Says why the program cannot go on; always ARMPLANE_PROCESS_ERROR.
///
/// # Safety
/// `process` is null or from `armplane_process_join`; `why` is null or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_fail(
    process: *mut armplane_process,
    why: *const c_char,
) -> i32 {
    // SAFETY: the caller's.
    unsafe {
        let why = text(why).unwrap_or_default();
        with(process, (), |process| {
            let (name, tick) = (process.joined.shell().name(), process.now.tick);
            let why = format!("the program of {name} cannot continue at tick {tick}: {why}");
            process.fail(&why);
            Ok(())
        });
    }
    ARMPLANE_PROCESS_ERROR
}

/// Why the process cannot go on; empty where it can. Valid until the next call. NULL for NULL.
///
/// # Safety
/// `process` is null or from `armplane_process_join`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_error(process: *const armplane_process) -> *const c_char {
    // SAFETY: the caller's.
    unsafe { process.as_ref() }.map_or(std::ptr::null(), |process| process.error.as_ptr())
}

/// Leaves the run and frees the process. Prints why it could not go on, if it could not. Returns the exit code of the program, 0 or 1.
///
/// # Safety
/// `process` is null, or from `armplane_process_join` and not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_process_leave(process: *mut armplane_process) -> i32 {
    if process.is_null() {
        return 1;
    }
    // SAFETY: the caller's.
    let process = unsafe { Box::from_raw(process) };
    if process.has_failed {
        runtime::complain(&format_args!(
            "armplane: {}",
            process.error.to_string_lossy()
        ));
    }
    let code = i32::from(process.has_failed);
    if process.owner != std::process::id() {
        // Its parent's memory must not be removed.
        std::mem::forget(process);
        return code;
    }
    let armplane_process { joined, error, .. } = *process;
    let _ = catch_unwind(AssertUnwindSafe(|| joined.leave(&error.to_string_lossy())));
    code
}
