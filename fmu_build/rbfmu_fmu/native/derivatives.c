/* Derivatives: of inputs and outputs with respect to time, of outputs by inputs, and at the start by parameters. */

#include <math.h>

#include "instance.h"
#include "slopes.h"

static int has_derivative(Instance *m, const char *call, unsigned r, int order) {
    if (order >= 1 && order <= MAX_DERIVATIVE_ORDER && DERIVATIVES[r][order - 1] != NOT_PROVIDED) return 1;
    refuse(m, call, "%s has no derivative of order %d here", VARIABLES[r].name, order);
    return 0;
}

/* Whether these value references are of inputs, or of outputs, and so many values fit. */
static int are(Causality wanted, Instance *m, const char *call, const unsigned v[], size_t n, size_t n_values) {
    for (size_t i = 0; i < n; i++) {
        unsigned r = v[i] < REFERENCES ? *elements_of(v[i]).r : TIME;
        if (r == TIME || causality_of(r) != wanted)
            return !refuse(m, call, "%s is no " REAL " %s", named(v[i]).text, CAUSALITIES[wanted].name);
    }
    return fit(m, call, v, n, n_values);
}

/* --- with respect to time */

/* They count for one step, after which the kernels leave the input at its last value: u + u' h + u'' h^2 / 2. */
Status set_input_derivatives(Instance *m, const char *call, const unsigned v[], size_t n, const int order[],
                             const double values[]) {
    if (!given(m, call, n, v, values) || !given(m, call, n, order, order)) return CALL_ERROR;
    if (!allowed(m, call, SET_INPUT_DERIVATIVES) || !are(INPUT, m, call, v, n, n)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        unsigned r = *elements_of(v[i]).r;
        if (!has_derivative(m, call, r, order[i]) || !settable(m, call, r, values[i])) return CALL_ERROR;
    }
    for (size_t i = 0; i < n; i++) m->now.z[DERIVATIVES[*elements_of(v[i]).r][order[i] - 1]] = values[i];
    return CALL_OK;
}

Status get_output_derivatives(Instance *m, const char *call, const unsigned v[], size_t n, const int order[],
                              double values[], size_t n_values) {
    if (!given(m, call, n, v, values) || !given(m, call, n, order, order)) return CALL_ERROR;
    if (!are(OUTPUT, m, call, v, n, n_values)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++)
        if (!has_derivative(m, call, *elements_of(v[i]).r, order[i])) return CALL_ERROR;
    if (!exchanged(m, call, v, n, CAN_GET) || (n && !fresh(m, call))) return CALL_ERROR;
#ifdef OUTPUT_DERIVATIVES
    if (n) output_rates(m->now.z);
#endif
    for (size_t i = 0; i < n; i++) {
        Elements e = elements_of(v[i]);
        for (size_t k = 0; k < e.n; k++) *values++ = m->now.z[DERIVATIVES[e.r[k]][order[i] - 1]];
    }
    return CALL_OK;
}

/* --- of outputs by inputs, and by parameters while these can be set */

/* Whether these value references are of inputs, or of parameters in Initialization Mode, and so many values fit. */
static int are_known(Instance *m, const char *call, const unsigned v[], size_t n, size_t n_values) {
    for (size_t i = 0; i < n; i++) {
        unsigned r = v[i] < REFERENCES ? *elements_of(v[i]).r : TIME;
        if (r != TIME && causality_of(r) == PARAMETER && m->now.phase != INITIALIZING)
            return !refuse(m, call, "%s is a parameter, which is known in Initialization Mode alone", named(v[i]).text);
        if (r == TIME || causality_of(r) == OUTPUT)
            return !refuse(m, call, "%s is no input or parameter", named(v[i]).text);
    }
    return fit(m, call, v, n, n_values);
}

/* Whether the values of a direction are finite numbers. */
static int are_finite(Instance *m, const char *call, const double seed[], size_t n) {
    for (size_t k = 0; k < n; k++)
        if (!isfinite(seed[k])) return !refuse(m, call, "seed %s: expected a finite number", number(seed[k]).text);
    return 1;
}

/* Whether outputs have derivatives by these knowns now, and the seed and the result fit them. */
static int can_derive(Instance *m, const char *call, const Partial *of, int adjoint) {
    const double *of_outputs = adjoint ? of->seed : of->result, *of_inputs = adjoint ? of->result : of->seed;
    size_t n_of_outputs = adjoint ? of->n_seed : of->n_result, n_of_inputs = adjoint ? of->n_result : of->n_seed;
    return given(m, call, of->n_outputs, of->outputs, of_outputs) &&
           given(m, call, of->n_inputs, of->inputs, of_inputs) &&
           are(OUTPUT, m, call, of->outputs, of->n_outputs, n_of_outputs) &&
           are_known(m, call, of->inputs, of->n_inputs, n_of_inputs) &&
           are_finite(m, call, of->seed, of->n_seed) && fresh(m, call);
}

/* What an element counts: a number off the diagonal of an inertia stands twice in the matrix, each half of it. */
static double share(Elements e, size_t k) {
    int times = 0;
    for (size_t i = 0; i < e.n; i++) times += e.r[i] == e.r[k];
    return 1.0 / times;
}

/* Whether a parameter changes. Where none does, formulas without a derivative by one, as a norm at zero, say nothing. */
static int changes_parameters(const double *change) {
    for (unsigned r = FIRST_PARAMETER; r < FIRST_OUTPUT; r++)
        if (change[OFFSETS[r]] != 0.0) return 1;
    return 0;
}

/* Set how much outputs change at once with inputs, and at the start with parameters. */
static void change_outputs(const Instance *m, double *change) {
    feedthrough((double *)m->now.z, change);
    if (m->now.phase == INITIALIZING && changes_parameters(change)) add_changes(m->now.z, change);
}

/* A function of one's own may have no derivative where it stands, as a root at zero. */
static Status result_of(Instance *m, const char *call, const Partial *of) {
    for (size_t k = 0; k < of->n_result; k++)
        if (!isfinite(of->result[k])) return refuse(m, call, "no finite derivative here");
    return CALL_OK;
}

Status get_directional_derivative(Instance *m, const char *call, const Partial *of) {
    double change[CHANGES] = {0.0}, *result = of->result;
    const double *seed = of->seed;
    if (!can_derive(m, call, of, 0)) return CALL_ERROR;
    for (size_t i = 0; i < of->n_inputs; i++) {
        Elements e = elements_of(of->inputs[i]);
        for (size_t k = 0; k < e.n; k++) change[OFFSETS[e.r[k]]] += share(e, k) * *seed++;
    }
    change_outputs(m, change);
    for (size_t i = 0; i < of->n_outputs; i++) {
        Elements e = elements_of(of->outputs[i]);
        for (size_t k = 0; k < e.n; k++) *result++ = change[OFFSETS[e.r[k]]];
    }
    return result_of(m, call, of);
}

/* How much the outputs, weighted by the seed, change at once with one input or parameter. */
static double weighted_change(const Instance *m, const Partial *of, unsigned input) {
    double change[CHANGES] = {0.0}, sum = 0.0;
    const double *seed = of->seed;
    change[OFFSETS[input]] = 1.0;
    change_outputs(m, change);
    for (size_t i = 0; i < of->n_outputs; i++) {
        Elements e = elements_of(of->outputs[i]);
        for (size_t k = 0; k < e.n; k++) sum += *seed++ * change[OFFSETS[e.r[k]]];
    }
    return sum;
}

Status get_adjoint_derivative(Instance *m, const char *call, const Partial *of) {
    double *result = of->result;
    if (!can_derive(m, call, of, 1)) return CALL_ERROR;
    for (size_t i = 0; i < of->n_inputs; i++) {
        Elements e = elements_of(of->inputs[i]);
        for (size_t k = 0; k < e.n; k++) *result++ = share(e, k) * weighted_change(m, of, e.r[k]);
    }
    return result_of(m, call, of);
}
