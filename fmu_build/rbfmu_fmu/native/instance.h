/* What the parts of co-simulation share, and no file for a version of FMI needs: an instance from the inside. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdint.h>

#include "call_rules.h"
#include "cosimulation.h"
#include "model.h"
#include "scene.h"

/* What a saved state holds. */
typedef struct {
    double time, stop; /* the time where the instance stands, and the experiment's end, which may be infinite */
    int64_t phase, status, stale, discarded;
    double z[SIZE]; /* the model's buffer */
} State;

typedef struct Saved {
    struct Saved *next;
    State state;
} Saved;

/* What the importer may do in an intermediate update; nothing outside of one. */
typedef enum { NO_UPDATE, CAN_SET, CAN_GET } Update;

struct Instance {
    void *memory; /* the block that the instance lies in */
    Host host;
    Step *step;
    int returned_early;
    Update update;
    unsigned char intermediate[STATUS_REFERENCE + COUNTS + 1]; /* by value reference: may be set or read in intermediate updates */
    Saved *saved; /* the newest one first */
    State now;
    char name[];
};

/* The Reals that a value reference stands for, row by row. */
typedef struct {
    const unsigned short *r;
    size_t n;
} Elements;

static inline Elements elements_of(unsigned v) {
#ifdef ONE_ELEMENT_EACH
    Elements e = {ELEMENTS + v, 1}; /* FIRST_ELEMENT would say so, but cost time */
#else
    Elements e = {ELEMENTS + FIRST_ELEMENT[v], (size_t)(FIRST_ELEMENT[v + 1] - FIRST_ELEMENT[v])};
#endif
    return e;
}

static inline Causality causality_of(unsigned r) {
    return r >= FIRST_OUTPUT ? OUTPUT : r >= FIRST_PARAMETER ? PARAMETER : INPUT;
}

static inline int is_integer(unsigned v) { return v >= STATUS_REFERENCE && v <= STATUS_REFERENCE + COUNTS; }

/* Whether a call is allowed, a Real may have this value, the outputs can be as the inputs want them; if not, refuse. */
int allowed(Instance *m, const char *call, Call what);
int settable(Instance *m, const char *call, unsigned r, double value);
int fresh(Instance *m, const char *call);

/* Whether known value references stand for as many elements together as there are values; if not, refuse. */
int fit(Instance *m, const char *call, const unsigned v[], size_t n, size_t n_values);

/* Whether variables may be read or set: in an intermediate update only some may; if not, refuse. */
int exchanged_in_update(Instance *m, const char *call, const unsigned v[], size_t n, Update how);
#define exchanged(m, call, v, n, how) ((m)->update == NO_UPDATE || exchanged_in_update(m, call, v, n, how))

void *allocate(const Host *host, size_t size);
void release(const Host *host, void *memory);

typedef struct {
    char text[40];
} Number;

/* What a value reference stands for, by its name if it has one. */
Number named(unsigned v);

/* The shortest digits that give back x, as Python writes them. */
Number number(double x);

/* Whether the pointers that a call needs are there; if not, refuse the call. With n = 0 it needs none. */
int given(Instance *m, const char *call, size_t n, const void *references, const void *values);

#endif
