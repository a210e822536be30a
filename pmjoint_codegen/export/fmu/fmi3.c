/* FMI 3.0 for co-simulation around unit.h. */
#include "fmi3.h"
#include "unit.h"

#include <stdlib.h>
#include <string.h>

/* Declares a function of the interface, and begins its definition. */
#define API(type, name, ...)                                                                                         \
    FMI3_EXPORT type FMI3_NAME(name)(__VA_ARGS__);                                                                   \
    FMI3_EXPORT type FMI3_NAME(name)(__VA_ARGS__)
#define REFERENCES fmi3Instance c, const fmi3ValueReference vr[], size_t n

typedef struct {
    unit s;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance;

static fmi3Status failed(instance *at, const char *message)
{
    if (at->log != NULL) {
        at->log(at->environment, fmi3Error, "logStatusError", message);
    }
    return fmi3Error;
}

static fmi3Status answer(instance *at, const char *trouble)
{
    return (trouble == NULL) ? fmi3OK : failed(at, trouble);
}

API(const char *, fmi3GetVersion, void)
{
    return "3.0";
}

API(fmi3Status, fmi3SetDebugLogging, fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)c;
    (void)on; /* only errors are logged, and those always */
    (void)n;
    (void)names;
    return fmi3OK;
}

API(fmi3Instance, fmi3InstantiateModelExchange, fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)environment;
    (void)log;
    return NULL;
}

API(fmi3Instance, fmi3InstantiateScheduledExecution, fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)environment;
    (void)log;
    (void)update;
    (void)lock;
    (void)unlock;
    return NULL;
}

API(fmi3Instance, fmi3InstantiateCoSimulation, fmi3String name, fmi3String token, fmi3String resources,
    fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean returns,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)events;
    (void)returns;
    (void)intermediate;
    (void)n;
    (void)update;
    instance *const at = calloc(1, sizeof(instance));
    if (at == NULL) {
        return NULL;
    }
    at->environment = environment;
    at->log = log;
    if ((token == NULL) || (strcmp(token, MODEL_TOKEN) != 0)) {
        (void)failed(at, "the instantiation token is not that of this unit");
        free(at);
        return NULL;
    }
    unit_renew(&at->s);
    return at;
}

API(void, fmi3FreeInstance, fmi3Instance c)
{
    free(c);
}

API(fmi3Status, fmi3EnterInitializationMode, fmi3Instance c, fmi3Boolean tolerant, fmi3Float64 tolerance,
    fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop)
{
    instance *const at = c;
    (void)tolerant; /* of the master; the plant has a parameter of that name */
    (void)tolerance;
    (void)stops;
    (void)stop;
    if (at->s.phase != INSTANTIATED) {
        return failed(at, "fmi3EnterInitializationMode: the unit is initialised");
    }
    at->s.held.start = start;
    at->s.held.time = start;
    at->s.phase = INITIALIZING;
    return fmi3OK;
}

API(fmi3Status, fmi3ExitInitializationMode, fmi3Instance c)
{
    instance *const at = c;
    return answer(at, unit_initialized(&at->s));
}

API(fmi3Status, fmi3Terminate, fmi3Instance c)
{
    ((instance *)c)->s.phase = TERMINATED;
    return fmi3OK;
}

API(fmi3Status, fmi3Reset, fmi3Instance c)
{
    unit_renew(&((instance *)c)->s);
    return fmi3OK;
}

/* Getter and setter of a type that variables have. */
#define ACCESS(Type, kind)                                                                                           \
    API(fmi3Status, fmi3Get##Type, REFERENCES, fmi3##Type values[], size_t count)                                    \
    {                                                                                                                \
        fmi3Status status = (count == n) ? fmi3OK : failed(c, "every variable has one value");                       \
        for (size_t i = 0; (i < n) && (status == fmi3OK); ++i) {                                                     \
            double value = 0.0;                                                                                      \
            status = answer(c, unit_get(&((instance *)c)->s, vr[i], kind, &value));                                  \
            values[i] = (fmi3##Type)value;                                                                           \
        }                                                                                                            \
        return status;                                                                                               \
    }                                                                                                                \
    API(fmi3Status, fmi3Set##Type, REFERENCES, const fmi3##Type values[], size_t count)                              \
    {                                                                                                                \
        fmi3Status status = (count == n) ? fmi3OK : failed(c, "every variable has one value");                       \
        for (size_t i = 0; (i < n) && (status == fmi3OK); ++i) {                                                     \
            status = answer(c, unit_set(&((instance *)c)->s, vr[i], kind, (double)values[i]));                       \
        }                                                                                                            \
        return status;                                                                                               \
    }

/* Getter and setter of a type that no variable has. */
#define NO_ACCESS(Type)                                                                                              \
    API(fmi3Status, fmi3Get##Type, REFERENCES, fmi3##Type values[], size_t count)                                    \
    {                                                                                                                \
        (void)vr;                                                                                                    \
        (void)values;                                                                                                \
        return ((n == 0) && (count == 0)) ? fmi3OK : failed(c, "there is no variable of type " #Type);               \
    }                                                                                                                \
    API(fmi3Status, fmi3Set##Type, REFERENCES, const fmi3##Type values[], size_t count)                              \
    {                                                                                                                \
        (void)vr;                                                                                                    \
        (void)values;                                                                                                \
        return ((n == 0) && (count == 0)) ? fmi3OK : failed(c, "there is no variable of type " #Type);               \
    }

ACCESS(Float64, REAL)
ACCESS(Int32, INTEGER)
ACCESS(Boolean, BOOLEAN)
NO_ACCESS(Float32)
NO_ACCESS(Int8)
NO_ACCESS(UInt8)
NO_ACCESS(Int16)
NO_ACCESS(UInt16)
NO_ACCESS(UInt32)
NO_ACCESS(Int64)
NO_ACCESS(UInt64)
NO_ACCESS(String)

API(fmi3Status, fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t count)
{
    (void)vr;
    (void)sizes;
    (void)values;
    return ((n == 0) && (count == 0)) ? fmi3OK : failed(c, "there is no variable of type Binary");
}

API(fmi3Status, fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t count)
{
    (void)vr;
    (void)sizes;
    (void)values;
    return ((n == 0) && (count == 0)) ? fmi3OK : failed(c, "there is no variable of type Binary");
}

API(fmi3Status, fmi3GetFMUState, fmi3Instance c, fmi3FMUState *state)
{
    instance *const at = c;
    return answer(at, unit_keep(state, &at->s));
}

API(fmi3Status, fmi3SetFMUState, fmi3Instance c, fmi3FMUState state)
{
    instance *const at = c;
    return answer(at, unit_restore(&at->s, state));
}

API(fmi3Status, fmi3FreeFMUState, fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

API(fmi3Status, fmi3SerializedFMUStateSize, fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(unit);
    return fmi3OK;
}

API(fmi3Status, fmi3SerializeFMUState, fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return answer(c, unit_serialize(state, bytes, size));
}

API(fmi3Status, fmi3DeserializeFMUState, fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return answer(c, unit_deserialize(state, bytes, size));
}

API(fmi3Status, fmi3EnterStepMode, fmi3Instance c)
{
    return failed(c, "the unit has no event mode to leave");
}

API(fmi3Status, fmi3DoStep, fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keeps,
    fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    instance *const at = c;
    (void)keeps;
    const char *const trouble = unit_step(&at->s, time, step);
    *event = false;
    *terminate = false;
    *early = false;
    *last = at->s.held.time;
    return answer(at, trouble);
}

API(fmi3Status, fmi3UpdateDiscreteStates, fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate,
    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
{
    (void)again;
    (void)terminate;
    (void)nominals;
    (void)values;
    (void)defined;
    (void)next;
    return failed(c, "the unit has no event mode");
}

/* What the standard lists and this unit's modelDescription.xml does not offer. */
#define NOT_OFFERED(name, ...)                                                                                       \
    API(fmi3Status, name, fmi3Instance c, __VA_ARGS__)                                                               \
    {                                                                                                                \
        return failed(c, #name " is not offered: see modelDescription.xml");                                         \
    }
#define NOT_OFFERED_PLAIN(name)                                                                                      \
    API(fmi3Status, name, fmi3Instance c)                                                                            \
    {                                                                                                                \
        return failed(c, #name " is not offered: see modelDescription.xml");                                         \
    }

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_OFFERED_PLAIN(fmi3EnterEventMode)
NOT_OFFERED_PLAIN(fmi3EnterConfigurationMode)
NOT_OFFERED_PLAIN(fmi3ExitConfigurationMode)
NOT_OFFERED_PLAIN(fmi3EvaluateDiscreteStates)
NOT_OFFERED_PLAIN(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3GetClock, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
NOT_OFFERED(fmi3SetClock, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *count)
NOT_OFFERED(fmi3GetVariableDependencies, fmi3ValueReference vr, size_t rows[], fmi3ValueReference on[],
    size_t columns[], fmi3DependencyKind kinds[], size_t n)
NOT_OFFERED(fmi3GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t n,
    const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[], size_t seeds, fmi3Float64 derivative[],
    size_t derivatives)
NOT_OFFERED(fmi3GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t n,
    const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[], size_t seeds, fmi3Float64 derivative[],
    size_t derivatives)
NOT_OFFERED(fmi3GetIntervalDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
    fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetIntervalFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
    fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetShiftDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
NOT_OFFERED(fmi3GetShiftFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
    fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetIntervalDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 intervals[])
NOT_OFFERED(fmi3SetIntervalFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
    const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetShiftDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
NOT_OFFERED(fmi3SetShiftFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
    const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3CompletedIntegratorStep, fmi3Boolean keeps, fmi3Boolean *event, fmi3Boolean *terminate)
NOT_OFFERED(fmi3SetTime, fmi3Float64 time)
NOT_OFFERED(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n)
NOT_OFFERED(fmi3GetContinuousStates, fmi3Float64 x[], size_t n)
NOT_OFFERED(fmi3GetContinuousStateDerivatives, fmi3Float64 x_dot[], size_t n)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t n)
NOT_OFFERED(fmi3GetEventIndicators, fmi3Float64 indicators[], size_t n)
NOT_OFFERED(fmi3GetNumberOfEventIndicators, size_t *n)
NOT_OFFERED(fmi3GetNumberOfContinuousStates, size_t *n)
NOT_OFFERED(fmi3GetOutputDerivatives, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
    fmi3Float64 values[], size_t count)
NOT_OFFERED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
