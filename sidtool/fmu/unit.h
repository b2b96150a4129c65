/* An instance of the functional mock-up unit: what both versions of FMI have in common.
 *
 * FMI is a standard of the Modelica Association, https://fmi-standard.org. The functions
 * are declared here by their names and arguments; its header files are not needed.
 */
#ifndef UNIT_H
#define UNIT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "plant.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Status of both versions. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status;

/* Numbers of variables: the time, inputs, outputs. */
typedef uint32_t Variable;

typedef struct Unit Unit;

/* A function of the importer, which `Messenger` knows the type of. */
typedef void (*Logger)(void);

/* Writes one message to the importer. */
typedef void (*Messenger)(const Unit *unit, Status status, char *text);

struct Unit {
    Plant *plant;
    char *name;
    Messenger messenger;
    Logger logger;           /* null for none */
    void *environment;       /* its first argument */
    bool stops_at_breaks;    /* 3.0: event mode and early return are allowed */
};

Unit *unit_new(const char *name, const char *token, Messenger messenger, Logger logger,
               void *environment);
/* The same with the messages of FMI 3.0. */
Unit *fmi3_new_unit(const char *name, const char *token, Logger logger, void *environment);
void unit_free(Unit *unit);
Status unit_fail(const Unit *unit, Status status, const char *format, ...);

Status unit_start(Unit *unit, double start, bool stop_defined, double stop);
Status unit_step(Unit *unit, double time, double length);
/* Part of a step until the next break, if the unit stops there, else the whole step. */
double unit_length_to_break(const Unit *unit, double time, double length);

Status unit_get(Unit *unit, const Variable *variables, size_t n, double *values);
Status unit_set(Unit *unit, const Variable *variables, size_t n, const double *values);

Status unit_get_state(const Unit *unit, void **state);
Status unit_set_state(Unit *unit, const void *state);
Status unit_free_state(void **state);
size_t unit_state_size(void);
Status unit_serialise(const Unit *unit, const void *state, char *bytes, size_t size);
Status unit_deserialise(const Unit *unit, const char *bytes, size_t size, void **state);

#endif
