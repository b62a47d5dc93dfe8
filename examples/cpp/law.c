/* An arm of six joints and one of seven, simulated here, follow a pose through a singularity; prints how well, and how long a step takes.
 *
 *     cc law.c $(pkg-config --cflags --libs armplane) -lm
 */
#include <libarmplane.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { STEPS = 4000, MOVING = 3000, N = ARMPLANE_JOINTS_MAX };
static const double DT = 0.001; /* s */

/* x of A x = b, A symmetric and positive, n x n: A becomes its Cholesky factor, b the solution. */
static void solve(double *A, double *b, size_t n) {
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++) {
            double sum = A[i * n + j];
            for (size_t k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
            A[i * n + j] = i == j ? sqrt(sum) : sum / A[j * n + j];
        }
        for (size_t k = 0; k < i; k++) b[i] -= A[i * n + k] * b[k];
        b[i] /= A[i * n + i];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++) b[i] -= A[k * n + i] * b[k];
        b[i] /= A[i * n + i];
    }
}

/* Quaternion w x y z of the rotation in a homogeneous matrix, for turns of less than half a revolution. */
static void quaternion(const double *X, double *q) {
    q[0] = 0.5 * sqrt(fmax(0.0, 1.0 + X[0] + X[5] + X[10]));
    q[1] = copysign(0.5 * sqrt(fmax(0.0, 1.0 + X[0] - X[5] - X[10])), X[9] - X[6]);
    q[2] = copysign(0.5 * sqrt(fmax(0.0, 1.0 - X[0] + X[5] - X[10])), X[2] - X[8]);
    q[3] = copysign(0.5 * sqrt(fmax(0.0, 1.0 - X[0] - X[5] + X[10])), X[4] - X[1]);
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double now_us(void) {
    struct timespec at;
    clock_gettime(CLOCK_MONOTONIC, &at);
    return 1e6 * (double)at.tv_sec + 1e-3 * (double)at.tv_nsec;
}

/* Moves the hand of a built-in arm by 5 cm/s along y of the base. Returns whether it arrived. */
static int follow(const char *name, const double *start) {
    char why[512];
    armplane_arm *arm;
    armplane_law *law;
    if (armplane_arm_create_builtin(ARMPLANE_ABI_VERSION, name, NULL, &arm, why, sizeof why) ||
        armplane_law_create(ARMPLANE_ABI_VERSION, arm, DT, NULL, NULL, &law, why, sizeof why)) {
        fprintf(stderr, "%s\n", why);
        return 0;
    }
    size_t n = armplane_arm_joint_count(arm), count;
    armplane_singularity found[ARMPLANE_SINGULARITIES_MAX];
    armplane_arm_singularities(arm, start, found, &count);
    for (size_t i = 0; i < count; i++)
        printf("%s: %s, %s, measure %.3f%s\n", name, found[i].name, found[i].type, found[i].measure, found[i].inside ? ", inside" : "");

    double q[N], qdot[N] = {0}, tau[N], pose[7], rest[6] = {0}, twist[6] = {0.0, 0.05, 0.0, 0.0, 0.0, 0.0};
    static double took[STEPS];
    armplane_posture at;
    armplane_law_state state;
    unsigned engaged = 0, refused = 0;
    memcpy(q, start, n * sizeof *q);
    armplane_arm_at(arm, q, NULL, &at);
    for (size_t i = 0; i < 3; i++) pose[i] = at.pose[4 * i + 3];
    quaternion(at.pose, pose + 3);
    for (size_t tick = 0; tick < STEPS; tick++) {
        double begun = now_us();
        refused += armplane_law_step(law, q, qdot, pose, tick < MOVING ? twist : rest, NULL, tau) != ARMPLANE_OK;
        took[tick] = now_us() - begun;
        armplane_law_get_state(law, &state);
        for (size_t i = 0; i < state.mode_count; i++) engaged += state.modes[i].beta < 1.0;
        /* The arm: A qddot = tau - bias. */
        armplane_arm_at(arm, q, qdot, &at);
        for (size_t i = 0; i < n; i++) tau[i] -= at.bias[i];
        solve(at.mass, tau, n);
        for (size_t i = 0; i < n; i++) q[i] += DT * (qdot[i] += DT * tau[i]);
        if (tick < MOVING) pose[1] += DT * twist[1];
    }
    double off = 0.0;
    for (size_t i = 0; i < 3; i++) off += pow(at.pose[4 * i + 3] - pose[i], 2);
    qsort(took, STEPS, sizeof *took, ascending);
    printf("%s: %.3f mm off after %d steps, %u of them in a neighbourhood, %u refused: %s\n", name, 1e3 * sqrt(off), STEPS, engaged, refused, state.reason);
    printf("%s: a step takes %.1f us (p50), %.1f (p99), %.1f (max)\n", name, took[STEPS / 2], took[STEPS * 99 / 100], took[STEPS - 1]);
    armplane_law_destroy(law);
    armplane_arm_destroy(arm);
    return off < 1e-6 && !refused && engaged;
}

int main(void) {
    printf("libarmplane %s\n", armplane_version());
    const double ur5[] = {0.3, -1.2, 1.4, -0.6, 0.15, 0.2}, iiwa14[] = {-1.57, 1.0, 0.1, -0.15, 0.1, 0.6, 0.0};
    int good = follow("ur5", ur5);
    return good & follow("iiwa14", iiwa14) ? EXIT_SUCCESS : EXIT_FAILURE;
}
