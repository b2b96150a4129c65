/* FMI 2.0 for co-simulation, section 4.2 of the standard. All functions exist, as importers
   ask for all; those of variables and abilities that a unit has not return an error. With
   LINEAR the unit is a linearised mechanism, and exchange2.c has its model exchange. */
#include "unit.h"

typedef int Boolean;
typedef const char *Text;
enum { MODEL_EXCHANGE, CO_SIMULATION };
#ifdef LINEAR
enum { OFFERS_EXCHANGE = 1 };
#else
enum { OFFERS_EXCHANGE = 0 };
#endif
enum { DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED };

typedef void (*Logger2)(void *environment, Text name, int status, Text category,
                        Text text, ...);

typedef struct {
    Logger2 logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} Callbacks;

/* The text is a format of printf to the importer, though some print it as it is. */
static void send_message(const Unit *unit, Status status, char *text)
{
    Text category = status >= STATUS_ERROR ? "logStatusError"
        : status == STATUS_DISCARD         ? "logStatusDiscard"
                                           : "logStatusWarning";
    for (char *c = text; *c; c++)
        *c = *c == '%' ? '#' : *c;
    ((Logger2)unit->logger)(unit->environment, unit->name, status, category, text);
}

/* ---- instances ---------------------------------------------------------------------- */

EXPORT Text fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT Text fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT int fmi2SetDebugLogging(void *unit, Boolean on, size_t n, const Text *categories)
{
    (void)unit, (void)on, (void)n, (void)categories;
    return STATUS_OK;
}

EXPORT void *fmi2Instantiate(Text name, int type, Text token, Text resources,
                             const Callbacks *callbacks, Boolean visible, Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    if (type != CO_SIMULATION && !(OFFERS_EXCHANGE && type == MODEL_EXCHANGE))
        return NULL;
    Logger logger = callbacks ? (Logger)callbacks->logger : NULL;
    return unit_new(name, token, send_message, logger,
                    callbacks ? callbacks->environment : NULL);
}

EXPORT void fmi2FreeInstance(void *unit)
{
    unit_free(unit);
}

EXPORT int fmi2SetupExperiment(void *unit, Boolean tolerance_defined, double tolerance,
                               double start, Boolean stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance;  /* the tolerance is that of the scene */
    return unit_start(unit, start, stop_defined != 0, stop);
}

EXPORT int fmi2EnterInitializationMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi2ExitInitializationMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi2Terminate(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi2Reset(void *unit)
{
    plant_reset(((Unit *)unit)->plant);
    return STATUS_OK;
}

/* ---- variables ---------------------------------------------------------------------- */

EXPORT int fmi2GetReal(void *unit, const Variable *variables, size_t n, double *values)
{
    return unit_get(unit, variables, n, values);
}

EXPORT int fmi2SetReal(void *unit, const Variable *variables, size_t n,
                       const double *values)
{
    return unit_set(unit, variables, n, values);
}

#define NO_VARIABLES(name, type)                                                         \
    EXPORT int name(void *unit, const Variable *variables, size_t n, type *values)       \
    {                                                                                    \
        (void)variables, (void)values;                                                   \
        return n == 0 ? STATUS_OK                                                        \
                      : unit_fail(unit, STATUS_ERROR, "%s: all variables are real",      \
                                  #name);                                                \
    }

NO_VARIABLES(fmi2GetInteger, int)
NO_VARIABLES(fmi2GetBoolean, Boolean)
NO_VARIABLES(fmi2GetString, Text)
NO_VARIABLES(fmi2SetInteger, const int)
NO_VARIABLES(fmi2SetBoolean, const Boolean)
NO_VARIABLES(fmi2SetString, const Text)

/* ---- steps -------------------------------------------------------------------------- */

EXPORT int fmi2DoStep(void *unit, double time, double length, Boolean no_rollback)
{
    (void)no_rollback;
    return unit_step(unit, time, length);
}

EXPORT int fmi2CancelStep(void *unit)
{
    return unit_fail(unit, STATUS_ERROR, "fmi2CancelStep: steps are not asynchronous");
}

EXPORT int fmi2GetStatus(void *unit, int kind, int *status)
{
    (void)unit, (void)kind, (void)status;
    return STATUS_DISCARD;
}

EXPORT int fmi2GetRealStatus(void *unit, int kind, double *value)
{
    if (kind != LAST_SUCCESSFUL_TIME)
        return STATUS_DISCARD;
    *value = plant_time(((Unit *)unit)->plant);
    return STATUS_OK;
}

EXPORT int fmi2GetIntegerStatus(void *unit, int kind, int *value)
{
    (void)unit, (void)kind, (void)value;
    return STATUS_DISCARD;
}

/* A step that an event of the scene ends is discarded, and the unit has terminated. */
EXPORT int fmi2GetBooleanStatus(void *unit, int kind, Boolean *value)
{
    if (kind != TERMINATED)
        return STATUS_DISCARD;
    *value = plant_has_ended(((Unit *)unit)->plant);
    return STATUS_OK;
}

EXPORT int fmi2GetStringStatus(void *unit, int kind, Text *value)
{
    (void)unit, (void)kind, (void)value;
    return STATUS_DISCARD;
}

/* ---- states ------------------------------------------------------------------------- */

EXPORT int fmi2GetFMUstate(void *unit, void **state)
{
    return unit_get_state(unit, state);
}

EXPORT int fmi2SetFMUstate(void *unit, void *state)
{
    return unit_set_state(unit, state);
}

EXPORT int fmi2FreeFMUstate(void *unit, void **state)
{
    (void)unit;
    return unit_free_state(state);
}

EXPORT int fmi2SerializedFMUstateSize(void *unit, void *state, size_t *size)
{
    (void)unit, (void)state;
    *size = unit_state_size();
    return STATUS_OK;
}

EXPORT int fmi2SerializeFMUstate(void *unit, void *state, char *bytes, size_t size)
{
    return unit_serialise(unit, state, bytes, size);
}

EXPORT int fmi2DeSerializeFMUstate(void *unit, const char *bytes, size_t size, void **state)
{
    return unit_deserialise(unit, bytes, size, state);
}

/* ---- not offered -------------------------------------------------------------------- */

#define NOT_OFFERED(name)                                                                \
    EXPORT int name(void *unit)                                                          \
    {                                                                                    \
        return unit_fail(unit, STATUS_ERROR, "%s is not offered", #name);                \
    }

#ifndef LINEAR
NOT_OFFERED(fmi2GetDirectionalDerivative)
#endif
NOT_OFFERED(fmi2SetRealInputDerivatives)
NOT_OFFERED(fmi2GetRealOutputDerivatives)
