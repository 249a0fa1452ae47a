/* What the fuzzers of both versions of FMI share: bytes become numbers and calls on saved states; counts are printed.

   FUZZER SEED INPUTS makes random bytes; with clang, -fsanitize=fuzzer -DLIBFUZZER makes guided ones. Buffers are
   allocated to the byte, so that the address sanitizer sees what passes their ends.

   A fuzzer defines the names of the calls below before it includes this file, and afterwards `one_call`. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

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
    fprintf(stderr, "fuzzer: %s\n", what);
    abort();
}

static struct {
    void *c;
    double time;
} instances[INSTANCES];
static void *places[PLACES];
static struct {
    BYTE *bytes;
    size_t size;
} texts[TEXTS];

static struct {
    const char *name;
    long calls, refused;
} counts[64];

static int count(const char *name, int status) {
    int k = 0;
    if (status != CALL_OK && status != CALL_DISCARD && status != CALL_ERROR) wrong(name);
    while (counts[k].name && strcmp(counts[k].name, name)) k++;
    counts[k].name = name;
    counts[k].calls++;
    counts[k].refused += status != CALL_OK;
    return status == CALL_OK;
}

#define TEXT_OF(name) #name
#define COUNTED(function, ...) count(TEXT_OF(function), function(__VA_ARGS__))
#define CALL(...) COUNTED(__VA_ARGS__)

static unsigned *some_references(size_t n, unsigned usual) {
    static const unsigned odd[] = {REFERENCES, REFERENCES - 1, REFERENCES + 1, 0x7fffffff, 0x80000000, 0xffffffff};
    unsigned *r = malloc(n * sizeof *r);
    for (size_t i = 0; i < n; i++) r[i] = take(16) ? take(usual) : odd[take(sizeof odd / sizeof *odd)];
    return r;
}

/* --- states: places hold pointers that are null, alive, freed, of another instance, or of nothing */

static void to_bytes(void *c, void *saved) {
    size_t size = 0;
    BYTE *bytes;
    int k = (int)take(TEXTS);
    if (!CALL(STATE_SIZE, c, saved, take(16) ? &size : NULL)) size = sizeof(Serialized);
    switch (take(8)) {
    case 0: size = take((unsigned)size); break;
    case 1: size -= 1 + take(9); break;
    case 2: size += take(9); break;
    }
    bytes = malloc(size);
    if (CALL(SERIALIZE_STATE, c, saved, take(16) ? bytes : NULL, size)) {
        free(texts[k].bytes);
        texts[k].bytes = bytes, texts[k].size = size;
    } else
        free(bytes);
}

/* Damage that the checksum cannot see, because it is made anew. */
static void forge(BYTE *bytes) {
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

static void from_bytes(void *c, void **place) {
    int k = (int)take(TEXTS);
    size_t size = texts[k].size;
    BYTE *bytes;
    if (!take(8)) size = take(2) ? take((unsigned)size + 1) : size + take(9);
    bytes = malloc(size);
    for (size_t i = 0; i < size; i++) bytes[i] = i < texts[k].size ? texts[k].bytes[i] : (BYTE)take(256);
    if (size && take(4) == 0) bytes[take((unsigned)size)] ^= (BYTE)(1 + take(255));
    if (size == sizeof(Serialized) && take(4) == 0) forge(bytes);
    CALL(DESERIALIZE_STATE, c, take(16) ? bytes : NULL, size, take(16) ? place : NULL);
    free(bytes);
}

static void states(int k) {
    void *c = instances[k].c;
    void **place = &places[take(8) ? 2 * (unsigned)k + take(2) : take(PLACES)], *copy;
    if (!*place && take(4)) CALL(GET_STATE, c, place);
    switch (take(8)) {
    case 0: CALL(GET_STATE, c, take(16) ? place : NULL); break;
    case 1:
    case 2: CALL(SET_STATE, c, *place); break;
    case 3:
        copy = *place; /* freed, and remembered */
        CALL(FREE_STATE, c, &copy);
        break;
    case 4: CALL(FREE_STATE, c, take(16) ? place : NULL); break;
    case 5:
        if (!take(4)) *place = take(2) ? NULL : (void *)(uintptr_t)(0x10 + 8 * take(256));
        break;
    case 6: to_bytes(c, *place); break;
    default:
        if (take(2)) to_bytes(c, *place);
        from_bytes(c, place);
    }
}

static void one_call(void);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    data = bytes, left = size;
    while (left) one_call();
    for (int k = 0; k < INSTANCES; k++) {
        FREE_INSTANCE(instances[k].c); /* and all its states with it */
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
