/* Model exchange of a linearised mechanism: what FMI 2.0 and 3.0 have in common. */
#include "exchange.h"

#include "linear_plant.h"

static bool has_all_states(const Unit *unit, size_t n)
{
    if (n == linear_n_states())
        return true;
    unit_fail(unit, STATUS_ERROR, "there are %zu states, not %zu", linear_n_states(), n);
    return false;
}

Status exchange_states(Unit *unit, double *states, size_t n)
{
    if (!has_all_states(unit, n))
        return STATUS_ERROR;
    linear_states(unit->plant, states);
    return STATUS_OK;
}

Status exchange_set_states(Unit *unit, const double *states, size_t n)
{
    if (!has_all_states(unit, n))
        return STATUS_ERROR;
    linear_set_states(unit->plant, states);
    return STATUS_OK;
}

Status exchange_rates(Unit *unit, double *rates, size_t n)
{
    if (!has_all_states(unit, n))
        return STATUS_ERROR;
    linear_rates(unit->plant, rates);
    return STATUS_OK;
}

Status exchange_nominals(Unit *unit, double *nominals, size_t n)
{
    if (!has_all_states(unit, n))
        return STATUS_ERROR;
    linear_nominals(nominals);
    return STATUS_OK;
}

Status exchange_derivative(Unit *unit, const Variable *unknowns, size_t n_unknowns,
                           const Variable *knowns, size_t n_knowns, const double *seeds,
                           double *changes)
{
    size_t inputs = plant_n_inputs(), outputs = plant_n_outputs();
    for (size_t i = 0; i < n_unknowns; i++) {
        if (unknowns[i] <= inputs || unknowns[i] > inputs + outputs)
            return unit_fail(unit, STATUS_ERROR,
                             "variable %u is neither an output nor a rate",
                             (unsigned)unknowns[i]);
        changes[i] = 0.0;
        for (size_t k = 0; k < n_knowns; k++) {
            if (knowns[k] == 0 || knowns[k] > inputs)
                return unit_fail(unit, STATUS_ERROR,
                                 "variable %u is neither an input nor a state",
                                 (unsigned)knowns[k]);
            size_t output = unknowns[i] - 1 - inputs;
            changes[i] += linear_derivative(output, knowns[k] - 1) * seeds[k];
        }
    }
    return STATUS_OK;
}
