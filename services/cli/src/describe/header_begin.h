/* The wire of armplane: messages, codes, and a process of a run. Written by `armplane generate wire --lang c`.
 *
 *     #include "armplane.h"
 *     int main(void) {
 *         struct armplane_process *p = armplane_begin();
 *         struct armplane_torque_command *torque = armplane_out_torque(p);
 *         while (armplane_process_wait(p) == ARMPLANE_PROCESS_TICK) {
 *             const struct armplane_state_estimate *estimate = armplane_in_estimate(p);
 *             torque->tau[0] = -10.0 * estimate->qdot[0];
 *             armplane_process_send(p, 0);
 *         }
 *         return armplane_process_leave(p);
 *     }
 *
 * Linux, C11 or C++11; link libarmplane-process (docs/wire.md). */
#ifndef ARMPLANE_H
#define ARMPLANE_H

#include <stdio.h>
#include <stdlib.h>

#ifdef __cplusplus
#define ARMPLANE_ASSERT(condition, text) static_assert(condition, text)
#else
#define ARMPLANE_ASSERT(condition, text) _Static_assert(condition, text)
#endif

