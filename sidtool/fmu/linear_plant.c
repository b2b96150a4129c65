/* The plant of a linearised mechanism. It advances by the exact solution for inputs that
   are held: x(t + h) = x + h phi(h A) x'(t), phi(z) = (exp(z) - 1) / z. */
#include "linear_plant.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit.h"

/* N_STATES, N_INPUTS, N_OUTPUTS; A, B, C, D by rows; INPUTS, OUTPUTS, RATES at the
   operating point; NOMINALS, the sizes of the states. */
#include "matrices.h"

/* Norm of z up to which the series of phi is summed, and its number of terms: the rest is
   0.5^17 / 18!, below rounding. */
static const double SERIES_NORM = 0.5;
enum { TERMS = 17, SQUARE = N_STATES * N_STATES };

struct Plant {
    double time;
    double length;         /* step that `response` belongs to */
    double *values;        /* u, then x */
    double *response;      /* h phi(h A) by rows */
    double *scratch;       /* three square matrices */
};

static size_t size_of_values(void)
{
    return (N_INPUTS + N_STATES) * sizeof(double);
}

Plant *plant_new(void)
{
    Plant *plant = calloc(1, sizeof *plant);
    if (!plant)
        return NULL;
    plant->values = calloc(N_INPUTS + N_STATES + 1, sizeof(double));
    plant->response = calloc(SQUARE + 1, sizeof(double));
    plant->scratch = calloc(3 * SQUARE + 1, sizeof(double));
    if (plant->values && plant->response && plant->scratch) {
        plant_reset(plant);
        return plant;
    }
    plant_free(plant);
    return NULL;
}

void plant_free(Plant *plant)
{
    if (!plant)
        return;
    free(plant->values);
    free(plant->response);
    free(plant->scratch);
    free(plant);
}

void plant_reset(Plant *plant)
{
    plant->time = 0.0;
    memset(plant->values, 0, size_of_values());
    memcpy(plant->values, INPUTS, N_INPUTS * sizeof(double));
}

/* ---- states ------------------------------------------------------------------------- */

size_t plant_state_size(void)
{
    return sizeof(double) + size_of_values();
}

void plant_write_state(const Plant *plant, void *state)
{
    memcpy(state, &plant->time, sizeof(double));
    memcpy((char *)state + sizeof(double), plant->values, size_of_values());
}

void plant_read_state(Plant *plant, const void *state)
{
    memcpy(&plant->time, state, sizeof(double));
    memcpy(plant->values, (const char *)state + sizeof(double), size_of_values());
}

size_t linear_n_states(void)
{
    return N_STATES;
}

void linear_states(const Plant *plant, double *states)
{
    memcpy(states, plant->values + N_INPUTS, N_STATES * sizeof(double));
}

void linear_set_states(Plant *plant, const double *states)
{
    memcpy(plant->values + N_INPUTS, states, N_STATES * sizeof(double));
}

/* ---- inputs, outputs and rates ------------------------------------------------------ */

size_t plant_n_inputs(void)
{
    return N_INPUTS + N_STATES;
}

size_t plant_n_outputs(void)
{
    return N_OUTPUTS + N_STATES;
}

double plant_input(const Plant *plant, size_t index)
{
    return plant->values[index];
}

void plant_set_input(Plant *plant, size_t index, double value)
{
    plant->values[index] = value;
}

double linear_derivative(size_t output, size_t input)
{
    if (output < N_OUTPUTS)
        return input < N_INPUTS ? D[output * N_INPUTS + input]
                                : C[output * N_STATES + input - N_INPUTS];
    size_t row = output - N_OUTPUTS;
    return input < N_INPUTS ? B[row * N_INPUTS + input]
                            : A[row * N_STATES + input - N_INPUTS];
}

double plant_output(Plant *plant, size_t index)
{
    double value = index < N_OUTPUTS ? OUTPUTS[index] : RATES[index - N_OUTPUTS];
    for (size_t k = 0; k < N_INPUTS + N_STATES; k++) {
        double origin = k < N_INPUTS ? INPUTS[k] : 0.0;
        value += linear_derivative(index, k) * (plant->values[k] - origin);
    }
    return value;
}

void linear_nominals(double *nominals)
{
    memcpy(nominals, NOMINALS, N_STATES * sizeof(double));
}

void linear_rates(const Plant *plant, double *rates)
{
    for (size_t i = 0; i < N_STATES; i++)
        rates[i] = plant_output((Plant *)plant, N_OUTPUTS + i);
}

/* ---- time --------------------------------------------------------------------------- */

double plant_time(const Plant *plant)
{
    return plant->time;
}

void linear_set_time(Plant *plant, double time)
{
    plant->time = time;
}

double plant_start_time(void)
{
    return 0.0;
}

double plant_end_time(void)
{
    return INFINITY;
}

double plant_next_break(const Plant *plant)
{
    (void)plant;
    return INFINITY;
}

int plant_has_ended(const Plant *plant)
{
    (void)plant;
    return 0;
}

void plant_explain(const Plant *plant, int64_t code, char *text, size_t size)
{
    snprintf(text, size, "the states are not finite at %.9g s (code %d)", plant->time,
             (int)code);
}

/* out = factor one two */
static void multiply(double factor, const double *one, const double *two, double *out)
{
    for (size_t i = 0; i < N_STATES; i++) {
        double *row = out + i * N_STATES;
        memset(row, 0, N_STATES * sizeof(double));
        for (size_t k = 0; k < N_STATES; k++) {
            double entry = factor * one[i * N_STATES + k];
            for (size_t j = 0; j < N_STATES; j++)
                row[j] += entry * two[k * N_STATES + j];
        }
    }
}

static void add_to_diagonal(double value, double *matrix)
{
    for (size_t i = 0; i < N_STATES; i++)
        matrix[i * N_STATES + i] += value;
}

static double largest_row_sum(void)
{
    double largest = 0.0;
    for (size_t i = 0; i < N_STATES; i++) {
        double sum = 0.0;
        for (size_t j = 0; j < N_STATES; j++)
            sum += fabs(A[i * N_STATES + j]);
        largest = fmax(largest, sum);
    }
    return largest;
}

/* h phi(h A) by its series for a part of h, doubled: phi(2 z) = (exp(z) + 1) phi(z) / 2. */
static void find_response(Plant *plant, double h)
{
    double norm = h * largest_row_sum();
    int doublings = norm > SERIES_NORM ? (int)ceil(log2(norm / SERIES_NORM)) : 0;
    double part = ldexp(h, -doublings);
    double *phi = plant->response, *power = plant->scratch;
    double *next = power + SQUARE, *exponential = next + SQUARE;
    /* Horner: phi = 1 + z/2 (1 + z/3 (1 + ...)) */
    memset(phi, 0, SQUARE * sizeof(double));
    add_to_diagonal(1.0, phi);
    for (int k = TERMS; k > 1; k--) {
        multiply(part / k, A, phi, next);
        memcpy(phi, next, SQUARE * sizeof(double));
        add_to_diagonal(1.0, phi);
    }
    multiply(part, A, phi, exponential);
    for (int k = 0; k < doublings; k++) {
        /* `exponential` is exp(z) - 1 */
        multiply(0.5, exponential, phi, next);
        for (size_t i = 0; i < SQUARE; i++)
            phi[i] += next[i];
        multiply(1.0, exponential, exponential, power);
        for (size_t i = 0; i < SQUARE; i++)
            exponential[i] = 2.0 * exponential[i] + power[i];
    }
    for (size_t i = 0; i < SQUARE; i++)
        phi[i] *= h;
    plant->length = h;
}

/* A length to 40 bits: communication steps that are equal but for rounding have one
   response, which depends on nothing else. */
static double rounded(double length)
{
    int exponent;
    double mantissa = frexp(length, &exponent);
    return ldexp(round(ldexp(mantissa, 40)), exponent - 40);
}

int64_t plant_advance(Plant *plant, double time)
{
    double h = rounded(time - plant->time), *states = plant->values + N_INPUTS;
    if (h > 0.0 && N_STATES > 0) {
        if (h != plant->length)
            find_response(plant, h);
        double *rates = plant->scratch;
        linear_rates(plant, rates);
        for (size_t i = 0; i < N_STATES; i++)
            for (size_t k = 0; k < N_STATES; k++)
                states[i] += plant->response[i * N_STATES + k] * rates[k];
    }
    plant->time = time;
    for (size_t i = 0; i < N_STATES; i++)
        if (!isfinite(states[i]))
            return PLANT_SINGULAR;
    return PLANT_OK;
}
