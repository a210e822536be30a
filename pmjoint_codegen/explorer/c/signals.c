/* Signals at the output instants: the C twin of pmjoint_codegen/simulate/signals.py. */
#include "explorer.h"

#include <string.h>

/* Put the segment of the reference at a time into p. */
static void at_segment(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double t)
{
    if (problem->n_breaks > 0) {
        const double slack = PMJ_SAME_INSTANT * problem->sample_time;
        pmj_put_segment(problem, memory, pmj_segment_at(problem, progress, t + slack));
    }
}

#if CAN_HOLD
/* 1 for the kink that holds the plant at a time, both ends included; whether any ever does. */
static int held_at(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double t,
                   double *flags)
{
    memset(flags, 0, (size_t)problem->n_kinks * sizeof(double));
    long long last = -1;
    for (long long i = 0; i < progress->holds; i += 2) {
        const double end = i + 1 < progress->holds ? memory->hold_times[i + 1] : progress->t;
        if (memory->hold_times[i] <= t) {
            last = t <= end ? memory->hold_kinks[i] : -1;
        }
    }
    if (last >= 0) {
        flags[last] = 1.0;
    }
    return progress->holds > 0;
}
#endif

static int full(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double t,
                const double *X, int held, double *out)
{
    at_segment(problem, progress, memory, t);
    double *res[] = {SIGNALS_RESULTS(out)};
#if CAN_HOLD
    double flags[PMJ_NK];
    if (held && held_at(problem, progress, memory, t, flags)) {
        const double *arg[] = {&t, X, flags, problem->p};
        return pmjoint_signals_held(arg, res, 0, 0, 0);
    }
#endif
    (void)held;
    const double *arg[] = {&t, X, problem->p};
    return pmjoint_signals(arg, res, 0, 0, 0);
}

/* What the plant reports under w: D and, of a joint or a system, physical quantities. */
static int acting(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double t,
                  const double *X, const double *w, double *out)
{
    at_segment(problem, progress, memory, t);
    double *res[] = {DISTURBANCE_RESULTS(out)};
#if CAN_HOLD
    double flags[PMJ_NK];
    if (held_at(problem, progress, memory, t, flags)) {
        const double *arg[] = {&t, X, w, flags, problem->p};
        return pmjoint_disturbance_held(arg, res, 0, 0, 0);
    }
#endif
    const double *arg[] = {&t, X, w, problem->p};
    return pmjoint_disturbance(arg, res, 0, 0, 0);
}

/* Signals of a sampled run that move between samples. */
static int put_live(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, long long row,
                    const double *w, double *out)
{
    const double t = problem->times[row];
    const double *X = memory->rows + row * problem->n_states;
    double y_r[N_RHO + 1];
    const double *arg[] = {&t, problem->p};
    double *res[] = {y_r};
    at_segment(problem, progress, memory, t);
    const int failed = pmjoint_reference(arg, res, 0, 0, 0);
    out[SIGNAL_Y] = X[0];
    out[SIGNAL_Y_R] = y_r[0];
    out[SIGNAL_E] = X[0] - y_r[0];
    return failed || acting(problem, progress, memory, t, X, w, out + SIGNAL_D1);
}

static double clipped(const double *limits, double v)
{
    const double value = limits[0] + limits[1] * v;
    const double above = value > limits[2] ? value : limits[2];
    return above < limits[3] ? above : limits[3];
}

static int sampled_row(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, long long row,
                       double *out)
{
    const double *X = memory->row_samples + row * problem->n_states;
    double w[PMJ_NW];
    if (full(problem, progress, memory, memory->row_sample_times[row], X, 0, out)) {
        return 1;
    }
    for (int j = 0; j < PMJ_NW; ++j) {
        w[j] = clipped(problem->limits + 4 * j, out[SIGNAL_V]);
    }
    return put_live(problem, progress, memory, row, w, out);
}

static int chained_row(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, long long row,
                       double *out)
{
    const double *held = memory->row_held + row * (6 + PMJ_NW);
    double seen[PMJ_NS];
    memcpy(seen, memory->row_samples + row * problem->n_states, sizeof seen);
    seen[0] = held[PMJ_FILTERED];
    if (full(problem, progress, memory, held[PMJ_CLOCK], seen, 0, out)) {
        return 1;
    }
    const int places[] = {SIGNAL_Y_M, SIGNAL_Y_F, SIGNAL_U, SIGNAL_U_COMMAND, SIGNAL_U_VALVE};
    const int sources[] = {PMJ_MEASURED, PMJ_FILTERED, PMJ_U, PMJ_COMMAND, PMJ_ACTING + 1};
    for (int i = 0; i < 5; ++i) {
        if (places[i] >= 0) { /* a model without the key has no such signal */
            out[places[i]] = held[sources[i]];
        }
    }
    return put_live(problem, progress, memory, row, held + PMJ_ACTING, out);
}

int explorer_report(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double *signals)
{
    for (long long row = 0; row < progress->row; ++row) {
        double *out = signals + row * N_SIGNALS;
        const int failed =
            problem->n_history > 0        ? chained_row(problem, progress, memory, row, out)
            : problem->sample_time > 0.0  ? sampled_row(problem, progress, memory, row, out)
                                          : full(problem, progress, memory, problem->times[row],
                                                 memory->rows + row * problem->n_states, 1, out);
        if (failed) {
            return failed;
        }
    }
    return 0;
}
