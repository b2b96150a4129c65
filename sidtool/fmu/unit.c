/* What FMI 2.0 and 3.0 have in common, on top of the plant. No variable is global: units
   in one process share nothing. */
#include "unit.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "token.h"
#ifdef LINEAR
#include "linear_plant.h"
#endif

/* Communication points are compared with this tolerance, relative to 1 s and the time. */
static const double TIME_TOLERANCE = 1e-9;

enum { MESSAGE_SIZE = 512, TIME_VARIABLE = 0 };

/* A state of an instance: the token tells units apart, the words are those of the plant. */
typedef struct {
    char token[sizeof TOKEN];
    uint64_t size;
} StateHeader;

enum { HEADER_SIZE = (sizeof(StateHeader) + 63) / 64 * 64 };

static bool same_time(double one, double other)
{
    return fabs(one - other) <= TIME_TOLERANCE * (1.0 + fabs(other));
}

/* ---- instances ---------------------------------------------------------------------- */

Status unit_fail(const Unit *unit, Status status, const char *format, ...)
{
    char text[MESSAGE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (unit->logger)
        unit->messenger(unit, status, text);
    return status;
}

Unit *unit_new(const char *name, const char *token, Messenger messenger, Logger logger,
               void *environment)
{
    Unit announced = {.messenger = messenger, .logger = logger,
                      .environment = environment, .name = (char *)(name ? name : "")};
    if (!token || strcmp(token, TOKEN) != 0) {
        unit_fail(&announced, STATUS_ERROR,
                  "the token %s is not %s: modelDescription.xml and the library do not "
                  "belong together", token ? token : "(none)", TOKEN);
        return NULL;
    }
    Unit *unit = malloc(sizeof *unit);
    if (unit) {
        *unit = announced;
        unit->name = malloc(strlen(announced.name) + 1);
        unit->plant = plant_new();
        if (unit->name)
            strcpy(unit->name, announced.name);
        if (unit->name && unit->plant)
            return unit;
        unit_free(unit);
    }
    unit_fail(&announced, STATUS_ERROR, "there is not enough memory");
    return NULL;
}

void unit_free(Unit *unit)
{
    if (!unit)
        return;
    plant_free(unit->plant);
    free(unit->name);
    free(unit);
}

/* ---- time --------------------------------------------------------------------------- */

#ifdef LINEAR
/* A linearised mechanism begins at any time. */
Status unit_start(Unit *unit, double start, bool stop_defined, double stop)
{
    (void)stop_defined, (void)stop;
    linear_set_time(unit->plant, start);
    return STATUS_OK;
}
#else
Status unit_start(Unit *unit, double start, bool stop_defined, double stop)
{
    if (!same_time(start, plant_start_time()))
        return unit_fail(unit, STATUS_ERROR,
                         "the start time %.9g s is not that of the scene, %.9g s", start,
                         plant_start_time());
    if (stop_defined && stop > plant_end_time() && !same_time(stop, plant_end_time()))
        unit_fail(unit, STATUS_WARNING,
                  "the scene ends at %.9g s, before the stop time %.9g s: export it with "
                  "a later time.end", plant_end_time(), stop);
    return STATUS_OK;
}
#endif

Status unit_step(Unit *unit, double time, double length)
{
    if (!(length >= 0.0) || !isfinite(length))
        return unit_fail(unit, STATUS_ERROR, "the communication step %.9g s is negative "
                         "or not finite", length);
    if (!same_time(time, plant_time(unit->plant)))
        return unit_fail(unit, STATUS_ERROR, "the communication point %.17g s is not the "
                         "end of the step before, %.17g s", time,
                         plant_time(unit->plant));
    bool had_ended = plant_has_ended(unit->plant);
    int64_t code = plant_advance(unit->plant, time + length);
    if (code != PLANT_OK) {
        char text[MESSAGE_SIZE];
        plant_explain(unit->plant, code, text, sizeof text);
        return unit_fail(unit, had_ended ? STATUS_ERROR : STATUS_DISCARD, "%s", text);
    }
    return STATUS_OK;
}

double unit_length_to_break(const Unit *unit, double time, double length)
{
    double next = plant_next_break(unit->plant);
    bool ends = unit->stops_at_breaks && next < time + length
        && !same_time(next, time + length);
    return ends ? next - time : length;
}

/* ---- variables ---------------------------------------------------------------------- */

Status unit_get(Unit *unit, const Variable *variables, size_t n, double *values)
{
    size_t inputs = plant_n_inputs(), outputs = plant_n_outputs();
    for (size_t i = 0; i < n; i++) {
        size_t k = variables[i];
        if (k == TIME_VARIABLE)
            values[i] = plant_time(unit->plant);
        else if (k <= inputs)
            values[i] = plant_input(unit->plant, k - 1);
        else if (k <= inputs + outputs)
            values[i] = plant_output(unit->plant, k - 1 - inputs);
        else
            return unit_fail(unit, STATUS_ERROR, "there is no variable %zu", k);
    }
    return STATUS_OK;
}

Status unit_set(Unit *unit, const Variable *variables, size_t n, const double *values)
{
    for (size_t i = 0; i < n; i++) {
        size_t k = variables[i];
        if (k == TIME_VARIABLE || k > plant_n_inputs())
            return unit_fail(unit, STATUS_ERROR, "variable %zu is not an input", k);
        if (!isfinite(values[i]))
            return unit_fail(unit, STATUS_ERROR, "input %zu is not finite", k);
    }
    for (size_t i = 0; i < n; i++)
        plant_set_input(unit->plant, variables[i] - 1, values[i]);
    return STATUS_OK;
}

/* ---- states ------------------------------------------------------------------------- */

size_t unit_state_size(void)
{
    return HEADER_SIZE + plant_state_size();
}

static bool is_own_state(const void *state)
{
    StateHeader header;
    memcpy(&header, state, sizeof header);
    return memcmp(header.token, TOKEN, sizeof TOKEN) == 0
        && header.size == unit_state_size();
}

Status unit_get_state(const Unit *unit, void **state)
{
    StateHeader header = {.size = unit_state_size()};
    memcpy(header.token, TOKEN, sizeof TOKEN);
    if (!*state)
        *state = calloc(1, unit_state_size());
    if (!*state)
        return unit_fail(unit, STATUS_ERROR, "there is not enough memory");
    memcpy(*state, &header, sizeof header);
    plant_write_state(unit->plant, (char *)*state + HEADER_SIZE);
    return STATUS_OK;
}

Status unit_set_state(Unit *unit, const void *state)
{
    if (!state || !is_own_state(state))
        return unit_fail(unit, STATUS_ERROR, "the state is not one of this unit");
    plant_read_state(unit->plant, (const char *)state + HEADER_SIZE);
    return STATUS_OK;
}

Status unit_free_state(void **state)
{
    if (state) {
        free(*state);
        *state = NULL;
    }
    return STATUS_OK;
}

Status unit_serialise(const Unit *unit, const void *state, char *bytes, size_t size)
{
    if (!state || size < unit_state_size())
        return unit_fail(unit, STATUS_ERROR, "a state has %zu bytes, not %zu",
                         unit_state_size(), size);
    memcpy(bytes, state, unit_state_size());
    return STATUS_OK;
}

Status unit_deserialise(const Unit *unit, const char *bytes, size_t size, void **state)
{
    if (size != unit_state_size() || !is_own_state(bytes))
        return unit_fail(unit, STATUS_ERROR,
                         "the serialised state is not one of this unit");
    *state = malloc(size);
    if (!*state)
        return unit_fail(unit, STATUS_ERROR, "there is not enough memory");
    memcpy(*state, bytes, size);
    return STATUS_OK;
}
