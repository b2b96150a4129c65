/* FMI 2.0 for model exchange, section 3.2 of the standard: what a linearised mechanism has
   beside the functions in fmi2.c. It has no events. */
#include "exchange.h"
#include "linear_plant.h"

typedef int Boolean;

typedef struct {
    Boolean discrete_states_needed;
    Boolean terminate;
    Boolean nominals_changed;
    Boolean states_changed;
    Boolean next_defined;
    double next;
} EventInfo;

EXPORT int fmi2EnterEventMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi2NewDiscreteStates(void *unit, EventInfo *info)
{
    (void)unit;
    *info = (EventInfo){0};
    return STATUS_OK;
}

EXPORT int fmi2EnterContinuousTimeMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi2CompletedIntegratorStep(void *unit, Boolean no_rollback, Boolean *event,
                                       Boolean *terminate)
{
    (void)unit, (void)no_rollback;
    *event = *terminate = 0;
    return STATUS_OK;
}

EXPORT int fmi2SetTime(void *unit, double time)
{
    linear_set_time(((Unit *)unit)->plant, time);
    return STATUS_OK;
}

EXPORT int fmi2SetContinuousStates(void *unit, const double *states, size_t n)
{
    return exchange_set_states(unit, states, n);
}

EXPORT int fmi2GetContinuousStates(void *unit, double *states, size_t n)
{
    return exchange_states(unit, states, n);
}

EXPORT int fmi2GetDerivatives(void *unit, double *rates, size_t n)
{
    return exchange_rates(unit, rates, n);
}

EXPORT int fmi2GetNominalsOfContinuousStates(void *unit, double *nominals, size_t n)
{
    return exchange_nominals(unit, nominals, n);
}

EXPORT int fmi2GetEventIndicators(void *unit, double *indicators, size_t n)
{
    (void)indicators;
    return n == 0 ? STATUS_OK
                  : unit_fail(unit, STATUS_ERROR, "there are no event indicators");
}

EXPORT int fmi2GetDirectionalDerivative(void *unit, const Variable *unknowns,
                                        size_t n_unknowns, const Variable *knowns,
                                        size_t n_knowns, const double *seeds,
                                        double *changes)
{
    return exchange_derivative(unit, unknowns, n_unknowns, knowns, n_knowns, seeds,
                               changes);
}
