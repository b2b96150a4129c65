/* Motion of one scene without Python.
 *
 * `struct Plant` (scene.h) is the table of all tables and arrays of the scene. It stands
 * at the begin of an image, to whose words its pointers refer. An instance is a copy of
 * the image with the pointers filled in.
 *
 * The kernels are those of sidtool: the step loop, what it calls, and the outputs. This
 * file does what the Python module `solver/simulation/run_loop.py` does between calls of
 * the step loop: it begins smooth intervals, asks sampled control laws, and interpolates
 * the state at communication points.
 *
 *     z, v   positions z_I and velocities z_II, theory section 1
 *     h      length of a step
 */
#include "plant.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene.h"

/* Arrays as kernels take them: the address and the extents. */
#define ARRAY1(a) (a), (a##_extent)[0]
#define ARRAY2(a) ARRAY1(a), (a##_extent)[1]
#define ARRAY3(a) ARRAY2(a), (a##_extent)[2]

#define COUNT(array) (sizeof(array) / sizeof *(array))

/* ---- instances ---------------------------------------------------------------------- */

static void fill_in_pointers(Plant *plant)
{
    int64_t *words = (int64_t *)plant;
    for (size_t i = 0; i < COUNT(pointer_words); i++)
        words[pointer_words[i].word] = (int64_t)(intptr_t)(words + pointer_words[i].target);
    for (size_t i = 0; i < COUNT(kernel_words); i++)
        words[kernel_words[i].word] = (int64_t)(intptr_t)kernel_words[i].kernel;
}

Plant *plant_new(void)
{
    Plant *plant = malloc(sizeof image);
    if (plant)
        plant_reset(plant);
    return plant;
}

void plant_free(Plant *plant)
{
    free(plant);
}

void plant_reset(Plant *plant)
{
    plant_read_state(plant, image);
}

size_t plant_state_size(void)
{
    return sizeof image;
}

void plant_write_state(const Plant *plant, void *state)
{
    int64_t *words = state;
    memcpy(state, plant, sizeof image);
    for (size_t i = 0; i < COUNT(pointer_words); i++)
        words[pointer_words[i].word] = 0;
    for (size_t i = 0; i < COUNT(kernel_words); i++)
        words[kernel_words[i].word] = 0;
}

void plant_read_state(Plant *plant, const void *state)
{
    memcpy(plant, state, sizeof image);
    fill_in_pointers(plant);
}

double plant_time(const Plant *plant)
{
    return plant->now;
}

double plant_start_time(void)
{
    return START_TIME;
}

double plant_end_time(void)
{
    return breaks[COUNT(breaks) - 1];
}

/* ---- smooth intervals --------------------------------------------------------------- */

/* True if a law with a period is sampled at a time. */
static int is_sample_time(double time, double period)
{
    double count = (time - START_TIME) / period;
    return fabs(count - round(count)) <= SAMPLE_TOLERANCE;
}

/* End of the smooth interval that begins at a time: a break of a function, a sample of a
   law, or the end of the scene. A sample next to a break is at the break. */
static double interval_end(double time)
{
    double end = breaks[COUNT(breaks) - 1];
    for (size_t i = COUNT(breaks); i-- > 0;)
        if (breaks[i] > time)
            end = breaks[i];
    double next_break = end;
    for (int i = 0; i < N_SAMPLED_LAWS; i++) {
        double period = sampled_laws[i].period, near = SAMPLE_TOLERANCE * period;
        double count = floor((time - START_TIME) / period + SAMPLE_TOLERANCE) + 1.0;
        double sample = START_TIME + period * count;
        if (sample < end && next_break - sample > near)
            end = sample;
    }
    return end;
}

double plant_next_break(const Plant *plant)
{
    for (size_t i = 0; i + 1 < COUNT(breaks); i++)
        if (breaks[i] > plant->now + TIME_TOLERANCE * (1.0 + fabs(plant->now)))
            return breaks[i];
    return INFINITY;
}

/* Evaluates the state in hand with the inputs as they are now. */
static int64_t evaluate_start(Plant *plant)
{
    struct StepLoopState *control = plant->control;
    return sidtool_evaluate_start(plant->kernels, plant->system, plant->work,
                                  plant->memory, control->time, ARRAY1(control->z),
                                  ARRAY1(control->v));
}

/* Sets the values that sampled laws hold from now on; true if there are any. All laws are
   asked before any value is set. */
static int take_samples(Plant *plant)
{
    struct StepLoopState *control = plant->control;
    double value[N_SAMPLED_LAWS + 1];
    int due = 0;
    if (control->time == plant->last_sample_time)
        return 0;
    plant->last_sample_time = control->time;
    for (int i = 0; i < N_SAMPLED_LAWS; i++)
        if (is_sample_time(control->time, sampled_laws[i].period))
            value[i] = sidtool_law_value_at(plant->system, plant->work,
                                            sampled_laws[i].force, control->time);
    for (int i = 0; i < N_SAMPLED_LAWS; i++)
        if (is_sample_time(control->time, sampled_laws[i].period)) {
            control->v[sampled_laws[i].velocity] = value[i];
            due = 1;
        }
    return due;
}

/* Begins a smooth interval, or goes on behind a jump of an input: the step loop keeps no
   memory of earlier steps. */
static int64_t enter_interval(Plant *plant)
{
    struct StepLoopState *control = plant->control;
    struct WorkArrays *work = plant->work;
    plant->interval_start = control->time;
    plant->interval_end = interval_end(control->time);
    control->old_step = control->factored_step = 0.0;
    control->newton_step_limit = INFINITY;
    control->steps_since_failure = FREQUENT_FAILURES;
    control->needs_jacobian = 1;
    control->stage_prediction = 0;
    work->interval_time[0] = 0.5 * (control->time + plant->interval_end);
    int64_t status = evaluate_start(plant);
    if (status == 0 && take_samples(plant))
        status = evaluate_start(plant);
    if (work->law_failure[FAILED_LAW] != 0.0
        && work->law_failure[FAILURE_TIME] >= control->time)
        return PLANT_LAW_FAILURE;
    if (status != 0)
        return PLANT_SINGULAR;
    int64_t counted = plant->system->n_rotation_counters;
    double *rotations = control->z + control->z_extent[0] - counted;
    for (int64_t i = 0; i < counted; i++)
        rotations[i] = work->rotation_counter[i * work->rotation_counter_extent[1]];
    int64_t width = control->force_measures_extent[1];
    for (int64_t k = 0; k < control->force_measures_extent[0]; k++)
        for (int64_t i = 0; i < 2; i++)
            control->force_measures[k * width + i] = work->measure[2 * k + i];
    return PLANT_OK;
}

/* ---- states at communication points ------------------------------------------------- */

/* State at a time in the last step: the polynomial through the dense output at Chebyshev's
   extrema, in barycentric form. */
static void interpolate_state(Plant *plant, double time)
{
    const struct StepLoopState *control = plant->control;
    int64_t nz = control->z_extent[0], nv = control->v_extent[0];
    int64_t first = control->output_times_extent[0];
    const double *node_z = control->output_z + first * nz;
    const double *node_v = control->output_v + first * nv;
    if (time >= control->time) {
        memcpy(plant->z, control->z, sizeof(double) * (size_t)nz);
        memcpy(plant->v, control->v, sizeof(double) * (size_t)nv);
        return;
    }
    double weight[N_DENSE_POINTS], sum = 0.0;
    for (int i = 0; i < N_DENSE_POINTS; i++) {
        double distance = time - control->fraction_times[i];
        if (distance == 0.0) {
            memcpy(plant->z, node_z + i * nz, sizeof(double) * (size_t)nz);
            memcpy(plant->v, node_v + i * nv, sizeof(double) * (size_t)nv);
            return;
        }
        int is_end = i == 0 || i == N_DENSE_POINTS - 1;
        weight[i] = (i % 2 ? -1.0 : 1.0) * (is_end ? 0.5 : 1.0) / distance;
        sum += weight[i];
    }
    memset(plant->z, 0, sizeof(double) * (size_t)nz);
    memset(plant->v, 0, sizeof(double) * (size_t)nv);
    for (int i = 0; i < N_DENSE_POINTS; i++) {
        double share = weight[i] / sum;
        for (int64_t k = 0; k < nz; k++)
            plant->z[k] += share * node_z[i * nz + k];
        for (int64_t k = 0; k < nv; k++)
            plant->v[k] += share * node_v[i * nv + k];
    }
}

/* Value of an input at a time, and its rate: a cubic polynomial of the time since the begin
   of its piece. */
static double input_at(const Plant *plant, int index, double time, double *rate)
{
    const double *piece = (const double *)plant + inputs[index].piece;
    double x = time - piece[0], value = 0.0, slope = 0.0;
    for (int k = N_INPUT_TERMS; k >= 1; k--) {
        slope = slope * x + value;
        value = value * x + piece[k];
    }
    if (rate)
        *rate = slope;
    return value;
}

static int64_t restart(Plant *plant);

/* State at the communication point on the constraints, with accelerations, forces and
   energies. At the start sampled laws are asked before. */
static void find_outputs(Plant *plant)
{
    if (plant->outputs_known)
        return;
    if (plant->must_restart && plant->now == START_TIME && plant->control->time == plant->now)
        restart(plant);  /* fails in `plant_advance`, too, which tells it */
    plant->outputs_known = 1;
    plant->time[0] = plant->now;
    plant->interval[0] = plant->interval_start;
    plant->interval[1] = plant->interval_end;
    plant->interval_time[0] = 0.5 * (plant->interval_start + plant->interval_end);
    interpolate_state(plant, plant->now);
    for (int i = 0; i < N_INPUTS; i++)
        plant->input_values[i] = input_at(plant, i, plant->now, NULL);
    plant->multiplier_sizes[0] = -1.0;
    plant->largest_multiplier[0] = 0.0;  /* outputs depend on the state alone */
    sidtool_sample(plant->kernels, plant->system, plant->sampler_work,
                   plant->sampler_memory, ARRAY2(plant->constraint_tolerance),
                   ARRAY1(plant->time), ARRAY1(plant->interval), ARRAY2(plant->z),
                   ARRAY2(plant->v), ARRAY2(plant->step_z), ARRAY2(plant->step_v),
                   ARRAY3(plant->frames), ARRAY3(plant->points),
                   ARRAY2(plant->accelerations), ARRAY2(plant->multipliers),
                   ARRAY2(plant->factors), ARRAY3(plant->friction),
                   ARRAY2(plant->row_blocks), ARRAY1(plant->row_sizes),
                   ARRAY1(plant->multiplier_sizes), ARRAY1(plant->largest_multiplier));
    sidtool_write_forces(plant->output_system, plant->output_work, plant->output,
                         ARRAY1(plant->time), ARRAY1(plant->interval_time),
                         ARRAY2(plant->z), ARRAY3(plant->points), ARRAY2(plant->factors),
                         ARRAY2(plant->multipliers), ARRAY2(plant->friction_forces));
    sidtool_write_bodies(plant->output_system, plant->output_work, plant->output,
                         ARRAY2(plant->z), ARRAY2(plant->v), ARRAY3(plant->frames));
}

/* ---- outputs ------------------------------------------------------------------------ */

/* A component of an orientation: of its quaternion q, of its rotation vector, or the angle.
 *
 * The quaternion of a rotation matrix R is that of S. W. Shepperd, J. Guidance and Control 1
 * (1978), which divides by its largest component. It has q0 >= 0.
 */
static double orientation(const Plant *plant, int64_t first, int64_t count, int component)
{
    const double *entries = (const double *)plant;
    double q[4] = {1.0, 0.0, 0.0, 0.0};
    if (count == 1) {
        double half_angle = 0.5 * entries[terms[first].first];
        q[0] = cos(half_angle);
        q[3] = sin(half_angle);
    } else {
        double R[3][3];
        for (int i = 0; i < 9; i++)
            R[i / 3][i % 3] = entries[terms[first + i].first];
        double trace = R[0][0] + R[1][1] + R[2][2];
        int i = R[1][1] > R[0][0] ? 1 : 0;
        i = R[2][2] > R[i][i] ? 2 : i;
        int j = (i + 1) % 3, k = (i + 2) % 3;
        if (trace > R[i][i]) {
            q[0] = 0.5 * sqrt(1.0 + trace);
            q[1] = 0.25 * (R[2][1] - R[1][2]) / q[0];
            q[2] = 0.25 * (R[0][2] - R[2][0]) / q[0];
            q[3] = 0.25 * (R[1][0] - R[0][1]) / q[0];
        } else {
            q[1 + i] = 0.5 * sqrt(1.0 + 2.0 * R[i][i] - trace);
            q[0] = 0.25 * (R[k][j] - R[j][k]) / q[1 + i];
            q[1 + j] = 0.25 * (R[j][i] + R[i][j]) / q[1 + i];
            q[1 + k] = 0.25 * (R[k][i] + R[i][k]) / q[1 + i];
        }
    }
    for (int i = 3; i >= 0; i--)
        q[i] = q[0] < 0.0 ? -q[i] : q[i];
    if (component < 4)
        return q[component];
    double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double angle = 2.0 * atan2(sine, q[0]);
    if (component == 7)
        return angle;
    return q[component - 3] * (sine > 0.0 ? angle / sine : 2.0);
}

/* An output: a polynomial in entries of the arrays, its square root, or an orientation. */
static double output_value(const Plant *plant, size_t index)
{
    const double *entries = (const double *)plant;
    if (outputs[index].kind >= ORIENTATION)
        return orientation(plant, outputs[index].first, outputs[index].count,
                           outputs[index].kind - ORIENTATION);
    double y = outputs[index].constant;
    for (int64_t i = 0; i < outputs[index].count; i++) {
        int64_t k = outputs[index].first + i;
        double x = entries[terms[k].first];
        if (terms[k].second >= 0)
            x *= entries[terms[k].second];
        y += terms[k].weight * x;
    }
    return outputs[index].kind == ROOT ? sqrt(fmax(y, 0.0)) : y;
}

/* ---- events that end the motion ----------------------------------------------------- */

/* Distance of the quantity of an event from its value, in the last step. */
static double event_height(Plant *plant, int event, double time)
{
    plant->now = time;
    plant->outputs_known = 0;
    find_outputs(plant);
    return output_value(plant, N_OUTPUTS + (size_t)event) - events[event].value;
}

/* Time of a crossing between two times, by bisection down to rounding. */
static double crossing_time(Plant *plant, int event, double low, double high)
{
    double side = event_height(plant, event, high);
    if (event_height(plant, event, low) * side >= 0.0)
        return low;
    for (;;) {
        double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high)
            return high;
        if (event_height(plant, event, middle) * side > 0.0)
            high = middle;
        else
            low = middle;
    }
}

/* Looks at one time for events, which saw the quantities last at an earlier one. The first
   event that ends the motion, or -1; `time_of_end` is then the time of its crossing. */
static int look_for_events(Plant *plant, double before, double time, double *time_of_end)
{
    int ending = -1;
    for (int k = 0; k < N_EVENTS; k++) {
        double height = event_height(plant, k, time), *size = plant->event_sizes + k;
        *size = fmax(*size, fabs(height + events[k].value));
        if (fabs(height) <= EVENT_TOLERANCE * *size)
            continue;
        double side = height > 0.0 ? 1.0 : -1.0, last = plant->event_sides[k];
        plant->event_sides[k] = side;
        if (last * side >= 0.0 || (events[k].direction && events[k].direction != side))
            continue;
        plant->event_counts[k] += 1.0;
        if (plant->event_counts[k] != events[k].count)
            continue;
        double crossing = crossing_time(plant, k, before, time);
        if (ending < 0 || crossing < *time_of_end) {
            ending = k;
            *time_of_end = crossing;
        }
    }
    return ending;
}

/* Looks for events from the communication point to a time in the last step, at the nodes of
   its dense output. True if one ends the motion: its time is the communication point then. */
static int find_ending_event(Plant *plant, double end)
{
    const struct StepLoopState *control = plant->control;
    double begin = plant->now, before = begin, crossing = 0.0;
    if (N_EVENTS == 0 || !(end > begin))
        return 0;
    int ending = -1;
    if (begin == START_TIME)
        ending = look_for_events(plant, begin, begin, &crossing);
    for (int i = 0; i < N_DENSE_POINTS && ending < 0; i++) {
        double time = control->fraction_times[i];
        if (time <= before || time >= end)
            continue;
        ending = look_for_events(plant, before, time, &crossing);
        before = time;
    }
    if (ending < 0)
        ending = look_for_events(plant, before, end, &crossing);
    plant->now = ending < 0 ? end : crossing;
    plant->outputs_known = 0;
    plant->ending_event = ending + 1;
    return ending >= 0;
}

/* ---- advance ------------------------------------------------------------------------ */

/* Goes back to the communication point, from where an input has another value. */
static int64_t restart(Plant *plant)
{
    struct StepLoopState *control = plant->control;
    int64_t code = PLANT_OK;
    if (control->time > plant->now) {
        find_outputs(plant);
        memcpy(control->z, plant->z, sizeof(double) * (size_t)control->z_extent[0]);
        memcpy(control->v, plant->v, sizeof(double) * (size_t)control->v_extent[0]);
        control->time = plant->now;
    }
    if (control->time < plant->interval_end)
        code = enter_interval(plant);
    plant->must_restart = code != PLANT_OK;
    return code;
}

/* Steps of the integrator, at most `limit`; the code of the step loop. */
static int64_t make_steps(Plant *plant, int64_t limit)
{
    int64_t code = sidtool_advance(plant->kernels, plant->system, plant->work,
                                   plant->memory, plant->control, plant->stages, limit);
    if (code == NEAR_SINGULARITY)
        code = sidtool_advance_past_singularity(plant->kernels, plant->system,
                                                plant->work, plant->memory,
                                                plant->control, plant->stages, limit);
    return code;
}

/* Inputs that must not jump move to their new values until the end of the communication
   step: along a straight line, or along a cubic polynomial that begins with the rate so far
   and ends with the rate of the parabola through the values at the ends of this step and
   of the piece before; after rest, of the parabola without rate at its start. True if one
   moves. */
static int choose_courses(Plant *plant, double end)
{
    int moves = 0;
    for (int i = 0; i < N_INPUTS; i++) {
        double *piece = (double *)plant + inputs[i].piece, goal = plant->input_goals[i];
        int is_constant = piece[2] == 0.0 && piece[3] == 0.0 && piece[4] == 0.0;
        if (inputs[i].continuity == 0 || (is_constant && piece[1] == goal))
            continue;
        double rate, value = input_at(plant, i, plant->now, &rate);
        double length = end - plant->now, mean = (goal - value) / length;
        double before = is_constant ? 0.0 : plant->now - piece[0];
        double mean_before = piece[2] + before * (piece[3] + before * piece[4]);
        double change = mean - mean_before;
        double last_rate = mean + change * length / (length + before);
        int is_smooth = inputs[i].continuity > 1;
        piece[0] = plant->now;
        piece[1] = value;
        piece[2] = is_smooth ? rate : mean;
        piece[3] = is_smooth ? (3.0 * mean - 2.0 * rate - last_rate) / length : 0.0;
        piece[4] = is_smooth ? (rate + last_rate - 2.0 * mean) / (length * length) : 0.0;
        moves = plant->must_restart = 1;
    }
    if (moves && plant->now == START_TIME)  /* samples there know the rates of inputs */
        plant->last_sample_time = -INFINITY;
    return moves;
}

/* True if an interval ends at a time but for rounding. */
static int is_interval_end(const Plant *plant, double time)
{
    double length = plant->interval_end - plant->interval_start;
    double near = fmin(TIME_TOLERANCE * (1.0 + fabs(time)), SAMPLE_TOLERANCE * length);
    return fabs(time - plant->interval_end) <= near;
}

/* Steps go over communication points: their sequence does not depend on these. With fixed
   steps each call ends at the communication point, after a whole number of steps. The state
   at the end of an interval is the one before what happens there. */
int64_t plant_advance(Plant *plant, double time)
{
    struct StepLoopState *control = plant->control;
    if (time > plant_end_time() + TIME_TOLERANCE * (1.0 + fabs(time)))
        return PLANT_BEHIND_END;
    if (time > plant_end_time())
        time = plant_end_time();
    if (plant->ending_event)
        return PLANT_ENDED;
    int inputs_move = time > plant->now && choose_courses(plant, time);
    int64_t code = plant->must_restart ? restart(plant) : PLANT_OK;
    if (code != PLANT_OK)
        return code;
    plant->outputs_known = 0;
    if (find_ending_event(plant, fmin(time, control->time)))
        return PLANT_ENDED;
    while (control->time < time) {
        if (is_interval_end(plant, time))
            time = plant->interval_end;
        if (control->time >= plant->interval_end) {
            if (time == plant->interval_end)
                break;
            code = enter_interval(plant);
            if (code != PLANT_OK)
                return code;
            continue;
        }
        int64_t limit = 1;  /* the dense output is that of one step */
        control->stop = plant->interval_end;
        if (inputs_move || control->fixed_step)
            control->stop = fmin(time, plant->interval_end);
        if (control->fixed_step) {
            double length = control->stop - control->time;
            double count = fmax(1.0, ceil(length / FIXED_STEP - 1e-9));
            control->step = length / count;
            limit = N_EVENTS ? 1 : (int64_t)count;
        }
        control->fraction_index = control->next_output = 0;
        code = make_steps(plant, limit);
        if (code == INTERVAL_END)  /* only rounding is left of it */
            control->time = control->stop;
        else if (code != STEPS_DONE)
            return code;
        if (find_ending_event(plant, fmin(time, control->time)))
            return PLANT_ENDED;
    }
    plant->now = time;
    return PLANT_OK;
}

int plant_has_ended(const Plant *plant)
{
    return plant->ending_event != 0;
}

void plant_explain(const Plant *plant, int64_t code, char *text, size_t size)
{
    static const struct {
        int64_t code;
        const char *text;
    } reasons[] = {
        {TOO_SMALL, "the steps become smaller than time resolves"},
        {OFF_CONSTRAINTS, "a step cannot be projected onto the constraints"},
        {NOT_FINITE, "the state is not finite"},
        {NO_CONVERGENCE, "Newton's iteration does not converge"},
        {BELOW_ROUNDING, "the tolerance is below rounding"},
        {NEAR_SINGULARITY, "a singular configuration cannot be passed"},
        {PLANT_BEHIND_END, "the scene ends before the requested time: export it with a "
                           "later time.end"},
        {PLANT_SINGULAR, "the equations of motion are singular"},
        {PLANT_LAW_FAILURE, "a control law gives no finite number"},
    };
    const char *reason = "the step loop stopped";
    for (size_t i = 0; i < COUNT(reasons); i++)
        if (reasons[i].code == code)
            reason = reasons[i].text;
    double time = plant->control->time;
    if (code == PLANT_ENDED) {
        snprintf(text, size, "t = %.9g s: event %s has ended the motion", plant->now,
                 events[plant->ending_event - 1].name);
        return;
    }
    int64_t law = (int64_t)plant->work->law_failure[FAILED_LAW];
    if (law > 0 && code != PLANT_BEHIND_END)
        snprintf(text, size, "t = %.9g s: %s; the law of %s gave no finite number at "
                 "t = %.9g s", time, reason, force_names[law - 1],
                 plant->work->law_failure[FAILURE_TIME]);
    else
        snprintf(text, size, "t = %.9g s: %s", time, reason);
}

/* ---- inputs and outputs ------------------------------------------------------------- */

size_t plant_n_inputs(void)
{
    return N_INPUTS;
}

size_t plant_n_outputs(void)
{
    return N_OUTPUTS;
}

double plant_input(const Plant *plant, size_t index)
{
    return plant->input_goals[index];
}

/* A value that may jump holds from the communication point on. Others are reached at the end
   of the next communication step. */
void plant_set_input(Plant *plant, size_t index, double value)
{
    double *piece = (double *)plant + inputs[index].piece;
    plant->input_goals[index] = value;
    if (inputs[index].continuity > 0 || piece[1] == value)
        return;
    piece[1] = value;
    if (plant->now == START_TIME)
        plant->last_sample_time = -INFINITY;
    plant->must_restart = 1;
    plant->outputs_known = 0;
}

double plant_output(Plant *plant, size_t index)
{
    find_outputs(plant);
    return output_value(plant, index);
}
