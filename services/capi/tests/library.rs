//! The library as C sees it: no input makes it panic, allocate or give a number that is not finite.

#[path = "../../../tests/counting.rs"]
mod counting;

use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

use armplane::armplane_status::*;
use armplane::*;

use counting::ALLOCATIONS;
use shared_types::random::Uniform;

const N: usize = ARMPLANE_JOINTS_MAX;
const ABI: u32 = ARMPLANE_ABI_VERSION;

/// The error text of a `create`.
type Why = [c_char; 512];

fn said(why: &Why) -> String {
    // SAFETY: `create` has ended it with a zero byte.
    let text = unsafe { CStr::from_ptr(why.as_ptr()) };
    text.to_str().expect("UTF-8").to_owned()
}

fn arm(name: &str) -> *mut armplane_arm {
    let (name, mut arm, mut why) = (CString::new(name).unwrap(), null_mut(), [1; 512]);
    // SAFETY: a text, and room for the answers.
    let status = unsafe {
        let why: &mut Why = &mut why;
        let (at, size) = (why.as_mut_ptr(), why.len());
        armplane_arm_create_builtin(ABI, name.as_ptr(), null(), &mut arm, at, size)
    };
    assert_eq!((status, said(&why).as_str()), (ARMPLANE_OK, ""));
    arm
}

fn law(arm: *const armplane_arm, settings: *const c_char) -> Result<*mut armplane_law, String> {
    let (mut law, mut why) = (null_mut(), [1; 512]);
    // SAFETY: an arm, and room for the answers.
    let status = unsafe {
        let (at, size) = (why.as_mut_ptr(), why.len());
        armplane_law_create(ABI, arm, 0.001, null(), settings, &mut law, at, size)
    };
    assert_eq!(
        (status == ARMPLANE_OK, law.is_null()),
        (!law.is_null(), status != ARMPLANE_OK)
    );
    (status == ARMPLANE_OK).then_some(law).ok_or(said(&why))
}

/// A number within ±1; in one of `odds` cases one that no sensor should give.
fn hostile(random: &mut Uniform, odds: f64) -> f64 {
    const BAD: [f64; 8] = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        1e300,
        f64::MIN_POSITIVE,
        1e9,
    ];
    if random.within(0.0, odds) < 1.0 {
        BAD[random.within(0.0, 8.0) as usize]
    } else {
        random.within(-1.0, 1.0)
    }
}

#[test]
fn no_input_makes_it_panic_allocate_or_give_a_number_that_is_not_finite() {
    let mut random = Uniform(7);
    for (name, numeric) in [
        ("puma560", false),
        ("ur5", true),
        ("iiwa14", false),
        ("panda", true),
    ] {
        let arm = arm(name);
        let settings = if numeric {
            c"analysis.numeric=true".as_ptr()
        } else {
            null()
        };
        let law = law(arm, settings).expect("a law");
        // SAFETY: handles from `create`, and arrays that are large enough.
        unsafe {
            let n = armplane_arm_joint_count(arm);
            let mut limits = [0.0; N];
            let mut middle = [0.0; N];
            for (place, limit) in limits.iter_mut().enumerate().take(n) {
                let mut joint = MaybeUninit::uninit();
                assert_eq!(
                    armplane_arm_joint(arm, place, joint.as_mut_ptr()),
                    ARMPLANE_OK
                );
                let joint: armplane_joint = joint.assume_init();
                *limit = joint.effort;
                middle[place] = 0.5 * (joint.lower.max(-6.0) + joint.upper.min(6.0));
            }
            let mut met = [0; 3];
            let before = ALLOCATIONS.get();
            for round in 0..25_000 {
                // Arms that stand and follow, among states of any kind.
                let odds = [1e5, 300.0, 4.0][round / 50 % 3];
                let mut any = |size: f64| -> [f64; N] {
                    std::array::from_fn(|_| size * hostile(&mut random, odds))
                };
                let (off, qdot, pose, twist, torque) =
                    (any(1e-4), any(1e-3), any(0.7), any(0.3), any(3.0));
                let q: [f64; N] = std::array::from_fn(|i| middle[i] + off[i]);
                if round % 50 == 0 {
                    assert_eq!(armplane_law_reset(law), ARMPLANE_OK);
                }
                let or_null =
                    |values: &[f64; N], is_given| if is_given { values.as_ptr() } else { null() };
                let [p, t, d] = [3, 5, 7].map(|every| round % every > 0);
                let mut tau = [f64::NAN; N];
                let status = armplane_law_step(
                    law,
                    q.as_ptr(),
                    qdot.as_ptr(),
                    or_null(&pose, p),
                    or_null(&twist, t),
                    or_null(&torque, d),
                    tau.as_mut_ptr(),
                );
                assert!(status as i32 >= 0, "{name} {round}: {status:?}");
                met[status as usize] += 1;
                let within = |i: usize| tau[i].abs() <= limits[i] * (1.0 + 1e-9);
                assert!((0..n).all(within), "{name} {round}: {tau:?}");
                let mut state = MaybeUninit::uninit();
                assert_eq!(armplane_law_get_state(law, state.as_mut_ptr()), ARMPLANE_OK);
                let state = state.assume_init();
                let listed = &state.modes[..state.mode_count as usize];
                assert!(state.reason[0] != 0 && state.speed_scale.is_finite());
                assert!(
                    listed
                        .iter()
                        .all(|one| one.beta.is_finite() && one.name[0] != 0)
                );
                check_posture(arm, &q, &qdot, n);
            }
            let allocations = ALLOCATIONS.get() - before;
            assert!(
                allocations == 0 && met.iter().all(|count| *count > 100),
                "{name}: {allocations} allocations, {met:?}"
            );
            armplane_law_destroy(law);
            armplane_arm_destroy(arm);
        }
    }
}

/// Kinematics and singularities of a state are finite, or refused where it is not.
///
/// # Safety
/// `arm` comes from `create` and has n joints.
unsafe fn check_posture(arm: *mut armplane_arm, q: &[f64; N], qdot: &[f64; N], n: usize) {
    let (mut at, mut found, mut count) = (
        MaybeUninit::uninit(),
        [const { MaybeUninit::uninit() }; ARMPLANE_SINGULARITIES_MAX],
        usize::MAX,
    );
    let is_finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
    // SAFETY: the caller's, and room for the answers.
    let (status, other) = unsafe {
        (
            armplane_arm_at(arm, q.as_ptr(), qdot.as_ptr(), at.as_mut_ptr()),
            armplane_arm_singularities(arm, q.as_ptr(), found.as_mut_ptr().cast(), &mut count),
        )
    };
    if status == ARMPLANE_OK {
        // SAFETY: written.
        let at: armplane_posture = unsafe { at.assume_init() };
        assert!(
            [&at.pose[..], &at.jacobian, &at.mass, &at.bias, &at.gravity]
                .into_iter()
                .all(is_finite)
        );
    } else {
        assert_eq!(status, ARMPLANE_ERROR_NOT_FINITE);
        assert!(
            !is_finite(&q[..n])
                || !is_finite(&qdot[..n])
                || q.iter().chain(qdot).any(|x| x.abs() > 1e100)
        );
    }
    if other == ARMPLANE_OK {
        for one in &found[..count] {
            // SAFETY: written.
            let one: armplane_singularity = unsafe { one.assume_init() };
            assert!(
                one.measure.is_finite()
                    && is_finite(&one.direction)
                    && one.name[0] != 0
                    && one.r#type[0] != 0
            );
        }
    } else {
        assert_eq!((other, count), (ARMPLANE_ERROR_NOT_FINITE, usize::MAX));
    }
}

#[test]
fn a_null_pointer_is_an_error_and_the_wrong_argument_is_named() {
    let arm = arm("ur5");
    let law = law(arm, null()).expect("a law");
    let (mut x, mut why) = ([0.1; 64], [1; 512]);
    let (p, text, size) = (x.as_mut_ptr(), why.as_mut_ptr(), why.len());
    // SAFETY: handles from `create`, large arrays, and null.
    unsafe {
        let (none, no_arm, no_law) = (null(), null_mut(), null_mut());
        let statuses = [
            armplane_law_step(no_law, p, p, none, none, none, p),
            armplane_law_step(law, none, p, none, none, none, p),
            armplane_law_step(law, p, none, none, none, none, p),
            armplane_law_step(law, p, p, none, none, none, null_mut()),
            armplane_law_reset(no_law),
            armplane_law_get_state(no_law, null_mut()),
            armplane_law_get_state(law, null_mut()),
            armplane_arm_at(no_arm, p, p, null_mut()),
            armplane_arm_at(arm, none, p, null_mut()),
            armplane_arm_at(arm, p, none, null_mut()),
            armplane_arm_joint(no_arm, 0, null_mut()),
            armplane_arm_joint(arm, 0, null_mut()),
            armplane_arm_singularities(no_arm, p, null_mut(), null_mut()),
            armplane_arm_singularities(arm, none, null_mut(), null_mut()),
            armplane_arm_singularities(arm, p, null_mut(), null_mut()),
            armplane_arm_create_builtin(ABI, c"ur5".as_ptr(), null(), null_mut(), null_mut(), 0),
            armplane_law_create(ABI, arm, 0.001, none, null(), null_mut(), text, size),
        ];
        assert!(
            statuses.iter().all(|status| *status == ARMPLANE_ERROR_NULL),
            "{statuses:?}"
        );
        assert_eq!(armplane_arm_joint_count(null()), 0);
        assert_eq!(
            armplane_arm_joint(arm, 6, null_mut()),
            ARMPLANE_ERROR_ARGUMENT
        );
        armplane_arm_destroy(null_mut());
        armplane_law_destroy(null_mut());
        let mut made = arm;
        let status =
            armplane_arm_create_builtin(ABI + 1, c"ur5".as_ptr(), null(), &mut made, text, size);
        assert_eq!((status, made), (ARMPLANE_ERROR_VERSION, null_mut()));
        let file = |path: &CStr, text, size| {
            armplane_arm_create_from_file(
                ABI,
                path.as_ptr(),
                null(),
                null(),
                &mut null_mut(),
                text,
                size,
            )
        };
        assert_eq!(file(c"no.urdf", text, size), ARMPLANE_ERROR_ARGUMENT);
        assert!(said(&why).contains("no.urdf"), "{}", said(&why));
        // A short buffer is not written beyond its end.
        why.fill(1);
        assert_eq!(file(c"no.urdf", text, 5), ARMPLANE_ERROR_ARGUMENT);
        assert!(why[4] == 0 && why[5..].iter().all(|byte| *byte == 1));
        armplane_law_destroy(law);
    }
    for (settings, names) in [
        (c"control.kp=1", ["kp", "k_p"]),
        (c"\xff", ["settings", "UTF-8"]),
    ] {
        let why = self::law(arm, settings.as_ptr()).expect_err("no law");
        assert!(names.iter().all(|name| why.contains(name)), "{why}");
    }
    // SAFETY: from `create`.
    unsafe { armplane_arm_destroy(arm) };
}

#[test]
fn a_law_that_is_reset_gives_the_bits_of_a_new_one() {
    let arm = arm("panda");
    let torques = |law: *mut armplane_law| -> Vec<[f64; N]> {
        let mut random = Uniform(3);
        let steps = (0..400).map(|_| {
            let (mut tau, q) = ([0.0; N], [0.1, -0.8, 0.0, -2.3, 0.0, 1.5, 0.8, 0.0]);
            let twist: [f64; N] = std::array::from_fn(|_| random.within(-0.2, 0.2));
            let zero = [0.0; N];
            // SAFETY: handles from `create`, and arrays that are large enough.
            unsafe {
                let status = armplane_law_step(
                    law,
                    q.as_ptr(),
                    zero.as_ptr(),
                    null(),
                    twist.as_ptr(),
                    null(),
                    tau.as_mut_ptr(),
                );
                assert_eq!(status, ARMPLANE_OK);
            }
            tau
        });
        steps.collect()
    };
    let law = law(arm, null()).expect("a law");
    let first = torques(law);
    // SAFETY: from `create`.
    unsafe { armplane_law_reset(law) };
    assert!(first == torques(law) && first[0] != first[399]);
    // SAFETY: from `create`, used no more.
    unsafe {
        armplane_law_destroy(law);
        armplane_arm_destroy(arm);
    }
}
