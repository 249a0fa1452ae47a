/* By hand, for comparison: what `loaded_dop853` does for a free body with a torque at its port, in plain C.

   DOP853 with error control inside a communication step, the centre of mass in closed form, quaternion, rpy and omega_b
   as outputs. layout.h, generated, has the places in the unit's buffer, tableau.h the method's coefficients. Goes behind
   the same C layer. Inertia: principal axes only (it is inverted when the unit is initialised, never later). */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "layout.h"
#include "tableau.h"

#define STAGES 12
#define MAX_SUBSTEPS 1e9

typedef struct {
    double M[3][3], M_inverse[3][3], damping[3], torque_b[3];
} Body;

static void cross(const double a[3], const double b[3], double c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static void transform(const double A[3][3], const double x[3], double y[3]) {
    for (int i = 0; i < 3; i++) y[i] = A[i][0] * x[0] + A[i][1] * x[1] + A[i][2] * x[2];
}

static void rates(const double y[8], double k[8], const Body *body) {
    const double *q = y, *w = y + 4;
    double momentum[3], gyroscopic[3], torque[3];
    k[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]);
    k[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]);
    k[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]);
    k[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]);
    transform(body->M, w, momentum);
    cross(w, momentum, gyroscopic);
    for (int i = 0; i < 3; i++) torque[i] = body->torque_b[i] - body->damping[i] * w[i] - gyroscopic[i];
    transform(body->M_inverse, torque, k + 4);
    k[7] = 0.0;
}

static double largest(const double v[3]) { return fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2]))); }

/* One step from y to `trial`, not normalised; its estimated error. */
static double dop853(const double y[8], double trial[8], double h, const Body *body) {
    double k[STAGES][8], sums[2] = {0.0, 0.0}, rate;
    rates(y, k[0], body);
    for (int s = 1; s <= STAGES; s++) {
        for (int j = 0; j < 8; j++) trial[j] = 0.0;
        for (int l = 0; l < s; l++)
            if (A[s][l] != 0.0)
                for (int j = 0; j < 8; j++) trial[j] += A[s][l] * k[l][j];
        for (int j = 0; j < 8; j++) trial[j] = y[j] + h * trial[j];
        if (s < STAGES) rates(trial, k[s], body);
    }
    rate = fmax(fmax(largest(y + 4), largest(trial + 4)), 1e-300);
    for (int j = 0; j < 8; j++) {
        double e5 = 0.0, e3 = 0.0, size = j < 4 ? 0.5 : rate;
        for (int l = 0; l < STAGES; l++) {
            e5 += E5[l] * k[l][j];
            e3 += E3[l] * k[l][j];
        }
        sums[0] += (e5 / size) * (e5 / size);
        sums[1] += (e3 / size) * (e3 / size);
    }
    return sums[0] == 0.0 ? 0.0 : h * sums[0] / sqrt((sums[0] + 0.01 * sums[1]) * 7.0);
}

static void accept(double y[8], const double trial[8]) {
    double s = 1.0 / sqrt(trial[0] * trial[0] + trial[1] * trial[1] + trial[2] * trial[2] + trial[3] * trial[3]);
    for (int i = 0; i < 4; i++) y[i] = s * trial[i];
    for (int i = 4; i < 8; i++) y[i] = trial[i];
}

static int advance(double y[8], double h, double tolerance, double *size, const Body *body) {
    double rest = h, low = 0.0, trial[8];
    long steps = 0;
    while (rest > 0.0) {
        if (!(rest < MAX_SUBSTEPS * *size && ++steps < (long)MAX_SUBSTEPS)) return 1;
        double count = ceil(rest / *size * (1.0 - 1e-9)), part = (rest + low) / count;
        double error = dop853(y, trial, part, body) / tolerance;
        if (error <= 1.0) {
            double growth = error < 2.6e-7 ? 6.0 : 0.9 / sqrt(sqrt(sqrt(error)));
            double left = count == 1.0 ? 0.0 : rest - part;
            accept(y, trial);
            low += (rest - left) - part;
            rest = left;
            *size = growth >= 1.0 ? fmax(*size, part * growth) : part * growth;
        } else {
            *size = part * fmax(0.2, isfinite(error) ? 0.9 / sqrt(sqrt(sqrt(error))) : 0.0);
        }
    }
    return 0;
}

static Body body_of(const double *z) {
    Body body;
    memcpy(body.M, z + AT_M, sizeof body.M);
    memcpy(body.M_inverse, z + AT_M_INVERSE, sizeof body.M_inverse);
    memcpy(body.damping, z + AT_DAMPING_B, sizeof body.damping);
    for (int i = 0; i < 3; i++) body.torque_b[i] = z[AT_TORQUE_B + i] + z[AT_CONSTANT_TORQUE_B + i];
    return body;
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
    double *q = z + AT_Q, length = 0.0, rate = 0.0, acceleration = 0.0, k[8];
    Body body;
    for (int i = 0; i < 3; i++) {
        z[AT_M + 4 * i] = z[AT_INERTIA + i];
        z[AT_M_INVERSE + 4 * i] = 1.0 / z[AT_INERTIA + i];
    }
    for (int i = 0; i < 4; i++) length += z[AT_QUATERNION_0 + i] * z[AT_QUATERNION_0 + i];
    for (int i = 0; i < 4; i++) q[i] = z[AT_QUATERNION_0 + i] / sqrt(length);
    memcpy(z + AT_OMEGA, z + AT_OMEGA_B_0, 3 * sizeof *z);
    memcpy(z + AT_R_C, z + AT_POSITION_0, 3 * sizeof *z);
    memcpy(z + AT_V_C, z + AT_VELOCITY_0, 3 * sizeof *z);
    body = body_of(z);
    rates(q, k, &body);
    for (int i = 4; i < 7; i++) {
        rate += q[i] * q[i];
        acceleration += k[i] * k[i];
    }
    z[AT_STEP_SIZE] = 0.5 / (sqrt(rate) + sqrt(sqrt(acceleration)));
    return outputs(z);
}

int64_t step(double *z, double h) {
    double y[8], size = z[AT_STEP_SIZE], total = 0.0;
    Body body = body_of(z);
    memcpy(y, z + AT_Q, sizeof y);
    if (!(h > 0.0) || advance(y, h, z[AT_TOLERANCE], &size, &body)) return 1;
    for (int i = 0; i < 8; i++) total += 0.0 * y[i];
    if (total != 0.0) return 1;
    memcpy(z + AT_Q, y, sizeof y);
    z[AT_STEP_SIZE] = size;
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
