/* A linearised mechanism, x' = x0' + A x + B (u - u0), y = y0 + C x + D (u - u0): what
   model exchange needs beside the functions of a plant. Its inputs are u and then x, its
   outputs y and then x'. */
#ifndef LINEAR_PLANT_H
#define LINEAR_PLANT_H

#include "plant.h"

size_t linear_n_states(void);
void linear_set_time(Plant *plant, double time);
void linear_states(const Plant *plant, double *states);
void linear_set_states(Plant *plant, const double *states);
void linear_nominals(double *nominals);
void linear_rates(const Plant *plant, double *rates);
/* Derivative of an output by an input of the plant. */
double linear_derivative(size_t output, size_t input);

#endif
