/* FMI 3.0 for co-simulation, section 4 of the standard. All functions exist, as importers
   ask for all; those of variables and abilities that a unit has not return an error. With
   LINEAR the unit is a linearised mechanism, and exchange3.c has its model exchange. */
#include <math.h>

#include "unit.h"

typedef const char *Text;
typedef void (*Logger3)(void *environment, int status, Text category, Text text);

static void send_message(const Unit *unit, Status status, char *text)
{
    Text category = status >= STATUS_ERROR ? "logStatusError"
        : status == STATUS_DISCARD         ? "logStatusDiscard"
                                           : "logStatusWarning";
    ((Logger3)unit->logger)(unit->environment, status, category, text);
}

/* ---- instances ---------------------------------------------------------------------- */

EXPORT Text fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT int fmi3SetDebugLogging(void *unit, bool on, size_t n, const Text *categories)
{
    (void)unit, (void)on, (void)n, (void)categories;
    return STATUS_OK;
}

Unit *fmi3_new_unit(Text name, Text token, Logger logger, void *environment)
{
    return unit_new(name, token, send_message, logger, environment);
}

EXPORT void *fmi3InstantiateCoSimulation(Text name, Text token, Text resources,
                                         bool visible, bool logging, bool event_mode,
                                         bool early_return, const Variable *intermediate,
                                         size_t n_intermediate, void *environment,
                                         Logger logger, void *update)
{
    (void)resources, (void)visible, (void)logging;
    (void)intermediate, (void)n_intermediate, (void)update;
    Unit *unit = fmi3_new_unit(name, token, logger, environment);
    if (unit)
        unit->stops_at_breaks = event_mode && early_return;
    return unit;
}

#ifndef LINEAR
EXPORT void *fmi3InstantiateModelExchange(void)
{
    return NULL;
}
#endif

EXPORT void *fmi3InstantiateScheduledExecution(void)
{
    return NULL;
}

EXPORT void fmi3FreeInstance(void *unit)
{
    unit_free(unit);
}

EXPORT int fmi3EnterInitializationMode(void *unit, bool tolerance_defined,
                                       double tolerance, double start, bool stop_defined,
                                       double stop)
{
    (void)tolerance_defined, (void)tolerance;  /* the tolerance is that of the scene */
    return unit_start(unit, start, stop_defined, stop);
}

EXPORT int fmi3ExitInitializationMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi3EnterEventMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi3EnterStepMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi3Terminate(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi3Reset(void *unit)
{
    plant_reset(((Unit *)unit)->plant);
    return STATUS_OK;
}

/* ---- variables ---------------------------------------------------------------------- */

EXPORT int fmi3GetFloat64(void *unit, const Variable *variables, size_t n, double *values,
                          size_t n_values)
{
    if (n != n_values)
        return unit_fail(unit, STATUS_ERROR, "%zu variables have %zu values", n, n_values);
    return unit_get(unit, variables, n, values);
}

EXPORT int fmi3SetFloat64(void *unit, const Variable *variables, size_t n,
                          const double *values, size_t n_values)
{
    if (n != n_values)
        return unit_fail(unit, STATUS_ERROR, "%zu variables have %zu values", n, n_values);
    return unit_set(unit, variables, n, values);
}

/* ---- steps -------------------------------------------------------------------------- */

/* With event mode and early return a step ends at a break of a function of the scene, so
   that the importer can act there; else breaks are passed inside. */
EXPORT int fmi3DoStep(void *unit, double time, double length, bool no_rollback,
                      bool *needs_event, bool *terminates, bool *early, double *last_time)
{
    (void)no_rollback;
    double until_break = unit_length_to_break(unit, time, length);
    *terminates = false;
    *early = *needs_event = until_break < length;
    Status status = unit_step(unit, time, until_break);
    *last_time = plant_time(((Unit *)unit)->plant);
    if (status == STATUS_DISCARD && plant_has_ended(((Unit *)unit)->plant)) {
        *terminates = *early = true;
        *needs_event = false;
        return STATUS_OK;
    }
    return status;
}

EXPORT int fmi3UpdateDiscreteStates(void *unit, bool *again, bool *terminates,
                                    bool *nominals_changed, bool *values_changed,
                                    bool *next_defined, double *next)
{
    *again = *terminates = *nominals_changed = *values_changed = false;
    *next = plant_next_break(((Unit *)unit)->plant);
    *next_defined = isfinite(*next);
    return STATUS_OK;
}

EXPORT int fmi3EvaluateDiscreteStates(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

/* ---- states ------------------------------------------------------------------------- */

EXPORT int fmi3GetFMUState(void *unit, void **state)
{
    return unit_get_state(unit, state);
}

EXPORT int fmi3SetFMUState(void *unit, void *state)
{
    return unit_set_state(unit, state);
}

EXPORT int fmi3FreeFMUState(void *unit, void **state)
{
    (void)unit;
    return unit_free_state(state);
}

EXPORT int fmi3SerializedFMUStateSize(void *unit, void *state, size_t *size)
{
    (void)unit, (void)state;
    *size = unit_state_size();
    return STATUS_OK;
}

EXPORT int fmi3SerializeFMUState(void *unit, void *state, char *bytes, size_t size)
{
    return unit_serialise(unit, state, bytes, size);
}

EXPORT int fmi3DeserializeFMUState(void *unit, const char *bytes, size_t size, void **state)
{
    return unit_deserialise(unit, bytes, size, state);
}

/* ---- not offered -------------------------------------------------------------------- */

#define NOT_OFFERED(name)                                                                \
    EXPORT int name(void *unit)                                                          \
    {                                                                                    \
        return unit_fail(unit, STATUS_ERROR, "%s is not offered", #name);                \
    }

NOT_OFFERED(fmi3GetFloat32)
NOT_OFFERED(fmi3GetInt8)
NOT_OFFERED(fmi3GetUInt8)
NOT_OFFERED(fmi3GetInt16)
NOT_OFFERED(fmi3GetUInt16)
NOT_OFFERED(fmi3GetInt32)
NOT_OFFERED(fmi3GetUInt32)
NOT_OFFERED(fmi3GetInt64)
NOT_OFFERED(fmi3GetUInt64)
NOT_OFFERED(fmi3GetBoolean)
NOT_OFFERED(fmi3GetString)
NOT_OFFERED(fmi3GetBinary)
NOT_OFFERED(fmi3GetClock)
NOT_OFFERED(fmi3SetFloat32)
NOT_OFFERED(fmi3SetInt8)
NOT_OFFERED(fmi3SetUInt8)
NOT_OFFERED(fmi3SetInt16)
NOT_OFFERED(fmi3SetUInt16)
NOT_OFFERED(fmi3SetInt32)
NOT_OFFERED(fmi3SetUInt32)
NOT_OFFERED(fmi3SetInt64)
NOT_OFFERED(fmi3SetUInt64)
NOT_OFFERED(fmi3SetBoolean)
NOT_OFFERED(fmi3SetString)
NOT_OFFERED(fmi3SetBinary)
NOT_OFFERED(fmi3SetClock)
NOT_OFFERED(fmi3GetNumberOfVariableDependencies)
NOT_OFFERED(fmi3GetVariableDependencies)
NOT_OFFERED(fmi3GetAdjointDerivative)
NOT_OFFERED(fmi3EnterConfigurationMode)
NOT_OFFERED(fmi3ExitConfigurationMode)
NOT_OFFERED(fmi3GetIntervalDecimal)
NOT_OFFERED(fmi3GetIntervalFraction)
NOT_OFFERED(fmi3GetShiftDecimal)
NOT_OFFERED(fmi3GetShiftFraction)
NOT_OFFERED(fmi3SetIntervalDecimal)
NOT_OFFERED(fmi3SetIntervalFraction)
NOT_OFFERED(fmi3SetShiftDecimal)
NOT_OFFERED(fmi3SetShiftFraction)
NOT_OFFERED(fmi3GetOutputDerivatives)
NOT_OFFERED(fmi3ActivateModelPartition)
#ifndef LINEAR
NOT_OFFERED(fmi3GetDirectionalDerivative)
NOT_OFFERED(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3CompletedIntegratorStep)
NOT_OFFERED(fmi3SetTime)
NOT_OFFERED(fmi3SetContinuousStates)
NOT_OFFERED(fmi3GetContinuousStateDerivatives)
NOT_OFFERED(fmi3GetEventIndicators)
NOT_OFFERED(fmi3GetContinuousStates)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates)
NOT_OFFERED(fmi3GetNumberOfEventIndicators)
NOT_OFFERED(fmi3GetNumberOfContinuousStates)
#endif
