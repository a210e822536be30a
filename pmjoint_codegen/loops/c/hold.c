#include "hold.h"
#include "stick.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Integral of e^2 over one step of a hold with several steps. */
static double long_integral(const pmj_problem *problem, const double *c, double size)
{
    double sum = 0.0;
    for (long long i = 0; i < problem->n_nodes; ++i) {
        double e = 0.0;
        pmj_evaluate(c + E, CHANNELS, problem->order, size * problem->nodes[i], &e, 1);
        sum += problem->weights[i] * (e * e);
    }
    return size * sum;
}

/* The next output row: plant states as given, everything else as at the sample at time t_sample. */
double *pmj_next_row(pmj_progress *progress, const pmj_memory *memory, double t_sample)
{
    double *row = memory->rows + progress->row * PMJ_NS;
    memcpy(row, memory->sample, PMJ_NS * sizeof *row);
    memcpy(memory->row_samples + progress->row * PMJ_NS, memory->sample, PMJ_NS * sizeof *row);
    memory->row_sample_times[progress->row] = t_sample;
    progress->row += 1;
    return row;
}

/* Accept a step of the plant to time `until`: output rows before `rows_until`, peaks, the new state. */
static void accept(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long order,
                   double tau, double until, double rows_until, double t_sample)
{
    const double *c = memory->coefficients;
    while (progress->row < problem->n_rows && problem->times[progress->row] <= until
           && problem->times[progress->row] < rows_until) {
        const double at = problem->times[progress->row] - progress->t;
        pmj_evaluate(c, CHANNELS, order, at, pmj_next_row(progress, memory, t_sample), PMJ_NX);
    }
    pmj_note_peaks(c, CHANNELS, order, PMJ_NX, progress->t, tau, memory->trial, memory->peaks, memory->peak_times);
    pmj_note_peaks(c + E, CHANNELS, order, 1, progress->t, tau, memory->trial + E, memory->peaks + PEAK_E,
                   memory->peak_times + PEAK_E);
    if (problem->notes_rate) {
        pmj_note_rate(c, CHANNELS, order, progress->t, tau, memory->peaks + PEAK_RATE, memory->peak_times + PEAK_RATE);
    }
    pmj_note_settled(progress, c + E, CHANNELS, order, memory->trial[E], tau, until);
    memcpy(memory->state, memory->trial, PMJ_NX * sizeof(double));
    progress->t = until;
    progress->steps += 1;
}

/* The end of a trial step, or the status that forbids it. */
static void try_step(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long order,
                     double tau)
{
    pmj_evaluate(memory->coefficients, CHANNELS, order, tau, memory->trial, CHANNELS);
    if (!pmj_all_finite(memory->trial, PMJ_NX)) {
        progress->status = PMJ_NON_FINITE;
    } else if (progress->steps >= problem->max_steps) {
        progress->status = PMJ_TOO_MANY_STEPS;
    }
}

/* Whether a state of the plant passes the limit of divergence inside a step of size *tau, which then becomes the time
 * until that. */
static int first_beyond(const pmj_problem *problem, const pmj_memory *memory, long long order, double *tau)
{
    int found = 0;
    for (int i = 0; i < PMJ_NX; ++i) {
        found |= pmj_exceeds(memory->coefficients + i, CHANNELS, order, problem->divergence, tau);
    }
    return found;
}

/* Put a kink on a side. On the other side the right-hand side is another function: the guard's window is invalid. */
static void set_side(const pmj_problem *problem, const pmj_memory *memory, long long kink, double side)
{
    if (memory->sides[kink] != side) {
        memory->window[1] = -1.0;
    }
    memory->sides[kink] = side;
    memory->w[problem->n_actuated + kink] = side;
}

/* Rates of the plant, e and the arguments of kinks at the state, into `rest`; 0 is success. */
static int apply_rates(const pmj_problem *problem, const pmj_function *rates, const pmj_progress *progress,
                       const pmj_memory *memory)
{
    rates->arg[0] = &progress->t;
    rates->arg[1] = memory->state;
    rates->arg[2] = memory->w;
    rates->arg[3] = problem->p;
    rates->res[0] = memory->rest;
    rates->res[1] = memory->rest + PMJ_NX;
    if (PMJ_NK > 0) {
        rates->res[2] = memory->rest + PMJ_NX + 1;
    }
    return pmj_apply(rates);
}

/* The sides of all kinks at the state; an argument of 0 leaves its side unchanged. 0 is success. */
static int find_sides(const pmj_problem *problem, const pmj_function *rates, const pmj_progress *progress,
                      const pmj_memory *memory)
{
    double *w = memory->w + problem->n_actuated;
    for (int j = 0; j < PMJ_NK; ++j) { /* an argument depends on the sides before its own */
        for (int i = 0; i < PMJ_NK; ++i) {
            w[i] = memory->sides[i];
        }
        if (apply_rates(problem, rates, progress, memory)) {
            return 1;
        }
        const double value = memory->rest[PMJ_NX + 1 + j];
        set_side(problem, memory, j, value < 0.0 ? -1.0 : value > 0.0 ? 1.0 : memory->sides[j]);
    }
    for (int i = 0; i < PMJ_NK; ++i) {
        w[i] = memory->sides[i];
    }
    return 0;
}

/* Whether the kink that holds the run still does under the new w; or whether one on whose zero the run is begins to. `rest`
 * has the arguments. 0 is success. */
static int find_rest(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress,
                     const pmj_memory *memory)
{
    double side = 0.0;
    if (progress->held < 0) {
        return pmj_find_rest(problem, plant, progress, memory, memory->rest + PMJ_NX + 1) < 0;
    }
    const int holds = pmj_can_hold(problem, plant, memory, progress->t, progress->held, &side);
    if (holds == 0) {
        pmj_let_go(problem, progress, memory, progress->t, side, 0);
    }
    return holds < 0;
}

/* The error of a step of a long hold relative to the allowed one; above 1 it is too long, -1 if a kernel fails. */
static double missed(const pmj_problem *problem, const pmj_kernels *plant, const pmj_progress *progress,
                     const pmj_memory *memory, double tau)
{
    double most = 0.0;
    for (long long j = 0; j <= problem->n_inside; ++j) {
        const double at = j < problem->n_inside ? tau * problem->inside[j] : tau;
        const double defect = pmj_defect(problem, pmj_rates_now(plant, progress), progress->t, memory, memory->w, memory->coefficients, at, tau);
        if (defect < 0.0) {
            return -1.0;
        }
        most = defect > most ? defect : most;
    }
    return problem->lebesgue * most / (PMJ_DEFECT * problem->tolerance);
}

/* The step of a long hold from the coefficients in memory, up to `left`, to the first kink; 0 at a kink that is passed at
 * once or where the run ends. */
static double long_step(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress,
                        const pmj_memory *memory, double left, double smallest, long long *kink)
{
    const double *c = memory->coefficients;
    double h = pmj_step_size(c, CHANNELS, problem->order, problem->tolerance, problem->safety);
    h = h < PMJ_GROWTH * progress->last_cut ? h : PMJ_GROWTH * progress->last_cut;
    h = h < problem->max_step ? h : problem->max_step;
    h = h < left ? h : left;
    const double first = h;
    const double least = smallest < left ? smallest : left;
    pmj_scales(c, CHANNELS, memory->scales);
    for (;;) {
        h = pmj_guarded(problem, pmj_guard_now(plant, progress), progress, memory, memory->w, c, h, least);
        if (!(h > 0.0)) {
            progress->status = h < 0.0 ? PMJ_KERNEL_FAILED : pmj_all_finite(c, (problem->order + 1) * CHANNELS) ? PMJ_STALLED : PMJ_NON_FINITE;
            return 0.0;
        }
        double tau = h;
        pmj_bounds(c, CHANNELS, problem->order, h, 0, memory->term_sums);
        *kink = pmj_first_kink(problem, progress, memory, c, progress->touching, h, &tau);
        if (*kink >= 0 && tau == 0.0) {
            return 0.0;
        }
        const double miss = missed(problem, plant, progress, memory, tau);
        if (miss < 0.0) {
            progress->status = PMJ_KERNEL_FAILED;
            return 0.0;
        }
        if (miss <= 1.0) {
            progress->last_cut = h < first ? h : HUGE_VAL;
            return tau;
        }
        progress->rejected += 1;
        h = tau * pmj_shrink(miss, problem->order);
    }
}

int pmj_enter_break(const pmj_problem *problem, const pmj_function *rates, pmj_progress *progress,
                    const pmj_memory *memory, double until)
{
    if (!pmj_enter_segments(problem, progress, memory, until)) {
        return 0;
    }
    memory->window[1] = -1.0; /* the guard of e is known for the segment before */
    if (apply_rates(problem, rates, progress, memory)) {
        return 1;
    }
    pmj_note_value(memory->rest[PMJ_NX], progress->t, memory->peaks + PEAK_E, memory->peak_times + PEAK_E);
    return 0;
}

void pmj_long_hold(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory,
                   double end, double rows_until, double t_sample)
{
    const double smallest = PMJ_SMALLEST_STEP * (end > 1.0 ? end : 1.0);
    double *c = memory->coefficients;
    progress->touching = -1;
    progress->flips = 0;
    progress->last_cut = HUGE_VAL;
    if (find_sides(problem, plant->rates, progress, memory) || find_rest(problem, plant, progress, memory)) {
        progress->status = PMJ_KERNEL_FAILED;
    }
    while (progress->t < end && progress->status == PMJ_RUNNING) {
        const double at = pmj_next_break(problem, progress);
        const double last = at < rows_until && at < end ? at : end; /* where the step must end */
        const double left = last - progress->t;
        long long kink = -1;
        const pmj_function *taylor = pmj_taylor_now(plant, progress);
        taylor->arg[0] = &progress->t;
        taylor->arg[1] = memory->state;
        taylor->arg[2] = memory->w;
        taylor->arg[3] = problem->p;
        taylor->res[0] = c;
        progress->evaluations += 1;
        if (pmj_apply(taylor)) {
            progress->status = PMJ_KERNEL_FAILED;
            return;
        }
        double tau = long_step(problem, plant, progress, memory, left, smallest, &kink);
        if (progress->status != PMJ_RUNNING) {
            return;
        }
        if (tau > 0.0) {
            const int diverging = first_beyond(problem, memory, problem->order, &tau);
            try_step(problem, progress, memory, problem->order, tau);
            if (progress->status != PMJ_RUNNING) {
                return;
            }
            progress->integral += long_integral(problem, c, tau);
            accept(problem, progress, memory, problem->order, tau, tau < left ? progress->t + tau : last, rows_until, t_sample);
            progress->touching = -1;
            progress->flips = 0;
            progress->status = diverging ? PMJ_DIVERGED : progress->status;
        }
        if (last == at && progress->t >= at && progress->status == PMJ_RUNNING
            && pmj_enter_break(problem, plant->rates, progress, memory, progress->t)) {
            progress->status = PMJ_KERNEL_FAILED;
        }
        if (kink >= 0 && progress->status == PMJ_RUNNING) {
            const double side = tau > 0.0 ? memory->trial[E + 1 + kink] : c[E + 1 + kink];
            pmj_meet(problem, plant, progress, memory, progress->t, kink, side, 0);
        }
    }
}

/* The error of a hold relative to the allowed one, from the guard on discs of radius R in time and `spreads` of each x. */
static double hold_miss(const pmj_problem *problem, const pmj_kernels *plant, const pmj_memory *memory, double t,
                        const double *x, double R, const double *spreads, double length, long long disc)
{
    double most = 0.0;
    plant->guard->arg[0] = &t;
    plant->guard->arg[1] = x;
    plant->guard->arg[2] = memory->w;
    plant->guard->arg[3] = problem->p;
    plant->guard->arg[4] = &R;
    plant->guard->arg[5] = spreads;
    plant->guard->res[0] = memory->rest;
    if (pmj_apply(plant->guard)) {
        return HUGE_VAL;
    }
    for (int i = 0; i < CHANNELS; ++i) {
        const double miss = i < PMJ_NX ? problem->hold_rate_factors[disc] * memory->rest[i] * length
                                       : problem->hold_value_factors[disc] * memory->rest[i];
        if (!(miss <= most)) {
            most = miss <= DBL_MAX ? miss : HUGE_VAL;
        }
    }
    return most / (PMJ_DEFECT * problem->tolerance);
}

/* Whether the guard shows a hold to be one step of the sample's own coefficients. A window that it has
 * evaluated once serves many holds; inside it, variations are at most twice the nonlinear part. */
static int shown(const pmj_problem *problem, const pmj_kernels *plant, const pmj_progress *progress,
                 const pmj_memory *memory, double length)
{
    const double *c = memory->coefficients;
    const double R = problem->hold_ratios[0] * problem->sample_time;
    double *window = memory->window;
    double *spreads = memory->majorants;
    if (covered(window, c, progress->t, R)) {
        return 1;
    }
    if (PMJ_WINDOWS) {
        window[0] = progress->t + R;
        window[1] = 2.0 * R;
        for (int i = 0; i < PMJ_NX; ++i) {
            window[2 + i] = c[i];
            window[2 + PMJ_NX + i] = PMJ_WINDOW * spread(c, i, R);
        }
        if (2.0 * hold_miss(problem, plant, memory, window[0], window + 2, window[1], window + 2 + PMJ_NX,
                            problem->sample_time, 0) <= 1.0) {
            return 1;
        }
    }
    window[1] = -1.0; /* none */
    for (long long disc = 0; disc < problem->n_hold_ratios; ++disc) {
        const double radius = problem->hold_ratios[disc] * length;
        for (int i = 0; i < PMJ_NX; ++i) {
            spreads[i] = spread(c, i, radius);
        }
        if (hold_miss(problem, plant, memory, progress->t, c, radius, spreads, length, disc) <= 1.0) {
            return 1;
        }
    }
    return 0;
}

/* Set the sides at a sample for the guard. */
static void take_sides(const pmj_problem *problem, const pmj_memory *memory)
{
    for (int j = 0; j < PMJ_NK; ++j) {
        set_side(problem, memory, j, memory->coefficients[E + 1 + j] < 0.0 ? -1.0 : 1.0);
    }
}

/* Integrate the plant under constant w for the time `length`, to `end`; the sample's coefficients are in memory. */
void pmj_hold(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory,
              double length, double end, double rows_until)
{
    take_sides(problem, memory);
    if (!(progress->held < 0 && length <= problem->max_step && smooth(memory->coefficients, length)
          && !(pmj_next_break(problem, progress) < rows_until && pmj_next_break(problem, progress) < end)
          && within(memory->coefficients, bounds_of(problem, length))
          && shown(problem, plant, progress, memory, length))) {
        pmj_long_hold(problem, plant, progress, memory, end, rows_until, progress->t);
        return;
    }
    const int diverging = first_beyond(problem, memory, ORDER, &length);
    try_step(problem, progress, memory, ORDER, length);
    if (progress->status == PMJ_RUNNING) {
        progress->integral += integral(memory->coefficients, length);
        accept(problem, progress, memory, ORDER, length, diverging ? progress->t + length : end, rows_until, progress->t);
        progress->status = diverging ? PMJ_DIVERGED : progress->status;
    }
}
