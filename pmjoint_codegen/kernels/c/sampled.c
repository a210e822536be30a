#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>

/* Output instants closer to a sample than this fraction of the sample time are the sample itself. */
#define SAME_INSTANT 1e-9

static int call_reference(const pmj_problem *problem, const pmj_function *reference, const pmj_memory *memory,
                          double t)
{
    reference->arg[0] = &t;
    reference->arg[1] = problem->p;
    reference->res[0] = memory->reference;
    return reference->call(reference->arg, reference->res, reference->iw, reference->w, 0);
}

/* v of (29) from the sampled y and the controller's own states; 0 is success. */
static int control(const pmj_problem *problem, const pmj_function *reference, const pmj_function *law,
                   const pmj_memory *memory, double t, double *v)
{
    if (call_reference(problem, reference, memory, t)) {
        return 1;
    }
    law->arg[0] = memory->sample;
    law->arg[1] = memory->sample + problem->n_plant;
    law->arg[2] = memory->reference;
    law->arg[3] = problem->p;
    law->res[0] = 0;
    law->res[1] = 0;
    law->res[2] = v;
    return law->call(law->arg, law->res, law->iw, law->w, 0);
}

/* What the actuator delivers for v: (10) for every channel of w. */
static void actuate(const pmj_problem *problem, double v, double *w)
{
    for (long long j = 0; j < problem->n_actuated; ++j) {
        const double *limit = problem->limits + 4 * j;
        const double free = limit[0] + limit[1] * v;
        w[j] = free < limit[2] ? limit[2] : free > limit[3] ? limit[3] : free;
    }
}

/* Keep the mode of v at a sample, and its change. */
static void note_mode(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t,
                      double v)
{
    long long mode = 0;
    while (mode < problem->n_thresholds && v > problem->thresholds[mode]) {
        ++mode;
    }
    if (progress->sample == 0) {
        progress->first_mode = mode;
    } else if (mode != progress->mode && progress->switches < problem->max_switches) {
        memory->switch_times[progress->switches] = t;
        memory->switch_modes[progress->switches] = mode;
        progress->switches += 1;
    } else if (mode != progress->mode) {
        progress->status = PMJ_TOO_MANY_SWITCHES;
    }
    progress->mode = mode;
}

/* The next output row: plant states as given, everything else as at the sample at time t_sample. */
static double *next_row(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory,
                        double t_sample)
{
    const long long n = problem->n_states;
    double *row = memory->rows + progress->row * n;
    double *held = memory->held + progress->row * n;
    for (long long i = 0; i < n; ++i) {
        row[i] = memory->sample[i];
        held[i] = memory->sample[i];
    }
    memory->held_times[progress->row] = t_sample;
    progress->row += 1;
    return row;
}

/* Add the integral of (y - y_r)^2 over a step of the plant; 0 is success. */
static int integrate_error(const pmj_problem *problem, const pmj_function *reference, pmj_progress *progress,
                           const pmj_memory *memory, double size)
{
    double sum = 0.0;
    for (long long i = 0; i < problem->n_nodes; ++i) {
        const double tau = size * problem->nodes[i];
        double y = 0.0;
        pmj_evaluate(memory->coefficients, problem->n_plant, problem->order, tau, &y, 1);
        if (call_reference(problem, reference, memory, progress->t + tau)) {
            return 1;
        }
        const double e = y - memory->reference[0];
        sum += problem->weights[i] * (e * e);
    }
    progress->integral += size * sum;
    return 0;
}

static int all_finite(const double *values, long long n)
{
    for (long long i = 0; i < n; ++i) {
        if (!(fabs(values[i]) <= DBL_MAX)) {
            return 0;
        }
    }
    return 1;
}

/* Taylor coefficients of the plant at (t, x) under w, and the step that they allow; 0 is success. */
static int expand(const pmj_problem *problem, const pmj_function *plant_taylor, pmj_progress *progress,
                  const pmj_memory *memory, double *size)
{
    plant_taylor->arg[0] = &progress->t;
    plant_taylor->arg[1] = memory->state;
    plant_taylor->arg[2] = memory->w;
    plant_taylor->arg[3] = problem->p;
    plant_taylor->res[0] = memory->coefficients;
    progress->evaluations += 1;
    if (plant_taylor->call(plant_taylor->arg, plant_taylor->res, plant_taylor->iw, plant_taylor->w, 0)) {
        return 1;
    }
    *size = pmj_step_size(memory->coefficients, problem->n_plant, problem->order, problem->tolerance,
                          problem->safety);
    return 0;
}

/* Accept a step of the plant to time `until`: output rows before `rows_until`, the integral, the new state. */
static void accept(const pmj_problem *problem, const pmj_function *reference, pmj_progress *progress,
                   const pmj_memory *memory, double tau, double until, double rows_until, double t_sample)
{
    const double *c = memory->coefficients;
    while (progress->row < problem->n_rows && problem->times[progress->row] <= until
           && problem->times[progress->row] < rows_until) {
        const double at = problem->times[progress->row] - progress->t;
        double *row = next_row(problem, progress, memory, t_sample);
        pmj_evaluate(c, problem->n_plant, problem->order, at, row, problem->n_plant);
    }
    if (integrate_error(problem, reference, progress, memory, tau)) {
        progress->status = PMJ_KERNEL_FAILED;
    }
    pmj_differentiate(c, problem->n_plant, problem->order, tau, memory->slope, problem->n_plant);
    pmj_note_peaks(c, problem->n_plant, problem->order, problem->n_plant, problem->n_searched, progress->t, tau,
                   memory->trial, memory->slope, memory->peaks, memory->peak_times);
    for (long long i = 0; i < problem->n_plant; ++i) {
        memory->state[i] = memory->trial[i];
    }
    progress->t = until;
    progress->steps += 1;
}

/* Integrate the plant under constant w from `progress->t` to `end`. */
static void hold(const pmj_problem *problem, const pmj_function *plant_taylor, const pmj_function *reference,
                 pmj_progress *progress, const pmj_memory *memory, double end, double rows_until)
{
    const double t_sample = progress->t;
    const double smallest = PMJ_SMALLEST_STEP * (end > 1.0 ? end : 1.0);
    while (progress->t < end && progress->status == PMJ_RUNNING) {
        const double remaining = end - progress->t;
        double tau = 0.0;
        if (expand(problem, plant_taylor, progress, memory, &tau)) {
            progress->status = PMJ_KERNEL_FAILED;
            return;
        }
        const int whole = !(tau < remaining);
        tau = whole ? remaining : tau;
        pmj_evaluate(memory->coefficients, problem->n_plant, problem->order, tau, memory->trial, problem->n_plant);
        if (!all_finite(memory->trial, problem->n_plant)) {
            progress->status = PMJ_NON_FINITE;
        } else if (!whole && tau < smallest) {
            progress->status = PMJ_STALLED;
        } else if (progress->steps >= problem->max_steps) {
            progress->status = PMJ_TOO_MANY_STEPS;
        } else {
            accept(problem, reference, progress, memory, tau, whole ? end : progress->t + tau, rows_until,
                   t_sample);
        }
    }
}

/* The controller's states at the next sample, and the plant's; or the status that forbids going on. */
static void settle(const pmj_problem *problem, const pmj_function *update, pmj_progress *progress,
                   const pmj_memory *memory, const double *v)
{
    const long long n = problem->n_states;
    update->arg[0] = memory->sample;
    update->arg[1] = memory->sample + problem->n_plant;
    update->arg[2] = memory->w;
    update->arg[3] = v;
    update->arg[4] = problem->hold;
    update->arg[5] = problem->p;
    update->res[0] = memory->state + problem->n_plant;
    if (update->call(update->arg, update->res, update->iw, update->w, 0)) {
        progress->status = PMJ_KERNEL_FAILED;
        return;
    }
    if (!all_finite(memory->state, n)) {
        progress->status = PMJ_NON_FINITE;
    }
    for (long long i = 0; i < n; ++i) {
        memory->sample[i] = memory->state[i];
        if (progress->status == PMJ_RUNNING && fabs(memory->state[i]) > problem->divergence) {
            progress->status = PMJ_DIVERGED;
        }
    }
}

/* One sample: y taken, v computed, u held until the next; the plant goes on in between. */
static void sample(const pmj_problem *problem, const pmj_function *plant_taylor, const pmj_function *reference,
                   const pmj_function *law, const pmj_function *update, pmj_progress *progress,
                   const pmj_memory *memory)
{
    const double slack = SAME_INSTANT * problem->sample_time;
    const double horizon = problem->times[problem->n_rows - 1];
    const double t = (double)progress->sample * problem->sample_time;
    double end = (double)(progress->sample + 1) * problem->sample_time;
    double rows_until = end - slack;
    double v = 0.0;
    if (control(problem, reference, law, memory, t, &v)) {
        progress->status = PMJ_KERNEL_FAILED;
        return;
    }
    for (long long i = 0; i < problem->n_states; ++i) {
        pmj_note_value(memory->sample[i], t, memory->peaks + i, memory->peak_times + i);
    }
    pmj_note_value(v, t, memory->peaks + problem->n_states, memory->peak_times + problem->n_states);
    if (!(fabs(v) <= DBL_MAX)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    actuate(problem, v, memory->w);
    note_mode(problem, progress, memory, t, v);
    progress->t = t;
    while (progress->row < problem->n_rows && problem->times[progress->row] <= t + slack) {
        next_row(problem, progress, memory, t);
    }
    if (progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
        return;
    }
    if (horizon < rows_until) {
        end = horizon; /* ends inside this hold */
    }
    hold(problem, plant_taylor, reference, progress, memory, end, rows_until);
    if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
    }
    if (progress->status == PMJ_RUNNING) {
        settle(problem, update, progress, memory, &v);
        progress->sample += 1;
    }
}

/* Advance the sampled loop by at most `budget` samples; `progress->status` says whether and how it ended.
 * `memory->state` and `memory->sample` start as X(0). */
void pmj_sampled(const pmj_problem *problem, const pmj_function *plant_taylor, const pmj_function *reference,
                 const pmj_function *law, const pmj_function *update, pmj_progress *progress, pmj_memory *memory,
                 long long budget)
{
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        sample(problem, plant_taylor, reference, law, update, progress, memory);
    }
}
