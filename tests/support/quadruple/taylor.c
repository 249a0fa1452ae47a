/* Motion of one rigid body by Taylor series with control of the step, in quadruple precision.

   State: Euler parameters q_ab, body rate omega_b, position and velocity of the centre of mass in a. Loads fixed in a
   are carried on as b sees them. -DREAL=double makes the plain integrator in double precision. */
#define _GNU_SOURCE
#include <math.h>
#include <string.h>

#ifndef REAL
#include <quadmath.h>
#define REAL __float128
#define SQRT sqrtq
#define ATAN2 atan2q
#define SINCOS sincosq
#define ORDER 36
#define FEW 22 /* terms from this on, small beside the first, are sums in long double */
#define SIGNIFICAND(x, e) (double)frexpq(x, e)
#define LAST_TERM -92.0 /* log2 of the share of a series that its last term may be */
#else
#define SQRT sqrt
#define ATAN2 atan2
#define SINCOS sincos
#define ORDER 20
#define FEW ORDER
#define SIGNIFICAND frexp
#define LAST_TERM -56.0
#endif

typedef REAL real;
typedef struct {
    real c[FEW + 1];
    long double d[ORDER + 1]; /* all, shorter */
} series;

enum { MASS, INERTIA, R_OC = 7, GRAVITY = 10, DAMPING = 13, FORCE_A = 16, FORCE_B = 19, TORQUE_A = 22, TORQUE_B = 25,
       POSITION_0 = 28, VELOCITY_0 = 31, QUATERNION_0 = 34, OMEGA_0 = 38, PIVOT = 41 };
enum { POSITION, VELOCITY = 3, ACCELERATION = 6, QUATERNION = 9, RPY = 13, OMEGA_B = 16, OMEGA_A = 19, ALPHA = 22,
       MOMENTUM = 25, ENERGY = 28, COUNT };
enum { SIZES = 10, SCALES = 4 };

typedef struct {
    real mass, M[3][3], inverse[3][3], arm[3], damping[3], r_oc[3], gravity[3], position_0[3];
    real arm_force_a[3], arm_force_b[3], torque_a[3], torque_b[3]; /* known and supplied */
    int pivot;
    real q[4], omega[3], r_c[3], v_c[3];
    series Q[4], W[3], F[3], T[3], V[3], R[3];
    int terms; /* of V and R */
} body;

static void cross(const real *a, const real *b, real *c) {
    real x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x, c[1] = y, c[2] = z;
}

static real dot(const real *a, const real *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void times(real A[3][3], const real *v, real *out) {
    real x = dot(A[0], v), y = dot(A[1], v), z = dot(A[2], v);
    out[0] = x, out[1] = y, out[2] = z;
}

/* v as the other frame sees it: from b to a with sign 1, from a to b with -1. */
static void turn(const real *q, real sign, const real *v, real *out) {
    real e[3] = {sign * q[1], sign * q[2], sign * q[3]}, c[3], d[3];
    cross(e, v, c);
    for (int i = 0; i < 3; i++) c[i] += q[0] * v[i];
    cross(e, c, d);
    real s = dot(e, v);
    for (int i = 0; i < 3; i++) out[i] = q[0] * c[i] + d[i] + s * e[i];
}

/* Of a symmetric matrix; about an axis with (to 1e-12 of the trace) no moment there is no acceleration. */
static void invert(real M[3][3], real out[3][3]) {
    real A[3][3], B[3][3], trace = M[0][0] + M[1][1] + M[2][2], n[3] = {0, 0, 0};
    for (int pass = 0; pass < 2; pass++) {
        memcpy(B, M, sizeof B);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) B[i][j] += trace * n[i] * n[j];
        for (int i = 0; i < 3; i++) cross(B[(i + 1) % 3], B[(i + 2) % 3], A[i]);
        real det = dot(B[0], A[0]), minors = A[0][0] + A[1][1] + A[2][2];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) out[i][j] = A[j][i] / det - n[i] * n[j] / trace;
        if (pass || det > (real)1e-12 * trace * minors) return;
        int k = 0; /* the adjugate is minors n n^T */
        for (int i = 1; i < 3; i++) k = A[i][i] > A[k][k] ? i : k;
        real length = SQRT(dot(A[k], A[k]));
        for (int i = 0; i < 3; i++) n[i] = A[k][i] / length;
    }
}

static void set_loads(body *b, const double *p, const double *u) {
    for (int i = 0; i < 3; i++) {
        real force_a = (real)p[FORCE_A + i] + u[i], force_b = (real)p[FORCE_B + i] + u[3 + i];
        b->arm_force_a[i] = b->pivot ? b->mass * b->gravity[i] : force_a;
        b->arm_force_b[i] = b->pivot ? 0 : force_b;
        b->torque_a[i] = (real)p[TORQUE_A + i] + u[6 + i];
        b->torque_b[i] = (real)p[TORQUE_B + i] + u[9 + i];
    }
}

static void set_body(body *b, const double *p) {
    static const int at[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    real lever[3], square = 0, norm = 0;
    memset(b, 0, sizeof *b);
    b->mass = p[MASS], b->pivot = p[PIVOT] != 0;
    for (int i = 0; i < 3; i++) {
        b->r_oc[i] = p[R_OC + i], b->gravity[i] = p[GRAVITY + i], b->damping[i] = p[DAMPING + i];
        b->position_0[i] = p[POSITION_0 + i], b->omega[i] = p[OMEGA_0 + i];
        b->arm[i] = b->pivot ? b->r_oc[i] : -b->r_oc[i];
        square += b->r_oc[i] * b->r_oc[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            b->M[i][j] = p[INERTIA + at[i][j]];
            if (b->pivot) b->M[i][j] += b->mass * ((i == j ? square : 0) - b->r_oc[i] * b->r_oc[j]);
        }
    invert(b->M, b->inverse);
    for (int i = 0; i < 4; i++) b->q[i] = p[QUATERNION_0 + i], norm += b->q[i] * b->q[i];
    for (int i = 0; i < 4; i++) b->q[i] /= SQRT(norm);
    turn(b->q, 1, b->r_oc, lever);
    for (int i = 0; i < 3; i++) b->r_c[i] = b->position_0[i] + lever[i];
    cross(b->omega, b->r_oc, lever);
    turn(b->q, 1, lever, lever);
    for (int i = 0; i < 3; i++) b->v_c[i] = b->pivot ? 0 : p[VELOCITY_0 + i] + lever[i];
}

static real term(const series *v, int k) { return k <= FEW ? v->c[k] : (real)v->d[k]; }

static void set_term(series *v, int k, real x) {
    if (k <= FEW) v->c[k] = x;
    v->d[k] = (long double)x;
}

static real product(const series *a, const series *b, int k) {
    if (k > FEW) {
        long double sum = 0;
        for (int i = 0; i <= k; i++) sum += a->d[i] * b->d[k - i];
        return sum;
    }
    real sum = 0;
    for (int i = 0; i <= k; i++) sum += a->c[i] * b->c[k - i];
    return sum;
}

static real square(const series *a, int k) {
    if (k > FEW) return product(a, a, k);
    real sum = 0;
    for (int i = 0; i < (k + 1) / 2; i++) sum += a->c[i] * a->c[k - i];
    return 2 * sum + (k % 2 ? 0 : a->c[k / 2] * a->c[k / 2]);
}

/* omega x (M omega) */
static void gyroscopic(body *b, int k, real *out) {
    real P[3][3];
    int full = b->M[0][1] != 0 || b->M[0][2] != 0 || b->M[1][2] != 0;
    for (int i = 0; i < 3; i++) {
        P[i][i] = full ? square(&b->W[i], k) : 0;
        for (int j = 0; j < i; j++) P[i][j] = P[j][i] = product(&b->W[i], &b->W[j], k);
    }
    for (int i = 0; i < 3; i++) {
        int m = (i + 1) % 3, n = (i + 2) % 3;
        out[i] = b->M[n][i] * P[m][i] - b->M[m][i] * P[n][i] + b->M[m][n] * (P[m][m] - P[n][n])
                 + (b->M[n][n] - b->M[m][m]) * P[m][n];
    }
}

static int any(const real *v) { return v[0] != 0 || v[1] != 0 || v[2] != 0; }

/* The next term of a vector fixed in a, as b sees it. */
static void carry(series *v, series *w, int k) {
    for (int i = 0; i < 3; i++) {
        int m = (i + 1) % 3, n = (i + 2) % 3;
        set_term(&v[i], k + 1, (product(&v[m], &w[n], k) - product(&v[n], &w[m], k)) / (k + 1));
    }
}

static void rate_of_omega(body *b, int k, real *rate) {
    real gyro[3], force[3], torque[3];
    gyroscopic(b, k, gyro);
    for (int i = 0; i < 3; i++) force[i] = term(&b->F[i], k) + (k ? 0 : b->arm_force_b[i]);
    cross(b->arm, force, torque);
    for (int i = 0; i < 3; i++)
        torque[i] += (k ? 0 : b->torque_b[i]) + term(&b->T[i], k) - b->damping[i] * term(&b->W[i], k) - gyro[i];
    times(b->inverse, torque, rate);
}

/* The k-th term of R(q) v, v constant in b. */
static void pushed(body *b, const real *v, int k, real *out) {
    real S[4][4];
    for (int i = 0; i < 4; i++) {
        S[i][i] = square(&b->Q[i], k);
        for (int j = 0; j < i; j++) S[i][j] = S[j][i] = product(&b->Q[i], &b->Q[j], k);
    }
    for (int i = 0; i < 3; i++) {
        int m = (i + 1) % 3, n = (i + 2) % 3;
        out[i] = (S[0][0] + S[i + 1][i + 1] - S[m + 1][m + 1] - S[n + 1][n + 1]) * v[i]
                 + 2 * (S[i + 1][m + 1] - S[0][n + 1]) * v[m] + 2 * (S[i + 1][n + 1] + S[0][m + 1]) * v[n];
    }
}

static void begin(body *b) {
    real force[3], torque[3];
    turn(b->q, -1, b->arm_force_a, force), turn(b->q, -1, b->torque_a, torque);
    for (int i = 0; i < 4; i++) set_term(&b->Q[i], 0, b->q[i]);
    for (int i = 0; i < 3; i++) {
        set_term(&b->W[i], 0, b->omega[i]), set_term(&b->V[i], 0, b->v_c[i]), set_term(&b->R[i], 0, b->r_c[i]);
        set_term(&b->F[i], 0, force[i]), set_term(&b->T[i], 0, torque[i]);
    }
}

static void rates_of_q(body *b, int k) {
    const series *q = b->Q, *w = b->W;
    real half = (real)0.5 / (k + 1), rate[4];
    rate[0] = -product(&q[1], &w[0], k) - product(&q[2], &w[1], k) - product(&q[3], &w[2], k);
    for (int i = 0; i < 3; i++) {
        int m = (i + 1) % 3, n = (i + 2) % 3;
        rate[i + 1] = product(&q[0], &w[i], k) + product(&q[m + 1], &w[n], k) - product(&q[n + 1], &w[m], k);
    }
    for (int i = 0; i < 4; i++) set_term(&b->Q[i], k + 1, half * rate[i]);
}

static void expand(body *b) {
    int turned = any(b->arm) && any(b->arm_force_a), twisted = any(b->torque_a);
    int push = !b->pivot && any(b->arm_force_b);
    real rate[3];
    memset(b->F, 0, sizeof b->F), memset(b->T, 0, sizeof b->T);
    begin(b);
    if (!turned) memset(b->F, 0, sizeof b->F);
    b->terms = push ? ORDER : 2;
    for (int k = 0; k < ORDER; k++) {
        rate_of_omega(b, k, rate);
        rates_of_q(b, k);
        for (int i = 0; i < 3; i++) set_term(&b->W[i], k + 1, rate[i] / (k + 1));
        if (turned) carry(b->F, b->W, k);
        if (twisted) carry(b->T, b->W, k);
        if (k >= b->terms) continue;
        real a[3] = {0, 0, 0};
        if (push) pushed(b, b->arm_force_b, k, a);
        for (int i = 0; i < 3; i++) {
            a[i] = b->pivot ? 0 : a[i] / b->mass + (k ? 0 : b->gravity[i] + b->arm_force_a[i] / b->mass);
            set_term(&b->R[i], k + 1, term(&b->V[i], k) / (k + 1)), set_term(&b->V[i], k + 1, a[i] / (k + 1));
        }
    }
}

static double log2_of(series *v, int count, int k) {
    double largest = -1e9;
    for (int i = 0; i < count; i++) {
        int exponent;
        real x = term(&v[i], k);
        if (x == 0) continue;
        double size = log2(fabs(SIGNIFICAND(x, &exponent)));
        size += exponent;
        largest = size > largest ? size : largest;
    }
    return largest;
}

/* log2 of the step at which the last terms of these series are small beside the largest of the first half. */
static double longest_step(series *v, int count) {
    double low = -400, high = 400;
    double last[2] = {log2_of(v, count, ORDER - 1), log2_of(v, count, ORDER)}, first[ORDER / 2];
    if (last[0] < -1e8 && last[1] < -1e8) return high;
    for (int k = 0; k < ORDER / 2; k++) first[k] = log2_of(v, count, k);
    for (int round = 0; round < 40; round++) {
        double h = 0.5 * (low + high), size = -1e9;
        for (int k = 0; k < ORDER / 2; k++) size = fmax(size, first[k] + k * h);
        double term = fmax(last[0] + (ORDER - 1) * h, last[1] + ORDER * h);
        if (term <= size + LAST_TERM) low = h; else high = h;
    }
    return low;
}

static double step_of(body *b) {
    double h = fmin(longest_step(b->Q, 4), longest_step(b->W, 3));
    if (b->terms == ORDER) h = fmin(h, fmin(longest_step(b->V, 3), longest_step(b->R, 3)));
    return exp2(fmin(h, 300));
}

static void horner(series *v, int count, int terms, real t, real *out) {
    for (int i = 0; i < count; i++) {
        long double tail = 0, step = t;
        int k = terms;
        for (; k > FEW && k <= ORDER; k--) tail = (tail + v[i].d[k]) * step;
        real sum = tail;
        for (; k > 0; k--) sum = (sum + v[i].c[k]) * t;
        out[i] = sum + v[i].c[0];
    }
}

static void advance(body *b, real t) {
    real square = 0;
    horner(b->Q, 4, ORDER, t, b->q), horner(b->W, 3, ORDER, t, b->omega);
    horner(b->V, 3, b->terms, t, b->v_c), horner(b->R, 3, b->terms, t, b->r_c);
    for (int i = 0; i < 4; i++) square += b->q[i] * b->q[i];
    for (int i = 0; i < 4; i++) b->q[i] /= SQRT(square);
}

static void put_attitude(const real *q, const real *omega, real *out) {
    for (int i = 0; i < 4; i++) out[QUATERNION + i] = q[i];
    real sine = 2 * (q[0] * q[2] - q[1] * q[3]);
    out[RPY] = ATAN2(2 * (q[0] * q[1] + q[2] * q[3]), q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3]);
    out[RPY + 1] = ATAN2(sine, SQRT(sine * sine < 1 ? 1 - sine * sine : 0));
    out[RPY + 2] = ATAN2(2 * (q[0] * q[3] + q[1] * q[2]), q[0] * q[0] + q[1] * q[1] - q[2] * q[2] - q[3] * q[3]);
    turn(q, 1, omega, out + OMEGA_A);
    for (int i = 0; i < 3; i++) out[OMEGA_B + i] = omega[i];
}

/* All quantities, of the loads now set. */
static void quantities(body *b, real *out) {
    real momentum[3], swing[3], lever[3], a_r[3], rate[3];
    put_attitude(b->q, b->omega, out);
    real force[3];
    begin(b);
    rate_of_omega(b, 0, rate);
    times(b->M, b->omega, momentum);
    real energy = dot(b->omega, momentum) / 2 + (b->pivot ? 0 : b->mass * dot(b->v_c, b->v_c) / 2);
    out[ENERGY] = energy;
    turn(b->q, 1, momentum, out + MOMENTUM);
    cross(b->omega, b->r_oc, swing);
    cross(rate, b->r_oc, lever), cross(b->omega, swing, a_r);
    for (int i = 0; i < 3; i++) lever[i] += a_r[i];
    turn(b->q, 1, lever, lever), turn(b->q, 1, swing, swing), turn(b->q, 1, b->arm_force_b, force);
    turn(b->q, 1, b->r_oc, a_r);
    for (int i = 0; i < 3; i++) {
        real a_c = b->gravity[i] + (b->arm_force_a[i] + force[i]) / b->mass;
        out[ALPHA + i] = rate[i];
        out[ACCELERATION + i] = b->pivot ? 0 : a_c - lever[i];
        out[VELOCITY + i] = b->pivot ? 0 : b->v_c[i] - swing[i];
        out[POSITION + i] = b->pivot ? b->position_0[i] : b->r_c[i] - a_r[i];
    }
}

static double norm_of(const real *v, int count) {
    double sum = 0;
    for (int i = 0; i < count; i++) sum += (double)v[i] * (double)v[i];
    return sqrt(sum);
}

/* Largest size of each quantity so far. */
static void note(const real *out, double *sizes) {
    static const int at[SIZES] = {POSITION, VELOCITY, ACCELERATION, QUATERNION, RPY, OMEGA_B, OMEGA_A, ALPHA, MOMENTUM,
                                  ENERGY};
    static const int count[SIZES] = {3, 3, 3, 4, 3, 3, 3, 3, 3, 1};
    for (int i = 0; i < SIZES; i++) sizes[i] = fmax(sizes[i], norm_of(out + at[i], count[i]));
}

static void put(const real *values, double *row) {
    for (int i = 0; i < COUNT; i++) {
        row[2 * i] = (double)values[i];
        row[2 * i + 1] = (double)(values[i] - row[2 * i]);
    }
}

/* Largest torque by its parts, and the accelerations that they make, whatever cancels: what round-off is relative to. */
static void note_scales(body *b, double *scales) {
    real parts[4][3], alpha[3];
    double torque = 0, angular = 0, linear = 0;
    for (int i = 0; i < 3; i++) parts[0][i] = b->torque_a[i], parts[1][i] = b->torque_b[i];
    for (int i = 0; i < 3; i++) parts[2][i] = b->damping[i] * b->omega[i], parts[3][i] = 0;
    double levered = norm_of(b->arm, 3) * (norm_of(b->arm_force_a, 3) + norm_of(b->arm_force_b, 3));
    for (int k = 0; k < 3; k++) {
        times(b->inverse, parts[k], alpha);
        torque += norm_of(parts[k], 3), angular += norm_of(alpha, 3);
    }
    double trace = (double)(b->M[0][0] + b->M[1][1] + b->M[2][2]), omega = norm_of(b->omega, 3);
    angular += omega * omega + levered / trace;
    linear = norm_of(b->gravity, 3) + (norm_of(b->arm_force_a, 3) + norm_of(b->arm_force_b, 3)) / (double)b->mass;
    linear += (omega * omega + angular) * norm_of(b->r_oc, 3);
    double now[SCALES] = {omega + sqrt((torque + levered) / trace), angular, linear, trace};
    for (int i = 0; i < SCALES; i++) scales[i] = fmax(scales[i], now[i]);
}

/* n segments of length h[i] under inputs u[12 i..]; all quantities as (high, low) at the start and each one's end.
   Returns the series that it took, or -1 where that were more than `most`. */
int body_motion(const double *p, int n, const double *h, const double *u, int most, double *rows, double *sizes,
                double *scales) {
    body b;
    real out[COUNT], at = 0, end = 0;
    int expansions = 0, fresh = 0;
    set_body(&b, p), set_loads(&b, p, u);
    quantities(&b, out), put(out, rows), note(out, sizes), note_scales(&b, scales);
    for (int i = 0; i < n; i++) {
        real left = h[i];
        int same = i > 0 && !memcmp(u + 12 * i, u + 12 * (i - 1), 12 * sizeof *u);
        if (!same) {
            if (fresh) advance(&b, at);
            set_loads(&b, p, u + 12 * i), fresh = 0;
        }
        while (!fresh || at + left > end) {
            if (fresh) {
                left -= end - at;
                advance(&b, end);
                quantities(&b, out), note(out, sizes), note_scales(&b, scales);
            }
            if (++expansions > most) return -1;
            expand(&b), at = 0, end = step_of(&b), fresh = 1;
            if (!(end > 0)) return -2;
        }
        at += left;
        body here = b;
        advance(&here, at), quantities(&here, out);
        put(out, rows + 2 * COUNT * (i + 1)), note(out, sizes), note_scales(&here, scales);
    }
    return expansions;
}

/* Rates held over each segment: q times exp(omega h / 2). */
int prescribed_motion(const double *q_0, int n, const double *h, const double *omega, double *rows, double *sizes) {
    real q[4], w[3] = {0, 0, 0}, out[COUNT] = {0}, norm = 0;
    for (int i = 0; i < 4; i++) q[i] = q_0[i], norm += q[i] * q[i];
    for (int i = 0; i < 4; i++) q[i] /= SQRT(norm);
    for (int i = 0; i < 3; i++) w[i] = n ? omega[i] : 0;
    put_attitude(q, w, out), put(out, rows), note(out, sizes);
    for (int s = 0; s < n; s++) {
        for (int i = 0; i < 3; i++) w[i] = omega[3 * s + i];
        real rate = SQRT(dot(w, w)), sine, cosine, product[4];
        SINCOS(rate * h[s] / 2, &sine, &cosine);
        real e[3] = {0, 0, 0}, c[3];
        for (int i = 0; i < 3 && rate > 0; i++) e[i] = sine * w[i] / rate;
        product[0] = q[0] * cosine - dot(q + 1, e);
        cross(q + 1, e, c);
        for (int i = 0; i < 3; i++) product[i + 1] = q[0] * e[i] + cosine * q[i + 1] + c[i];
        norm = 0;
        for (int i = 0; i < 4; i++) norm += product[i] * product[i];
        for (int i = 0; i < 4; i++) q[i] = product[i] / SQRT(norm);
        put_attitude(q, w, out), put(out, rows + 2 * COUNT * (s + 1)), note(out, sizes);
    }
    return n;
}
