/* Bytes become FMI 2.0 calls on the C layer: sanitizers watch, counts are printed.

   fuzz SEED INPUTS makes random bytes; with clang, -fsanitize=fuzzer -DLIBFUZZER makes guided ones. Memory for some
   instances comes through callbacks that count, and sometimes have none; buffers are allocated to the byte, so that
   the address sanitizer sees what passes their ends. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"
#include "saved_states.c" /* the layout of a state's bytes */

enum { INSTANCES = 3, PLACES = 2 * INSTANCES, MOST = 8, TEXTS = 2 };

static const uint8_t *data;
static size_t left;

static unsigned take(unsigned n) { /* a number below n */
    unsigned x = 0;
    for (unsigned most = n; most > 1 && left; most >>= 8) x = x << 8 | *data++, left--;
    return n ? x % n : 0;
}

static double real(double usual) {
    static const double odd[] = {0.0, -0.0, 1e300, -1e300, 5e-324, 1e-12, -1.0, 99.99};
    uint64_t bits = 0;
    double x;
    switch (take(16)) {
    case 0: return NAN;
    case 1: return take(2) ? INFINITY : -INFINITY;
    case 2: return odd[take(sizeof odd / sizeof *odd)];
    case 3:
        for (int i = 0; i < 8; i++) bits = bits << 8 | take(256);
        memcpy(&x, &bits, sizeof x);
        return fabs(x) > 1e3 && fabs(x) < 1e25 ? 1.0 : x; /* minutes of substeps show nothing about memory */
    default: return usual * (0.5 + take(256) / 256.0);
    }
}

/* --- the importer's side */

static long blocks, messages;

static void wrong(const char *what) {
    fprintf(stderr, "fuzz.c: %s\n", what);
    abort();
}

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
    int length;
    (void)environment;
    if (!name || !category || (status != fmi2Discard && status != fmi2Error)) wrong("a message");
    va_start(none_given, message);
    length = vsnprintf(text, sizeof text, message, none_given); /* reads none: no % in it is a conversion */
    va_end(none_given);
    if (length <= 0 || length >= (int)sizeof text) wrong("a message's text");
    messages++;
}

static const fmi2CallbackFunctions CALLBACKS[] = {{their_logger, their_memory, their_free, NULL, NULL},
                                                  {their_logger, NULL, NULL, NULL, NULL},
                                                  {their_logger, their_memory, NULL, NULL, NULL},
                                                  {NULL, NULL, NULL, NULL, NULL}};

static struct {
    fmi2Component c;
    double time;
} instances[INSTANCES];
static fmi2FMUstate places[PLACES];
static struct {
    fmi2Byte *bytes;
    size_t size;
} texts[TEXTS];

static struct {
    const char *name;
    long calls, refused;
} counts[64];

static int count(const char *name, fmi2Status status) {
    int k = 0;
    if (status != fmi2OK && status != fmi2Discard && status != fmi2Error) wrong(name);
    while (counts[k].name && strcmp(counts[k].name, name)) k++;
    counts[k].name = name;
    counts[k].calls++;
    counts[k].refused += status != fmi2OK;
    return status == fmi2OK;
}

#define CALL(function, ...) count(#function, function(__VA_ARGS__))

/* --- calls */

static fmi2ValueReference *some_references(size_t n, unsigned usual) {
    static const fmi2ValueReference odd[] = {REALS, REALS - 1, REALS + 1, 0x7fffffff, 0x80000000, 0xffffffff};
    fmi2ValueReference *r = malloc(n * sizeof *r);
    for (size_t i = 0; i < n; i++) r[i] = take(16) ? take(usual) : odd[take(sizeof odd / sizeof *odd)];
    return r;
}

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
        CALL(fmi2GetDirectionalDerivative, c, NULL, take(3), NULL, take(3), NULL, NULL);
    }
}

static void categories(fmi2Component c) {
    static const char *const known[] = CATEGORIES;
    char *unknown = malloc(2000);
    fmi2String wanted[3];
    size_t n = take(4);
    memset(unknown, '%', 1999), unknown[take(2000)] = 0, unknown[1999] = 0;
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

/* --- states: places hold pointers that are null, alive, freed, of another instance, or of nothing */

static void to_bytes(fmi2Component c, fmi2FMUstate saved) {
    size_t size = 0;
    fmi2Byte *bytes;
    int k = (int)take(TEXTS);
    if (!CALL(fmi2SerializedFMUstateSize, c, saved, take(16) ? &size : NULL)) size = sizeof(Serialized);
    switch (take(8)) {
    case 0: size = take((unsigned)size); break;
    case 1: size -= 1 + take(9); break;
    case 2: size += take(9); break;
    }
    bytes = malloc(size);
    if (CALL(fmi2SerializeFMUstate, c, saved, take(16) ? bytes : NULL, size)) {
        free(texts[k].bytes);
        texts[k].bytes = bytes, texts[k].size = size;
    } else
        free(bytes);
}

/* Damage that the checksum cannot see, because it is made anew. */
static void forge(fmi2Byte *bytes) {
    Serialized s;
    memcpy(&s, bytes, sizeof s);
    switch (take(6)) {
    case 0: s.state.phase = (int64_t)take(20) - 2; break;
    case 1: s.state.status = (int64_t)take(6) - 2; break;
    case 2: s.state.time = real(1.0); break;
    case 3: s.state.stop = real(50.0); break;
    case 4: s.state.stale = take(3), s.state.discarded = take(3); break;
    default: s.state.z[OFFSETS[take(FIRST_OUTPUT)]] = real(1.0);
    }
    s.checksum = checksum(&s.state);
    memcpy(bytes, &s, sizeof s);
}

static void from_bytes(fmi2Component c, fmi2FMUstate *place) {
    int k = (int)take(TEXTS);
    size_t size = texts[k].size;
    fmi2Byte *bytes;
    if (!take(8)) size = take(2) ? take((unsigned)size + 1) : size + take(9);
    bytes = malloc(size);
    for (size_t i = 0; i < size; i++) bytes[i] = i < texts[k].size ? texts[k].bytes[i] : (fmi2Byte)take(256);
    if (size && take(4) == 0) bytes[take((unsigned)size)] ^= (fmi2Byte)(1 + take(255));
    if (size == sizeof(Serialized) && take(4) == 0) forge(bytes);
    CALL(fmi2DeSerializeFMUstate, c, take(16) ? bytes : NULL, size, take(16) ? place : NULL);
    free(bytes);
}

static void states(int k) {
    fmi2Component c = instances[k].c;
    fmi2FMUstate *place = &places[take(8) ? 2 * (unsigned)k + take(2) : take(PLACES)], copy;
    if (!*place && take(4)) CALL(fmi2GetFMUstate, c, place);
    switch (take(8)) {
    case 0: CALL(fmi2GetFMUstate, c, take(16) ? place : NULL); break;
    case 1:
    case 2: CALL(fmi2SetFMUstate, c, *place); break;
    case 3:
        copy = *place; /* freed, and remembered */
        CALL(fmi2FreeFMUstate, c, &copy);
        break;
    case 4: CALL(fmi2FreeFMUstate, c, take(16) ? place : NULL); break;
    case 5:
        if (!take(4)) *place = take(2) ? NULL : (fmi2FMUstate)(uintptr_t)(0x10 + 8 * take(256));
        break;
    case 6: to_bytes(c, *place); break;
    default:
        if (take(2)) to_bytes(c, *place);
        from_bytes(c, place);
    }
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
    case 13: derivatives(instances[k].c); break;
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

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    data = bytes, left = size;
    while (left) one_call();
    for (int k = 0; k < INSTANCES; k++) {
        fmi2FreeInstance(instances[k].c); /* and all its states with it */
        instances[k].c = NULL;
    }
    for (int k = 0; k < TEXTS; k++) {
        free(texts[k].bytes);
        texts[k].bytes = NULL, texts[k].size = 0;
    }
    memset(places, 0, sizeof places);
    if (blocks) wrong("the importer's memory did not come back");
    return 0;
}

#ifndef LIBFUZZER
static uint64_t splitmix64(uint64_t *state) {
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

int main(int argc, char **argv) {
    uint8_t bytes[4096];
    uint64_t state = argc > 1 ? strtoull(argv[1], NULL, 10) : 1;
    long inputs = argc > 2 ? atol(argv[2]) : 1000, calls = 0, refused = 0;
    for (long i = 0; i < inputs; i++) {
        size_t size = splitmix64(&state) % sizeof bytes;
        for (size_t k = 0; k < size; k++) bytes[k] = (uint8_t)splitmix64(&state);
        LLVMFuzzerTestOneInput(bytes, size);
    }
    for (int k = 0; counts[k].name; k++) calls += counts[k].calls, refused += counts[k].refused;
    printf("%ld inputs, %ld calls, %ld refused, %ld messages\n", inputs, calls, refused, messages);
    for (int k = 0; counts[k].name; k++)
        printf("  %s: %ld, %ld refused\n", counts[k].name, counts[k].calls, counts[k].refused);
    return 0;
}
#endif
