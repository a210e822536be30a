#include "hold.h"
#include "pmjoint_runtime.h"
#include "sampled.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define N_CONTROLLER (PMJ_NS - PMJ_NX) /* the controller's states */

/* By default, the compiler inlines the rare path into the frequent one and spills its registers. */
#if defined(__GNUC__)
#define RARE __attribute__((noinline, cold))
#define SELDOM(condition) __builtin_expect(!!(condition), 0)
#else
#define RARE
#define SELDOM(condition) (condition)
#endif

void pmj_note_mode(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, double v)
{
    const long long mode = pmj_mode_at(problem, v);
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

void pmj_settle(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, const double *next)
{
    memcpy(memory->sample, memory->state, PMJ_NX * sizeof(double));
    memcpy(memory->sample + PMJ_NX, next, N_CONTROLLER * sizeof(double));
    if (!pmj_all_finite(memory->sample, PMJ_NS)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    for (int i = 0; i < PMJ_NS; ++i) {
        pmj_note_value(memory->sample[i], progress->t, memory->peaks + i, memory->peak_times + i);
    }
    if (pmj_beyond(problem, memory->sample)) {
        progress->status = PMJ_DIVERGED;
    }
}

/* Everything that may happen at a sample and in its hold: the coefficients, X and w are in memory. */
static RARE void whole_sample(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory,
                              double t, double v, const double *next)
{
    const double slack = PMJ_SAME_INSTANT * problem->sample_time;
    const double horizon = problem->times[problem->n_rows - 1];
    const double end = (double)(progress->sample + 1) * problem->sample_time;
    const double rows_until = end - slack;
    pmj_note_value(v, t, memory->peaks + PEAK_V, memory->peak_times + PEAK_V);
    if (!(fabs(v) <= DBL_MAX)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    pmj_note_mode(problem, progress, memory, t, v);
    if (progress->sample == 0 && pmj_beyond(problem, memory->sample)) {
        progress->status = PMJ_DIVERGED;
    }
    while (progress->row < problem->n_rows && problem->times[progress->row] <= t + slack) {
        pmj_next_row(progress, memory, t);
    }
    if (progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
        return;
    }
    if (progress->status != PMJ_RUNNING) {
        return;
    }
    if (horizon < rows_until) { /* ends inside this hold */
        pmj_hold(problem, plant, progress, memory, horizon - t, horizon, rows_until);
    } else {
        pmj_hold(problem, plant, progress, memory, problem->sample_time, end, rows_until);
    }
    if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
    }
    if (progress->status == PMJ_RUNNING) {
        pmj_settle(problem, progress, memory, next);
        progress->sample += 1;
    }
}

/* Limits of an ordinary sample, which changes only X, the integral and peaks. */
typedef struct {
    bounds accuracy;   /* one step for the whole hold */
    double low;        /* thresholds of v on both sides of the mode */
    double high;
    double row;        /* the next output instant, or the reference's next break point */
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
    if (pmj_next_break(problem, progress) < now.row) {
        now.row = pmj_next_break(problem, progress);
    }
    return now;
}

/* X(0) and e(0). */
static void note_start(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, const double *c)
{
    progress->band = problem->settled * fabs(c[E]);
    memory->window[1] = -1.0;
    for (int i = 0; i < PMJ_NS; ++i) {
        pmj_note_value(memory->sample[i], 0.0, memory->peaks + i, memory->peak_times + i);
    }
    pmj_note_value(c[E], 0.0, memory->peaks + PEAK_E, memory->peak_times + PEAK_E);
    if (problem->notes_rate) {
        pmj_note_value(c[CHANNELS], 0.0, memory->peaks + PEAK_RATE, memory->peak_times + PEAK_RATE);
    }
}

/* Upper bound on |y'| during a hold of some size. */
static inline double steepest(const double *c, double size)
{
    double sum = 0.0;
    UNROLLED
    for (int k = ORDER; k > 0; --k) {
        sum = sum * size + k * fabs(c[k * CHANNELS]);
    }
    return sum * PMJ_ROUNDED_UP;
}

/* Record the peaks of an ordinary sample and its hold; or return 0, and record nothing, if the run may diverge. */
static RARE int note_sample(const pmj_problem *problem, const pmj_memory *memory, double t, double end, double v,
                            const double *next)
{
    const double limit = problem->divergence < DBL_MAX ? problem->divergence : DBL_MAX;
    const double *c = memory->coefficients;
    const double size = problem->sample_time;
    for (int i = 0; i < PMJ_NS; ++i) {
        const double most = i < PMJ_NX ? term_sum(c, i, size) : fabs(next[i - PMJ_NX]);
        if (!(most <= limit)) {
            return 0;
        }
    }
    pmj_note_value(v, t, memory->peaks + PEAK_V, memory->peak_times + PEAK_V);
    for (int i = 0; i < N_CONTROLLER; ++i) {
        pmj_note_value(next[i], end, memory->peaks + PMJ_NX + i, memory->peak_times + PMJ_NX + i);
    }
    for (int i = 0; i <= E; ++i) {
        const int place = i == E ? PEAK_E : i;
        if (!(term_sum(c, i, size) <= memory->peaks[place])) {
            const double last = value(c, i, size);
            pmj_note_peaks(c + i, CHANNELS, ORDER, 1, t, size, &last, memory->peaks + place,
                           memory->peak_times + place);
        }
    }
    if (problem->notes_rate) {
        pmj_note_rate(c, CHANNELS, ORDER, t, size, memory->peaks + PEAK_RATE, memory->peak_times + PEAK_RATE);
    }
    return 1;
}

/* At a sample with which the reference's next segment begins: the sample there. */
static RARE void enter(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, double until,
                       double *v, double *next)
{
    if (pmj_enter_segments(problem, progress, memory, until)) {
        memory->window[1] = -1.0; /* the guard of e is known for the segment before */
        pmj_sample(&t, memory->sample, problem->hold, problem->p, v, memory->w, memory->coefficients, next);
        pmj_note_value(memory->coefficients[E], t, memory->peaks + PEAK_E, memory->peak_times + PEAK_E);
    }
}

/* At most `budget` samples, up to one in which a segment of the reference begins: within a segment p is constant, and the
 * compiler computes terms of p alone once. Gives their number.
 *
 ** The ordinary sample is handled here, on values that the compiler keeps in registers. If anything else may happen (a
 * switch, an output row, a second step, an end), `whole_sample` handles all of it, with the same arithmetic. */
static long long samples(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, pmj_memory *memory,
                         long long budget)
{
    const double R = problem->hold_ratios[0] * problem->sample_time;
    const int whole = problem->sample_time <= problem->max_step;
    double window[2 + 2 * PMJ_NX];
    const double period = problem->sample_time;
    const double slack = PMJ_SAME_INSTANT * period;
    double X[PMJ_NS];
    double p[PMJ_NP];
    double h[PMJ_NH];
    const long long segment = progress->segment;
    ordinary now = ordinary_of(problem, progress);
    memcpy(X, memory->sample, sizeof X);
    memcpy(p, problem->p, sizeof p);
    memcpy(h, problem->hold, sizeof h);
    memcpy(window, memory->window, sizeof window);
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        const double t = (double)progress->sample * period;
        const double end = (double)(progress->sample + 1) * period;
        double v;
        double w[PMJ_NW];
        double c[(ORDER + 1) * CHANNELS];
        double next[N_CONTROLLER];
        pmj_sample(&t, X, h, p, &v, w, c, next);
        progress->evaluations += 1;
        const int usual = v > now.low && v <= now.high && now.row >= end - slack && within(c, now.accuracy) && whole
                          && covered(window, c, t, R) && smooth(c, period) && progress->steps < problem->max_steps && progress->sample > 0;
        int calm = fabs(v) <= memory->peaks[PEAK_V] && term_sum(c, E, period) <= memory->peaks[PEAK_E];
        UNROLLED
        for (int j = 0; j < PMJ_NX; ++j) {
            calm = calm && term_sum(c, j, period) <= memory->peaks[j];
        }
        UNROLLED
        for (int j = 0; j < N_CONTROLLER; ++j) {
            calm = calm && fabs(next[j]) <= memory->peaks[PMJ_NX + j];
        }
        calm = calm && (!problem->notes_rate || steepest(c, period) <= memory->peaks[PEAK_RATE]);
        if (SELDOM(!(usual && calm))) {
            double kept[N_CONTROLLER];
            double kept_v = v;
            memcpy(kept, next, sizeof kept);
            memcpy(memory->coefficients, c, sizeof c);
            memcpy(memory->w, w, sizeof w);
            if (now.row <= t + slack) { /* then it is not usual */
                memcpy(memory->sample, X, sizeof X);
                enter(problem, progress, memory, t, t + slack, &kept_v, kept);
            }
            if (!usual || !note_sample(problem, memory, t, end, v, kept)) {
                memcpy(memory->sample, X, sizeof X);
                memcpy(memory->state, X, sizeof X);
                if (progress->sample == 0) {
                    note_start(problem, progress, memory, memory->coefficients);
                }
                progress->t = t;
                whole_sample(problem, plant, progress, memory, t, kept_v, kept);
                memcpy(X, memory->sample, sizeof X);
                memcpy(window, memory->window, sizeof window);
                now = ordinary_of(problem, progress);
                if (progress->segment != segment) {
                    return i + 1;
                }
                continue;
            }
        }
        progress->integral += integral(c, period);
        const double e = value(c, E, period);
        if (fabs(e) > progress->band) {
            progress->settled = end;
        } else if (SELDOM(term_sum(c, E, period) > progress->band)) {
            memcpy(memory->coefficients, c, sizeof c);
            progress->t = t;
            pmj_note_settled(progress, memory->coefficients + E, CHANNELS, ORDER, e, period, end);
        }
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
    return budget;
}

/* Advance the sampled loop by at most `budget` samples; `progress->status` records whether and how it ended.
 * `memory->state` and `memory->sample` start as X(0). */
void pmj_sampled(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, pmj_memory *memory,
                 long long budget)
{
    while (budget > 0 && progress->status == PMJ_RUNNING) {
        budget -= samples(problem, plant, progress, memory, budget);
    }
}
