/* The importer's side of `bench_native.py`: communication steps of an FMU, and an FMU that does nothing. */
#include <stddef.h>
#include <time.h>

typedef int (*DoStep)(void *, double, double, int);
typedef int (*GetReal)(void *, const unsigned *, size_t, double *);

static double seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* Seconds of one step and of reading all outputs, from step number `first` on; negative where a call is refused. */
double seconds_per_step(DoStep do_step, GetReal get_real, void *component, const unsigned *references, size_t n,
                        double *values, double h, long first, long steps) {
    int bad = 0;
    double begin = seconds();
    for (long k = first; k < first + steps; k++) {
        bad |= do_step(component, k * h, h, 1);
        bad |= get_real(component, references, n, values);
    }
    return bad ? -1.0 : (seconds() - begin) / steps;
}
