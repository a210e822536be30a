#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>

/* A step's polynomial may miss the kernels at its end by this multiple of the tolerance. */
#define DEFECT 64.0
/* A threshold on which rounding alone decides the side is left alone for this long, s. */
#define UNDECIDED_STEP 1e-7
/* Rounding of a sum of terms, generously, relative to their magnitudes. */
#define ROUNDED_UP (1.0 + 1e-12)

static double *coefficients(const pmj_problem *problem, const pmj_memory *memory, long long buffer)
{
    return memory->coefficients + buffer * ((problem->order + 1) * (problem->n_states + 1) + 3);
}

/* Taylor coefficients at (t, X) in the given mode, into half `buffer`; 0 is success. */
static int expand(const pmj_problem *problem, const pmj_function *taylor, pmj_progress *progress,
                  const pmj_memory *memory, double t, const double *X, long long mode, long long buffer)
{
    taylor->arg[0] = &t;
    taylor->arg[1] = X;
    taylor->arg[2] = problem->modes + mode * 2 * problem->n_actuated;
    taylor->arg[3] = problem->p;
    taylor->res[0] = coefficients(problem, memory, buffer);
    progress->evaluations += 1;
    return taylor->call(taylor->arg, taylor->res, taylor->iw, taylor->w, 0);
}

/* Mode of a value of v: how many thresholds lie below it. */
static long long mode_of(const pmj_problem *problem, double v)
{
    long long mode = 0;
    while (mode < problem->n_thresholds && v > problem->thresholds[mode]) {
        ++mode;
    }
    return mode;
}

static void write_rows(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory,
                       const double *c, double until)
{
    const long long n = problem->n_states;
    while (progress->row < problem->n_rows && problem->times[progress->row] <= until) {
        const double tau = problem->times[progress->row] - progress->t;
        pmj_values(c, n + 1, problem->order, tau, memory->rows + progress->row * n, n);
        progress->row += 1;
    }
}

/* Add the integral of (y - y_r)^2 over the step; 0 is success. */
static int integrate_error(const pmj_problem *problem, const pmj_function *reference, pmj_progress *progress,
                           const pmj_memory *memory, const double *c, double size)
{
    double instants[PMJ_MAX_NODES];
    double y[PMJ_MAX_NODES];
    double sum = 0.0;
    for (long long i = 0; i < problem->n_nodes; ++i) {
        instants[i] = size * problem->nodes[i];
    }
    pmj_channel(c, problem->n_states + 1, problem->order, instants, y, problem->n_nodes);
    for (long long i = 0; i < problem->n_nodes; ++i) {
        const double t = progress->t + instants[i];
        reference->arg[0] = &t;
        reference->arg[1] = problem->p;
        reference->res[0] = memory->reference;
        const int failed = reference->call(reference->arg, reference->res, reference->iw, reference->w, 0);
        if (failed) {
            return failed;
        }
        const double e = y[i] - memory->reference[0];
        sum += problem->weights[i] * (e * e);
    }
    progress->integral += size * sum;
    return 0;
}

/* Whether v certainly keeps between the thresholds of its mode up to h, where `memory->reach` bounds its terms: a
 * straight line, and no more beside it than the higher terms can add. */
static int stays(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, const double *c,
                 double h)
{
    const long long n = problem->n_states;
    const double low = progress->mode > 0 ? problem->thresholds[progress->mode - 1] : -HUGE_VAL;
    const double high = progress->mode < problem->n_thresholds ? problem->thresholds[progress->mode] : HUGE_VAL;
    const double v = c[n];
    const double rise = c[2 * n + 1] * h;
    const double beside = memory->reach[n] * ROUNDED_UP - fabs(v) - fabs(rise);
    const double least = v + (rise < 0.0 ? rise : 0.0) - beside;
    const double most = v + (rise > 0.0 ? rise : 0.0) + beside;
    return progress->touching < 0 && least > low && most < high;
}

/* When v passes threshold `index` outwards (`outward` is +1 above the mode, -1 below), from 0 to before h.
 * 1 and the time after the step's start; 0 if it does not. On the threshold, to rounding, the first derivative of v
 * that does not vanish decides, and the zero at the start is divided out before the search. */
static int passes(const pmj_problem *problem, const pmj_progress *progress, const double *c, long long index,
                  int outward, double h, double *tau)
{
    double q[PMJ_MAX_ORDER + 1];
    const long long width = problem->n_states + 1;
    for (long long k = 0; k <= problem->order; ++k) {
        q[k] = c[k * width + problem->n_states];
    }
    q[0] = progress->touching == index ? 0.0 : q[0] - problem->thresholds[index];
    const long long zeros = pmj_leading_zeros(q, problem->order, h);
    if (q[zeros] * outward > 0.0) {
        *tau = 0.0;
        return 1;
    }
    return pmj_first_crossing(q + zeros, problem->order - zeros, h, tau);
}

/* The threshold that v passes first within h, or -1; `*tau` becomes the time until then, or h. */
static long long first_passage(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                               const double *c, double h, double *tau)
{
    long long found = -1;
    double when = 0.0;
    *tau = h;
    if (stays(problem, progress, memory, c, h)) {
        return -1;
    }
    if (progress->mode > 0 && passes(problem, progress, c, progress->mode - 1, -1, h, &when)) {
        found = progress->mode - 1;
        *tau = when;
    }
    if (progress->mode < problem->n_thresholds && passes(problem, progress, c, progress->mode, 1, *tau, &when)) {
        found = progress->mode;
        *tau = when;
    }
    return found;
}

/* Whether the step's polynomial agrees with the kernels at its end, as far as the tolerance asks: in the slopes of the
 * states, and in the value of v. High gains leave more rounding in v than its present value tells, so that its
 * scale is its largest value so far. Nothing agrees with NaN. */
static int agrees(const pmj_problem *problem, const pmj_memory *memory, const double *next, double tau)
{
    const long long n = problem->n_states;
    const double allowed = DEFECT * problem->tolerance;
    int good = fabs(memory->trial[n] - next[n]) <= allowed * (memory->peaks[n] > 1.0 ? memory->peaks[n] : 1.0);
    for (long long i = 0; i < n; ++i) {
        good &= tau * fabs(memory->slope[i] - next[n + 1 + i]) * memory->scales[i] <= allowed;
    }
    return good;
}

/* Write down a change of mode at time t; a touch, there and back at one instant, is none. */
static void note_switch(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t,
                        long long mode)
{
    const long long n = progress->switches;
    const long long before = n > 1 ? memory->switch_modes[n - 2] : progress->first_mode;
    if (n > 0 && memory->switch_times[n - 1] == t && before == mode) {
        progress->switches -= 1;
    } else if (t == 0.0) {
        progress->first_mode = mode;
    } else if (n < problem->max_switches) {
        memory->switch_times[n] = t;
        memory->switch_modes[n] = mode;
        progress->switches += 1;
    } else {
        progress->status = PMJ_TOO_MANY_SWITCHES;
    }
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

/* First call: the mode at t = 0 and the coefficients there. */
static void start(const pmj_problem *problem, const pmj_function *taylor, pmj_progress *progress,
                  const pmj_memory *memory)
{
    const long long width = problem->n_states + 1;
    const double *c = coefficients(problem, memory, 0);
    progress->touching = -1;
    if (expand(problem, taylor, progress, memory, 0.0, memory->state, 0, 0)) {
        progress->status = PMJ_KERNEL_FAILED;
        return;
    }
    progress->mode = mode_of(problem, c[problem->n_states]);
    progress->first_mode = progress->mode;
    if (expand(problem, taylor, progress, memory, 0.0, memory->state, progress->mode, 0)) {
        progress->status = PMJ_KERNEL_FAILED;
    } else if (!all_finite(c, 2 * width)) {
        progress->status = PMJ_NON_FINITE;
    }
    for (long long i = 0; i < width; ++i) {
        pmj_note_value(c[i], 0.0, memory->peaks + i, memory->peak_times + i);
    }
}

/* v leaves the mode through threshold `index` at time t, at which `X` is the state. */
static void cross(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long index,
                  double t)
{
    progress->mode += index == progress->mode ? 1 : -1;
    progress->touching = index;
    note_switch(problem, progress, memory, t, progress->mode);
}

/* Whether a channel may exceed its peak inside a step: the larger end of its straight line, and what its higher
 * terms, bounded by `reach`, can add. */
static int may_exceed(double start, double rise, double reach, double peak)
{
    const double end = fabs(start + rise);
    const double beside = reach * ROUNDED_UP - fabs(start) - fabs(rise);
    return (fabs(start) > end ? fabs(start) : end) + beside > peak;
}

/* Peaks of X and v over a step of size tau: at its end, and inside. */
static void note_peaks(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory,
                       const double *c, const double *next, double tau)
{
    const long long width = problem->n_states + 1;
    const double t = progress->t;
    for (long long i = 0; i < width; ++i) {
        if (!(fabs(next[i]) <= memory->peaks[i])) {
            memory->peaks[i] = fabs(next[i]);
            memory->peak_times[i] = t + tau;
        }
        if (i < problem->n_searched && may_exceed(c[i], c[width + i] * tau, memory->reach[i], memory->peaks[i])) {
            pmj_note_extremum(c + i, width, problem->order, t, tau, memory->peaks + i, memory->peak_times + i);
        }
    }
}

/* Accept a step of size tau whose end state is `memory->trial`. */
static void accept(const pmj_problem *problem, const pmj_function *reference, pmj_progress *progress,
                   const pmj_memory *memory, double tau, double end)
{
    const double *c = coefficients(problem, memory, progress->buffer);
    const double *next = coefficients(problem, memory, 1 - progress->buffer);
    write_rows(problem, progress, memory, c, end);
    if (integrate_error(problem, reference, progress, memory, c, tau)) {
        progress->status = PMJ_KERNEL_FAILED;
    }
    note_peaks(problem, progress, memory, c, next, tau);
    for (long long i = 0; i < problem->n_states; ++i) {
        memory->state[i] = memory->trial[i];
        if (fabs(memory->state[i]) > problem->divergence) {
            progress->status = PMJ_DIVERGED;
        }
    }
    progress->idle = end > progress->t ? 0 : progress->idle + 1;
    progress->t = end;
    progress->steps += 1;
    progress->buffer = 1 - progress->buffer;
}

/* One step: at most `h`, to the first threshold; halved until the end agrees with the kernels there. */
static void step(const pmj_problem *problem, const pmj_function *taylor, const pmj_function *reference,
                 pmj_progress *progress, const pmj_memory *memory)
{
    const long long n = problem->n_states;
    const double *c = coefficients(problem, memory, progress->buffer);
    const double *next = coefficients(problem, memory, 1 - progress->buffer);
    const double horizon = problem->times[problem->n_rows - 1];
    const double remaining = horizon - progress->t;
    const double smallest = PMJ_SMALLEST_STEP * (progress->t > 1.0 ? progress->t : 1.0);
    const int undecided = progress->idle > problem->n_thresholds;
    pmj_scales(c, n + 1, memory->scales);
    double h = pmj_allowed_step(c, memory->scales, n + 1, problem->order, problem->tolerance, problem->safety);
    h = undecided && h > UNDECIDED_STEP ? UNDECIDED_STEP : h;
    h = h < remaining ? h : remaining;
    for (;;) {
        double tau = h;
        pmj_bounds(c, n + 1, problem->order, tau, problem->n_searched > 0 ? 0 : n, memory->reach);
        const long long index = undecided ? -1 : first_passage(problem, progress, memory, c, h, &tau);
        if (index >= 0 && tau == 0.0) {
            cross(problem, progress, memory, index, progress->t);
            progress->idle += 1;
            if (expand(problem, taylor, progress, memory, progress->t, memory->state, progress->mode,
                       progress->buffer)) {
                progress->status = PMJ_KERNEL_FAILED;
            }
            return;
        }
        const double end = tau < remaining ? progress->t + tau : horizon;
        const long long mode = progress->mode + (index < 0 ? 0 : index == progress->mode ? 1 : -1);
        pmj_arrive(c, n + 1, problem->order, tau, memory->trial, memory->slope);
        if (expand(problem, taylor, progress, memory, end, memory->trial, mode, 1 - progress->buffer)) {
            progress->status = PMJ_KERNEL_FAILED;
            return;
        }
        if (agrees(problem, memory, next, tau)) {
            accept(problem, reference, progress, memory, tau, end);
            progress->touching = -1;
            if (index >= 0) {
                cross(problem, progress, memory, index, end);
            }
            return;
        }
        progress->rejected += 1;
        h = 0.5 * tau;
        if (!(h >= smallest)) {
            progress->status = all_finite(next, 2 * (n + 1)) ? PMJ_STALLED : PMJ_NON_FINITE;
            return;
        }
    }
}

/* Back to the start of a run from `memory->state`: what a fresh `progress` and `memory` hold. */
void pmj_begin(const pmj_problem *problem, pmj_progress *progress, pmj_memory *memory)
{
    const pmj_progress fresh = {.touching = -1, .row = 1};
    *progress = fresh;
    for (long long i = 0; i < problem->n_states; ++i) {
        memory->rows[i] = memory->state[i];
        memory->sample[i] = memory->state[i];
        if (problem->sample_time > 0.0) {
            memory->held[i] = memory->state[i];
        }
    }
    const long long peaks = problem->n_states + (problem->sample_time > 0.0 ? 2 : 1); /* of X and v; sampled: and e */
    for (long long i = 0; i < peaks; ++i) {
        memory->peaks[i] = 0.0;
        memory->peak_times[i] = 0.0;
    }
}

/* Advance the closed loop by at most `budget` steps; `progress->status` says whether and how it ended.
 * Between calls the caller may look at `progress`, tell its user, or stop. `memory->state` starts as X(0). */
void pmj_continuous(const pmj_problem *problem, const pmj_function *taylor, const pmj_function *reference,
                    pmj_progress *progress, pmj_memory *memory, long long budget)
{
    if (progress->evaluations == 0) {
        start(problem, taylor, progress, memory);
    }
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        if (progress->steps + progress->rejected >= problem->max_steps) {
            progress->status = PMJ_TOO_MANY_STEPS;
            return;
        }
        step(problem, taylor, reference, progress, memory);
        if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
            progress->status = PMJ_DONE;
        }
    }
}
