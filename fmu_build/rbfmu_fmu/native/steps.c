/* Steps, and inputs that change within one: the importer gives them while the step is taken.

   It is asked twice, for the middle and for the end of the step, and again where it wants the step to end early. The
   input then follows the parabola through these two values and that of the beginning, by the kernels' own derivatives
   of inputs, and keeps the last one. Inputs that the importer leaves as they are give the same bits as a step without
   updates. After the step, outputs can be read. */

#include <math.h>

#include "instance.h"

#define ROUND_OFF 1e-9 /* of an importer's clock, relative; half a step at most */

enum { INPUTS = FIRST_PARAMETER, ROOM = INPUTS + 1 /* C has no arrays of no size */ };

/* The inputs at the beginning, the middle and the end of a step. */
typedef struct {
    double begin[ROOM], middle[ROOM], end[ROOM];
} Course;

/* Why a step cannot even be tried, or null. */
static const char *impossible(const State *s, double t, double h) {
    double clock = fmin(ROUND_OFF * fmax(h, fmax(fabs(t), fabs(s->time))), 0.5 * h);
    if (!(h > 0.0) || !isfinite(t + h)) return "the step size must be positive, and all times finite";
    if (!(t + h > t)) return "the step is too small for this time";
    if (fabs(t - s->time) > clock) return "this is not the time where the instance stands";
    if (t + h > s->stop + clock) return "the experiment ends before";
    return NULL;
}

static Status not_taken(Instance *m, const char *call, Status status, double t, double h, const char *reason) {
    m->now.status = STEP_REJECTED;
    m->now.discarded = status == CALL_DISCARD;
    return answer(m, status, call, "step from t = %s by %s s refused: %s (it stands at t = %s)", number(t).text,
                  number(h).text, reason, number(m->now.time).text);
}

/* A step that is possible, as the inputs now are. */
static Status take_step(Instance *m, const char *call, double t, double h) {
    if (m->step(m->now.z, h))
        return not_taken(m, call, CALL_DISCARD, t, h, "no finite motion, or none that the accuracy allows");
    m->now.time = t + h;
    m->now.status = t + h > LAST_TIME ? PAST_STOP : STEP_OK;
    m->now.stale = m->now.discarded = 0;
    return CALL_OK;
}

/* --- intermediate updates */

int is_updating(Instance *m, const char *call) {
    if (!m || m->update == NO_UPDATE) return 0;
    refuse(m, call, "not allowed in an intermediate update");
    return 1;
}

Status use_intermediate(Instance *m, const char *call, const unsigned v[], size_t n) {
    if (!given(m, call, n, v, v)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        int is_real = v[i] < REFERENCES && v[i] != TIME_REFERENCE;
        if (is_real ? causality_of(*elements_of(v[i]).r) == PARAMETER : !is_integer(v[i]))
            return refuse(m, call, "%s is no input or output for intermediate updates", named(v[i]).text);
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
static void ask(Instance *m, double t, double h, Course *course, EarlyReturn *early) {
    update(m, CAN_SET, t + 0.5 * h, early);
    get_inputs(m, course->middle);
    if (!early || !early->wanted) update(m, CAN_SET, t + h, early);
    get_inputs(m, course->end);
}

/* Let inputs follow the parabola through their values in a step h. */
static void put_course(Instance *m, double h, const Course *course) {
    for (int i = 0; i < INPUTS; i++) {
        double half = course->middle[i] - course->begin[i], whole = course->end[i] - course->begin[i];
        set_derivatives(m, i, (4.0 * half - whole) / h, 4.0 * (whole - 2.0 * half) / h / h);
    }
    put_inputs(m, course->begin);
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

/* Whether the importer may return when it wants to; if so, shorten the step and ask again, for what is left of it. */
static int can_shorten(Instance *m, double t, double *h, Course *course, EarlyReturn early) {
    if (!(early.time >= t && early.time <= t + *h)) return 0;
    put_inputs(m, course->begin);
    if (early.time < t + *h) *h = early.time - t;
    if (*h > 0.0) ask(m, t, *h, course, NULL);
    return 1;
}

/* Nothing of a step, because the importer wants to return where it begins. */
static Status stay(Instance *m) {
    m->now.status = m->now.time > LAST_TIME ? PAST_STOP : STEP_OK;
    m->now.discarded = 0;
    m->returned_early = 1;
    return CALL_OK;
}

/* Take a step along the course of the inputs, and let outputs be read. */
static Status follow(Instance *m, const char *call, double t, double h, const Course *course) {
    Status status;
    put_course(m, h, course);
    status = take_step(m, call, t, h);
    if (status == CALL_OK)
        keep(m, course->end);
    else
        forget(m, course->begin);
    return status;
}

/* A step that is possible, as the importer gives the inputs in intermediate updates. */
static Status take_updated_step(Instance *m, const char *call, double t, double h) {
    Course course;
    EarlyReturn early = {0, t};
    double whole = h;
    Status status;
    if (!inputs_can_change()) return take_step(m, call, t, h);
    get_inputs(m, course.begin);
    ask(m, t, h, &course, &early);
    if (early.wanted && !can_shorten(m, t, &h, &course, early)) {
        put_inputs(m, course.begin);
        return not_taken(m, call, CALL_ERROR, t, h, "the importer wants to return at a time outside of it");
    }
    if (!(h > 0.0)) return stay(m);
    status = follow(m, call, t, h, &course);
    if (status != CALL_OK) return status;
    m->returned_early = h < whole;
    if (m->returned_early) m->now.time = early.time; /* which t + h is but for round-off */
    update(m, CAN_GET, m->now.time, NULL);
    return CALL_OK;
}

/* --- what importers call */

Status do_step(Instance *m, const char *call, double t, double h) {
    const char *reason;
    if (m) m->returned_early = 0;
    if (!allowed(m, call, DO_STEP)) return CALL_ERROR;
    if ((reason = impossible(&m->now, t, h))) return not_taken(m, call, CALL_ERROR, t, h, reason);
    return m->host.update ? take_updated_step(m, call, t, h) : take_step(m, call, t, h);
}

Status get_last_successful_time(Instance *m, const char *call, double *t) {
    if (!given(m, call, 1, t, t)) return CALL_ERROR;
    *t = m->now.time;
    return CALL_OK;
}

Status get_discarded(Instance *m, const char *call, int *discarded) {
    if (!given(m, call, 1, discarded, discarded)) return CALL_ERROR;
    *discarded = m->now.discarded != 0;
    return CALL_OK;
}

Status get_returned_early(Instance *m, const char *call, int *early) {
    if (!given(m, call, 1, early, early)) return CALL_ERROR;
    *early = m->returned_early;
    return CALL_OK;
}
