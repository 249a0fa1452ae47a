/* A unit's entries as those of a shared library, for a Python that loads it by ctypes. */

#include "unit.h"

#define EXPORTED __attribute__((visibility("default")))

EXPORTED int64_t unit_initialize(double *z) { return initialize(z); }
EXPORTED int64_t unit_outputs(double *z) { return outputs(z); }
EXPORTED Step *unit_chosen_step(void) { return chosen_step(); }
