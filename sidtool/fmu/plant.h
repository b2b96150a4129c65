/* A scene that advances in time: instances, inputs, outputs and states. */
#ifndef PLANT_H
#define PLANT_H

#include <stddef.h>
#include <stdint.h>

typedef struct Plant Plant;

/* Why the plant does not advance: codes of the step loop, then those of its own. */
enum {
    PLANT_OK = 0,
    PLANT_BEHIND_END = 100,   /* the scene ends before the requested time */
    PLANT_SINGULAR = 101,     /* no accelerations at the begin of an interval */
    PLANT_LAW_FAILURE = 102,  /* a control law gives no finite number */
    PLANT_ENDED = 103         /* an event of the scene has ended the motion */
};

/* An instance at the start of the scene, or null without memory. Instances share
   nothing. */
Plant *plant_new(void);
void plant_free(Plant *plant);
void plant_reset(Plant *plant);

/* A state holds everything of an instance, the memory of the integrator included, and
   no address: it continues in any instance, in any process. */
size_t plant_state_size(void);
void plant_write_state(const Plant *plant, void *state);
void plant_read_state(Plant *plant, const void *state);

/* Time of the outputs, the communication point [s]. */
double plant_time(const Plant *plant);
double plant_start_time(void);
double plant_end_time(void);
/* The next time at which a function of the scene is not smooth, or infinity [s]. */
double plant_next_break(const Plant *plant);

/* Advances to a time; PLANT_OK, or why it stopped before. With PLANT_ENDED the
   communication point is the time of the event. */
int64_t plant_advance(Plant *plant, double time);
/* True if an event of the scene has ended the motion. */
int plant_has_ended(const Plant *plant);
/* A sentence on a code of `plant_advance`. */
void plant_explain(const Plant *plant, int64_t code, char *text, size_t size);

size_t plant_n_inputs(void);
size_t plant_n_outputs(void);
double plant_input(const Plant *plant, size_t index);
void plant_set_input(Plant *plant, size_t index, double value);
double plant_output(Plant *plant, size_t index);

#endif
