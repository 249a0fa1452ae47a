/* The life of an instance and its values; cosimulation.h says what each function does. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

#define CACHE_LINE 64

/* --- the rules of calls */

static int is_in(const Instance *m, unsigned phases) { return phases >> m->now.phase & 1; }

int allowed(Instance *m, const char *call, Call what) {
    if (m && is_in(m, RULES[what].phases)) return 1;
    if (m) refuse(m, call, "%s %s", RULES[what].refusal, PHASE_NAMES[m->now.phase]);
    return 0;
}

int fit(Instance *m, const char *call, const unsigned v[], size_t n, size_t n_values) {
    size_t expected = 0;
    for (size_t i = 0; i < n; i++) expected += elements_of(v[i]).n;
    return n_values == expected || !refuse(m, call, "%zu values: expected %zu", n_values, expected);
}

int exchanged_in_update(Instance *m, const char *call, const unsigned v[], size_t n, Update how) {
    for (size_t i = 0; i < n; i++)
        if (m->update != how || !m->intermediate[v[i]])
            return !refuse(m, call, "%s cannot be %s in this intermediate update", named(v[i]).text,
                           how == CAN_SET ? "set" : "read");
    return 1;
}

/* Whether these value references are of Real variables, and so many values fit; any_output: whether there are outputs
   among them. */
static int are_reals(Instance *m, const char *call, const unsigned v[], size_t n, size_t n_values, int *any_output) {
    int found = 0;
    for (size_t i = 0; i < n; i++) {
        unsigned r;
        if (v[i] >= REFERENCES) return !refuse(m, call, "%s is no " REAL " variable", named(v[i]).text);
        r = *elements_of(v[i]).r;
        found |= r >= FIRST_OUTPUT && (!HAS_TIME || r != TIME);
    }
    *any_output = found;
    return fit(m, call, v, n, n_values);
}

/* Whether Real r may be set to this value now. */
int settable(Instance *m, const char *call, unsigned r, double value) {
    Causality causality = causality_of(r);
    if (r == TIME)
        refuse(m, call, "the time cannot be set: it follows from the steps");
    else if (!isfinite(value))
        refuse(m, call, "%s = %s: expected a finite number", VARIABLES[r].name, number(value).text);
    else if (!is_in(m, CAUSALITIES[causality].settable_in))
        refuse(m, call, SET_REFUSAL, CAUSALITIES[causality].name, VARIABLES[r].name,
               PHASE_NAMES[m->now.phase]);
    else
        return 1;
    return 0;
}

/* --- memory */

void *allocate(const Host *host, size_t size) {
    void *memory = host->allocate ? host->allocate(1, size) : malloc(size);
    if (memory) memset(memory, 0, size);
    return memory;
}

void release(const Host *host, void *memory) {
    if (host->allocate)
        host->release(memory);
    else
        free(memory);
}

/* An instance whose buffer begins with a cache line, because the kernels' vectors are fastest there. */
static Instance *new_instance(const Host *host, size_t size) {
    char *memory = allocate(host, size + CACHE_LINE);
    Instance *m;
    if (!memory) return NULL;
    m = (Instance *)(memory + -((uintptr_t)memory + offsetof(Instance, now.z)) % CACHE_LINE);
    m->memory = memory;
    return m;
}

/* --- life */

static void begin(State *s) {
    memset(s, 0, sizeof *s);
    s->time = START_TIME;
    s->stop = INFINITY;
    s->phase = INSTANTIATED;
    s->stale = 1;
    memcpy(s->z, START, sizeof START);
}

Instance *create_instance(const Host *host, const char *call, const char *name, const char *guid) {
    Instance *m;
    if (!name) return refuse_instance(host, call, name, "the instance has no name");
    if (!guid || strcmp(guid, GUID))
        return refuse_instance(host, call, name, "the " IDENTITY " is not that of this FMU, " GUID);
    m = new_instance(host, sizeof *m + strlen(name) + 1);
    if (!m) return refuse_instance(host, call, name, "no memory");
    m->host = *host;
    m->step = chosen_step();
    strcpy(m->name, name);
    begin(&m->now);
    return m;
}

void free_instance(Instance *m) {
    Host host;
    if (!m) return;
    host = m->host;
    while (m->saved) {
        Saved *next = m->saved->next;
        release(&host, m->saved);
        m->saved = next;
    }
    release(&host, m->memory);
}

Status set_up_experiment(Instance *m, const char *call, double start, int has_stop, double stop) {
    if (!allowed(m, call, SET_UP_EXPERIMENT)) return CALL_ERROR;
    if (!isfinite(start)) return refuse(m, call, "start time = %s: expected a finite number", number(start).text);
    if (has_stop && !(stop >= start))
        return refuse(m, call, "stop time = %s: expected none before the start, %s", number(stop).text,
                      number(start).text);
    m->now.time = start;
    if (START_PLACE >= 0) m->now.z[START_PLACE] = start;
    m->now.stop = has_stop ? stop : INFINITY;
    return CALL_OK;
}

Status enter_initialization(Instance *m, const char *call) {
    if (!allowed(m, call, ENTER_INITIALIZATION)) return CALL_ERROR;
    m->now.phase = INITIALIZING;
    return CALL_OK;
}

Status set_up_and_enter(Instance *m, const char *call, double start, int has_stop, double stop) {
    if (!allowed(m, call, ENTER_INITIALIZATION)) return CALL_ERROR;
    if (set_up_experiment(m, call, start, has_stop, stop) != CALL_OK) return CALL_ERROR;
    return enter_initialization(m, call);
}

Status terminate(Instance *m, const char *call) {
    if (!allowed(m, call, TERMINATE)) return CALL_ERROR;
    m->now.phase = TERMINATED;
    return CALL_OK;
}

Status reset(Instance *m) {
    if (!m) return CALL_ERROR;
    begin(&m->now);
    return CALL_OK;
}

/* --- initialisation */

typedef struct {
    char text[MESSAGE_SIZE / 2];
    size_t used;
} List;

/* Append to a text; what does not fit is cut off. */
static void append(List *list, const char *format, ...) {
    va_list arguments;
    if (list->used >= sizeof list->text) return;
    va_start(arguments, format);
    list->used += (size_t)vsnprintf(list->text + list->used, sizeof list->text - list->used, format, arguments);
    va_end(arguments);
}

/* Whether the parameters that the plan rests on have the values that it was made for. */
static int pinned_as_planned(Instance *m, const char *call) {
    for (int r = 0; r < REALS; r++) {
        double planned = START[OFFSETS[r]], value = m->now.z[OFFSETS[r]];
        if (VARIABLES[r].pinned && value != planned) {
            refuse(m, call, PINNED, VARIABLES[r].name, number(value).text, number(planned).text, VARIABLES[r].block);
            return 0;
        }
    }
    return 1;
}

static int is_changed_parameter(const Instance *m, int r) {
    return causality_of((unsigned)r) == PARAMETER && m->now.z[OFFSETS[r]] != START[OFFSETS[r]];
}

/* Refuse the values of a fault's block or, where the model does not serve the changed parameters, those parameters. */
static void refuse_parameters(Instance *m, const char *call, const Fault *fault) {
    List values = {"", 0}, blocks = {"", 0};
    const char *last_block = "";
    int all_changed = !strcmp(fault->block, CHANGED);
    for (int r = 0; r < REALS; r++) {
        if (all_changed ? !is_changed_parameter(m, r) : strcmp(VARIABLES[r].block, fault->block)) continue;
        append(&values, "%s%s = %s", values.used ? ", " : "", VARIABLES[r].name, number(m->now.z[OFFSETS[r]]).text);
        if (all_changed && strcmp(VARIABLES[r].block, last_block))
            append(&blocks, "%s%s", blocks.used ? "\", \"" : "", VARIABLES[r].block);
        last_block = VARIABLES[r].block;
    }
    if (!values.used) append(&values, "%s", *fault->block && !all_changed ? fault->block : "parameters");
    if (blocks.used)
        refuse(m, call, "%s: %s; " TO_VARY, values.text, fault->expected, blocks.text);
    else
        refuse(m, call, "%s: %s", values.text, fault->expected);
}

/* Set state and outputs from the parameters, or say which of them is wrong. */
static int initialized(Instance *m, const char *call) {
    int64_t fault;
    if (!pinned_as_planned(m, call)) return 0;
    fault = initialize(m->now.z);
    if (fault < 0 || fault >= (int64_t)(sizeof FAULTS / sizeof *FAULTS)) fault = UNKNOWN_FAULT;
    if (fault != NO_FAULT) {
        refuse_parameters(m, call, &FAULTS[fault]);
        return 0;
    }
    m->now.stale = 0;
    return 1;
}

Status exit_initialization(Instance *m, const char *call) {
    if (!allowed(m, call, EXIT_INITIALIZATION) || !initialized(m, call)) return CALL_ERROR;
    m->now.phase = STEPPING;
    return CALL_OK;
}

/* --- values */

/* Let the outputs follow what was set since the last step. */
int fresh(Instance *m, const char *call) {
    if (!allowed(m, call, GET_OUTPUTS)) return 0;
    if (!m->now.stale) return 1;
    if (m->now.phase == INITIALIZING) return initialized(m, call);
    if (outputs(m->now.z)) return !refuse(m, call, "with these inputs an output is not finite");
    m->now.stale = 0;
    return 1;
}

static double value_of(const Instance *m, unsigned r) {
    return HAS_TIME && r == TIME ? m->now.time : m->now.z[OFFSETS[r]];
}

Status get_reals(Instance *m, const char *call, const unsigned v[], size_t n, double values[], size_t n_values) {
    int any_output;
    if (!given(m, call, n, v, values) || !are_reals(m, call, v, n, n_values, &any_output)) return CALL_ERROR;
    if (!exchanged(m, call, v, n, CAN_GET) || (any_output && !fresh(m, call))) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        Elements e = elements_of(v[i]);
        for (size_t k = 0; k < e.n; k++) *values++ = value_of(m, e.r[k]);
    }
    return CALL_OK;
}

/* Whether a variable may be set to these values now; an element that stands in two places must have one value. */
static int all_settable(Instance *m, const char *call, Elements e, const double values[]) {
    for (size_t k = 0; k < e.n; k++) {
        if (!settable(m, call, e.r[k], values[k])) return 0;
        for (size_t twin = 0; twin < k; twin++)
            if (e.r[twin] == e.r[k] && values[twin] != values[k])
                return !refuse(m, call, "%s = %s and %s: expected a symmetric matrix", VARIABLES[e.r[k]].name,
                               number(values[twin]).text, number(values[k]).text);
    }
    return 1;
}

Status set_reals(Instance *m, const char *call, const unsigned v[], size_t n, const double values[], size_t n_values) {
    const double *next = values;
    int any_output;
    if (!given(m, call, n, v, values) || !are_reals(m, call, v, n, n_values, &any_output)) return CALL_ERROR;
    if (!exchanged(m, call, v, n, CAN_SET)) return CALL_ERROR;
    for (size_t i = 0; i < n; next += elements_of(v[i++]).n)
        if (!all_settable(m, call, elements_of(v[i]), next)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++) {
        Elements e = elements_of(v[i]);
        for (size_t k = 0; k < e.n; k++) m->now.z[OFFSETS[e.r[k]]] = *values++;
    }
    m->now.stale |= n > 0;
    return CALL_OK;
}

Status get_integers(Instance *m, const char *call, const unsigned r[], size_t n, int values[]) {
    if (!given(m, call, n, r, values)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++)
        if (!is_integer(r[i]))
            return refuse(m, call, "%s is no " INTEGER " variable", named(r[i]).text);
    if (!exchanged(m, call, r, n, CAN_GET)) return CALL_ERROR;
    for (size_t i = 0; i < n; i++)
        values[i] = (int)(r[i] == STATUS_REFERENCE ? m->now.status : m->now.z[COUNT_OFFSETS[r[i] - STATUS_REFERENCE - 1]]);
    return CALL_OK;
}

Status no_variables(Instance *m, const char *call, const unsigned r[], size_t n, const char *kind) {
    if (!given(m, call, n, r, r)) return CALL_ERROR;
    return n ? refuse(m, call, "%s is no %s", named(r[0]).text, kind) : CALL_OK;
}
