/* FMI 3.0 for model exchange, section 3 of the standard: what a linearised mechanism has
   beside the functions in fmi3.c. It has no events. */
#include "exchange.h"
#include "linear_plant.h"

typedef const char *Text;

EXPORT void *fmi3InstantiateModelExchange(Text name, Text token, Text resources,
                                          bool visible, bool logging, void *environment,
                                          Logger logger)
{
    (void)resources, (void)visible, (void)logging;
    return fmi3_new_unit(name, token, logger, environment);
}

EXPORT int fmi3EnterContinuousTimeMode(void *unit)
{
    (void)unit;
    return STATUS_OK;
}

EXPORT int fmi3CompletedIntegratorStep(void *unit, bool no_rollback, bool *event,
                                       bool *terminate)
{
    (void)unit, (void)no_rollback;
    *event = *terminate = false;
    return STATUS_OK;
}

EXPORT int fmi3SetTime(void *unit, double time)
{
    linear_set_time(((Unit *)unit)->plant, time);
    return STATUS_OK;
}

EXPORT int fmi3SetContinuousStates(void *unit, const double *states, size_t n)
{
    return exchange_set_states(unit, states, n);
}

EXPORT int fmi3GetContinuousStates(void *unit, double *states, size_t n)
{
    return exchange_states(unit, states, n);
}

EXPORT int fmi3GetContinuousStateDerivatives(void *unit, double *rates, size_t n)
{
    return exchange_rates(unit, rates, n);
}

EXPORT int fmi3GetNominalsOfContinuousStates(void *unit, double *nominals, size_t n)
{
    return exchange_nominals(unit, nominals, n);
}

EXPORT int fmi3GetNumberOfContinuousStates(void *unit, size_t *n)
{
    (void)unit;
    *n = linear_n_states();
    return STATUS_OK;
}

EXPORT int fmi3GetNumberOfEventIndicators(void *unit, size_t *n)
{
    (void)unit;
    *n = 0;
    return STATUS_OK;
}

EXPORT int fmi3GetEventIndicators(void *unit, double *indicators, size_t n)
{
    (void)indicators;
    return n == 0 ? STATUS_OK
                  : unit_fail(unit, STATUS_ERROR, "there are no event indicators");
}

EXPORT int fmi3GetDirectionalDerivative(void *unit, const Variable *unknowns,
                                        size_t n_unknowns, const Variable *knowns,
                                        size_t n_knowns, const double *seeds,
                                        size_t n_seeds, double *changes, size_t n_changes)
{
    if (n_seeds != n_knowns || n_changes != n_unknowns)
        return unit_fail(unit, STATUS_ERROR, "each variable has one value");
    return exchange_derivative(unit, unknowns, n_unknowns, knowns, n_knowns, seeds,
                               changes);
}
