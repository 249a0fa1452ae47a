/* FMI co-simulation of one model, whatever the version of FMI: instances and their life, messages, values, steps, saved
   states, and the rules of calls. It knows nothing of the body, and nothing of any version's types.

   A refused call returns CALL_ERROR, says why through the importer's logger, and changes nothing (a refused step
   changes the variable `status`), so that the instance can go on. A null instance gives CALL_ERROR without a message.
   All memory of an instance is one allocation, and of a saved state another; there are no global variables.

   A file for one version of FMI, such as fmi2.c, is thin. It has to
   - define the functions of that version, and export nothing else. Each calls the function below that does its work,
     passes `__func__` as `call`, with which every message begins, and casts the Status that comes back (it has the
     values of fmi2Status and of fmi3Status: assert that);
   - fill a Host with what the importer offers: `log` hands one message to the version's logger, after `escape`;
     `allocate` and `release` stay null where the version has no functions for memory, and `update` where it has no
     intermediate updates;
   - refuse by `refuse`, in one line each, what no model here has: asynchronous steps, events, clocks;
   - be the `signatures` of the version in fmi_versions.toml.

   A value reference stands for one or more Reals, row by row, as scene.h lists them: what a call takes or gives are the
   values of all of them, one after another. In FMI 2 each has one. */

#ifndef COSIMULATION_H
#define COSIMULATION_H

#include <stddef.h>

#define MESSAGE_SIZE 1024 /* of a message, with the zero at its end; what is longer is cut off */

typedef enum { CALL_OK, CALL_WARNING, CALL_DISCARD, CALL_ERROR } Status;

typedef struct Instance Instance;
typedef void Function(void);

/* Whether the importer wants a step to end before its end, and when. */
typedef struct {
    int wanted;
    double time;
} EarlyReturn;

/* What the importer offers. Any part of it may be null. */
typedef struct Host {
    void (*log)(const struct Host *host, const char *name, Status status, const char *category, const char *text);
    Function *logger; /* the importer's own, for `log` to call */
    void *environment;
    void *(*allocate)(size_t count, size_t size); /* both of these, or malloc and free serve */
    void (*release)(void *memory);
    /* Called while a step is taken: before it is finished, for inputs, and afterwards, for outputs. `early` is null
       where it is too late to return. */
    void (*update)(const struct Host *host, double t, int finished, EarlyReturn *early);
    Function *updater; /* the importer's own, for `update` to call */
    int takes_early_return;
} Host;

/* --- the life of an instance */

/* Return null, after a message, where there can be no instance. */
Instance *create_instance(const Host *host, const char *call, const char *name, const char *guid);
Instance *refuse_instance(const Host *host, const char *call, const char *name, const char *reason);
void free_instance(Instance *m);

/* Refuse categories that there are not. Nothing is turned on or off: errors and discards are always logged. */
Status set_debug_logging(Instance *m, const char *call, size_t n, const char *const categories[]);

/* Say that the importer's tolerance, where it gives one that is not the scene's accuracy, has no effect. */
void say_of_tolerance(Instance *m, const char *call, int defined, double tolerance);

Status set_up_experiment(Instance *m, const char *call, double start, int has_stop, double stop);
Status enter_initialization(Instance *m, const char *call);
Status set_up_and_enter(Instance *m, const char *call, double start, int has_stop, double stop);
Status exit_initialization(Instance *m, const char *call);
Status terminate(Instance *m, const char *call);
Status reset(Instance *m);

/* --- values: all of a call's or none of them */

Status get_reals(Instance *m, const char *call, const unsigned v[], size_t n, double values[], size_t n_values);
Status set_reals(Instance *m, const char *call, const unsigned v[], size_t n, const double values[], size_t n_values);
Status get_integers(Instance *m, const char *call, const unsigned r[], size_t n, int values[]);

/* Derivatives with respect to time. Those of inputs are for variables of one element. */
Status set_input_derivatives(Instance *m, const char *call, const unsigned v[], size_t n, const int order[],
                             const double values[]);
Status get_output_derivatives(Instance *m, const char *call, const unsigned v[], size_t n, const int order[],
                              double values[], size_t n_values);

/* Derivatives of outputs by inputs, in Initialization Mode by parameters too: J seed, where the seed is a change of
   these and the result that of the outputs, or seed^T J, where the seed has weights of the outputs and the result is a
   number for each input or parameter. */
typedef struct {
    const unsigned *outputs;
    size_t n_outputs;
    const unsigned *inputs;
    size_t n_inputs;
    const double *seed;
    size_t n_seed;
    double *result;
    size_t n_result;
} Partial;

Status get_directional_derivative(Instance *m, const char *call, const Partial *of);
Status get_adjoint_derivative(Instance *m, const char *call, const Partial *of);

/* For types of which there is no variable: `kind` says in a message what was looked for. */
Status no_variables(Instance *m, const char *call, const unsigned r[], size_t n, const char *kind);

/* --- steps */

/* Take all of a step from time t to t + h, or nothing of it: CALL_DISCARD where the motion cannot go on like this. */
Status do_step(Instance *m, const char *call, double t, double h);
Status get_last_successful_time(Instance *m, const char *call, double *t);
Status get_discarded(Instance *m, const char *call, int *discarded);
Status get_returned_early(Instance *m, const char *call, int *early);

/* --- intermediate updates: only what was named here can be set or read in them, and no other call made */

Status use_intermediate(Instance *m, const char *call, const unsigned v[], size_t n);

/* Whether this is called from within an update, which is refused. */
int is_updating(Instance *m, const char *call);

/* --- saved states; a pointer that is no saved state of this instance is refused, and never followed */

Status save_state(Instance *m, const char *call, void **state);
Status restore_state(Instance *m, const char *call, void *state);
Status free_state(Instance *m, const char *call, void **state);
Status state_size(Instance *m, const char *call, void *state, size_t *size);
Status serialize_state(Instance *m, const char *call, void *state, void *bytes, size_t size);
Status deserialize_state(Instance *m, const char *call, const void *bytes, size_t size, void **state);

/* --- answers */

/* Log "call: message" and return the status; CALL_ERROR where there is no instance. Whether the importer wants messages
   to debug by makes no difference: without these none would know why a call was refused or a step not taken. */
Status answer(Instance *m, Status status, const char *call, const char *format, ...);
#define refuse(m, call, ...) answer(m, CALL_ERROR, call, __VA_ARGS__)

/* Write a message twice as long as it may be: each of the special characters, which mean something to a version's
   logger, is doubled, which stands for the character itself. */
void escape(char *out, const char *text, const char *special);

#endif
