#include "stick.h"

#include <float.h>
#include <math.h>

static double *coefficients(const pmj_problem *problem, const pmj_memory *memory, long long buffer)
{
    return memory->coefficients + buffer * ((problem->order + 1) * problem->n_channels + PMJ_PADDING);
}

/* A mode and the present sides, as the kernels expect them. */
static const double *actuation(const pmj_problem *problem, const pmj_memory *memory, long long mode)
{
    const long long size = 2 * problem->n_actuated;
    for (long long i = 0; i < size; ++i) {
        memory->g[i] = problem->modes[mode * size + i];
    }
    for (long long j = 0; j < 2 * problem->n_kinks; ++j) {
        memory->g[size + j] = memory->sides[j];
    }
    return memory->g;
}

/* Taylor coefficients at (t, X) in the given mode, into half `buffer`; 0 is success. */
static int expand(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress,
                  const pmj_memory *memory, double t, const double *X, long long mode, long long buffer)
{
    const pmj_function *taylor = pmj_taylor_now(run, progress);
    taylor->arg[0] = &t;
    taylor->arg[1] = X;
    taylor->arg[2] = actuation(problem, memory, mode);
    taylor->arg[3] = problem->p;
    taylor->res[0] = coefficients(problem, memory, buffer);
    progress->evaluations += 1;
    return pmj_apply(taylor);
}

static void write_rows(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory,
                       const double *c, double until)
{
    const long long n = problem->n_states;
    while (progress->row < problem->n_rows && problem->times[progress->row] <= until) {
        const double tau = problem->times[progress->row] - progress->t;
        pmj_values(c, problem->n_channels, problem->order, tau, memory->rows + progress->row * n, n);
        progress->row += 1;
    }
}

/* Add the integral of e^2 over the step, and record when e is last outside its band. */
static void note_error(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, const double *c,
                       double size, double end)
{
    const long long place = problem->n_states + 1;
    double instants[PMJ_MAX_NODES];
    double e[PMJ_MAX_NODES];
    double sum = 0.0;
    for (long long i = 0; i < problem->n_nodes; ++i) {
        instants[i] = size * problem->nodes[i];
    }
    pmj_channel(c + place, problem->n_channels, problem->order, instants, e, problem->n_nodes);
    for (long long i = 0; i < problem->n_nodes; ++i) {
        sum += problem->weights[i] * (e[i] * e[i]);
    }
    progress->integral += size * sum;
    pmj_note_settled(progress, c + place, problem->n_channels, problem->order, memory->trial[place], size, end);
}

/* Whether v certainly stays between the thresholds of its mode. */
static int keeps_mode(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                      const double *c, double h)
{
    const double low = progress->mode > 0 ? problem->thresholds[progress->mode - 1] : -HUGE_VAL;
    const double high = progress->mode < problem->n_thresholds ? problem->thresholds[progress->mode] : HUGE_VAL;
    return (progress->touching < 0 || progress->touching >= problem->n_thresholds)
           && pmj_stays(problem, memory, c, problem->n_states, low, high, h);
}

/* The threshold or kink that is passed first within h, or -1; `*tau` becomes the time until then, or h. */
static long long first_passage(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                               const double *c, double h, double *tau)
{
    const long long v = problem->n_states;
    long long found = -1;
    double when = 0.0;
    *tau = h;
    if (!keeps_mode(problem, progress, memory, c, h)) {
        for (int side = -1; side <= 1; side += 2) {
            const long long index = progress->mode + (side < 0 ? -1 : 0);
            if (index >= 0 && index < problem->n_thresholds
                && pmj_channel_passes(problem, c, v, problem->thresholds[index], progress->touching == index, side, *tau,
                                      &when)) {
                found = index;
                *tau = when;
            }
        }
    }
    const long long kink = pmj_first_kink(problem, progress, memory, c, progress->touching - problem->n_thresholds, h, tau);
    found = kink >= 0 ? problem->n_thresholds + kink : found;
    return found;
}

/* The error of the polynomials, relative to the allowed one, at the points of comparison inside the step and at its end,
 * where `next` comes from the kernels; above 1 the step is too long. -1 if a kernel fails. */
static double missed(const pmj_problem *problem, const pmj_function *rates, const pmj_progress *progress,
                     const pmj_memory *memory, const double *c, const double *next, double tau)
{
    const double *g = actuation(problem, memory, progress->mode);
    for (long long i = 0; i < problem->n_channels; ++i) {
        memory->rest[i] = i < problem->n_rates ? memory->slope[i] - next[problem->n_channels + i]
                                               : memory->trial[i] - next[i];
    }
    double most = pmj_largest(problem, memory, memory->rest, tau);
    for (long long j = 0; j < problem->n_inside; ++j) {
        const double defect = pmj_defect(problem, rates, progress->t, memory, g, c, tau * problem->inside[j], tau);
        most = defect > most ? defect : most;
        if (defect < 0.0) {
            return -1.0;
        }
    }
    return problem->lebesgue * most / (PMJ_DEFECT * problem->tolerance);
}

/* First call: the sides and the mode at t = 0, and the coefficients there. */
static void start(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress,
                  const pmj_memory *memory)
{
    const long long n = problem->n_states;
    const double *c = coefficients(problem, memory, 0);
    int failed = 0;
    progress->touching = -1;
    progress->last_cut = HUGE_VAL;
    for (long long j = 0; j < problem->n_kinks; ++j) {
        memory->sides[j] = 1.0;
    }
    for (long long pass = 0; pass <= problem->n_kinks; ++pass) { /* an argument depends on the sides before its own */
        failed |= expand(problem, run, progress, memory, 0.0, memory->state, 0, 0);
        for (long long j = 0; j < problem->n_kinks; ++j) {
            memory->sides[j] = c[n + 2 + j] < 0.0 ? -1.0 : 1.0;
        }
    }
    progress->mode = pmj_mode_at(problem, c[n]);
    progress->first_mode = progress->mode;
    failed |= expand(problem, run, progress, memory, 0.0, memory->state, progress->mode, 0);
    pmj_deliver(problem, progress, memory, c[n]);
    const int holds = pmj_find_rest(problem, run, progress, memory, c + n + 2);
    failed |= holds < 0 || (holds && expand(problem, run, progress, memory, 0.0, memory->state, progress->mode, 0));
    if (failed) {
        progress->status = PMJ_KERNEL_FAILED;
    } else if (!pmj_all_finite(c, 2 * problem->n_channels)) {
        progress->status = PMJ_NON_FINITE;
    }
    if (progress->status == PMJ_RUNNING && pmj_beyond(problem, memory->state)) {
        progress->status = PMJ_DIVERGED;
    }
    progress->band = problem->settled * fabs(c[n + 1]);
    for (long long i = 0; i < n + 2; ++i) {
        pmj_note_value(c[i], 0.0, memory->peaks + i, memory->peak_times + i);
    }
    if (problem->notes_rate) {
        pmj_note_value(c[problem->n_channels], 0.0, memory->peaks + n + 2, memory->peak_times + n + 2);
    }
}

/* A threshold or a kink is passed at time t, where the channels have `values`. */
static void cross(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory,
                  long long index, double t, const double *values)
{
    if (index >= problem->n_thresholds) {
        const long long j = index - problem->n_thresholds;
        pmj_deliver(problem, progress, memory, values[problem->n_states]);
        pmj_meet(problem, run, progress, memory, t, j, values[problem->n_states + 2 + j], problem->n_thresholds);
        return;
    }
    progress->touching = index;
    progress->mode += index == progress->mode ? 1 : -1;
    pmj_note_switch(problem, progress, memory, t, progress->mode);
}

/* Whether a channel may exceed its peak inside a step. The bound is the larger end of its linear part plus the most that
 * the higher terms can add; the magnitudes of all terms add up to `term_sum`. */
static int may_exceed(double start, double rise, double term_sum, double peak)
{
    const double end = fabs(start + rise);
    const double beside = term_sum * PMJ_ROUNDED_UP - fabs(start) - fabs(rise);
    return (fabs(start) > end ? fabs(start) : end) + beside > peak;
}

/* Peaks of X, v, e and y' over a step of size tau: at its end, and inside. */
static void note_peaks(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                       const double *c, const double *next, double tau)
{
    const long long width = problem->n_channels;
    const double t = progress->t;
    for (long long i = 0; i < problem->n_states + 2; ++i) {
        if (!(fabs(next[i]) <= memory->peaks[i])) {
            memory->peaks[i] = fabs(next[i]);
            memory->peak_times[i] = t + tau;
        }
        const int searched = i < problem->n_searched || i == problem->n_states; /* of v always: the guard scales by it */
        if (searched && may_exceed(c[i], c[width + i] * tau, memory->term_sums[i], memory->peaks[i])) {
            pmj_note_extremum(c + i, width, problem->order, t, tau, memory->peaks + i, memory->peak_times + i);
        }
    }
    if (problem->notes_rate) {
        const long long place = problem->n_states + 2;
        pmj_note_rate(c, width, problem->order, t, tau, memory->peaks + place, memory->peak_times + place);
    }
}

/* Whether a state passes its limit of divergence inside a step of size *tau, which then becomes the time until that. */
static int first_beyond(const pmj_problem *problem, const pmj_memory *memory, const double *c, double *tau)
{
    int found = 0;
    for (long long i = 0; i < problem->n_states; ++i) {
        if (memory->term_sums[i] * PMJ_ROUNDED_UP > problem->reach[i]) {
            found |= pmj_exceeds(c + i, problem->n_channels, problem->order, problem->reach[i], tau);
        }
    }
    return found;
}

/* Accept a step of size tau whose end state is `memory->trial`. */
static void accept(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double tau, double end)
{
    const double *c = coefficients(problem, memory, progress->buffer);
    const double *next = coefficients(problem, memory, 1 - progress->buffer);
    write_rows(problem, progress, memory, c, end);
    if (problem->n_nodes > 0) {
        note_error(problem, progress, memory, c, tau, end);
    }
    note_peaks(problem, progress, memory, c, next, tau);
    for (long long i = 0; i < problem->n_states; ++i) {
        memory->state[i] = memory->trial[i];
    }
    if (pmj_beyond(problem, memory->state)) {
        progress->status = PMJ_DIVERGED;
    }
    progress->idle = end > progress->t ? 0 : progress->idle + 1;
    progress->flips = end > progress->t ? 0 : progress->flips;
    progress->t = end;
    progress->steps += 1;
    progress->buffer = 1 - progress->buffer;
}

/* A threshold or kink is passed at the very start of a step: the coefficients beyond it. */
static void pass_at_once(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress,
                         const pmj_memory *memory, long long index)
{
    cross(problem, run, progress, memory, index, progress->t, coefficients(problem, memory, progress->buffer));
    progress->idle += index < problem->n_thresholds;
    if (expand(problem, run, progress, memory, progress->t, memory->state, progress->mode, progress->buffer)) {
        progress->status = PMJ_KERNEL_FAILED;
    }
}

/* The first trial step: the length that the last coefficients allow, within the other limits. */
static double first_step(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                         const double *c, double remaining)
{
    double h = pmj_allowed_step(c, memory->scales, problem->n_channels, problem->order, problem->tolerance,
                                problem->safety);
    h = h < PMJ_GROWTH * progress->last_cut ? h : PMJ_GROWTH * progress->last_cut;
    h = h < problem->max_step ? h : problem->max_step;
    h = progress->idle > problem->n_thresholds && h > PMJ_UNDECIDED_STEP ? PMJ_UNDECIDED_STEP : h;
    return h < remaining ? h : remaining;
}

/* At a break point of the reference: the coefficients beyond it. Where the reference jumps, so do v and e. */
static void enter(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress,
                  const pmj_memory *memory)
{
    const long long v = problem->n_states;
    const double *c = coefficients(problem, memory, progress->buffer);
    pmj_enter_segments(problem, progress, memory, progress->t);
    int failed = expand(problem, run, progress, memory, progress->t, memory->state, progress->mode, progress->buffer);
    const long long mode = pmj_mode_at(problem, c[v]);
    if (mode != progress->mode) {
        progress->mode = mode;
        progress->touching = -1;
        pmj_note_switch(problem, progress, memory, progress->t, mode);
        failed |= expand(problem, run, progress, memory, progress->t, memory->state, mode, progress->buffer);
    }
    if (failed) {
        progress->status = PMJ_KERNEL_FAILED;
    }
    for (long long i = v; i < v + 2; ++i) {
        pmj_note_value(c[i], progress->t, memory->peaks + i, memory->peak_times + i);
    }
}

/* One step, to the first threshold or kink; cut until the guard and the points of comparison accept it. */
static void step(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory)
{
    const long long width = problem->n_channels;
    const double *c = coefficients(problem, memory, progress->buffer);
    const double *next = coefficients(problem, memory, 1 - progress->buffer);
    const double horizon = problem->times[problem->n_rows - 1];
    const double at = pmj_next_break(problem, progress);
    const double last = at < horizon ? at : horizon; /* where the step must end */
    const double remaining = last - progress->t;
    const double shortest = PMJ_SMALLEST_STEP * (progress->t > 1.0 ? progress->t : 1.0);
    const double smallest = shortest < remaining ? shortest : remaining;
    const int undecided = progress->idle > problem->n_thresholds;
    pmj_scales(c, width, memory->scales);
    const double first = first_step(problem, progress, memory, c, remaining);
    double h = first;
    for (;;) {
        h = pmj_guarded(problem, pmj_guard_now(run, progress), progress, memory, actuation(problem, memory, progress->mode), c, h, smallest);
        if (!(h > 0.0)) {
            progress->status = h < 0.0 ? PMJ_KERNEL_FAILED
                               : pmj_all_finite(c, (problem->order + 1) * width) ? PMJ_STALLED : PMJ_NON_FINITE;
            return;
        }
        double tau = h;
        pmj_bounds(c, width, problem->order, tau, 0, memory->term_sums);
        long long index = undecided ? -1 : first_passage(problem, progress, memory, c, h, &tau);
        if (index >= 0 && tau == 0.0) {
            pass_at_once(problem, run, progress, memory, index);
            return;
        }
        const int diverging = first_beyond(problem, memory, c, &tau);
        index = diverging ? -1 : index;
        const double end = tau < remaining ? progress->t + tau : last;
        const long long mode = progress->mode
                               + (index < 0 || index >= problem->n_thresholds ? 0 : index == progress->mode ? 1 : -1);
        pmj_arrive(c, width, problem->order, tau, memory->trial, memory->slope);
        if (expand(problem, run, progress, memory, end, memory->trial, mode, 1 - progress->buffer)) {
            progress->status = PMJ_KERNEL_FAILED;
            return;
        }
        const double miss = missed(problem, pmj_rates_now(run, progress), progress, memory, c, next, tau);
        if (miss < 0.0) {
            progress->status = PMJ_KERNEL_FAILED;
            return;
        }
        if (miss <= 1.0) {
            accept(problem, progress, memory, tau, end);
            progress->status = diverging ? PMJ_DIVERGED : progress->status;
            progress->last_cut = h < first ? h : HUGE_VAL;
            progress->touching = -1;
            if (index >= 0) {
                cross(problem, run, progress, memory, index, end, memory->trial);
            }
            if (index >= problem->n_thresholds
                && expand(problem, run, progress, memory, end, memory->state, progress->mode, progress->buffer)) {
                progress->status = PMJ_KERNEL_FAILED;
            }
            if (end >= at && progress->status == PMJ_RUNNING) {
                enter(problem, run, progress, memory);
            }
            return;
        }
        progress->rejected += 1;
        h = tau * pmj_shrink(miss, problem->order);
        if (!(h >= smallest)) {
            progress->status = pmj_all_finite(next, 2 * width) ? PMJ_STALLED : PMJ_NON_FINITE;
            return;
        }
    }
}

/* Advance the closed loop by at most `budget` steps; `progress->status` records whether and how it ended.
 * Between calls the caller may read `progress`, report it, or stop. `memory->state` starts as X(0). */
void pmj_continuous(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, pmj_memory *memory,
                    long long budget)
{
    if (progress->evaluations == 0) {
        start(problem, run, progress, memory);
    }
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        if (progress->steps + progress->rejected >= problem->max_steps) {
            progress->status = PMJ_TOO_MANY_STEPS;
            return;
        }
        step(problem, run, progress, memory);
        if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
            progress->status = PMJ_DONE;
        }
    }
}
