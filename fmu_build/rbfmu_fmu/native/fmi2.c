/* The functions of FMI 2.0 for co-simulation: its types and signatures around cosimulation.h. */

#include <string.h>

#include "cosimulation.h"
#include "fmi2Functions.h"

_Static_assert((int)fmi2OK == (int)CALL_OK && (int)fmi2Warning == (int)CALL_WARNING, "a status needs no translation");
_Static_assert((int)fmi2Discard == (int)CALL_DISCARD && (int)fmi2Error == (int)CALL_ERROR, "a status needs none");

/* --- what the importer offers */

/* FMI 2.0's logger takes the text for a format; '#' stands before and after a value reference. */
static void log_message(const Host *host, const char *name, Status status, const char *category, const char *text) {
    char escaped[2 * MESSAGE_SIZE];
    escape(escaped, text, "%#");
    ((fmi2CallbackLogger)host->logger)(host->environment, name, (fmi2Status)status, category, escaped);
}

static Host host_of(const fmi2CallbackFunctions *functions) {
    Host host = {0};
    if (!functions) return host;
    host.environment = functions->componentEnvironment;
    if (functions->logger) {
        host.log = log_message;
        host.logger = (Function *)functions->logger;
    }
    if (functions->allocateMemory && functions->freeMemory) {
        host.allocate = functions->allocateMemory;
        host.release = functions->freeMemory;
    }
    return host;
}

/* --- life */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Host host = host_of(functions);
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation) return refuse_instance(&host, __func__, name, "this FMU is for co-simulation");
    return create_instance(&host, __func__, name, guid);
}

void fmi2FreeInstance(fmi2Component c) { free_instance(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)on;
    return (fmi2Status)set_debug_logging(c, __func__, n, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    Status status = set_up_experiment(c, __func__, start, stop_defined, stop);
    if (status == CALL_OK) say_of_tolerance(c, __func__, tolerance_defined, tolerance);
    return (fmi2Status)status;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (fmi2Status)enter_initialization(c, __func__); }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (fmi2Status)exit_initialization(c, __func__); }

fmi2Status fmi2Terminate(fmi2Component c) { return (fmi2Status)terminate(c, __func__); }

fmi2Status fmi2Reset(fmi2Component c) { return (fmi2Status)reset(c); }

/* --- values */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    return (fmi2Status)get_reals(c, __func__, r, n, values, n);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    return (fmi2Status)set_reals(c, __func__, r, n, values, n);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[]) {
    return (fmi2Status)get_integers(c, __func__, r, n, values);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer values[]) {
    (void)values;
    return (fmi2Status)no_variables(c, __func__, r, n, "Integer variable that can be set");
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean values[]) {
    (void)values;
    return (fmi2Status)no_variables(c, __func__, r, n, "Boolean variable");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean values[]) {
    (void)values;
    return (fmi2Status)no_variables(c, __func__, r, n, "Boolean variable");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String values[]) {
    (void)values;
    return (fmi2Status)no_variables(c, __func__, r, n, "String variable");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String values[]) {
    (void)values;
    return (fmi2Status)no_variables(c, __func__, r, n, "String variable");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[]) {
    return (fmi2Status)set_input_derivatives(c, __func__, r, n, order, values);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real values[]) {
    return (fmi2Status)get_output_derivatives(c, __func__, r, n, order, values, n);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real by[],
                                        fmi2Real values[]) {
    Partial of = {unknown, n_unknown, known, n_known, by, n_known, values, n_unknown};
    return (fmi2Status)get_directional_derivative(c, __func__, &of);
}

/* --- steps */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean never_back) {
    (void)never_back;
    return (fmi2Status)do_step(c, __func__, t, h);
}

fmi2Status fmi2CancelStep(fmi2Component c) { return (fmi2Status)refuse(c, __func__, "no step is pending"); }

static fmi2Status no_status(fmi2Component c, const char *call, fmi2StatusKind kind) {
    return (fmi2Status)answer(c, CALL_DISCARD, call, "there is no status of kind %d", (int)kind);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)value;
    return no_status(c, __func__, kind);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return no_status(c, __func__, kind);
    return (fmi2Status)get_last_successful_time(c, __func__, value);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)value;
    return no_status(c, __func__, kind);
}

/* fmi2Terminated is true after a discarded step: from here the motion cannot go on as it is. */
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return no_status(c, __func__, kind);
    return (fmi2Status)get_discarded(c, __func__, value);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)value;
    return no_status(c, __func__, kind);
}

/* --- saved states */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return (fmi2Status)save_state(c, __func__, state); }

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return (fmi2Status)restore_state(c, __func__, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) { return (fmi2Status)free_state(c, __func__, state); }

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return (fmi2Status)state_size(c, __func__, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return (fmi2Status)serialize_state(c, __func__, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return (fmi2Status)deserialize_state(c, __func__, bytes, size, state);
}
