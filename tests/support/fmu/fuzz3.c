/* Bytes become FMI 3.0 calls on the C layer, also from within intermediate updates. See fuzzing.h. */

#include "fmi3Functions.h"

#define BYTE fmi3Byte
#define FREE_INSTANCE fmi3FreeInstance
#define GET_STATE fmi3GetFMUState
#define SET_STATE fmi3SetFMUState
#define FREE_STATE fmi3FreeFMUState
#define STATE_SIZE fmi3SerializedFMUStateSize
#define SERIALIZE_STATE fmi3SerializeFMUState
#define DESERIALIZE_STATE fmi3DeserializeFMUState
#include "fuzzing.h"

enum { MOST_ELEMENTS = 9 };

/* How many value references are those of inputs, or of inputs and parameters. */
static unsigned references_below(unsigned real_number) {
    unsigned v = 0;
    while (v < REFERENCES && ELEMENTS[FIRST_ELEMENT[v]] < real_number) v++;
    return v;
}

#define INPUT_REFERENCES references_below(FIRST_PARAMETER)
#define OUTPUT_REFERENCE references_below(FIRST_OUTPUT)

/* --- the importer's side */

static void their_logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                         fmi3String message) {
    size_t hashes = 0;
    (void)environment;
    if (!category || !message || !*message || (status != fmi3Warning && status != fmi3Discard && status != fmi3Error)) wrong("a message");
    for (; *message; message++) hashes += *message == '#';
    if (hashes % 2) wrong("a single # in a message");
    messages++;
}

static void any_call(int k);
static int depth;

/* Calls of all kinds, most of which are not allowed now; freeing another instance is. */
static void their_update(fmi3InstanceEnvironment environment, fmi3Float64 t, fmi3Boolean may_set, fmi3Boolean may_get,
                         fmi3Boolean finished, fmi3Boolean can_return, fmi3Boolean *early, fmi3Float64 *when) {
    int k = (int)(intptr_t)environment;
    if (may_set == may_get || may_get != finished || !early || !when || !isfinite(t)) wrong("an update");
    depth++;
    for (int calls = (int)take(3); calls && depth < 3; calls--) any_call(k);
    if (can_return && take(4) == 0) *early = fmi3True, *when = take(2) ? t : real(1.0);
    depth--;
}

/* --- calls */

/* How many values the call expects, or one more or less. */
static size_t expected(const unsigned v[], size_t n) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) count += v[i] < REFERENCES ? FIRST_ELEMENT[v[i] + 1] - FIRST_ELEMENT[v[i]] : 1;
    if (take(16)) return count;
    return take(2) ? count + 1 : count - (count > 0);
}

static double *some_reals(size_t n) {
    double *x = malloc(n * sizeof *x);
    for (size_t i = 0; i < n; i++) x[i] = real(1.0);
    return x;
}

static void any_reals(fmi3Instance c, int set) {
    size_t n = take(MOST), m;
    unsigned *v = some_references(n, take(2) ? INPUT_REFERENCES : REFERENCES);
    double *x;
    m = expected(v, n), x = some_reals(m);
    if (set)
        CALL(fmi3SetFloat64, c, take(16) ? v : NULL, n, take(16) ? x : NULL, m);
    else
        CALL(fmi3GetFloat64, c, take(16) ? v : NULL, n, take(16) ? x : NULL, m);
    free(v), free(x);
}

static void other_types(fmi3Instance c) {
    size_t n = take(4), room = n * MOST_ELEMENTS;
    unsigned *all = some_references(n, REFERENCES), *v = take(16) ? all : NULL;
    void *x = calloc(room + 1, 8);
    if (n && take(2)) all[0] = STATUS_REFERENCE;
    switch (take(12)) {
    case 0:
    case 1: CALL(fmi3GetInt32, c, v, n, x, take(8) ? n : room); break;
    case 2: CALL(fmi3SetInt32, c, v, n, x, n); break;
    case 3: CALL(fmi3GetFloat32, c, v, n, x, n); break;
    case 4: CALL(fmi3SetInt8, c, v, n, x, n); break;
    case 5: CALL(fmi3GetUInt64, c, v, n, x, n); break;
    case 6: CALL(fmi3SetBoolean, c, v, n, x, n); break;
    case 7: CALL(fmi3GetString, c, v, n, x, n); break;
    case 8: CALL(fmi3SetBinary, c, v, n, x, x, n); break;
    case 9: CALL(fmi3GetClock, c, v, n, x); break;
    case 10: CALL(fmi3GetIntervalDecimal, c, v, n, x, NULL); break;
    default: CALL(fmi3SetShiftFraction, c, v, n, x, NULL);
    }
    free(all), free(x);
}

static void derivatives(fmi3Instance c) {
    static const fmi3Int32 odd[] = {0, -1, MAX_DERIVATIVE_ORDER + 1, INT32_MAX, INT32_MIN};
    size_t n = take(4), m;
    unsigned *v = some_references(n, REFERENCES);
    fmi3Int32 *order = malloc(n * sizeof *order);
    double *x;
    for (size_t i = 0; i < n; i++) order[i] = take(8) ? 1 : odd[take(sizeof odd / sizeof *odd)];
    m = expected(v, n), x = some_reals(m);
    CALL(fmi3GetOutputDerivatives, c, v, n, take(16) ? order : NULL, x, m);
    free(v), free(order), free(x);
}

static void partial_derivatives(fmi3Instance c) {
    size_t n = take(4), k = take(4), m[2];
    unsigned *unknown = some_references(n, REFERENCES), *known = some_references(k, INPUT_REFERENCES), *u, *v;
    double *seed, *result;
    int adjoint = (int)take(2);
    for (size_t i = 0; i < n; i++)
        if (take(8)) unknown[i] = OUTPUT_REFERENCE + take(REFERENCES - OUTPUT_REFERENCE);
    m[0] = expected(unknown, n), m[1] = expected(known, k);
    seed = some_reals(m[!adjoint]), result = some_reals(m[adjoint]);
    u = take(16) ? unknown : NULL, v = take(16) ? known : NULL;
    if (adjoint)
        CALL(fmi3GetAdjointDerivative, c, u, n, v, k, take(16) ? seed : NULL, m[0], take(16) ? result : NULL, m[1]);
    else
        CALL(fmi3GetDirectionalDerivative, c, u, n, v, k, take(16) ? seed : NULL, m[1], take(16) ? result : NULL, m[0]);
    free(unknown), free(known), free(seed), free(result);
}

static void categories(fmi3Instance c) {
    static const char *const known[] = CATEGORIES;
    char *unknown = malloc(2000);
    fmi3String wanted[3];
    size_t n = take(4);
    memset(unknown, '#', 1999), unknown[take(2000)] = 0, unknown[1999] = 0;
    for (size_t i = 0; i < n; i++) {
        wanted[i] = known[take(sizeof known / sizeof *known)]; /* the last one is null */
        if (!take(4)) wanted[i] = unknown;
    }
    CALL(fmi3SetDebugLogging, c, take(2), n, take(16) ? wanted : NULL);
    free(unknown);
}

static void make(int k) {
    size_t length = take(3000), n = take(2) ? take(MOST) : 0; /* longer than any message */
    char *name = malloc(length + 1);
    int odd = !take(8);
    unsigned *intermediate = some_references(n, take(4) ? INPUT_REFERENCES : REFERENCES);
    memset(name, take(2) ? 'n' : '#', length), name[length] = 0;
    instances[k].c = fmi3InstantiateCoSimulation(
        odd && take(2) ? NULL : name, odd && take(2) ? "{no}" : GUID, NULL, fmi3False, take(2), odd && take(2), take(2),
        take(16) ? intermediate : NULL, n, (fmi3InstanceEnvironment)(intptr_t)k, take(16) ? their_logger : NULL,
        take(2) ? their_update : NULL);
    instances[k].time = START_TIME;
    if (instances[k].c && (uintptr_t)((Instance *)instances[k].c)->now.z % 64) wrong("a buffer across cache lines");
    count("fmi3InstantiateCoSimulation", instances[k].c ? fmi3OK : fmi3Error);
    free(name), free(intermediate);
}

static void set_up(int k) {
    double start = take(4) ? 0.0 : real(10.0);
    if (CALL(fmi3EnterInitializationMode, instances[k].c, take(2), real(1e-6), start, take(4) == 0, real(50.0)))
        instances[k].time = start;
}

static void start_anew(int k) {
    CALL(fmi3Reset, instances[k].c);
    set_up(k);
    CALL(fmi3ExitInitializationMode, instances[k].c);
}

static void any_step(int k) {
    double h = real(0.05), t = take(8) ? instances[k].time : real(1.0), reached = NAN;
    fmi3Boolean event = fmi3True, end = fmi3True, early = fmi3True;
    if (h > 0.1 && h < 1e200) h = 0.1;
    if (!CALL(fmi3DoStep, instances[k].c, t, h, fmi3True, &event, take(32) ? &end : NULL, &early, &reached)) return;
    if (event || end || !(reached <= t + h) || (early != (reached < t + h))) wrong("a step's answers");
    instances[k].time = reached;
}

static void seldom(fmi3Instance c) {
    size_t n;
    switch (take(6)) {
    case 0: CALL(fmi3EnterEventMode, c); break;
    case 1: CALL(fmi3EnterConfigurationMode, c); break;
    case 2: CALL(fmi3UpdateDiscreteStates, c, NULL, NULL, NULL, NULL, NULL, NULL); break;
    case 3: CALL(fmi3SetTime, c, real(1.0)); break;
    case 4: CALL(fmi3GetNumberOfVariableDependencies, c, take(REFERENCES), &n); break;
    default: CALL(fmi3ActivateModelPartition, c, take(REFERENCES), real(1.0));
    }
}

static void release_instance(int k) {
    fmi3FreeInstance(instances[k].c);
    if (!depth) instances[k].c = NULL; /* in an update it stays */
    count("fmi3FreeInstance", fmi3OK);
}

static void any_call(int k) {
    switch (take(32)) {
    case 0: release_instance(k); break;
    case 1: set_up(k); break;
    case 2: CALL(fmi3ExitInitializationMode, instances[k].c); break;
    case 3: CALL(fmi3Terminate, instances[k].c); break;
    case 4:
    case 5:
    case 6: start_anew(k); break;
    case 7:
    case 8: other_types(instances[k].c); break;
    case 9: seldom(instances[k].c); break;
    case 10:
    case 11: partial_derivatives(instances[k].c); break;
    case 12: categories(instances[k].c); break;
    case 13: derivatives(instances[k].c); break;
    case 14:
    case 15: any_reals(instances[k].c, 0); break;
    case 16:
    case 17:
    case 18:
    case 19: any_reals(instances[k].c, 1); break;
    case 20:
    case 21:
    case 22:
    case 23: any_step(k); break;
    default: states(k);
    }
}

static void one_call(void) {
    int k = (int)take(INSTANCES);
    if (!instances[k].c && take(8)) { /* else the call is made with a null instance */
        make(k);
        if (instances[k].c && take(2)) start_anew(k);
    }
    any_call(k);
}
