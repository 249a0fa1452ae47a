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

struct Instance {
    void *memory; /* the block that the instance lies in */
    Host host;
    Step *step;
    int logs_discards;
    Saved *saved; /* the newest one first */
    State now;
    char name[];
};

void *allocate(const Host *host, size_t size);
void release(const Host *host, void *memory);

typedef struct {
    char text[40];
} Number;

/* The shortest digits that give back x, as Python writes them. */
Number number(double x);

/* Whether the pointers that a call needs are there; if not, refuse the call. With n = 0 it needs none. */
int given(Instance *m, const char *call, size_t n, const void *references, const void *values);

#endif
