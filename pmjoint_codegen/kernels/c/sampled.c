#include "hold.h"
#include "pmjoint_runtime.h"
#include "sampled.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Output instants closer to a sample than this fraction of the sample time are the sample itself. */
#define SAME_INSTANT 1e-9

/* Entries of the peaks: X, v, e. */
#define PEAK_V PMJ_NS
#define PEAK_E (PMJ_NS + 1)
#define OWN (PMJ_NS - PMJ_NX) /* the controller's states */

/* A compiler that is not told puts the rare path into the frequent one, and its registers in memory. */
#if defined(__GNUC__)
#define RARE __attribute__((noinline, cold))
#define SELDOM(condition) __builtin_expect(!!(condition), 0)
#else
#define RARE
#define SELDOM(condition) (condition)
#endif

/* Integral of e^2 over a step of a hold that takes several. */
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

static int all_finite(const double *values, int n)
{
    for (int i = 0; i < n; ++i) {
        if (!(fabs(values[i]) <= DBL_MAX)) {
            return 0;
        }
    }
    return 1;
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
static double *next_row(pmj_progress *progress, const pmj_memory *memory, double t_sample)
{
    double *row = memory->rows + progress->row * PMJ_NS;
    memcpy(row, memory->sample, PMJ_NS * sizeof *row);
    memcpy(memory->held + progress->row * PMJ_NS, memory->sample, PMJ_NS * sizeof *row);
    memory->held_times[progress->row] = t_sample;
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
        pmj_evaluate(c, CHANNELS, order, at, next_row(progress, memory, t_sample), PMJ_NX);
    }
    pmj_note_peaks(c, CHANNELS, order, PMJ_NX, progress->t, tau, memory->trial, memory->peaks, memory->peak_times);
    pmj_note_peaks(c + E, CHANNELS, order, 1, progress->t, tau, memory->trial + E, memory->peaks + PEAK_E,
                   memory->peak_times + PEAK_E);
    memcpy(memory->state, memory->trial, PMJ_NX * sizeof(double));
    progress->t = until;
    progress->steps += 1;
}

/* The end of a step on trial, or the status that forbids it. */
static void try_step(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long order,
                     double tau)
{
    pmj_evaluate(memory->coefficients, CHANNELS, order, tau, memory->trial, CHANNELS);
    if (!all_finite(memory->trial, PMJ_NX)) {
        progress->status = PMJ_NON_FINITE;
    } else if (progress->steps >= problem->max_steps) {
        progress->status = PMJ_TOO_MANY_STEPS;
    }
}

/* Integrate the plant under constant w to `end` in as many steps as the tolerance demands. */
static void long_hold(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double end,
                      double rows_until)
{
    const double t_sample = progress->t;
    const double smallest = PMJ_SMALLEST_STEP * (end > 1.0 ? end : 1.0);
    double *c = memory->coefficients;
    while (progress->t < end) {
        const double left = end - progress->t;
        pmj_plant_taylor(&progress->t, memory->state, memory->w, problem->p, c);
        progress->evaluations += 1;
        const double size = pmj_step_size(c, CHANNELS, problem->order, problem->tolerance, problem->safety);
        const int whole = !(size < left);
        const double tau = whole ? left : size;
        try_step(problem, progress, memory, problem->order, tau);
        if (progress->status == PMJ_RUNNING && !whole && tau < smallest) {
            progress->status = PMJ_STALLED;
        }
        if (progress->status != PMJ_RUNNING) {
            return;
        }
        progress->integral += long_integral(problem, c, tau);
        accept(problem, progress, memory, problem->order, tau, whole ? end : progress->t + tau, rows_until, t_sample);
    }
}

/* Integrate the plant under constant w for the time `length`, to `end`; the sample's coefficients stand in memory. */
static void hold(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double length,
                 double end, double rows_until)
{
    if (!within(memory->coefficients, bounds_of(problem, length))) {
        long_hold(problem, progress, memory, end, rows_until);
        return;
    }
    try_step(problem, progress, memory, ORDER, length);
    if (progress->status == PMJ_RUNNING) {
        progress->integral += integral(memory->coefficients, length);
        accept(problem, progress, memory, ORDER, length, end, rows_until, progress->t);
    }
}

/* Whether any state has passed the limit of divergence. */
static int beyond(const pmj_problem *problem, const double *X)
{
    for (int i = 0; i < PMJ_NS; ++i) {
        if (fabs(X[i]) > problem->divergence) {
            return 1;
        }
    }
    return 0;
}

/* The state at the next sample, and its peaks; or the status that forbids going on. */
static void settle(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, const double *next)
{
    memcpy(memory->sample, memory->state, PMJ_NX * sizeof(double));
    memcpy(memory->sample + PMJ_NX, next, OWN * sizeof(double));
    if (!all_finite(memory->sample, PMJ_NS)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    for (int i = 0; i < PMJ_NS; ++i) {
        pmj_note_value(memory->sample[i], progress->t, memory->peaks + i, memory->peak_times + i);
    }
    if (beyond(problem, memory->sample)) {
        progress->status = PMJ_DIVERGED;
    }
}

/* Everything that may happen at a sample and in its hold: the coefficients, X and w stand in memory. */
static RARE void whole_sample(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t,
                              double v, const double *next)
{
    const double slack = SAME_INSTANT * problem->sample_time;
    const double horizon = problem->times[problem->n_rows - 1];
    const double end = (double)(progress->sample + 1) * problem->sample_time;
    const double rows_until = end - slack;
    pmj_note_value(v, t, memory->peaks + PEAK_V, memory->peak_times + PEAK_V);
    if (!(fabs(v) <= DBL_MAX)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    note_mode(problem, progress, memory, t, v);
    if (progress->sample == 0 && beyond(problem, memory->sample)) {
        progress->status = PMJ_DIVERGED;
    }
    while (progress->row < problem->n_rows && problem->times[progress->row] <= t + slack) {
        next_row(progress, memory, t);
    }
    if (progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
        return;
    }
    if (progress->status != PMJ_RUNNING) {
        return;
    }
    if (horizon < rows_until) { /* ends inside this hold */
        hold(problem, progress, memory, horizon - t, horizon, rows_until);
    } else {
        hold(problem, progress, memory, problem->sample_time, end, rows_until);
    }
    if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
    }
    if (progress->status == PMJ_RUNNING) {
        settle(problem, progress, memory, next);
        progress->sample += 1;
    }
}

/* What a sample must stay within to be an ordinary one, which changes X, the integral and peaks alone. */
typedef struct {
    bounds accuracy;   /* one step for the whole hold */
    double low;        /* thresholds of v on both sides of the mode */
    double high;
    double row;        /* the next output instant */
} ordinary;

static ordinary ordinary_of(const pmj_problem *problem, const pmj_progress *progress)
{
    ordinary now = {bounds_of(problem, problem->sample_time), -DBL_MAX, DBL_MAX, HUGE_VAL};
    if (progress->mode > 0) {
        now.low = problem->thresholds[progress->mode - 1];
    }
    if (progress->mode < problem->n_thresholds) {
        now.high = problem->thresholds[progress->mode];
    }
    if (progress->row < problem->n_rows) {
        now.row = problem->times[progress->row];
    }
    return now;
}

/* X(0) and e(0). */
static void note_start(const pmj_memory *memory, const double *c)
{
    for (int i = 0; i < PMJ_NS; ++i) {
        pmj_note_value(memory->sample[i], 0.0, memory->peaks + i, memory->peak_times + i);
    }
    pmj_note_value(c[E], 0.0, memory->peaks + PEAK_E, memory->peak_times + PEAK_E);
}

/* Keep the peaks of an ordinary sample and its hold; or 0, and keep nothing, where the run may diverge. */
static RARE int note_sample(const pmj_problem *problem, const pmj_memory *memory, double t, double end, double v,
                            const double *next)
{
    const double limit = problem->divergence < DBL_MAX ? problem->divergence : DBL_MAX;
    const double *c = memory->coefficients;
    const double size = problem->sample_time;
    for (int i = 0; i < PMJ_NS; ++i) {
        const double most = i < PMJ_NX ? reach(c, i, size) : fabs(next[i - PMJ_NX]);
        if (!(most <= limit)) {
            return 0;
        }
    }
    pmj_note_value(v, t, memory->peaks + PEAK_V, memory->peak_times + PEAK_V);
    for (int i = 0; i < OWN; ++i) {
        pmj_note_value(next[i], end, memory->peaks + PMJ_NX + i, memory->peak_times + PMJ_NX + i);
    }
    for (int i = 0; i < CHANNELS; ++i) {
        const int place = i == E ? PEAK_E : i;
        if (!(reach(c, i, size) <= memory->peaks[place])) {
            const double last = value(c, i, size);
            pmj_note_peaks(c + i, CHANNELS, ORDER, 1, t, size, &last, memory->peaks + place,
                           memory->peak_times + place);
        }
    }
    return 1;
}

/* Advance the sampled loop by at most `budget` samples; `progress->status` says whether and how it ended.
 * `memory->state` and `memory->sample` start as X(0).
 *
 * What a sample usually does stands here, on values that the compiler keeps in registers; as soon as anything else may
 * happen (a switch, an output row, a second step, an end), `whole_sample` does it all, with the same arithmetic. */
void pmj_sampled(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long budget)
{
    const double period = problem->sample_time;
    const double slack = SAME_INSTANT * period;
    double X[PMJ_NS];
    double p[PMJ_NP];
    double h[PMJ_NH];
    ordinary now = ordinary_of(problem, progress);
    memcpy(X, memory->sample, sizeof X);
    memcpy(p, problem->p, sizeof p);
    memcpy(h, problem->hold, sizeof h);
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        const double t = (double)progress->sample * period;
        const double end = (double)(progress->sample + 1) * period;
        double v;
        double w[PMJ_NW];
        double c[(ORDER + 1) * CHANNELS];
        double next[OWN];
        pmj_sample(&t, X, h, p, &v, w, c, next);
        progress->evaluations += 1;
        const int usual = v > now.low && v <= now.high && now.row >= end - slack && within(c, now.accuracy)
                          && progress->steps < problem->max_steps && progress->sample > 0;
        int calm = fabs(v) <= memory->peaks[PEAK_V] && reach(c, E, period) <= memory->peaks[PEAK_E];
        UNROLLED
        for (int j = 0; j < PMJ_NX; ++j) {
            calm = calm && reach(c, j, period) <= memory->peaks[j];
        }
        UNROLLED
        for (int j = 0; j < OWN; ++j) {
            calm = calm && fabs(next[j]) <= memory->peaks[PMJ_NX + j];
        }
        if (SELDOM(!(usual && calm))) {
            double kept[OWN];
            memcpy(kept, next, sizeof kept);
            memcpy(memory->coefficients, c, sizeof c);
            if (!usual || !note_sample(problem, memory, t, end, v, kept)) {
                memcpy(memory->sample, X, sizeof X);
                memcpy(memory->state, X, sizeof X);
                memcpy(memory->w, w, sizeof w);
                if (progress->sample == 0) {
                    note_start(memory, memory->coefficients);
                }
                progress->t = t;
                whole_sample(problem, progress, memory, t, v, kept);
                memcpy(X, memory->sample, sizeof X);
                now = ordinary_of(problem, progress);
                continue;
            }
        }
        progress->integral += integral(c, period);
        UNROLLED
        for (int j = 0; j < PMJ_NX; ++j) {
            X[j] = value(c, j, period);
        }
        memcpy(X + PMJ_NX, next, sizeof next);
        progress->t = end;
        progress->steps += 1;
        progress->sample += 1;
    }
    memcpy(memory->sample, X, sizeof X);
}
