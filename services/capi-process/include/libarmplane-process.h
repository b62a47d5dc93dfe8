/* A process of a run as a C library: docs/wire.md. Made by services/capi/header of services/capi-process/src/lib.rs.
 *
 * `armplane generate wire --lang c` gives the messages, with a function for each topic. */

#ifndef LIBARMPLANE_PROCESS_H
#define LIBARMPLANE_PROCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * Version of this header. `armplane_process_join` refuses a program that was compiled with another one.
 */
#define ARMPLANE_PROCESS_ABI_VERSION 1

/**
 * The process is given a tick.
 */
#define ARMPLANE_PROCESS_TICK 1

/**
 * Done; of `armplane_process_wait`: the run is over for this process.
 */
#define ARMPLANE_PROCESS_OK 0

/**
 * `armplane_process_error` says why the process cannot go on.
 */
#define ARMPLANE_PROCESS_ERROR -1

/**
 * The function given to `armplane_process_look_out` has ended the wait.
 */
#define ARMPLANE_PROCESS_LOOKED -2

/**
 * A process of a run. One thread at a time may use it, and no process that was forked from this one.
 */
typedef struct armplane_process armplane_process;

/**
 * The process and the tick in hand.
 */
typedef struct armplane_process_now {
  /**
   * The tick in hand.
   */
  uint64_t tick;
  /**
   * Bit i: topic i, in the order of `armplane_process_topic_at`, has a message of this tick.
   */
  uint64_t fresh;
  /**
   * 1 in lockstep, 0 in real time.
   */
  uint32_t lockstep;
  /**
   * Ticks per second of the arm's time; Hz.
   */
  uint32_t rate_hz;
  /**
   * Joints of the arm: the first so many elements of an array of joints.
   */
  uint32_t dof;
  /**
   * How often the process has been started in this run, from 1.
   */
  uint32_t incarnation;
  /**
   * 1: a state that is given for this tick by `armplane_process_keep` is kept.
   */
  uint32_t keeps;
  /**
   * Zero.
   */
  uint32_t reserved;
} armplane_process_now;

/**
 * A topic of the process.
 */
typedef struct armplane_process_topic {
  /**
   * Its name.
   */
  const char *name;
  /**
   * The versioned name of its messages' type.
   */
  const char *type_name;
  /**
   * The hash of their layout.
   */
  uint64_t layout;
  /**
   * Bytes of a message.
   */
  uint64_t bytes;
  /**
   * 1 of a topic that the process writes, 0 of one that it reads.
   */
  uint32_t is_output;
  /**
   * Zero.
   */
  uint32_t reserved;
} armplane_process_topic;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Joins a run.
 *
 * `abi_version`: ARMPLANE_PROCESS_ABI_VERSION. `run`, `name`: the run's directory and the name of the process in its graph; NULL: those of the run that has
 * started this program. `error`: NULL, or room for `error_size` bytes; takes a sentence, empty on success. Returns NULL where the process cannot join.
 */
struct armplane_process *armplane_process_join(uint32_t abi_version,
                                               const char *run,
                                               const char *name,
                                               char *error,
                                               size_t error_size);

/**
 * The process and the tick in hand: a place that stays until it leaves. NULL for NULL.
 */
const struct armplane_process_now *armplane_process_about(const struct armplane_process *process);

/**
 * A topic of the process, from 0: those that it reads in the order of its graph, then those that it writes. NULL behind the last.
 */
const struct armplane_process_topic *armplane_process_topic_at(const struct armplane_process *process,
                                                               size_t index);

/**
 * The directory of the run: `job.json` (scenario, robot, graph) and `arm.xml` (the arm in MJCF, its start posture as a key) lie there. NULL for NULL.
 */
const char *armplane_process_folder(const struct armplane_process *process);

/**
 * Waits for the next tick: ARMPLANE_PROCESS_TICK, ARMPLANE_PROCESS_OK when the run is over for this process, or an error below zero.
 */
int32_t armplane_process_wait(struct armplane_process *process);

/**
 * The message of the tick in hand, in shared memory where it was sent: valid until the next wait. NULL where none has come, which is no error, or the
 * process does not read the topic. `layout`: the hash that the program was compiled with, 0 for a topic that only the graph knows.
 */
const void *armplane_process_input(struct armplane_process *process,
                                   const char *topic,
                                   uint64_t layout);

/**
 * A place that stays, to which every later message of a topic that the process reads is copied; zeros before the first. NULL on an error.
 */
const void *armplane_process_copy(struct armplane_process *process,
                                  const char *topic,
                                  uint64_t layout);

/**
 * The message of a topic that the process writes: a place that stays, keeps what was sent last, and is private until it is sent. The header is filled in
 * then. NULL on an error.
 */
void *armplane_process_output(struct armplane_process *process,
                              const char *topic,
                              uint64_t layout);

/**
 * Answers the tick in hand: checks every output, then sends them. `last` other than 0, of the process that makes the ticks: the run ends with this tick.
 * ARMPLANE_PROCESS_OK, or an error, and nothing has been sent.
 */
int32_t armplane_process_send(struct armplane_process *process,
                              int32_t last);

/**
 * Gives the state after the tick in hand, before it is sent: a replacement of this process finds the bytes by armplane_process_previous.
 */
int32_t armplane_process_keep(struct armplane_process *process,
                              const void *state,
                              size_t size);

/**
 * The state that a predecessor of this process has left, and its size; NULL without one. Valid until the process leaves.
 */
const void *armplane_process_previous(const struct armplane_process *process,
                                      size_t *size);

/**
 * Has `look` called with `argument` at least every 25 ms of every wait from now on, on the waiting thread. Where it returns other than 0, the wait ends with
 * ARMPLANE_PROCESS_LOOKED.
 */
void armplane_process_look_out(struct armplane_process *process,
                               int32_t (*look)(void*),
                               void *argument);

/**
 * Says why the program cannot go on; always ARMPLANE_PROCESS_ERROR.
 */
int32_t armplane_process_fail(struct armplane_process *process, const char *why);

/**
 * Why the process cannot go on; empty where it can. Valid until the next call. NULL for NULL.
 */
const char *armplane_process_error(const struct armplane_process *process);

/**
 * Leaves the run and frees the process. Prints why it could not go on, if it could not. Returns the exit code of the program, 0 or 1.
 */
int32_t armplane_process_leave(struct armplane_process *process);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LIBARMPLANE_PROCESS_H */
