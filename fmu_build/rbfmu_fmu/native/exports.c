/* A unit's entries as those of a shared library, for a Python that loads it by ctypes. */

#include <stdint.h>

int64_t initialize(double *z);
int64_t step(double *z, double h);
int64_t outputs(double *z);

#define EXPORTED __attribute__((visibility("default")))

EXPORTED int64_t unit_initialize(double *z) { return initialize(z); }
EXPORTED int64_t unit_step(double *z, double h) { return step(z, h); }
EXPORTED int64_t unit_outputs(double *z) { return outputs(z); }
