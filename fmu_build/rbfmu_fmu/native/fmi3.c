/* The functions of FMI 3.0 for co-simulation: its types and signatures around cosimulation.h. */

#include <string.h>

#include "cosimulation.h"
#include "fmi3Functions.h"

_Static_assert((int)fmi3OK == (int)CALL_OK && (int)fmi3Warning == (int)CALL_WARNING, "a status needs no translation");
_Static_assert((int)fmi3Discard == (int)CALL_DISCARD && (int)fmi3Error == (int)CALL_ERROR, "a status needs none");

/* Of a call that an intermediate update does not allow. */
#define OUTSIDE_UPDATES(c) \
    if (is_updating(c, __func__)) return fmi3Error

/* --- what the importer offers */

/* In FMI 3.0's messages '#' stands before and after a value reference. */
static void log_message(const Host *host, const char *name, Status status, const char *category, const char *text) {
    char escaped[2 * MESSAGE_SIZE];
    (void)name;
    escape(escaped, text, "#");
    ((fmi3LogMessageCallback)host->logger)(host->environment, (fmi3Status)status, category, escaped);
}

static void update(const Host *host, double t, int finished, EarlyReturn *early) {
    fmi3Boolean can_return = host->takes_early_return && early, wanted = fmi3False;
    fmi3Float64 time = t;
    ((fmi3IntermediateUpdateCallback)host->updater)(host->environment, t, !finished, finished, finished, can_return,
                                                    &wanted, &time);
    if (!can_return) return;
    early->wanted = wanted;
    early->time = time;
}

static Host host_of(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    Host host = {0};
    host.environment = environment;
    if (log) {
        host.log = log_message;
        host.logger = (Function *)log;
    }
    return host;
}

/* --- life */

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback updater) {
    Host host = host_of(environment, log);
    Instance *m;
    (void)resources, (void)visible, (void)logging;
    if (events) return refuse_instance(&host, __func__, name, "this FMU has no event mode");
    host.takes_early_return = early_return;
    if (updater) {
        host.update = update;
        host.updater = (Function *)updater;
    }
    m = create_instance(&host, __func__, name, token);
    if (!m || use_intermediate(m, __func__, intermediate, n) == CALL_OK) return m;
    free_instance(m);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    Host host = host_of(environment, log);
    (void)token, (void)resources, (void)visible, (void)logging;
    return refuse_instance(&host, __func__, name, "this FMU is for co-simulation");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update_clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    Host host = host_of(environment, log);
    (void)token, (void)resources, (void)visible, (void)logging, (void)update_clock, (void)lock, (void)unlock;
    return refuse_instance(&host, __func__, name, "this FMU is for co-simulation");
}

void fmi3FreeInstance(fmi3Instance c) {
    if (!is_updating(c, __func__)) free_instance(c);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)on;
    OUTSIDE_UPDATES(c);
    return (fmi3Status)set_debug_logging(c, __func__, n, categories);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    OUTSIDE_UPDATES(c);
    Status status = set_up_and_enter(c, __func__, start, stop_defined, stop);
    if (status == CALL_OK) say_of_tolerance(c, __func__, tolerance_defined, tolerance);
    return (fmi3Status)status;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)exit_initialization(c, __func__);
}

fmi3Status fmi3Terminate(fmi3Instance c) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)terminate(c, __func__);
}

fmi3Status fmi3Reset(fmi3Instance c) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)reset(c);
}

/* --- values */

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference v[], size_t n, fmi3Float64 values[],
                          size_t n_values) {
    return (fmi3Status)get_reals(c, __func__, v, n, values, n_values);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference v[], size_t n, const fmi3Float64 values[],
                          size_t n_values) {
    return (fmi3Status)set_reals(c, __func__, v, n, values, n_values);
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference v[], size_t n, fmi3Int32 values[], size_t n_values) {
    if (c && n_values != n) return (fmi3Status)refuse(c, __func__, "%zu values: expected %zu", n_values, n);
    return (fmi3Status)get_integers(c, __func__, v, n, values);
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference v[], size_t n, const fmi3Int32 values[],
                        size_t n_values) {
    (void)values, (void)n_values;
    return (fmi3Status)no_variables(c, __func__, v, n, "Int32 variable that can be set");
}

#define NO_VARIABLES(type) \
    fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference v[], size_t n, fmi3##type values[], \
                             size_t n_values) { \
        (void)values, (void)n_values; \
        return (fmi3Status)no_variables(c, __func__, v, n, #type " variable"); \
    } \
    fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference v[], size_t n, const fmi3##type values[], \
                             size_t n_values) { \
        (void)values, (void)n_values; \
        return (fmi3Status)no_variables(c, __func__, v, n, #type " variable"); \
    }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference v[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t n_values) {
    (void)sizes, (void)values, (void)n_values;
    return (fmi3Status)no_variables(c, __func__, v, n, "Binary variable");
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference v[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values) {
    (void)sizes, (void)values, (void)n_values;
    return (fmi3Status)no_variables(c, __func__, v, n, "Binary variable");
}

/* --- derivatives */

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference v[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values) {
    return (fmi3Status)get_output_derivatives(c, __func__, v, n, orders, values, n_values);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    Partial of = {unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, sensitivity, n_sensitivity};
    OUTSIDE_UPDATES(c);
    return (fmi3Status)get_directional_derivative(c, __func__, &of);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    Partial of = {unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, sensitivity, n_sensitivity};
    OUTSIDE_UPDATES(c);
    return (fmi3Status)get_adjoint_derivative(c, __func__, &of);
}

/* --- steps */

/* A discarded step asks to end the simulation: from here the motion cannot go on as it is. */
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean never_back, fmi3Boolean *event,
                      fmi3Boolean *terminate_simulation, fmi3Boolean *early_return, fmi3Float64 *reached) {
    Status status;
    int discarded = 0, early = 0;
    (void)never_back;
    OUTSIDE_UPDATES(c);
    if (c && !(event && terminate_simulation && early_return && reached))
        return (fmi3Status)refuse(c, __func__, "null pointer");
    status = do_step(c, __func__, t, h);
    if (!c) return (fmi3Status)status;
    get_discarded(c, __func__, &discarded);
    get_returned_early(c, __func__, &early);
    get_last_successful_time(c, __func__, reached);
    *event = fmi3False;
    *terminate_simulation = status == CALL_DISCARD && discarded;
    *early_return = early;
    return (fmi3Status)status;
}

/* --- saved states */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)save_state(c, __func__, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)restore_state(c, __func__, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)free_state(c, __func__, state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)state_size(c, __func__, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)serialize_state(c, __func__, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    OUTSIDE_UPDATES(c);
    return (fmi3Status)deserialize_state(c, __func__, bytes, size, state);
}

/* --- what modelDescription.xml says that there is not */

#define NOT_PROVIDED(function, ...) \
    fmi3Status function(__VA_ARGS__) { return (fmi3Status)refuse(c, __func__, "not provided"); }

#define C fmi3Instance c
#define V const fmi3ValueReference v[], size_t n

NOT_PROVIDED(fmi3EnterEventMode, C)
NOT_PROVIDED(fmi3EnterStepMode, C)
NOT_PROVIDED(fmi3EnterConfigurationMode, C)
NOT_PROVIDED(fmi3ExitConfigurationMode, C)
NOT_PROVIDED(fmi3EvaluateDiscreteStates, C)
NOT_PROVIDED(fmi3UpdateDiscreteStates, C, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e,
             fmi3Boolean *f, fmi3Float64 *t)
NOT_PROVIDED(fmi3GetNumberOfVariableDependencies, C, fmi3ValueReference v, size_t *n)
NOT_PROVIDED(fmi3GetVariableDependencies, C, fmi3ValueReference v, size_t i[], fmi3ValueReference of[], size_t j[],
             fmi3DependencyKind kinds[], size_t n)
NOT_PROVIDED(fmi3GetClock, C, V, fmi3Clock values[])
NOT_PROVIDED(fmi3SetClock, C, V, const fmi3Clock values[])
NOT_PROVIDED(fmi3GetIntervalDecimal, C, V, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NOT_PROVIDED(fmi3GetIntervalFraction, C, V, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
             fmi3IntervalQualifier qualifiers[])
NOT_PROVIDED(fmi3GetShiftDecimal, C, V, fmi3Float64 shifts[])
NOT_PROVIDED(fmi3GetShiftFraction, C, V, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NOT_PROVIDED(fmi3SetIntervalDecimal, C, V, const fmi3Float64 intervals[])
NOT_PROVIDED(fmi3SetIntervalFraction, C, V, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_PROVIDED(fmi3SetShiftDecimal, C, V, const fmi3Float64 shifts[])
NOT_PROVIDED(fmi3SetShiftFraction, C, V, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

/* --- of other interface types */

NOT_PROVIDED(fmi3EnterContinuousTimeMode, C)
NOT_PROVIDED(fmi3CompletedIntegratorStep, C, fmi3Boolean never_back, fmi3Boolean *event, fmi3Boolean *end)
NOT_PROVIDED(fmi3SetTime, C, fmi3Float64 t)
NOT_PROVIDED(fmi3SetContinuousStates, C, const fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetContinuousStateDerivatives, C, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetEventIndicators, C, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetContinuousStates, C, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetNominalsOfContinuousStates, C, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetNumberOfEventIndicators, C, size_t *n)
NOT_PROVIDED(fmi3GetNumberOfContinuousStates, C, size_t *n)
NOT_PROVIDED(fmi3ActivateModelPartition, C, fmi3ValueReference clock, fmi3Float64 t)
