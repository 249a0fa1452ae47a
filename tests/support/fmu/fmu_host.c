/* An importer in C: steps an FMU, prints its outputs in hexadecimal at every step, then the ns that a step takes.
   usage: fmu_host LIBRARY GUID RESOURCES STEPS H INPUTS FIRST_OUTPUT OUTPUTS REPEATS, where the value references of
   the inputs count from 0, those of the outputs from FIRST_OUTPUT. */
#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef void *Component;
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*free)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

#ifdef _WIN32
static void *opened(const char *path) { return LoadLibraryA(path); }
static void *symbol(void *library, const char *name) { return (void *)GetProcAddress(library, name); }
static void close_library(void *library) { FreeLibrary(library); }
static const char *problem(void) { return "LoadLibrary failed"; }
#else
static void *opened(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *symbol(void *library, const char *name) { return dlsym(library, name); }
static void close_library(void *library) { dlclose(library); }
static const char *problem(void) { return dlerror(); }
#endif

static void logger(void *environment, const char *who, int status, const char *category, const char *text, ...) {
    fprintf(stderr, "%s %d %s %s\n", who, status, category ? category : "NULL", text);
}

static void *need(void *library, const char *name) {
    void *found = symbol(library, name);
    if (!found) {
        fprintf(stderr, "no %s\n", name);
        exit(3);
    }
    return found;
}

static void check(int status, const char *what) {
    if (status) {
        fprintf(stderr, "%s answered %d\n", what, status);
        exit(4);
    }
}

static double seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void live(char **argument) {
    int steps = atoi(argument[4]), inputs = atoi(argument[6]), first = atoi(argument[7]), outputs = atoi(argument[8]);
    int repeats = atoi(argument[9]);
    double h = atof(argument[5]);
    void *library = opened(argument[1]);
    if (!library) {
        fprintf(stderr, "%s\n", problem());
        exit(3);
    }
    Component (*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
        need(library, "fmi2Instantiate");
    int (*setup)(Component, int, double, double, int, double) = need(library, "fmi2SetupExperiment");
    int (*enter)(Component) = need(library, "fmi2EnterInitializationMode");
    int (*leave)(Component) = need(library, "fmi2ExitInitializationMode");
    int (*terminate)(Component) = need(library, "fmi2Terminate");
    int (*reset)(Component) = need(library, "fmi2Reset");
    void (*release)(Component) = need(library, "fmi2FreeInstance");
    int (*set_real)(Component, const unsigned *, size_t, const double *) = need(library, "fmi2SetReal");
    int (*get_real)(Component, const unsigned *, size_t, double *) = need(library, "fmi2GetReal");
    int (*do_step)(Component, double, double, int) = need(library, "fmi2DoStep");

    unsigned in[64], out[64];
    double given[64] = {0}, taken[64];
    for (int i = 0; i < inputs; i++) in[i] = i;
    for (int i = 0; i < outputs; i++) out[i] = first + i;
    Callbacks callbacks = {logger, calloc, free, NULL, NULL};
    Component it = instantiate("host", 1, argument[2], argument[3], &callbacks, 0, 1);
    if (!it) exit(5);
    for (int run = 0; run < 2; run++) { /* the second after a reset */
        check(setup(it, 0, 0.0, 0.0, 0, 0.0), "setup");
        check(enter(it), "enter");
        check(leave(it), "exit");
        for (int k = 0; k < steps; k++) {
            for (int i = 0; i < inputs; i++) given[i] = 0.125 * ((k + i) % 8 - 4);
            check(set_real(it, in, inputs, given), "set");
            check(do_step(it, k * h, h, 1), "step");
            check(get_real(it, out, outputs, taken), "get");
            for (int i = 0; i < outputs; i++) printf("%a ", taken[i]);
            printf("\n");
        }
        double begin = seconds();
        for (int k = 0; k < repeats; k++) {
            check(set_real(it, in, inputs, given), "set");
            check(do_step(it, (steps + k) * h, h, 1), "step");
            check(get_real(it, out, outputs, taken), "get");
        }
        printf("%g\n", (seconds() - begin) / repeats * 1e9);
        check(terminate(it), "terminate");
        check(reset(it), "reset");
    }
    release(it);
    close_library(library);
}

int main(int count, char **argument) {
    if (count != 10) return 2;
    live(argument);
    live(argument); /* the library loaded again */
    return 0;
}
