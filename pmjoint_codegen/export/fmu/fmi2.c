/* FMI 2.0 for co-simulation around unit.h. */
#include "fmi2.h"
#include "unit.h"

#include <stdlib.h>
#include <string.h>

/* Declares a function of the interface, and begins its definition. */
#define API(type, name, ...)                                                                                         \
    FMI2_EXPORT type FMI2_NAME(name)(__VA_ARGS__);                                                                   \
    FMI2_EXPORT type FMI2_NAME(name)(__VA_ARGS__)
#define REFERENCES fmi2Component c, const fmi2ValueReference vr[], size_t n

typedef struct {
    unit s;
    fmi2CallbackFunctions callbacks;
    char *name;
} instance;

static fmi2Status failed(instance *at, const char *message)
{
    if (at->callbacks.logger != NULL) {
        at->callbacks.logger(at->callbacks.componentEnvironment, at->name, fmi2Error, "logStatusError", "%s", message);
    }
    return fmi2Error;
}

static fmi2Status answer(instance *at, const char *trouble)
{
    return (trouble == NULL) ? fmi2OK : failed(at, trouble);
}

API(const char *, fmi2GetTypesPlatform, void)
{
    return "default";
}

API(const char *, fmi2GetVersion, void)
{
    return "2.0";
}

API(fmi2Status, fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    (void)c;
    (void)on; /* only errors are logged, and those always */
    (void)n;
    (void)names;
    return fmi2OK;
}

API(fmi2Component, fmi2Instantiate, fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources;
    (void)visible;
    (void)logging;
    if ((name == NULL) || (functions == NULL) || (type != fmi2CoSimulation)) {
        return NULL;
    }
    instance *const at = calloc(1, sizeof(instance));
    char *const copy = calloc(strlen(name) + 1, 1);
    if ((at == NULL) || (copy == NULL)) {
        free(at);
        free(copy);
        return NULL;
    }
    at->callbacks = *functions;
    at->name = memcpy(copy, name, strlen(name));
    if ((token == NULL) || (strcmp(token, MODEL_TOKEN) != 0)) {
        (void)failed(at, "the GUID is not that of this unit");
        free(copy);
        free(at);
        return NULL;
    }
    unit_renew(&at->s);
    return at;
}

API(void, fmi2FreeInstance, fmi2Component c)
{
    if (c != NULL) {
        free(((instance *)c)->name);
        free(c);
    }
}

API(fmi2Status, fmi2SetupExperiment, fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
    fmi2Boolean stops, fmi2Real stop)
{
    instance *const at = c;
    (void)tolerant; /* of the master; the plant has a parameter of that name */
    (void)tolerance;
    (void)stops;
    (void)stop;
    at->s.held.start = start;
    at->s.held.time = start;
    return fmi2OK;
}

API(fmi2Status, fmi2EnterInitializationMode, fmi2Component c)
{
    instance *const at = c;
    if (at->s.phase != INSTANTIATED) {
        return failed(at, "fmi2EnterInitializationMode: the unit is initialised");
    }
    at->s.phase = INITIALIZING;
    return fmi2OK;
}

API(fmi2Status, fmi2ExitInitializationMode, fmi2Component c)
{
    instance *const at = c;
    return answer(at, unit_initialized(&at->s));
}

API(fmi2Status, fmi2Terminate, fmi2Component c)
{
    ((instance *)c)->s.phase = TERMINATED;
    return fmi2OK;
}

API(fmi2Status, fmi2Reset, fmi2Component c)
{
    unit_renew(&((instance *)c)->s);
    return fmi2OK;
}

/* Getter and setter of a type. */
#define ACCESS(Type, kind)                                                                                           \
    API(fmi2Status, fmi2Get##Type, REFERENCES, fmi2##Type values[])                                                  \
    {                                                                                                                \
        fmi2Status status = fmi2OK;                                                                                  \
        for (size_t i = 0; (i < n) && (status == fmi2OK); ++i) {                                                     \
            double value = 0.0;                                                                                      \
            status = answer(c, unit_get(&((instance *)c)->s, vr[i], kind, &value));                                  \
            values[i] = (fmi2##Type)value;                                                                           \
        }                                                                                                            \
        return status;                                                                                               \
    }                                                                                                                \
    API(fmi2Status, fmi2Set##Type, REFERENCES, const fmi2##Type values[])                                            \
    {                                                                                                                \
        fmi2Status status = fmi2OK;                                                                                  \
        for (size_t i = 0; (i < n) && (status == fmi2OK); ++i) {                                                     \
            status = answer(c, unit_set(&((instance *)c)->s, vr[i], kind, (double)values[i]));                       \
        }                                                                                                            \
        return status;                                                                                               \
    }

ACCESS(Real, REAL)
ACCESS(Integer, INTEGER)
ACCESS(Boolean, BOOLEAN)

API(fmi2Status, fmi2GetString, REFERENCES, fmi2String values[])
{
    (void)vr;
    (void)values;
    return (n == 0) ? fmi2OK : failed(c, "there is no variable of type String");
}

API(fmi2Status, fmi2SetString, REFERENCES, const fmi2String values[])
{
    (void)vr;
    (void)values;
    return (n == 0) ? fmi2OK : failed(c, "there is no variable of type String");
}

API(fmi2Status, fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    instance *const at = c;
    return answer(at, unit_keep(state, &at->s));
}

API(fmi2Status, fmi2SetFMUstate, fmi2Component c, fmi2FMUstate state)
{
    instance *const at = c;
    return answer(at, unit_restore(&at->s, state));
}

API(fmi2Status, fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

API(fmi2Status, fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(unit);
    return fmi2OK;
}

API(fmi2Status, fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return answer(c, unit_serialize(state, bytes, size));
}

API(fmi2Status, fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return answer(c, unit_deserialize(state, bytes, size));
}

API(fmi2Status, fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference unknown[], size_t n,
    const fmi2ValueReference known[], size_t m, const fmi2Real seed[], fmi2Real derivative[])
{
    (void)unknown;
    (void)n;
    (void)known;
    (void)m;
    (void)seed;
    (void)derivative;
    return failed(c, "directional derivatives are not provided");
}

API(fmi2Status, fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
    const fmi2Integer order[], const fmi2Real values[])
{
    (void)vr;
    (void)n;
    (void)order;
    (void)values;
    return failed(c, "inputs are held from step to step: they have no derivatives");
}

API(fmi2Status, fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
    const fmi2Integer order[], fmi2Real values[])
{
    (void)vr;
    (void)n;
    (void)order;
    (void)values;
    return failed(c, "derivatives of outputs are not provided");
}

API(fmi2Status, fmi2DoStep, fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keeps)
{
    instance *const at = c;
    (void)keeps;
    return answer(at, unit_step(&at->s, time, step));
}

API(fmi2Status, fmi2CancelStep, fmi2Component c)
{
    return failed(c, "fmi2CancelStep: no step is pending");
}

API(fmi2Status, fmi2GetStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard; /* no step is ever pending */
}

API(fmi2Status, fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = ((instance *)c)->s.held.time;
    return fmi2OK;
}

API(fmi2Status, fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

API(fmi2Status, fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)c;
    if (kind != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False; /* a unit never ends a simulation */
    return fmi2OK;
}

API(fmi2Status, fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}
