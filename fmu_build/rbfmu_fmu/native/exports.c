/* A model's entry functions, exported from a shared library for a Python that loads them by ctypes. */

#include "model.h"

#define EXPORTED __attribute__((visibility("default")))

EXPORTED int64_t model_initialize(double *z) { return initialize(z); }
EXPORTED int64_t model_outputs(double *z) { return outputs(z); }
EXPORTED Step *model_chosen_step(void) { return chosen_step(); }
