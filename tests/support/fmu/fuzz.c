/* Bytes become FMI 2.0 calls on the C layer; memory for some instances comes through callbacks that count, and sometimes
   have none. See fuzzing.h. */

#include "fmi2Functions.h"

#define BYTE fmi2Byte
#define FREE_INSTANCE fmi2FreeInstance
#define GET_STATE fmi2GetFMUstate
#define SET_STATE fmi2SetFMUstate
#define FREE_STATE fmi2FreeFMUstate
#define STATE_SIZE fmi2SerializedFMUstateSize
#define SERIALIZE_STATE fmi2SerializeFMUstate
#define DESERIALIZE_STATE fmi2DeSerializeFMUstate
#include "fuzzing.h"

/* --- the importer's side */

static void *their_memory(size_t n, size_t size) {
    void *block = take(16) ? malloc(n * size) : NULL;
    if (block) memset(block, 0xff, n * size);
    blocks += block != NULL;
    return block;
}

static void their_free(void *block) {
    blocks -= block != NULL;
    free(block);
}

static void their_logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                         fmi2String message, ...) {
    va_list none_given;
    char text[4096];
    int length, hashes = 0;
    (void)environment;
    if (!name || !category || (status != fmi2Warning && status != fmi2Discard && status != fmi2Error)) wrong("a message");
    va_start(none_given, message);
    length = vsnprintf(text, sizeof text, message, none_given); /* reads none: no % in it is a conversion */
    va_end(none_given);
    if (length <= 0 || length >= (int)sizeof text) wrong("a message's text");
    for (int i = 0; text[i]; i++) hashes += text[i] == '#';
    if (hashes % 2) wrong("a single # in a message");
    messages++;
}

static const fmi2CallbackFunctions CALLBACKS[] = {{their_logger, their_memory, their_free, NULL, NULL},
                                                  {their_logger, NULL, NULL, NULL, NULL},
                                                  {their_logger, their_memory, NULL, NULL, NULL},
                                                  {NULL, NULL, NULL, NULL, NULL}};

/* --- calls */

static void any_reals(fmi2Component c, int set) {
    size_t n = take(MOST);
    fmi2ValueReference *r = some_references(n, take(2) ? FIRST_PARAMETER : REALS);
    fmi2Real *x = malloc(n * sizeof *x);
    for (size_t i = 0; i < n; i++) x[i] = real(1.0);
    if (set)
        CALL(fmi2SetReal, c, take(16) ? r : NULL, n, take(16) ? x : NULL);
    else
        CALL(fmi2GetReal, c, take(16) ? r : NULL, n, take(16) ? x : NULL);
    free(r), free(x);
}

static void all_reals(fmi2Component c) {
    fmi2ValueReference *r = malloc(REALS * sizeof *r);
    fmi2Real *x = malloc(REALS * sizeof *x);
    for (unsigned i = 0; i < REALS; i++) r[i] = i;
    CALL(fmi2GetReal, c, r, REALS, x);
    free(r), free(x);
}

static void other_types(fmi2Component c) {
    size_t n = take(4);
    fmi2ValueReference *all = some_references(n, REALS), *r = take(16) ? all : NULL;
    fmi2Integer *i = calloc(n + 1, sizeof *i);
    fmi2String *s = calloc(n + 1, sizeof *s);
    if (n && take(2)) all[0] = REALS;
    switch (take(6)) {
    case 0: CALL(fmi2GetInteger, c, r, n, i); break;
    case 1: CALL(fmi2GetBoolean, c, r, n, i); break;
    case 2: CALL(fmi2GetString, c, r, n, s); break;
    case 3: CALL(fmi2SetInteger, c, r, n, i); break;
    case 4: CALL(fmi2SetBoolean, c, r, n, i); break;
    default: CALL(fmi2SetString, c, r, n, s);
    }
    free(all), free(i), free(s);
}

static void derivatives(fmi2Component c) {
    static const fmi2Integer odd[] = {0, -1, MAX_DERIVATIVE_ORDER + 1, INT32_MAX, INT32_MIN};
    size_t n = take(4);
    int set = (int)take(2);
    fmi2ValueReference *r = some_references(n, set ? FIRST_PARAMETER : REALS);
    fmi2Integer *order = malloc(n * sizeof *order);
    fmi2Real *x = malloc(n * sizeof *x);
    for (size_t i = 0; i < n; i++) {
        order[i] = take(8) ? 1 + (int)take(2) : odd[take(sizeof odd / sizeof *odd)];
        x[i] = real(1.0);
    }
    if (set)
        CALL(fmi2SetRealInputDerivatives, c, r, n, take(16) ? order : NULL, x);
    else
        CALL(fmi2GetRealOutputDerivatives, c, r, n, take(16) ? order : NULL, x);
    free(r), free(order), free(x);
}

static void inquire(fmi2Component c) {
    fmi2StatusKind kind = (fmi2StatusKind)take(4);
    fmi2Real x;
    fmi2Integer i;
    fmi2Status s;
    fmi2String text;
    int null = !take(8);
    switch (take(6)) {
    case 0: CALL(fmi2GetRealStatus, c, kind, null ? NULL : &x); break;
    case 1: CALL(fmi2GetBooleanStatus, c, kind, null ? NULL : &i); break;
    case 2: CALL(fmi2GetIntegerStatus, c, kind, null ? NULL : &i); break;
    case 3: CALL(fmi2GetStatus, c, kind, null ? NULL : &s); break;
    case 4: CALL(fmi2GetStringStatus, c, kind, null ? NULL : &text); break;
    default:
        CALL(fmi2CancelStep, c);
    }
}

static void partial_derivatives(fmi2Component c) {
    size_t n = take(4), k = take(4);
    fmi2ValueReference *unknown = some_references(n, REALS), *known = some_references(k, FIRST_PARAMETER);
    fmi2Real *seed = malloc(k * sizeof *seed), *result = malloc(n * sizeof *result);
    for (size_t i = 0; i < n; i++)
        if (take(8)) unknown[i] = FIRST_OUTPUT + take(REALS - FIRST_OUTPUT);
    for (size_t i = 0; i < k; i++) seed[i] = real(1.0);
    CALL(fmi2GetDirectionalDerivative, c, take(16) ? unknown : NULL, n, take(16) ? known : NULL, k,
         take(16) ? seed : NULL, take(16) ? result : NULL);
    free(unknown), free(known), free(seed), free(result);
}

static void categories(fmi2Component c) {
    static const char *const known[] = CATEGORIES;
    char *unknown = malloc(2000);
    fmi2String wanted[3];
    size_t n = take(4);
    memset(unknown, take(2) ? '%' : '#', 1999), unknown[take(2000)] = 0, unknown[1999] = 0;
    for (size_t i = 0; i < n; i++) {
        wanted[i] = known[take(sizeof known / sizeof *known)]; /* the last one is null */
        if (!take(4)) wanted[i] = unknown;
    }
    CALL(fmi2SetDebugLogging, c, (int)take(2), n, take(16) ? wanted : NULL);
    free(unknown);
}

static void make(int k) {
    size_t length = take(3000); /* longer than any message */
    char *name = malloc(length + 1);
    int odd = !take(8);
    memset(name, take(2) ? 'n' : '%', length), name[length] = 0;
    instances[k].c = fmi2Instantiate(odd && take(2) ? NULL : name,
                                     odd && take(2) ? fmi2ModelExchange : fmi2CoSimulation,
                                     odd && take(2) ? "{no}" : GUID, NULL, take(16) ? &CALLBACKS[take(4)] : NULL,
                                     fmi2False, (int)take(2));
    instances[k].time = START_TIME;
    if (instances[k].c && (uintptr_t)((Instance *)instances[k].c)->now.z % 64) wrong("a buffer across cache lines");
    count("fmi2Instantiate", instances[k].c ? fmi2OK : fmi2Error);
    free(name);
}

static void set_up(int k) {
    double start = take(4) ? 0.0 : real(10.0);
    if (CALL(fmi2SetupExperiment, instances[k].c, (int)take(2), real(1e-6), start, take(4) == 0, real(50.0)))
        instances[k].time = start;
}

static void start_anew(int k) {
    CALL(fmi2Reset, instances[k].c);
    set_up(k);
    CALL(fmi2EnterInitializationMode, instances[k].c);
    CALL(fmi2ExitInitializationMode, instances[k].c);
}

static void any_step(int k) {
    double h = real(0.05), t = take(8) ? instances[k].time : real(1.0);
    if (h > 0.1 && h < 1e200) h = 0.1;
    if (CALL(fmi2DoStep, instances[k].c, t, h, fmi2True)) instances[k].time = t + h;
}

static void one_call(void) {
    int k = (int)take(INSTANCES);
    if (!instances[k].c && take(8)) { /* else the call is made with a null instance */
        make(k);
        if (instances[k].c && take(2)) start_anew(k);
    }
    switch (take(32)) {
    case 0:
        fmi2FreeInstance(instances[k].c);
        instances[k].c = NULL;
        count("fmi2FreeInstance", fmi2OK);
        break;
    case 1: set_up(k); break;
    case 2: CALL(fmi2EnterInitializationMode, instances[k].c); break;
    case 3: CALL(fmi2ExitInitializationMode, instances[k].c); break;
    case 4: CALL(fmi2Terminate, instances[k].c); break;
    case 5:
    case 6: start_anew(k); break;
    case 7:
    case 8: other_types(instances[k].c); break;
    case 9:
    case 10: inquire(instances[k].c); break;
    case 11: categories(instances[k].c); break;
    case 12:
    case 13: take(2) ? derivatives(instances[k].c) : partial_derivatives(instances[k].c); break;
    case 14:
    case 15: any_reals(instances[k].c, 0); break;
    case 16:
    case 17:
    case 18: any_reals(instances[k].c, 1); break;
    case 19: all_reals(instances[k].c); break;
    case 20:
    case 21:
    case 22:
    case 23: any_step(k); break;
    default: states(k);
    }
}

