//! `libarmplane`: the crate `arm` for C and C++. `services/capi/header` makes `include/libarmplane.h` of this file.
//!
//! Nothing but `*_create_*` allocates. A panic becomes [`ARMPLANE_ERROR_PANIC`](armplane_status), and no number that is not finite gets out.
#![allow(non_camel_case_types, non_snake_case)]

mod memory;

use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use arm::{Analysis, Arm, Given, Reason, Row, Task, is_finite};
use shared_types::job::RobotText;
use shared_types::{SingularityReport, codes};

use armplane_status::*;
use memory::{numbers, put, text, whole};

/// Version of this header. `create` refuses a program that was compiled with another one.
pub const ARMPLANE_ABI_VERSION: u32 = 1;
/// Most joints of an arm.
pub const ARMPLANE_JOINTS_MAX: usize = 8;
/// Most singularities that are reported at a posture.
pub const ARMPLANE_SINGULARITIES_MAX: usize = 4;

const _: () = assert!(
    ARMPLANE_JOINTS_MAX == shared_types::MAX_DOF
        && ARMPLANE_SINGULARITIES_MAX == shared_types::MAX_SINGULARITIES
);

/// Result of a call. Below zero it is an error, and nothing is written but the error text of `create`.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum armplane_status {
    /// Done.
    ARMPLANE_OK = 0,
    /// The law has given up: its torque brings the arm to rest until `armplane_law_reset`. `armplane_law_get_state` says why.
    ARMPLANE_REFUSED = 1,
    /// The law has not been given a posture within the arm's limits yet: its torque is zero.
    ARMPLANE_NOT_BEGUN = 2,
    /// A pointer is null that must not be.
    ARMPLANE_ERROR_NULL = -1,
    /// The program was compiled with the header of another ABI version.
    ARMPLANE_ERROR_VERSION = -2,
    /// An argument is wrong; of `create`, the error text says which.
    ARMPLANE_ERROR_ARGUMENT = -3,
    /// An argument, or the result, has a NaN or an infinity.
    ARMPLANE_ERROR_NOT_FINITE = -4,
    /// A defect of armplane. Destroy this handle; every further step of a law returns the same.
    ARMPLANE_ERROR_PANIC = -5,
}

/// A serial arm, seen at one of its links, the end-effector E. One thread at a time may use it.
pub struct armplane_arm {
    arm: Arm,
    analysis: Analysis,
    report: SingularityReport,
}

/// The control law of one arm, with its memory. One thread at a time may use it.
pub struct armplane_law {
    task: Task,
    row: Row,
    /// Whether a step has been left by a panic.
    is_broken: bool,
}

/// A joint. Units of a sliding joint: m and N in place of rad and N·m.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct armplane_joint {
    /// Its name, UTF-8, cut to 63 bytes.
    pub name: [c_char; 64],
    /// Lower position limit, rad; -INFINITY where there is none.
    pub lower: f64,
    /// Upper position limit, rad; INFINITY where there is none.
    pub upper: f64,
    /// Speed limit, rad/s.
    pub velocity: f64,
    /// Torque limit, N·m.
    pub effort: f64,
    /// Largest rate of the torque, N·m/s.
    pub torque_rate: f64,
}

/// An arm of n joints at a posture. B is the base. Rows of twists are [linear; angular] in the axes of B. Matrices lie row by row in the first places of
/// their arrays, with n columns.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct armplane_posture {
    /// Homogeneous matrix of E in B, 4 x 4, m.
    pub pose: [f64; 16],
    /// Jacobian at E, 6 x n, m/rad and rad/rad.
    pub jacobian: [f64; 48],
    /// Mass matrix with the inertia of the drives, n x n, kg·m².
    pub mass: [f64; 64],
    /// Coriolis and gravity torques, n, N·m.
    pub bias: [f64; ARMPLANE_JOINTS_MAX],
    /// Gravity torques, n, N·m.
    pub gravity: [f64; ARMPLANE_JOINTS_MAX],
}

/// A singularity of an arm, at one posture.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct armplane_singularity {
    /// elbow, wrist, overhead, shoulder; s1 to s4 where it is found by number.
    pub name: [c_char; 16],
    /// "type 1": motion in the null space moves the hand along the singular direction. "type 2": it only turns that direction. "mixed", "unknown".
    pub r#type: [c_char; 16],
    /// Signed and without unit; 0 at the singularity.
    pub measure: f64,
    /// Singular direction in the axes of B: a unit vector, [linear; angular].
    pub direction: [f64; 6],
    /// |measure| below which its neighbourhood is entered.
    pub entry: f64,
    /// |measure| above which the neighbourhood is left.
    pub exit: f64,
    /// Whether the posture is in the neighbourhood.
    pub inside: bool,
}

/// The law at one singularity.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct armplane_law_mode {
    /// The singularity's name, as in armplane_singularity.
    pub name: [c_char; 16],
    /// regular, blend, track, pass, hold, reorient, slide, recover.
    pub mode: [c_char; 16],
    /// Share of the operational-space command along the singular direction, 0 to 1.
    pub beta: f64,
}

/// The law's answer to the last step.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct armplane_law_state {
    /// Steps since the law began.
    pub tick: u64,
    /// How the arm follows what it was given, or why it does not, in words.
    pub reason: [c_char; 256],
    /// Why the last pose or twist that was refused was so; empty where none was. For 0.1 s the one before it stays in force.
    pub target_refusal: [c_char; 96],
    /// Poses and twists refused since the law began.
    pub targets_refused: u32,
    /// Number of modes.
    pub mode_count: u32,
    /// In the order of armplane_arm_singularities.
    pub modes: [armplane_law_mode; ARMPLANE_SINGULARITIES_MAX],
    /// Share of the twist asked for that the arm moves with, 0 to 1.
    pub speed_scale: f64,
    /// Whether the law has given up.
    pub refused: bool,
}

/// Runs `work`; a panic ends here.
fn guarded(work: impl FnOnce() -> Result<armplane_status, armplane_status>) -> armplane_status {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(status) | Err(status)) => status,
        Err(_) => ARMPLANE_ERROR_PANIC,
    }
}

/// Makes a handle; the reason for which there is none goes into `error`.
///
/// # Safety
/// `out` is null or takes a pointer; `error` is null or has room for `error_size` bytes.
unsafe fn create<T>(
    abi_version: u32,
    out: *mut *mut T,
    (error, error_size): (*mut c_char, usize),
    make: impl FnOnce() -> Result<T, String>,
) -> armplane_status {
    let made = catch_unwind(AssertUnwindSafe(|| {
        if out.is_null() {
            return Err((ARMPLANE_ERROR_NULL, "out is null".to_owned()));
        }
        if abi_version != ARMPLANE_ABI_VERSION {
            let why = format!(
                "the program was compiled with ABI version {abi_version} of libarmplane.h, the library has {ARMPLANE_ABI_VERSION}: compile the program again"
            );
            return Err((ARMPLANE_ERROR_VERSION, why));
        }
        make().map_err(|why| (ARMPLANE_ERROR_ARGUMENT, why))
    }));
    let defect = "a defect of armplane: standard error has its place".to_owned();
    let made = made.unwrap_or(Err((ARMPLANE_ERROR_PANIC, defect)));
    let (handle, status, why) = match made {
        Ok(made) => (Box::into_raw(Box::new(made)), ARMPLANE_OK, String::new()),
        Err((status, why)) => (std::ptr::null_mut(), status, why),
    };
    // SAFETY: the caller's.
    unsafe {
        if !out.is_null() {
            out.write(handle);
        }
        if let Some(error) = whole(error.cast(), error_size) {
            put(error, why);
        }
    }
    status
}

/// A handle of an arm.
fn handle(arm: Arm) -> armplane_arm {
    armplane_arm {
        analysis: arm.analysis(),
        report: SingularityReport::default(),
        arm,
    }
}

/// The version of the ABI that the library has: compare it with ARMPLANE_ABI_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn armplane_abi_version() -> u32 {
    ARMPLANE_ABI_VERSION
}

/// The version of the library, such as "0.1.0": compare it with ARMPLANE_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn armplane_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Makes the arm of a URDF file. `python -m armplane.mjcf ARM.xml` makes one of MJCF.
///
/// `abi_version`: ARMPLANE_ABI_VERSION. `tip`: the link that is E; NULL: the last one. `description`: a TOML file with what
/// the format has no element for (inertia of drives, friction, torque rates, speed limits); NULL: the file of the same name beside it, if there is one.
/// `error`: NULL, or room for `error_size` bytes; takes a sentence, cut where it is longer, empty on success. 512 bytes are enough for most.
///
/// # Safety
/// Texts end with a zero byte; `out` and `error` as above.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_create_from_file(
    abi_version: u32,
    path: *const c_char,
    tip: *const c_char,
    description: *const c_char,
    out: *mut *mut armplane_arm,
    error: *mut c_char,
    error_size: usize,
) -> armplane_status {
    // SAFETY: the caller's.
    unsafe {
        create(abi_version, out, (error, error_size), || {
            let path = text("path", path)?.ok_or("path is null")?;
            let description = text("description", description)?;
            let tip = text("tip", tip)?;
            let arm = Arm::read(Path::new(path), description.map(Path::new), tip);
            arm.map(handle).map_err(|error| error.to_string())
        })
    }
}

/// Makes the arm of a URDF text. `name`: what it is called; `description`: the text of a description, or NULL. The rest is as for
/// armplane_arm_create_from_file.
///
/// # Safety
/// Texts end with a zero byte; `out` and `error` as above.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_create_from_text(
    abi_version: u32,
    name: *const c_char,
    xml: *const c_char,
    tip: *const c_char,
    description: *const c_char,
    out: *mut *mut armplane_arm,
    error: *mut c_char,
    error_size: usize,
) -> armplane_status {
    // SAFETY: the caller's.
    unsafe {
        create(abi_version, out, (error, error_size), || {
            let source = RobotText {
                name: text("name", name)?.ok_or("name is null")?.to_owned(),
                urdf: text("xml", xml)?.ok_or("xml is null")?.to_owned(),
                description: text("description", description)?
                    .unwrap_or_default()
                    .to_owned(),
                ..RobotText::default()
            };
            let arm = Arm::parse(&source, text("tip", tip)?);
            arm.map(handle).map_err(|error| error.to_string())
        })
    }
}

/// Makes a built-in arm: puma560, ur5, ur10, iiwa14, panda, fr3, xarm7, gen3; the error text lists all. `tip` NULL: its own end-effector. The rest is as
/// for armplane_arm_create_from_file.
///
/// # Safety
/// Texts end with a zero byte; `out` and `error` as above.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_create_builtin(
    abi_version: u32,
    name: *const c_char,
    tip: *const c_char,
    out: *mut *mut armplane_arm,
    error: *mut c_char,
    error_size: usize,
) -> armplane_status {
    // SAFETY: the caller's.
    unsafe {
        create(abi_version, out, (error, error_size), || {
            let name = text("name", name)?.ok_or("name is null")?;
            let arm = Arm::builtin(name, text("tip", tip)?);
            arm.map(handle).map_err(|error| error.to_string())
        })
    }
}

/// Frees an arm; its laws live on. NULL: nothing.
///
/// # Safety
/// `arm` comes from `create` and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_destroy(arm: *mut armplane_arm) {
    // SAFETY: the caller's.
    unsafe { destroy(arm) }
}

/// # Safety
/// `handle` is null, or from `create` and not used again.
unsafe fn destroy<T>(handle: *mut T) {
    if !handle.is_null() {
        guarded(|| {
            // SAFETY: the caller's.
            drop(unsafe { Box::from_raw(handle) });
            Ok(ARMPLANE_OK)
        });
    }
}

/// Number of joints n, 1 to ARMPLANE_JOINTS_MAX; 0 for NULL.
///
/// # Safety
/// `arm` is null or from `create`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_joint_count(arm: *const armplane_arm) -> usize {
    // SAFETY: the caller's.
    unsafe { arm.as_ref() }.map_or(0, |arm| arm.arm.robot().dof())
}

/// A joint by its place, 0 to n - 1, counted from the base.
///
/// # Safety
/// `arm` is null or from `create`, `out` null or a joint.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_joint(
    arm: *const armplane_arm,
    place: usize,
    out: *mut armplane_joint,
) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let arm = unsafe { arm.as_ref() }.ok_or(ARMPLANE_ERROR_NULL)?;
        let joint = arm.arm.robot().joints.get(place);
        let joint = joint.ok_or(ARMPLANE_ERROR_ARGUMENT)?;
        let found = armplane_joint {
            name: memory::words(&joint.name),
            lower: joint.lower,
            upper: joint.upper,
            velocity: joint.velocity,
            effort: joint.effort,
            torque_rate: joint.torque_rate,
        };
        // SAFETY: the caller's.
        unsafe { memory::give(out, found) }
    })
}

/// Pose, Jacobian, mass matrix and torques at `q`, n values, rad, and `qdot`, n values, rad/s; NULL: at rest.
///
/// # Safety
/// `arm` is null or from `create`, `q` and `qdot` null or n numbers, `out` null or a posture.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_at(
    arm: *const armplane_arm,
    q: *const f64,
    qdot: *const f64,
    out: *mut armplane_posture,
) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let arm = &unsafe { arm.as_ref() }.ok_or(ARMPLANE_ERROR_NULL)?.arm;
        let n = arm.robot().dof();
        // SAFETY: the caller's.
        let (q, qdot) = unsafe { (numbers(q, n), numbers(qdot, n)) };
        let q = q.ok_or(ARMPLANE_ERROR_NULL)?;
        let at = arm.at(q, qdot.unwrap_or(&[0.0; ARMPLANE_JOINTS_MAX][..n]));
        let parts = [&at.pose[..], &at.J, &at.A, &at.bias, &at.gravity];
        let given = [q, qdot.unwrap_or_default()];
        if !given.into_iter().chain(parts).all(is_finite) {
            return Err(ARMPLANE_ERROR_NOT_FINITE);
        }
        let found = armplane_posture {
            pose: at.pose,
            jacobian: at.J,
            mass: at.A,
            bias: at.bias,
            gravity: at.gravity,
        };
        // SAFETY: the caller's.
        unsafe { memory::give(out, found) }
    })
}

/// The singularities at `q`, n values, rad: `count` of them, in the first places of `out`, which has ARMPLANE_SINGULARITIES_MAX.
///
/// # Safety
/// `arm` is null or from `create`, `q` null or n numbers, `out` null or with room for ARMPLANE_SINGULARITIES_MAX, `count` null or a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_arm_singularities(
    arm: *mut armplane_arm,
    q: *const f64,
    out: *mut armplane_singularity,
    count: *mut usize,
) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let arm = unsafe { arm.as_mut() }.ok_or(ARMPLANE_ERROR_NULL)?;
        // SAFETY: the caller's.
        let q = unsafe { numbers(q, arm.arm.robot().dof()) }.ok_or(ARMPLANE_ERROR_NULL)?;
        // SAFETY: the caller's; every bit pattern that C leaves there is written before it is read.
        let out = unsafe { memory::room(out, ARMPLANE_SINGULARITIES_MAX) };
        let out = out.ok_or(ARMPLANE_ERROR_NULL)?;
        arm.analysis.at(q, &mut arm.report);
        let listed = arm.report.listed();
        let all_finite =
            |one: &shared_types::SingularityState| one.s.is_finite() && is_finite(&one.zeta_B);
        if !is_finite(q) || !listed.iter().all(all_finite) {
            return Err(ARMPLANE_ERROR_NOT_FINITE);
        }
        // SAFETY: the caller's.
        unsafe { memory::give(count, listed.len()) }?;
        for (place, (one, out)) in listed.iter().zip(out).enumerate() {
            out.write(armplane_singularity {
                name: memory::words(codes::singularity_name(one.kind, place)),
                r#type: memory::words(codes::name_of(codes::TYPES, one.class)),
                measure: one.s,
                direction: one.zeta_B,
                entry: one.eta_in,
                exit: one.eta_out,
                inside: one.inside != 0,
            });
        }
        Ok(ARMPLANE_OK)
    })
}

/// Makes the law of an arm, which is not needed any more afterwards.
///
/// `dt`: time between two steps, s, 1/dt a whole number from 50 to 20000. `q`: the posture in which it begins at rest and to which spare joints are drawn,
/// n values, rad; NULL: that of the first step. `settings`: NULL, or keys of a scenario, one a line, such as "control.k_p=900\nservo.speed_m_s=0.2". The rest
/// is as for armplane_arm_create_from_file.
///
/// # Safety
/// `arm` is null or from `create`, `q` null or n numbers, `settings` null or a text; `out` and `error` as above.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_law_create(
    abi_version: u32,
    arm: *const armplane_arm,
    dt: f64,
    q: *const f64,
    settings: *const c_char,
    out: *mut *mut armplane_law,
    error: *mut c_char,
    error_size: usize,
) -> armplane_status {
    // SAFETY: the caller's.
    unsafe {
        create(abi_version, out, (error, error_size), || {
            let arm = &arm.as_ref().ok_or("arm is null")?.arm;
            let q = numbers(q, arm.robot().dof());
            let settings = text("settings", settings)?.unwrap_or_default().lines();
            let settings = settings.map(str::trim).filter(|line| !line.is_empty());
            let settings = settings.map(str::to_owned).collect();
            let task = Task::new(arm, dt, q, settings).map_err(|error| error.to_string())?;
            Ok(armplane_law {
                row: Row::new(&task),
                task,
                is_broken: false,
            })
        })
    }
}

/// Frees a law. NULL: nothing.
///
/// # Safety
/// `law` comes from `create` and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_law_destroy(law: *mut armplane_law) {
    // SAFETY: the caller's.
    unsafe { destroy(law) }
}

/// One step: the torque `tau`, n values, N·m, within the arm's torque limits and torque rates.
///
/// `q`: n values, rad. `qdot`: n values, rad/s. `pose`: of E in B, 7 values x y z qw qx qy qz, m, the quaternion of norm 1; or NULL. `twist`: with which the
/// pose moves on, or alone what is asked for, 6 values [linear; angular] in the axes of B, m/s and rad/s; or NULL. With neither the arm comes to rest.
/// `tau_disturbance`: torque on the joints that the model does not explain, n values, N·m; NULL: none.
///
/// A state that is not finite, or moves as no arm can, brings the arm to rest: ARMPLANE_REFUSED. A pose or twist that is not finite is left out, and
/// counted in the state. Each returns with a torque that can be sent; after an error (below zero) keep the one before, and stop the arm.
///
/// # Safety
/// `law` is null or from `create`; the others are null or have as many numbers as said. `tau` may be the place of another argument.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_law_step(
    law: *mut armplane_law,
    q: *const f64,
    qdot: *const f64,
    pose: *const f64,
    twist: *const f64,
    tau_disturbance: *const f64,
    tau: *mut f64,
) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let law = unsafe { law.as_mut() }.ok_or(ARMPLANE_ERROR_NULL)?;
        let n = law.task.robot().dof();
        if q.is_null() || qdot.is_null() || tau.is_null() {
            return Err(ARMPLANE_ERROR_NULL);
        }
        if std::mem::replace(&mut law.is_broken, true) {
            return Err(ARMPLANE_ERROR_PANIC);
        }
        // SAFETY: the caller's.
        let given = unsafe {
            let joints = |values| numbers(values, n);
            let (pose, twist) = (numbers(pose, 7), numbers(twist, 6));
            [
                joints(q),
                joints(qdot),
                pose,
                twist,
                joints(tau_disturbance),
            ]
        };
        law.row.step(&law.task, Given(given));
        law.is_broken = false;
        let torque = law.row.tau(&law.task);
        if !is_finite(torque) {
            return Err(ARMPLANE_ERROR_NOT_FINITE);
        }
        // SAFETY: the caller's; the arguments are read no more.
        unsafe { std::ptr::copy_nonoverlapping(torque.as_ptr(), tau, n) };
        Ok(match law.row.refusal(&law.task) {
            None => ARMPLANE_OK,
            Some(Reason::NotBegun { .. }) => ARMPLANE_NOT_BEGUN,
            Some(_) => ARMPLANE_REFUSED,
        })
    })
}

/// Forgets everything: the next step begins anew.
///
/// # Safety
/// `law` is null or from `create`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_law_reset(law: *mut armplane_law) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let law = unsafe { law.as_mut() }.ok_or(ARMPLANE_ERROR_NULL)?;
        law.row.reset();
        Ok(ARMPLANE_OK)
    })
}

/// The law's answer to the last step, and the reason for it.
///
/// # Safety
/// `law` is null or from `create`, `out` null or a state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armplane_law_get_state(
    law: *const armplane_law,
    out: *mut armplane_law_state,
) -> armplane_status {
    guarded(|| {
        // SAFETY: the caller's.
        let law = unsafe { law.as_ref() }.ok_or(ARMPLANE_ERROR_NULL)?;
        let state = law.row.state(&law.task);
        let mode = |place: usize| {
            let (name, mode, beta) = state.singularities[place].unwrap_or(("", "", 0.0));
            armplane_law_mode {
                name: memory::words(name),
                mode: memory::words(mode),
                beta,
            }
        };
        let found = armplane_law_state {
            tick: state.tick,
            reason: memory::words(state.reason),
            target_refusal: memory::words(state.target_refusal),
            targets_refused: state.targets_refused,
            mode_count: state.singularities.iter().flatten().count() as u32,
            modes: std::array::from_fn(mode),
            speed_scale: state.speed_scale,
            refused: state.refusal.is_some(),
        };
        // SAFETY: the caller's.
        unsafe { memory::give(out, found) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_ends_at_the_border() {
        assert_eq!(guarded(|| panic!("step")), ARMPLANE_ERROR_PANIC);
        let (mut made, mut why) = (std::ptr::dangling_mut::<u8>(), [0; 64]);
        let error = (why.as_mut_ptr(), why.len());
        // SAFETY: room for a pointer and 64 bytes.
        let status = unsafe { create(ARMPLANE_ABI_VERSION, &mut made, error, || panic!("create")) };
        assert_eq!((status, made.is_null()), (ARMPLANE_ERROR_PANIC, true));
        assert!(why[0] != 0 && why[63] == 0);
    }
}
