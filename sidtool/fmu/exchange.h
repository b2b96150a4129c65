/* Model exchange of a linearised mechanism: what FMI 2.0 and 3.0 have in common. */
#ifndef EXCHANGE_H
#define EXCHANGE_H

#include "unit.h"

Status exchange_states(Unit *unit, double *states, size_t n);
Status exchange_set_states(Unit *unit, const double *states, size_t n);
Status exchange_rates(Unit *unit, double *rates, size_t n);
Status exchange_nominals(Unit *unit, double *nominals, size_t n);
/* Changes of unknowns (outputs, rates) with those of knowns (inputs, states). */
Status exchange_derivative(Unit *unit, const Variable *unknowns, size_t n_unknowns,
                           const Variable *knowns, size_t n_knowns, const double *seeds,
                           double *changes);

#endif
