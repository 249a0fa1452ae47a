/* FMI 2.0 co-simulation of one unit: the calls' rules, the messages, the saved states; of the body it knows nothing.

   model.h, generated, holds the scene's numbers and names; unit.h has the kernels, chosen for the processor. All
   memory of an instance is one allocation; there are no globals. A refused call returns fmi2Error, says why through
   the importer's logger, and changes nothing (but a refused step the variable `status`): the instance can go on. */

#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "model.h"
#include "unit.h"

enum { INSTANTIATED = 1, INITIALIZING = 2, STEPPING = 4, TERMINATED = 8 };
enum { FINE, NOT_REACHED, PAST_STOP };

#define TEXT 1024
#define CACHE_LINE 64
#define ROUND_OFF 1e-9 /* of an importer's clock, relative; half a step at most */

typedef struct {
    double time, stop; /* where the instance stands; the experiment's end, or infinite */
    int64_t mode, status, stale, discarded;
    double z[SIZE];
} State; /* what a saved state holds */

typedef struct Saved {
    struct Saved *next;
    State state;
} Saved;

typedef struct {
    char guid[48];
    uint64_t checksum;
    State state;
} Serialized;

typedef struct {
    void *memory; /* that it lies in */
    fmi2CallbackFunctions callbacks;
    Step *step;
    int logs_discards;
    Saved *saved; /* newest first; a pointer that is not among them is not followed */
    State now;
    char name[];
} Instance;

/* --- messages */

typedef struct {
    char text[40];
} Number;

/* The shortest digits that give back x, as Python writes them. */
static Number number(double x) {
    Number out;
    char *exponent, *point;
    int digits = 0, power;
    if (isnan(x) || isinf(x)) {
        strcpy(out.text, isnan(x) ? "nan" : x < 0.0 ? "-inf" : "inf");
        return out;
    }
    do {
        snprintf(out.text, sizeof out.text, "%.*e", digits, x);
    } while (strtod(out.text, NULL) != x && ++digits < 17);
    exponent = strchr(out.text, 'e');
    power = exponent ? atoi(exponent + 1) : 0;
    if (power >= -4 && power < 16)
        snprintf(out.text, sizeof out.text, "%.*f", digits > power ? digits - power : 1, x);
    point = out.text + strcspn(out.text, "0123456789");
    point += strspn(point, "0123456789");
    if (*point && *point != 'e') *point = '.'; /* whatever the host's locale has there */
    return out;
}

/* Log a message; discards only where asked for. No '%' is left to whom takes it for a format. */
static void tell(const fmi2CallbackFunctions *callbacks, const char *name, fmi2Status status, const char *text) {
    char escaped[2 * TEXT], *end = escaped;
    const char *category = status == fmi2Discard ? "logStatusDiscard" : "logStatusError";
    if (!callbacks || !callbacks->logger) return;
    for (; *text; text++) {
        *end++ = *text;
        if (*text == '%') *end++ = '%';
    }
    *end = 0;
    callbacks->logger(callbacks->componentEnvironment, name, status, category, escaped);
}

static fmi2Status refuse(Instance *m, const char *call, const char *format, ...) {
    char text[TEXT];
    int used = snprintf(text, sizeof text, "%s: ", call);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - (size_t)used, format, arguments);
    va_end(arguments);
    tell(&m->callbacks, m->name, fmi2Error, text);
    return fmi2Error;
}

static const char *phase(const Instance *m) {
    switch (m->now.mode) {
    case INSTANTIATED: return "before initialisation";
    case INITIALIZING: return "in initialisation";
    case STEPPING: return "while stepping";
    default: return "after termination";
    }
}

static int allowed(Instance *m, const char *call, int modes, const char *otherwise) {
    if (m && !(m->now.mode & modes)) refuse(m, call, "%s %s", otherwise, phase(m));
    return m && m->now.mode & modes;
}

static int given(Instance *m, const char *call, size_t n, const void *references, const void *values) {
    int fine = m && (n == 0 || (references && values));
    if (m && !fine) refuse(m, call, "null pointer");
    return fine;
}

/* --- memory */

static void *allocate(const fmi2CallbackFunctions *callbacks, size_t size) {
    int theirs = callbacks->allocateMemory && callbacks->freeMemory;
    void *memory = theirs ? callbacks->allocateMemory(1, size) : malloc(size);
    if (memory) memset(memory, 0, size);
    return memory;
}

static void release(const fmi2CallbackFunctions *callbacks, void *memory) {
    if (callbacks->allocateMemory && callbacks->freeMemory)
        callbacks->freeMemory(memory);
    else
        free(memory);
}

/* An instance whose buffer begins with a cache line, as the kernels' vectors like it. */
static Instance *new_instance(const fmi2CallbackFunctions *callbacks, size_t size) {
    char *memory = allocate(callbacks, size + CACHE_LINE);
    Instance *m;
    if (!memory) return NULL;
    m = (Instance *)(memory + -((uintptr_t)memory + offsetof(Instance, now.z)) % CACHE_LINE);
    m->memory = memory;
    return m;
}

static void begin(State *s) {
    memset(s, 0, sizeof *s);
    s->time = START_TIME;
    s->stop = INFINITY;
    s->mode = INSTANTIATED;
    s->stale = 1;
    memcpy(s->z, START, sizeof START);
}

/* --- life */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    static const fmi2CallbackFunctions none = {0};
    const char *wrong = NULL;
    Instance *m = NULL;
    (void)resources, (void)visible;
    if (!functions) functions = &none;
    if (!name)
        wrong = "fmi2Instantiate: the instance has no name";
    else if (type != fmi2CoSimulation)
        wrong = "fmi2Instantiate: this FMU is for co-simulation";
    else if (!guid || strcmp(guid, GUID))
        wrong = "fmi2Instantiate: the guid is not that of this FMU, " GUID;
    else if (!(m = new_instance(functions, sizeof *m + strlen(name) + 1)))
        wrong = "fmi2Instantiate: no memory";
    if (wrong) {
        tell(functions, name ? name : "", fmi2Error, wrong);
        return NULL;
    }
    m->callbacks = *functions;
    m->step = chosen_step();
    m->logs_discards = logging != fmi2False;
    strcpy(m->name, name);
    begin(&m->now);
    return m;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *m = c;
    fmi2CallbackFunctions callbacks;
    if (!m) return;
    callbacks = m->callbacks;
    while (m->saved) {
        Saved *next = m->saved->next;
        release(&callbacks, m->saved);
        m->saved = next;
    }
    release(&callbacks, m->memory);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    static const char *const known[] = CATEGORIES;
    Instance *m = c;
    int discards = n == 0;
    if (!given(m, "fmi2SetDebugLogging", n, categories, categories)) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        size_t k = 0;
        if (!categories[i]) return refuse(m, "fmi2SetDebugLogging", "null pointer");
        while (known[k] && strcmp(categories[i], known[k])) k++;
        if (!known[k]) return refuse(m, "fmi2SetDebugLogging", "there is no category %.64s", categories[i]);
        discards |= !strcmp(known[k], "logStatusDiscard") || !strcmp(known[k], "logAll");
    }
    m->logs_discards = on && discards;
    return fmi2OK;
}

/* The tolerance is the importer's wish; the accuracy is the scene's. */
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    const char *call = "fmi2SetupExperiment";
    Instance *m = c;
    (void)tolerance_defined, (void)tolerance;
    if (!allowed(m, call, INSTANTIATED, "the experiment cannot be set up")) return fmi2Error;
    if (!isfinite(start)) return refuse(m, call, "start time = %s: expected a finite number", number(start).text);
    if (stop_defined && !(stop >= start))
        return refuse(m, call, "stop time = %s: expected none before the start, %s", number(stop).text,
                      number(start).text);
    m->now.time = start;
    m->now.stop = stop_defined ? stop : INFINITY;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *m = c;
    if (!allowed(m, "fmi2EnterInitializationMode", INSTANTIATED, "initialisation cannot begin")) return fmi2Error;
    m->now.mode = INITIALIZING;
    return fmi2OK;
}

static int held(Instance *m, const char *call) {
    for (int r = 0; r < REALS; r++) {
        double planned = START[OFFSETS[r]], value = m->now.z[OFFSETS[r]];
        if (VARIABLES[r].held && value != planned) {
            refuse(m, call, HELD, VARIABLES[r].name, number(value).text, number(planned).text,
                   VARIABLES[r].block);
            return 0;
        }
    }
    return 1;
}

static int changed(const Instance *m, int r) {
    return r >= FIRST_PARAMETER && r < FIRST_OUTPUT && m->now.z[OFFSETS[r]] != START[OFFSETS[r]];
}

/* Set state and outputs from the parameters, or say which of them is wrong. */
static int initialized(Instance *m, const char *call) {
    char values[TEXT / 2] = "", blocks[TEXT / 8] = "", remedy[TEXT / 4] = "";
    size_t used = 0, listed = 0;
    int model, last = -1;
    int64_t fault;
    if (!held(m, call)) return 0;
    fault = initialize(m->now.z);
    if (fault == 0) {
        m->now.stale = 0;
        return 1;
    }
    if (fault < 0 || fault >= (int64_t)(sizeof FAULTS / sizeof *FAULTS)) fault = 0;
    model = !strcmp(FAULTS[fault].block, CHANGED);
    for (int r = 0; r < REALS; r++) {
        if (model ? !changed(m, r) : strcmp(VARIABLES[r].block, FAULTS[fault].block)) continue;
        if (used < sizeof values)
            used += (size_t)snprintf(values + used, sizeof values - used, "%s%s = %s", used ? ", " : "",
                                     VARIABLES[r].name, number(m->now.z[OFFSETS[r]]).text);
        if (model && (last < 0 || strcmp(VARIABLES[last].block, VARIABLES[r].block)) && listed < sizeof blocks)
            listed += (size_t)snprintf(blocks + listed, sizeof blocks - listed, "%s%s", listed ? "\", \"" : "",
                                       VARIABLES[r].block);
        last = r;
    }
    if (listed)
        snprintf(remedy, sizeof remedy, "; " TO_VARY, blocks);
    refuse(m, call, "%s: %s%s", used ? values : *FAULTS[fault].block && !model ? FAULTS[fault].block : "parameters",
           FAULTS[fault].expected, remedy);
    return 0;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    const char *call = "fmi2ExitInitializationMode";
    Instance *m = c;
    if (!allowed(m, call, INITIALIZING, "initialisation cannot end") || !initialized(m, call)) return fmi2Error;
    m->now.mode = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *m = c;
    if (!allowed(m, "fmi2Terminate", STEPPING, "there is nothing to terminate")) return fmi2Error;
    m->now.mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    if (!c) return fmi2Error;
    begin(&((Instance *)c)->now);
    return fmi2OK;
}

/* --- values */

/* Outputs follow what was set since the step. */
static int fresh(Instance *m, const char *call) {
    if (!allowed(m, call, INITIALIZING | STEPPING | TERMINATED, "outputs have no values")) return 0;
    if (!m->now.stale) return 1;
    if (m->now.mode == INITIALIZING) return initialized(m, call);
    outputs(m->now.z);
    m->now.stale = 0;
    return 1;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    const char *call = "fmi2GetReal";
    Instance *m = c;
    int any_output = 0;
    if (!given(m, call, n, r, values)) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= REALS) return refuse(m, call, "value reference %u is no Real variable", r[i]);
        any_output |= r[i] >= FIRST_OUTPUT;
    }
    if (any_output && !fresh(m, call)) return fmi2Error;
    for (size_t i = 0; i < n; i++) values[i] = m->now.z[OFFSETS[r[i]]];
    return fmi2OK;
}

static int settable(Instance *m, const char *call, fmi2ValueReference r, double value) {
    if (r >= REALS) {
        refuse(m, call, "value reference %u is no Real variable", r);
        return 0;
    }
    if (!isfinite(value)) {
        refuse(m, call, "%s = %s: expected a finite number", VARIABLES[r].name, number(value).text);
        return 0;
    }
    if (r >= FIRST_OUTPUT || m->now.mode == TERMINATED || (r >= FIRST_PARAMETER && m->now.mode == STEPPING)) {
        const char *causality = r >= FIRST_OUTPUT ? "output" : r >= FIRST_PARAMETER ? "parameter" : "input";
        refuse(m, call, "%s %s cannot be set %s", causality, VARIABLES[r].name, phase(m));
        return 0;
    }
    return 1;
}

/* All of them or, with fmi2Error, none. */
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    const char *call = "fmi2SetReal";
    Instance *m = c;
    if (!given(m, call, n, r, values)) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (!settable(m, call, r[i], values[i])) return fmi2Error;
    for (size_t i = 0; i < n; i++) m->now.z[OFFSETS[r[i]]] = values[i];
    m->now.stale = 1;
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[]) {
    Instance *m = c;
    if (!given(m, "fmi2GetInteger", n, r, values)) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (r[i] != REALS) return refuse(m, "fmi2GetInteger", "value reference %u is no Integer variable", r[i]);
    for (size_t i = 0; i < n; i++) values[i] = (fmi2Integer)m->now.status;
    return fmi2OK;
}

static fmi2Status none(Instance *m, const char *call, const fmi2ValueReference r[], size_t n, const char *kind) {
    if (!given(m, call, n, r, r)) return fmi2Error;
    return n ? refuse(m, call, "value reference %u is no %s", r[0], kind) : fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer values[]) {
    (void)values;
    return none(c, "fmi2SetInteger", r, n, "Integer variable that can be set");
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean values[]) {
    (void)values;
    return none(c, "fmi2GetBoolean", r, n, "Boolean variable");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean values[]) {
    (void)values;
    return none(c, "fmi2SetBoolean", r, n, "Boolean variable");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String values[]) {
    (void)values;
    return none(c, "fmi2GetString", r, n, "String variable");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String values[]) {
    (void)values;
    return none(c, "fmi2SetString", r, n, "String variable");
}

/* --- derivatives with respect to time */

static int derivative_known(Instance *m, const char *call, fmi2ValueReference r, fmi2Integer order, int output) {
    if (r >= REALS || (r >= FIRST_OUTPUT) != output)
        refuse(m, call, "value reference %u is no %s", r, output ? "output" : "input");
    else if (order < 1 || order > MOST_RATES || RATES[r][order - 1] < 0)
        refuse(m, call, "%s has no derivative of order %d here", VARIABLES[r].name, order);
    else
        return 1;
    return 0;
}

/* They count for one step, after which the kernels leave the input at its last value: u + u' h + u'' h^2 / 2. */
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[]) {
    const char *call = "fmi2SetRealInputDerivatives";
    Instance *m = c;
    if (!given(m, call, n, r, values) || !given(m, call, n, order, order)) return fmi2Error;
    if (!allowed(m, call, INSTANTIATED | INITIALIZING | STEPPING, "derivatives of inputs cannot be set"))
        return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (!derivative_known(m, call, r[i], order[i], 0) || !settable(m, call, r[i], values[i])) return fmi2Error;
    for (size_t i = 0; i < n; i++) m->now.z[RATES[r[i]][order[i] - 1]] = values[i];
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real values[]) {
    const char *call = "fmi2GetRealOutputDerivatives";
    Instance *m = c;
    if (!given(m, call, n, r, values) || !given(m, call, n, order, order)) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (!derivative_known(m, call, r[i], order[i], 1)) return fmi2Error;
    if (n && !fresh(m, call)) return fmi2Error;
#ifdef OUTPUT_RATES
    if (n) output_rates(m->now.z);
#endif
    for (size_t i = 0; i < n; i++) values[i] = m->now.z[RATES[r[i]][order[i] - 1]];
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real by[],
                                        fmi2Real values[]) {
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)by, (void)values;
    return c ? refuse(c, "fmi2GetDirectionalDerivative", "not provided") : fmi2Error;
}

/* --- steps */

/* Why a step cannot even be tried, or NULL. */
static const char *impossible(const State *s, double t, double h) {
    double clock = fmin(ROUND_OFF * fmax(h, fmax(fabs(t), fabs(s->time))), 0.5 * h);
    if (!(h > 0.0) || !isfinite(t + h)) return "the step size must be positive, and all times finite";
    if (!(t + h > t)) return "the step is too small for this time";
    if (fabs(t - s->time) > clock) return "this is not the time where the instance stands";
    if (t + h > s->stop + clock) return "the experiment ends before";
    return NULL;
}

static fmi2Status not_taken(Instance *m, fmi2Status status, double t, double h, const char *reason) {
    char text[TEXT];
    m->now.status = NOT_REACHED;
    m->now.discarded = status == fmi2Discard;
    snprintf(text, sizeof text, "fmi2DoStep: step from t = %s by %s s refused: %s (it stands at t = %s)",
             number(t).text, number(h).text, reason, number(m->now.time).text);
    if (status == fmi2Error || m->logs_discards) tell(&m->callbacks, m->name, status, text);
    return status;
}

/* All of a step or nothing of it. */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean never_back) {
    Instance *m = c;
    const char *reason;
    (void)never_back;
    if (!allowed(m, "fmi2DoStep", STEPPING, "no step can be taken")) return fmi2Error;
    if ((reason = impossible(&m->now, t, h))) return not_taken(m, fmi2Error, t, h, reason);
    if (m->step(m->now.z, h))
        return not_taken(m, fmi2Discard, t, h, "no finite motion, or none that the accuracy allows");
    m->now.time = t + h;
    m->now.status = t + h > LAST_TIME ? PAST_STOP : FINE;
    m->now.stale = m->now.discarded = 0;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    return c ? refuse(c, "fmi2CancelStep", "no step is pending") : fmi2Error;
}

static fmi2Status no_status(Instance *m, const char *call, fmi2StatusKind kind) {
    char text[TEXT];
    snprintf(text, sizeof text, "%s: there is no status of kind %d", call, (int)kind);
    if (m && m->logs_discards) tell(&m->callbacks, m->name, fmi2Discard, text);
    return m ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)value;
    return no_status(c, "fmi2GetStatus", kind);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    Instance *m = c;
    if (kind != fmi2LastSuccessfulTime || !m) return no_status(m, "fmi2GetRealStatus", kind);
    if (!given(m, "fmi2GetRealStatus", 1, value, value)) return fmi2Error;
    *value = m->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)value;
    return no_status(c, "fmi2GetIntegerStatus", kind);
}

/* True after a discarded step: from here the motion cannot go on as it is. */
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    Instance *m = c;
    if (kind != fmi2Terminated || !m) return no_status(m, "fmi2GetBooleanStatus", kind);
    if (!given(m, "fmi2GetBooleanStatus", 1, value, value)) return fmi2Error;
    *value = m->now.discarded ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)value;
    return no_status(c, "fmi2GetStringStatus", kind);
}

/* --- saved states */

/* The link to a saved state of this instance, or NULL. */
static Saved **link_to(Instance *m, fmi2FMUstate state) {
    Saved **link = &m->saved;
    while (*link && *link != state) link = &(*link)->next;
    return *link ? link : NULL;
}

static Saved *new_saved(Instance *m, const char *call) {
    Saved *saved = allocate(&m->callbacks, sizeof *saved);
    if (!saved) {
        refuse(m, call, "no memory");
        return NULL;
    }
    saved->next = m->saved;
    return m->saved = saved;
}

static Saved *saved_of(Instance *m, const char *call, fmi2FMUstate state) {
    Saved **link = m ? link_to(m, state) : NULL;
    if (m && !link) refuse(m, call, "this is no saved state of this instance");
    return link ? *link : NULL;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    const char *call = "fmi2GetFMUstate";
    Instance *m = c;
    Saved *saved;
    if (!given(m, call, 1, state, state)) return fmi2Error;
    saved = *state ? saved_of(m, call, *state) : new_saved(m, call);
    if (!saved) return fmi2Error;
    saved->state = m->now;
    *state = saved;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Instance *m = c;
    Saved *saved = saved_of(m, "fmi2SetFMUstate", state);
    if (!saved) return fmi2Error;
    m->now = saved->state;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    Instance *m = c;
    Saved **link, *next;
    if (!m) return fmi2Error;
    if (!state || !*state) return fmi2OK;
    if (!saved_of(m, "fmi2FreeFMUstate", *state)) return fmi2Error;
    link = link_to(m, *state);
    next = (*link)->next;
    release(&m->callbacks, *link);
    *link = next;
    *state = NULL;
    return fmi2OK;
}

static uint64_t checksum(const State *state) { /* FNV-1a */
    const unsigned char *bytes = (const unsigned char *)state;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof *state; i++) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

static int is_valid(const Serialized *s) {
    static const char guid[sizeof s->guid] = GUID; /* with the zeros behind it */
    const State *state = &s->state;
    int64_t mode = state->mode;
    if (memcmp(s->guid, guid, sizeof guid) || s->checksum != checksum(state)) return 0;
    if (mode != INSTANTIATED && mode != INITIALIZING && mode != STEPPING && mode != TERMINATED) return 0;
    for (int r = 0; r < FIRST_OUTPUT; r++)
        if (!isfinite(state->z[OFFSETS[r]])) return 0;
    return isfinite(state->time) && !isnan(state->stop) && state->status >= FINE && state->status <= PAST_STOP;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    Instance *m = c;
    if (!given(m, "fmi2SerializedFMUstateSize", 1, size, size)) return fmi2Error;
    if (!saved_of(m, "fmi2SerializedFMUstateSize", state)) return fmi2Error;
    *size = sizeof(Serialized);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    const char *call = "fmi2SerializeFMUstate";
    Instance *m = c;
    Saved *saved = saved_of(m, call, state);
    Serialized s = {.guid = GUID};
    if (!saved || !given(m, call, 1, bytes, bytes)) return fmi2Error;
    if (size < sizeof s) return refuse(m, call, "%zu bytes: expected room for %zu", size, sizeof s);
    s.state = saved->state;
    s.checksum = checksum(&s.state);
    memcpy(bytes, &s, sizeof s);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    const char *call = "fmi2DeSerializeFMUstate";
    Instance *m = c;
    Saved **link, *saved;
    Serialized s;
    if (!given(m, call, 1, bytes, state)) return fmi2Error;
    if (size == sizeof s) memcpy(&s, bytes, sizeof s);
    if (size != sizeof s || !is_valid(&s)) return refuse(m, call, "these %zu bytes are no state of this FMU", size);
    link = link_to(m, *state);
    saved = link ? *link : new_saved(m, call);
    if (!saved) return fmi2Error;
    saved->state = s.state;
    *state = saved;
    return fmi2OK;
}
