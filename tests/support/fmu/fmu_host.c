/* An importer in C: steps an FMU, prints its outputs in hexadecimal at every step, then the ns that a step takes.
   usage: fmu_host LIBRARY GUID RESOURCES STEPS H INPUTS FIRST_OUTPUT OUTPUTS REPEATS, where the value references of
   the inputs count from 0, those of the outputs from FIRST_OUTPUT. */
#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif
#include <stdarg.h>
#include <stdbool.h>
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

/* --- the same calls of both versions of FMI, of variables without dimensions */

static struct {
    Component (*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*setup)(Component, int, double, double, int, double);
    int (*enter)(Component), (*leave)(Component), (*terminate)(Component), (*reset)(Component);
    void (*release)(Component);
    int (*set_real)(Component, const unsigned *, size_t, const double *);
    int (*get_real)(Component, const unsigned *, size_t, double *);
    int (*do_step)(Component, double, double, int);
} fmi;

static struct {
    Component (*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
                             void *, void (*)(void *, int, const char *, const char *), void *);
    int (*enter)(Component, bool, double, double, bool, double);
    int (*set_real)(Component, const unsigned *, size_t, const double *, size_t);
    int (*get_real)(Component, const unsigned *, size_t, double *, size_t);
    int (*do_step)(Component, double, double, bool, bool *, bool *, bool *, double *);
} fmi3;

static void logger_3(void *environment, int status, const char *category, const char *text) {
    fprintf(stderr, "%d %s %s\n", status, category ? category : "NULL", text);
}

static Component instantiate_3(const char *name, int kind, const char *token, const char *resources,
                               const Callbacks *callbacks, int visible, int logging) {
    return fmi3.instantiate(name, token, resources, visible, logging, 0, 0, NULL, 0, NULL, logger_3, NULL);
}

static int setup_3(Component it, int a, double b, double start, int c, double stop) { return 0; } /* part of `enter` */
static int enter_3(Component it) { return fmi3.enter(it, 0, 0.0, 0.0, 0, 0.0); }
static int set_real_3(Component it, const unsigned *r, size_t n, const double *x) {
    return fmi3.set_real(it, r, n, x, n);
}
static int get_real_3(Component it, const unsigned *r, size_t n, double *x) { return fmi3.get_real(it, r, n, x, n); }
static int do_step_3(Component it, double t, double h, int never_back) {
    bool event, end, early;
    double reached;
    return fmi3.do_step(it, t, h, never_back, &event, &end, &early, &reached) || event || end || early ||
           reached != t + h;
}

static void load_2(void *library) {
    fmi.instantiate = need(library, "fmi2Instantiate");
    fmi.setup = need(library, "fmi2SetupExperiment");
    fmi.enter = need(library, "fmi2EnterInitializationMode");
    fmi.leave = need(library, "fmi2ExitInitializationMode");
    fmi.terminate = need(library, "fmi2Terminate");
    fmi.reset = need(library, "fmi2Reset");
    fmi.release = need(library, "fmi2FreeInstance");
    fmi.set_real = need(library, "fmi2SetReal");
    fmi.get_real = need(library, "fmi2GetReal");
    fmi.do_step = need(library, "fmi2DoStep");
}

static void load_3(void *library) {
    fmi3.instantiate = need(library, "fmi3InstantiateCoSimulation");
    fmi3.enter = need(library, "fmi3EnterInitializationMode");
    fmi3.set_real = need(library, "fmi3SetFloat64");
    fmi3.get_real = need(library, "fmi3GetFloat64");
    fmi3.do_step = need(library, "fmi3DoStep");
    fmi.instantiate = instantiate_3;
    fmi.setup = setup_3;
    fmi.enter = enter_3;
    fmi.leave = need(library, "fmi3ExitInitializationMode");
    fmi.terminate = need(library, "fmi3Terminate");
    fmi.reset = need(library, "fmi3Reset");
    fmi.release = need(library, "fmi3FreeInstance");
    fmi.set_real = set_real_3;
    fmi.get_real = get_real_3;
    fmi.do_step = do_step_3;
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
    if (symbol(library, "fmi3GetVersion"))
        load_3(library);
    else
        load_2(library);

    unsigned in[64], out[64];
    double given[64] = {0}, taken[64];
    for (int i = 0; i < inputs; i++) in[i] = i;
    for (int i = 0; i < outputs; i++) out[i] = first + i;
    Callbacks callbacks = {logger, calloc, free, NULL, NULL};
    Component it = fmi.instantiate("host", 1, argument[2], argument[3], &callbacks, 0, 1);
    if (!it) exit(5);
    for (int run = 0; run < 2; run++) { /* the second after a reset */
        check(fmi.setup(it, 0, 0.0, 0.0, 0, 0.0), "setup");
        check(fmi.enter(it), "enter");
        check(fmi.leave(it), "exit");
        for (int k = 0; k < steps; k++) {
            for (int i = 0; i < inputs; i++) given[i] = 0.125 * ((k + i) % 8 - 4);
            check(fmi.set_real(it, in, inputs, given), "set");
            check(fmi.do_step(it, k * h, h, 1), "step");
            check(fmi.get_real(it, out, outputs, taken), "get");
            for (int i = 0; i < outputs; i++) printf("%a ", taken[i]);
            printf("\n");
        }
        double begin = seconds();
        for (int k = 0; k < repeats; k++) {
            check(fmi.set_real(it, in, inputs, given), "set");
            check(fmi.do_step(it, (steps + k) * h, h, 1), "step");
            check(fmi.get_real(it, out, outputs, taken), "get");
        }
        printf("%g\n", (seconds() - begin) / repeats * 1e9);
        check(fmi.terminate(it), "terminate");
        check(fmi.reset(it), "reset");
    }
    fmi.release(it);
    close_library(library);
}

int main(int count, char **argument) {
    if (count != 10) return 2;
    live(argument);
    live(argument); /* the library loaded again */
    return 0;
}
