/* Two unit links in the plane, as the plant of `two-links.toml`: the first arm of every textbook, in closed form.
 *
 *     cc -O2 -o plant plant.c $(pkg-config --cflags --libs armplane-process) -lm && armplane run two-links.toml
 *
 * Length 1 m and mass 1 kg each, slender rods, gravity along -y; classical Runge-Kutta, four steps a tick; ideal encoders and drives. */
#include <math.h>
#include <string.h>

#include "armplane.h"

struct state {
    double q[2], qdot[2];
};

/* A(q) qddot + C(q, qdot) qdot + g(q) = tau */
static struct state rate(struct state x, const double tau[2]) {
    const double c2 = cos(x.q[1]), s2 = sin(x.q[1]), c1 = cos(x.q[0]), c12 = cos(x.q[0] + x.q[1]), g = 9.81;
    const double A11 = 5.0 / 3.0 + c2, A12 = 1.0 / 3.0 + 0.5 * c2, A22 = 1.0 / 3.0;
    const double b1 = tau[0] + 0.5 * s2 * (2.0 * x.qdot[0] + x.qdot[1]) * x.qdot[1] - g * (1.5 * c1 + 0.5 * c12);
    const double b2 = tau[1] - 0.5 * s2 * x.qdot[0] * x.qdot[0] - g * 0.5 * c12;
    const double det = A11 * A22 - A12 * A12;
    return (struct state){{x.qdot[0], x.qdot[1]}, {(A22 * b1 - A12 * b2) / det, (A11 * b2 - A12 * b1) / det}};
}

static struct state along(struct state x, struct state v, double h) {
    return (struct state){{x.q[0] + h * v.q[0], x.q[1] + h * v.q[1]}, {x.qdot[0] + h * v.qdot[0], x.qdot[1] + h * v.qdot[1]}};
}

static struct state step(struct state x, const double tau[2], double h) {
    const struct state k1 = rate(x, tau), k2 = rate(along(x, k1, h / 2), tau), k3 = rate(along(x, k2, h / 2), tau), k4 = rate(along(x, k3, h), tau);
    return along(along(along(along(x, k1, h / 6), k2, h / 3), k3, h / 3), k4, h / 6);
}

int main(void) {
    struct armplane_process *p = armplane_begin();
    const struct armplane_process_now *now = armplane_process_about(p);
    struct armplane_sensor_sample *sensor = armplane_out_sensor(p);
    struct armplane_plant_state *truth = armplane_out_plant_state(p);
    if (now->dof != 2) {
        armplane_process_fail(p, "this program is the plant of an arm of two joints");
        return armplane_process_leave(p);
    }
    struct state x = {{0.3, 1.2}, {0.0, 0.0}}; /* the posture `bent` */
    double tau[2] = {9.81 * (1.5 * cos(0.3) + 0.5 * cos(1.5)), 9.81 * 0.5 * cos(1.5)};
    const double h = 1.0 / now->rate_hz / 4;
    while (armplane_process_wait(p) == ARMPLANE_PROCESS_TICK) {
        if (now->tick > 0) {
            /* Where no torque has come, the last one is held. */
            const struct armplane_torque_command *torque = armplane_in_torque(p);
            if (torque) memcpy(tau, torque->tau, sizeof tau);
            for (int i = 0; i < 4; i++) x = step(x, tau, h);
        }
        const double c1 = cos(x.q[0]), s1 = sin(x.q[0]), c12 = cos(x.q[0] + x.q[1]), s12 = sin(x.q[0] + x.q[1]);
        const double turn = x.qdot[0] + x.qdot[1];
        memcpy(sensor->q_encoder, x.q, sizeof x.q);
        memcpy(sensor->tau_drive, tau, sizeof tau);
        memcpy(truth->q, x.q, sizeof x.q);
        memcpy(truth->qdot, x.qdot, sizeof x.qdot);
        memcpy(truth->tau, tau, sizeof tau);
        truth->p_BE[0] = c1 + c12;
        truth->p_BE[1] = s1 + s12;
        const double R[9] = {c12, s12, 0, -s12, c12, 0, 0, 0, 1}; /* column by column */
        memcpy(truth->R_BE, R, sizeof R);
        truth->V_BE[0] = -s1 * x.qdot[0] - s12 * turn;
        truth->V_BE[1] = c1 * x.qdot[0] + c12 * turn;
        truth->V_BE[5] = turn;
        armplane_process_send(p, 0);
    }
    return armplane_process_leave(p);
}
