/* FMI co-simulation of one model, whatever the version of FMI: instances and their life, messages, values, steps, saved
   states, and the rules of calls. It knows nothing of the body, and nothing of any version's types.

   A refused call returns CALL_ERROR, says why through the importer's logger, and changes nothing (a refused step
   changes the variable `status`), so that the instance can go on. A null instance gives CALL_ERROR without a message.
   All memory of an instance is one allocation, and of a saved state another; there are no global variables.

   A file for one version of FMI, such as fmi2.c, is thin. It has to
   - define the functions of that version, and export nothing else. Each calls the function below that does its work,
     passes `__func__` as `call`, with which every message begins, and casts the Status that comes back (it has the
     values of fmi2Status and of fmi3Status: assert that);
   - fill a Host with what the importer offers: `log` hands one message to the version's logger (FMI 2 takes the text
     for a format, FMI 3 does not), `allocate` and `release` stay null where the version has no functions for memory;
   - turn value references into places: variable r of the Reals below is the r-th scalar of the model description. In
     FMI 2 a value reference is that number. Where one of FMI 3 stands for an array, list the places of its elements,
     compare their number with nValues, and make one call with all of them, because a call sets all values or none;
   - refuse by `refuse`, in one line each, what no model here has: directional derivatives, asynchronous steps, events;
   - stand beside this file in the list of sources in linking.py.

   For FMI 3.0 that means
     fmi3InstantiateCoSimulation      create_instance; the instantiation token is the guid
     fmi3EnterInitializationMode      set_up_experiment, and if that is CALL_OK enter_initialization
     fmi3GetFloat64, fmi3SetFloat64   get_reals, set_reals
     fmi3GetInt32                     get_integers
     fmi3GetOutputDerivatives         get_output_derivatives
     fmi3DoStep                       do_step, get_last_successful_time and get_discarded, which is terminateSimulation;
                                      eventHandlingNeeded and earlyReturn are always false
     fmi3GetFMUState and its family   save_state, restore_state, free_state, state_size, serialize_state,
                                      deserialize_state
   and everything else as in fmi2.c. */

#ifndef COSIMULATION_H
#define COSIMULATION_H

#include <stddef.h>

#define MESSAGE_SIZE 1024 /* of a message, with the zero at its end; what is longer is cut off */

typedef enum { CALL_OK, CALL_WARNING, CALL_DISCARD, CALL_ERROR } Status;

typedef struct Instance Instance;
typedef void Function(void);

/* What the importer offers. Any part of it may be null. */
typedef struct Host {
    void (*log)(const struct Host *host, const char *name, Status status, const char *category, const char *text);
    Function *logger; /* the importer's own, for `log` to call */
    void *environment;
    void *(*allocate)(size_t count, size_t size); /* both of these, or malloc and free serve */
    void (*release)(void *memory);
} Host;

/* --- the life of an instance */

/* Return null, after a message, where there can be no instance. */
Instance *create_instance(const Host *host, const char *call, const char *name, const char *guid, int logs_discards);
Instance *refuse_instance(const Host *host, const char *call, const char *name, const char *reason);
void free_instance(Instance *m);

Status set_debug_logging(Instance *m, const char *call, int on, size_t n, const char *const categories[]);
Status set_up_experiment(Instance *m, const char *call, double start, int has_stop, double stop);
Status enter_initialization(Instance *m, const char *call);
Status exit_initialization(Instance *m, const char *call);
Status terminate(Instance *m, const char *call);
Status reset(Instance *m);

/* --- values: all of a call's or none of them */

Status get_reals(Instance *m, const char *call, const unsigned r[], size_t n, double values[]);
Status set_reals(Instance *m, const char *call, const unsigned r[], size_t n, const double values[]);
Status get_integers(Instance *m, const char *call, const unsigned r[], size_t n, int values[]);
Status set_input_derivatives(Instance *m, const char *call, const unsigned r[], size_t n, const int order[],
                             const double values[]);
Status get_output_derivatives(Instance *m, const char *call, const unsigned r[], size_t n, const int order[],
                              double values[]);

/* For types of which there is no variable: `kind` says in a message what was looked for. */
Status no_variables(Instance *m, const char *call, const unsigned r[], size_t n, const char *kind);

/* --- steps */

/* Take all of a step from time t to t + h, or nothing of it: CALL_DISCARD where the motion cannot go on like this. */
Status do_step(Instance *m, const char *call, double t, double h);
Status get_last_successful_time(Instance *m, const char *call, double *t);
Status get_discarded(Instance *m, const char *call, int *discarded);

/* --- saved states; a pointer that is no saved state of this instance is refused, and never followed */

Status save_state(Instance *m, const char *call, void **state);
Status restore_state(Instance *m, const char *call, void *state);
Status free_state(Instance *m, const char *call, void **state);
Status state_size(Instance *m, const char *call, void *state, size_t *size);
Status serialize_state(Instance *m, const char *call, void *state, void *bytes, size_t size);
Status deserialize_state(Instance *m, const char *call, const void *bytes, size_t size, void **state);

/* --- answers */

/* Log "call: message" and return CALL_ERROR, or CALL_DISCARD, which is logged only where the importer asked for it. */
Status refuse(Instance *m, const char *call, const char *format, ...);
Status discard(Instance *m, const char *call, const char *format, ...);

#endif
