/* By hand, for comparison: what `loaded_taylor` does for a free body with a torque at its port, in plain C.

   Taylor series of the plan's order for the body rate and the attitude, each made once and evaluated for as many
   communication steps as it reaches over while the torque is held; the reach is as long as the last two terms (Jorba &
   Zou 2005) and the plan's tolerance allow. The centre of mass in closed form; quaternion, rpy and omega_b as outputs.
   layout.h, generated, has the places in the unit's buffer. Goes behind the same C layer. Inertia: principal axes only
   (it is inverted when the unit is initialised, never later); the torque is the only load that turns the body. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "layout.h"

#define MOST 25           /* terms */
#define CAUTION 0.015625  /* the part of a whole run's tolerance that series use up, as in the product */
#define CLOCK (1.0 + 1e-9)
#define TRIES 256

typedef double Four[4]; /* of which vectors leave the last one 0 */

/* In the unit's work space: both series, where they end, how far they serve and have served, and their torque. */
typedef struct {
    Four rate[MOST], turn[MOST];
    double turn_order, reach, since, torque[3];
} Series;

_Static_assert(sizeof(Series) <= SIZE_WORK * sizeof(double), "the unit has room for it");

static double largest(const double *v, int n) {
    double found = 0.0;
    for (int i = 0; i < n; i++) found = fmax(found, fabs(v[i]));
    return found;
}

static double square_of(const double *v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

static double power_of(double x, int n) {
    double total = 1.0;
    for (int i = 0; i < n; i++) total *= x;
    return total;
}

static void rate_series(Series *s, const double *z, int order) {
    const double *I = z + AT_INERTIA, *damping = z + AT_DAMPING_B;
    for (int k = 0; k < order; k++) {
        double product[3] = {0.0, 0.0, 0.0}, torque[3];
        for (int j = 0; j <= k; j++) {
            const double *a = s->rate[j], *b = s->rate[k - j];
            product[0] += a[1] * b[2];
            product[1] += a[2] * b[0];
            product[2] += a[0] * b[1];
        }
        for (int i = 0; i < 3; i++) torque[i] = (k == 0 ? s->torque[i] : 0.0) - damping[i] * s->rate[k][i];
        s->rate[k + 1][0] = ((I[1] - I[2]) * product[0] + torque[0]) / (I[0] * (k + 1));
        s->rate[k + 1][1] = ((I[2] - I[0]) * product[1] + torque[1]) / (I[1] * (k + 1));
        s->rate[k + 1][2] = ((I[0] - I[1]) * product[2] + torque[2]) / (I[2] * (k + 1));
    }
}

/* dq/dt = q o (0, omega) / 2, until two terms in turn are within `bound` at `reach`; the last one's order. */
static int turn_series(Series *s, int order, double reach, double bound) {
    double power = 1.0;
    int were_small = 0;
    for (int k = 0; k < order; k++) {
        double half = 0.5 / (k + 1), *next = s->turn[k + 1];
        for (int i = 0; i < 4; i++) next[i] = 0.0;
        for (int j = 0; j <= k; j++) {
            const double *q = s->turn[j], *w = s->rate[k - j];
            next[0] += -q[1] * w[0] - q[2] * w[1] - q[3] * w[2];
            next[1] += q[0] * w[0] + q[2] * w[2] - q[3] * w[1];
            next[2] += q[0] * w[1] + q[3] * w[0] - q[1] * w[2];
            next[3] += q[0] * w[2] + q[1] * w[1] - q[2] * w[0];
        }
        for (int i = 0; i < 4; i++) next[i] *= half;
        power *= reach;
        int small = largest(next, 4) * power <= bound;
        if (small && were_small && 2 * k >= order) return k + 1;
        were_small = small;
    }
    return order;
}

static double allowed(const double *z, double h) {
    double tolerance = z[AT_TOLERANCE], span = z[AT_SPAN];
    return span == 0.0 ? tolerance : fmax(CAUTION * tolerance * h / span, 0x1p-52);
}

/* The estimated error at h over that which is allowed; m: the attitude's order, 0 where it is not known yet. */
static double excess(const Series *s, const double *z, int order, int m, double h) {
    double square = 0.0, power = 1.0, at_end[3] = {0.0, 0.0, 0.0}, part[3];
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < 3; i++) {
            part[i] = power * s->rate[k][i];
            at_end[i] += part[i];
        }
        square = fmax(square, fmax(square_of(part), square_of(at_end)));
        power *= h;
    }
    double last = power_of(h, order - 1) * fmax(largest(s->rate[order - 1], 3), h * largest(s->rate[order], 3));
    last = fmax(square > 0.0 ? last / sqrt(square) : 0.0, last * z[AT_SPAN]);
    if (m > 0)
        last = fmax(last, 2.0 * power_of(h, m - 1) * fmax(largest(s->turn[m - 1], 4), h * largest(s->turn[m], 4)));
    return last / allowed(z, h);
}

/* The step whose error is that of h over `excess`, without a root. */
static double nearer(double h, int order, double excess) {
    if (!(excess < 1e4)) return 0.5 * h;
    if (excess < 1e-4) return excess < 1e-8 ? 2.0 * h : 1.3 * h;
    return h * ((order + 1) + (order - 1) * excess) / ((order - 1) + (order + 1) * excess);
}

static double reach_within(const Series *s, const double *z, int order, int m, double reach, double *next) {
    double found = excess(s, z, order, m, reach);
    for (int i = 0; i < TRIES && !(found <= 1.0); i++) {
        reach = nearer(reach, order, 1.4 * found);
        found = excess(s, z, order, m, reach);
    }
    *next = nearer(reach, order, 1.4 * found);
    return reach;
}

static void make_series(Series *s, double *z) {
    int order = (int)z[AT_ORDER];
    double turning, reach, next;
    memcpy(s->rate[0], z + AT_OMEGA, 3 * sizeof *z);
    memcpy(s->turn[0], z + AT_Q, 4 * sizeof *z);
    for (int i = 0; i < 3; i++) s->torque[i] = z[AT_TORQUE_B + i] + z[AT_CONSTANT_TORQUE_B + i];
    rate_series(s, z, order);
    turning = sqrt(square_of(s->rate[0])) + sqrt(sqrt(square_of(s->rate[1])));
    reach = turning > 0.0 ? fmin(z[AT_STEP_SIZE], order / turning) : z[AT_STEP_SIZE];
    reach = reach_within(s, z, order, 0, reach, &next);
    s->turn_order = turn_series(s, order, reach, 0.5 * allowed(z, reach));
    s->reach = reach_within(s, z, order, (int)s->turn_order, reach, &next);
    s->since = 0.0;
    z[AT_STEP_SIZE] = next;
}

/* A series at t: even and odd powers apart, of which neither waits for the other. */
static void value(const Four *u, int order, double t, double *found) {
    Four even, odd = {0.0, 0.0, 0.0, 0.0};
    int k = order & ~1;
    for (int i = 0; i < 4; i++) even[i] = u[k][i];
    if (order & 1)
        for (int i = 0; i < 4; i++) odd[i] = u[order][i];
    for (k -= 2; k >= 0; k -= 2)
        for (int i = 0; i < 4; i++) {
            even[i] = u[k][i] + t * t * even[i];
            odd[i] = u[k + 1][i] + t * t * odd[i];
        }
    for (int i = 0; i < 4; i++) found[i] = even[i] + t * odd[i];
}

static void follow(const Series *s, double *z, double t) {
    Four q, w;
    value(s->turn, (int)s->turn_order, t, q);
    value(s->rate, (int)z[AT_ORDER], t, w);
    /* Of unit length to round-off, but for the series' error: the root is linear there. */
    double over = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0;
    double r = fabs(over) < 1e-8 ? 1.0 - 0.5 * over : 1.0 / sqrt(1.0 + over);
    for (int i = 0; i < 4; i++) z[AT_Q + i] = r * q[i];
    memcpy(z + AT_OMEGA, w, 3 * sizeof *z);
}

int64_t outputs(double *z) {
    const double *q = z + AT_Q;
    memcpy(z + AT_QUATERNION, q, 4 * sizeof *z);
    memcpy(z + AT_OMEGA_B, z + AT_OMEGA, 3 * sizeof *z);
    z[AT_RPY] = atan2(2.0 * (q[0] * q[1] + q[2] * q[3]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]));
    z[AT_RPY + 1] = asin(fmin(fmax(2.0 * (q[0] * q[2] - q[3] * q[1]), -1.0), 1.0));
    z[AT_RPY + 2] = atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]));
    return 0;
}

int64_t initialize(double *z) {
    double length = 0.0;
    for (int i = 0; i < 4; i++) length += z[AT_QUATERNION_0 + i] * z[AT_QUATERNION_0 + i];
    for (int i = 0; i < 4; i++) z[AT_Q + i] = z[AT_QUATERNION_0 + i] / sqrt(length);
    memcpy(z + AT_OMEGA, z + AT_OMEGA_B_0, 3 * sizeof *z);
    memcpy(z + AT_R_C, z + AT_POSITION_0, 3 * sizeof *z);
    memcpy(z + AT_V_C, z + AT_VELOCITY_0, 3 * sizeof *z);
    memset(z + AT_WORK, 0, sizeof(Series));
    z[AT_STEP_SIZE] = 1e300; /* the series themselves say at once how much is too long */
    return outputs(z);
}

int64_t step(double *z, double h) {
    Series *s = (Series *)(z + AT_WORK);
    double rest = h, before[8], size = z[AT_STEP_SIZE], since = s->since, total = 0.0;
    int steady = s->reach > 0.0;
    if (!(h > 0.0 && h < 1e9)) return 1;
    memcpy(before, z + AT_Q, sizeof before);
    for (int i = 0; i < 3; i++) steady &= s->torque[i] == z[AT_TORQUE_B + i] + z[AT_CONSTANT_TORQUE_B + i];
    if (!steady) make_series(s, z);
    while (s->since + rest > CLOCK * s->reach) {
        rest -= s->reach - s->since;
        follow(s, z, s->reach);
        make_series(s, z);
        if (!(rest < 1e9 * s->reach)) break;
    }
    s->since += rest;
    follow(s, z, s->since);
    for (int i = 0; i < 7; i++) total += 0.0 * z[AT_Q + i];
    if (total != 0.0) { /* not finite: as before, with a new series next time */
        memcpy(z + AT_Q, before, sizeof before);
        z[AT_STEP_SIZE] = size;
        s->since = since;
        s->reach = 0.0;
        return 1;
    }
    for (int i = 0; i < 3; i++) {
        z[AT_R_C + i] += h * z[AT_V_C + i] + 0.5 * h * h * z[AT_GRAVITY_A + i];
        z[AT_V_C + i] += h * z[AT_GRAVITY_A + i];
    }
    return outputs(z);
}

/* The C layer wants these two; the benchmark never asks for derivatives. */
int64_t output_rates(double *z) {
    (void)z;
    return 1;
}

int64_t feedthrough(double *z, double *change) {
    (void)z, (void)change;
    return 1;
}
