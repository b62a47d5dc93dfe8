/* The wire of armplane: messages, codes, and the program's side of an exchange page. Written by `armplane generate wire --lang c`.
 *
 *     #include "armplane.h"
 *     int main(void) {
 *         struct armplane a;
 *         if (armplane_join(&a)) return armplane_failed(&a);
 *         struct armplane_state_estimate *estimate = ARMPLANE_USE(&a, "estimate", state_estimate, ESTIMATE);
 *         struct armplane_torque_command *torque = ARMPLANE_USE(&a, "torque", torque_command, TORQUE);
 *         if (armplane_ready(&a)) return armplane_failed(&a);
 *         while (armplane_next(&a) == ARMPLANE_REQUEST_TICK) {
 *             torque->tau[0] = -10.0 * estimate->qdot[0];
 *             armplane_answer(&a, ARMPLANE_ANSWER_DONE);
 *         }
 *         return armplane_end(&a);
 *     }
 *
 * docs/wire.md has the state machine. Linux, C11 or C++11. */
#ifndef ARMPLANE_H
#define ARMPLANE_H

#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#ifdef __cplusplus
#include <atomic>
#define ARMPLANE_ATOMIC_U32 std::atomic<uint32_t>
#define ARMPLANE_LOAD(word) (word).load(std::memory_order_acquire)
#define ARMPLANE_STORE(word, value) (word).store((value), std::memory_order_release)
#define ARMPLANE_ASSERT(condition, text) static_assert(condition, text)
#else
#include <stdatomic.h>
#define ARMPLANE_ATOMIC_U32 _Atomic uint32_t
#define ARMPLANE_LOAD(word) atomic_load_explicit(&(word), memory_order_acquire)
#define ARMPLANE_STORE(word, value) atomic_store_explicit(&(word), (value), memory_order_release)
#define ARMPLANE_ASSERT(condition, text) _Static_assert(condition, text)
#endif

