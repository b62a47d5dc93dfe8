/* Arms, their singularities and the control law as a C library: docs/c.md. Made by services/capi/header of services/capi/src/lib.rs.
 *
 * n is the number of an arm's joints, the first of which is at the base. SI units. */

#ifndef LIBARMPLANE_H
#define LIBARMPLANE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Version of the library that this header came with. */
#define ARMPLANE_VERSION "0.1.0"

/**
 * Version of this header. `create` refuses a program that was compiled with another one.
 */
#define ARMPLANE_ABI_VERSION 1

/**
 * Most joints of an arm.
 */
#define ARMPLANE_JOINTS_MAX 8

/**
 * Most singularities that are reported at a posture.
 */
#define ARMPLANE_SINGULARITIES_MAX 4

/**
 * Result of a call. Below zero it is an error, and nothing is written but the error text of `create`.
 */
enum armplane_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * Done.
   */
  ARMPLANE_OK = 0,
  /**
   * The law has given up: its torque brings the arm to rest until `armplane_law_reset`. `armplane_law_get_state` says why.
   */
  ARMPLANE_REFUSED = 1,
  /**
   * The law has not been given a posture within the arm's limits yet: its torque is zero.
   */
  ARMPLANE_NOT_BEGUN = 2,
  /**
   * A pointer is null that must not be.
   */
  ARMPLANE_ERROR_NULL = -1,
  /**
   * The program was compiled with the header of another ABI version.
   */
  ARMPLANE_ERROR_VERSION = -2,
  /**
   * An argument is wrong; of `create`, the error text says which.
   */
  ARMPLANE_ERROR_ARGUMENT = -3,
  /**
   * An argument, or the result, has a NaN or an infinity.
   */
  ARMPLANE_ERROR_NOT_FINITE = -4,
  /**
   * A defect of armplane. Destroy this handle; every further step of a law returns the same.
   */
  ARMPLANE_ERROR_PANIC = -5,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum armplane_status armplane_status;
#else
typedef int32_t armplane_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A serial arm, seen at one of its links, the end-effector E. One thread at a time may use it.
 */
typedef struct armplane_arm armplane_arm;

/**
 * The control law of one arm, with its memory. One thread at a time may use it.
 */
typedef struct armplane_law armplane_law;

/**
 * A joint. Units of a sliding joint: m and N in place of rad and N·m.
 */
typedef struct armplane_joint {
  /**
   * Its name, UTF-8, cut to 63 bytes.
   */
  char name[64];
  /**
   * Lower position limit, rad; -INFINITY where there is none.
   */
  double lower;
  /**
   * Upper position limit, rad; INFINITY where there is none.
   */
  double upper;
  /**
   * Speed limit, rad/s.
   */
  double velocity;
  /**
   * Torque limit, N·m.
   */
  double effort;
  /**
   * Largest rate of the torque, N·m/s.
   */
  double torque_rate;
} armplane_joint;

/**
 * An arm of n joints at a posture. B is the base. Rows of twists are [linear; angular] in the axes of B. Matrices lie row by row in the first places of
 * their arrays, with n columns.
 */
typedef struct armplane_posture {
  /**
   * Homogeneous matrix of E in B, 4 x 4, m.
   */
  double pose[16];
  /**
   * Jacobian at E, 6 x n, m/rad and rad/rad.
   */
  double jacobian[48];
  /**
   * Mass matrix with the inertia of the drives, n x n, kg·m².
   */
  double mass[64];
  /**
   * Coriolis and gravity torques, n, N·m.
   */
  double bias[ARMPLANE_JOINTS_MAX];
  /**
   * Gravity torques, n, N·m.
   */
  double gravity[ARMPLANE_JOINTS_MAX];
} armplane_posture;

/**
 * A singularity of an arm, at one posture.
 */
typedef struct armplane_singularity {
  /**
   * elbow, wrist, overhead, shoulder; s1 to s4 where it is found by number.
   */
  char name[16];
  /**
   * "type 1": motion in the null space moves the hand along the singular direction. "type 2": it only turns that direction. "mixed", "unknown".
   */
  char type[16];
  /**
   * Signed and without unit; 0 at the singularity.
   */
  double measure;
  /**
   * Singular direction in the axes of B: a unit vector, [linear; angular].
   */
  double direction[6];
  /**
   * |measure| below which its neighbourhood is entered.
   */
  double entry;
  /**
   * |measure| above which the neighbourhood is left.
   */
  double exit;
  /**
   * Whether the posture is in the neighbourhood.
   */
  bool inside;
} armplane_singularity;

/**
 * The law at one singularity.
 */
typedef struct armplane_law_mode {
  /**
   * The singularity's name, as in armplane_singularity.
   */
  char name[16];
  /**
   * regular, blend, track, pass, hold, reorient, slide, recover.
   */
  char mode[16];
  /**
   * Share of the operational-space command along the singular direction, 0 to 1.
   */
  double beta;
} armplane_law_mode;

/**
 * The law's answer to the last step.
 */
typedef struct armplane_law_state {
  /**
   * Steps since the law began.
   */
  uint64_t tick;
  /**
   * How the arm follows what it was given, or why it does not, in words.
   */
  char reason[256];
  /**
   * Why the last pose or twist that was refused was so; empty where none was. For 0.1 s the one before it stays in force.
   */
  char target_refusal[96];
  /**
   * Poses and twists refused since the law began.
   */
  uint32_t targets_refused;
  /**
   * Number of modes.
   */
  uint32_t mode_count;
  /**
   * In the order of armplane_arm_singularities.
   */
  struct armplane_law_mode modes[ARMPLANE_SINGULARITIES_MAX];
  /**
   * Share of the twist asked for that the arm moves with, 0 to 1.
   */
  double speed_scale;
  /**
   * Whether the law has given up.
   */
  bool refused;
} armplane_law_state;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the ABI that the library has: compare it with ARMPLANE_ABI_VERSION.
 */
uint32_t armplane_abi_version(void);

/**
 * The version of the library, such as "0.1.0": compare it with ARMPLANE_VERSION.
 */
const char *armplane_version(void);

/**
 * Makes the arm of a URDF file. `python -m armplane.mjcf ARM.xml` makes one of MJCF.
 *
 * `abi_version`: ARMPLANE_ABI_VERSION. `tip`: the link that is E; NULL: the last one. `description`: a TOML file with what
 * the format has no element for (inertia of drives, friction, torque rates, speed limits); NULL: the file of the same name beside it, if there is one.
 * `error`: NULL, or room for `error_size` bytes; takes a sentence, cut where it is longer, empty on success. 512 bytes are enough for most.
 */
armplane_status armplane_arm_create_from_file(uint32_t abi_version,
                                              const char *path,
                                              const char *tip,
                                              const char *description,
                                              struct armplane_arm **out,
                                              char *error,
                                              size_t error_size);

/**
 * Makes the arm of a URDF text. `name`: what it is called; `description`: the text of a description, or NULL. The rest is as for
 * armplane_arm_create_from_file.
 */
armplane_status armplane_arm_create_from_text(uint32_t abi_version,
                                              const char *name,
                                              const char *xml,
                                              const char *tip,
                                              const char *description,
                                              struct armplane_arm **out,
                                              char *error,
                                              size_t error_size);

/**
 * Makes a built-in arm: puma560, ur5, ur10, iiwa14, panda, fr3, xarm7, gen3; the error text lists all. `tip` NULL: its own end-effector. The rest is as
 * for armplane_arm_create_from_file.
 */
armplane_status armplane_arm_create_builtin(uint32_t abi_version,
                                            const char *name,
                                            const char *tip,
                                            struct armplane_arm **out,
                                            char *error,
                                            size_t error_size);

/**
 * Frees an arm; its laws live on. NULL: nothing.
 */
void armplane_arm_destroy(struct armplane_arm *arm);

/**
 * Number of joints n, 1 to ARMPLANE_JOINTS_MAX; 0 for NULL.
 */
size_t armplane_arm_joint_count(const struct armplane_arm *arm);

/**
 * A joint by its place, 0 to n - 1, counted from the base.
 */
armplane_status armplane_arm_joint(const struct armplane_arm *arm,
                                   size_t place,
                                   struct armplane_joint *out);

/**
 * Pose, Jacobian, mass matrix and torques at `q`, n values, rad, and `qdot`, n values, rad/s; NULL: at rest.
 */
armplane_status armplane_arm_at(const struct armplane_arm *arm,
                                const double *q,
                                const double *qdot,
                                struct armplane_posture *out);

/**
 * The singularities at `q`, n values, rad: `count` of them, in the first places of `out`, which has ARMPLANE_SINGULARITIES_MAX.
 */
armplane_status armplane_arm_singularities(struct armplane_arm *arm,
                                           const double *q,
                                           struct armplane_singularity *out,
                                           size_t *count);

/**
 * Makes the law of an arm, which is not needed any more afterwards.
 *
 * `dt`: time between two steps, s, 1/dt a whole number from 50 to 20000. `q`: the posture in which it begins at rest and to which spare joints are drawn,
 * n values, rad; NULL: that of the first step. `settings`: NULL, or keys of a scenario, one a line, such as "control.k_p=900\nservo.speed_m_s=0.2". The rest
 * is as for armplane_arm_create_from_file.
 */
armplane_status armplane_law_create(uint32_t abi_version,
                                    const struct armplane_arm *arm,
                                    double dt,
                                    const double *q,
                                    const char *settings,
                                    struct armplane_law **out,
                                    char *error,
                                    size_t error_size);

/**
 * Frees a law. NULL: nothing.
 */
void armplane_law_destroy(struct armplane_law *law);

/**
 * One step: the torque `tau`, n values, N·m, within the arm's torque limits and torque rates.
 *
 * `q`: n values, rad. `qdot`: n values, rad/s. `pose`: of E in B, 7 values x y z qw qx qy qz, m, the quaternion of norm 1; or NULL. `twist`: with which the
 * pose moves on, or alone what is asked for, 6 values [linear; angular] in the axes of B, m/s and rad/s; or NULL. With neither the arm comes to rest.
 * `tau_disturbance`: torque on the joints that the model does not explain, n values, N·m; NULL: none.
 *
 * A state that is not finite, or moves as no arm can, brings the arm to rest: ARMPLANE_REFUSED. A pose or twist that is not finite is left out, and
 * counted in the state. Each returns with a torque that can be sent; after an error (below zero) keep the one before, and stop the arm.
 */
armplane_status armplane_law_step(struct armplane_law *law,
                                  const double *q,
                                  const double *qdot,
                                  const double *pose,
                                  const double *twist,
                                  const double *tau_disturbance,
                                  double *tau);

/**
 * Forgets everything: the next step begins anew.
 */
armplane_status armplane_law_reset(struct armplane_law *law);

/**
 * The law's answer to the last step, and the reason for it.
 */
armplane_status armplane_law_get_state(const struct armplane_law *law,
                                       struct armplane_law_state *out);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LIBARMPLANE_H */
