/* Inputs that change within a step: the importer gives them while the step is taken.

   It is asked twice, for the middle and for the end of the step, and again where it wants the step to end early. The input then follows the parabola through these two
   values and that of the beginning, by the kernels' own derivatives of inputs, and keeps the last one. Inputs that the
   importer leaves as they are give the same bits as a step without updates. After the step, outputs can be read. */

#include <math.h>
#include <string.h>

#include "instance.h"

enum { INPUTS = FIRST_PARAMETER, ROOM = INPUTS + 1 /* C has no arrays of no size */ };

int exchanged(Instance *m, const char *call, unsigned v, Update how) {
    if (m->update == NO_UPDATE || (m->update == how && m->intermediate[v])) return 1;
    return !refuse(m, call, "value reference %u cannot be %s in this intermediate update", v,
                   how == CAN_SET ? "set" : "read");
}

int is_updating(Instance *m, const char *call) {
    if (!m || m->update == NO_UPDATE) return 0;
    refuse(m, call, "not allowed in an intermediate update");
    return 1;
}

Status use_intermediate(Instance *m, const char *call, const unsigned v[], size_t n) {
    if (!given(m, call, n, v, v)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        if (v[i] >= REFERENCES || v[i] == TIME_REFERENCE || causality_of(*elements_of(v[i]).r) == PARAMETER)
            return refuse(m, call, "value reference %u is no input or output for intermediate updates", v[i]);
        m->intermediate[v[i]] = 1;
    }
    return CALL_OK;
}

static void get_inputs(const Instance *m, double u[]) {
    for (int i = 0; i < INPUTS; i++) u[i] = m->now.z[OFFSETS[i]];
}

static void put_inputs(Instance *m, const double u[]) {
    for (int i = 0; i < INPUTS; i++) m->now.z[OFFSETS[i]] = u[i];
}

/* Whether there are inputs, and the kernels let every one change within a step. */
static int inputs_can_change(void) {
    for (int i = 0; i < INPUTS; i++)
        if (DERIVATIVES[i][1] == NOT_PROVIDED) return 0;
    return INPUTS > 0;
}

static void set_derivatives(Instance *m, int i, double first, double second) {
    m->now.z[DERIVATIVES[i][0]] = first;
    m->now.z[DERIVATIVES[i][1]] = second;
}

/* early: what the importer wants, or null where it is too late for that. */
static void update(Instance *m, Update how, double t, EarlyReturn *early) {
    m->update = how;
    m->host.update(&m->host, t, how == CAN_GET, early);
    m->update = NO_UPDATE;
}

/* What the importer gives for the middle and the end of a step; it may want to return early instead. */
static void ask(Instance *m, double t, double h, double middle[], double end[], EarlyReturn *early) {
    update(m, CAN_SET, t + 0.5 * h, early);
    get_inputs(m, middle);
    if (!early || !early->wanted) update(m, CAN_SET, t + h, early);
    get_inputs(m, end);
}

/* Let inputs follow their values at the beginning, the middle and the end of a step h. */
static void follow(Instance *m, double h, const double begin[], const double middle[], const double end[]) {
    for (int i = 0; i < INPUTS; i++) {
        double half = middle[i] - begin[i], whole = end[i] - begin[i];
        set_derivatives(m, i, (4.0 * half - whole) / h, 4.0 * (whole - 2.0 * half) / h / h);
    }
    put_inputs(m, begin);
}

/* Keep the values that the importer gave, which the parabola reaches but for round-off. */
static void keep(Instance *m, const double end[]) {
    for (int i = 0; i < INPUTS; i++) {
        m->now.stale |= m->now.z[OFFSETS[i]] != end[i];
        m->now.z[OFFSETS[i]] = end[i];
    }
}

static void forget(Instance *m, const double begin[]) {
    for (int i = 0; i < INPUTS; i++) set_derivatives(m, i, 0.0, 0.0);
    put_inputs(m, begin);
}

static Status refuse_updates(Instance *m, const char *call, const double begin[], double t, double h) {
    put_inputs(m, begin);
    return not_taken(m, call, CALL_ERROR, t, h, "the importer wants to return at a time outside of it");
}

/* Nothing of a step, because the importer wants to return where it begins. */
static Status stay(Instance *m, const double begin[]) {
    put_inputs(m, begin);
    m->now.status = m->now.time > LAST_TIME ? PAST_STOP : STEP_OK;
    m->now.discarded = 0;
    m->returned_early = 1;
    return CALL_OK;
}

Status take_updated_step(Instance *m, const char *call, double t, double h) {
    double begin[ROOM], middle[ROOM], end[ROOM];
    EarlyReturn early = {0, t};
    int is_early;
    Status status;
    if (!inputs_can_change()) return take_step(m, call, t, h);
    get_inputs(m, begin);
    ask(m, t, h, middle, end, &early);
    is_early = early.wanted && early.time < t + h;
    if (early.wanted && !(early.time >= t && early.time <= t + h)) return refuse_updates(m, call, begin, t, h);
    if (is_early && early.time == t) return stay(m, begin);
    if (early.wanted) {
        put_inputs(m, begin);
        if (is_early) h = early.time - t;
        ask(m, t, h, middle, end, NULL);
    }
    follow(m, h, begin, middle, end);
    status = take_step(m, call, t, h);
    if (status != CALL_OK) {
        forget(m, begin);
        return status;
    }
    keep(m, end);
    m->returned_early = is_early;
    if (is_early) m->now.time = early.time; /* which t + h is but for round-off */
    update(m, CAN_GET, m->now.time, NULL);
    return CALL_OK;
}
