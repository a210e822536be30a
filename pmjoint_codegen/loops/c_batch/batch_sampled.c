#include "chained_lanes.h"
#include "pmjoint_runtime.h"
#include "sampled_lanes.h"

#include <float.h>
#include <string.h>

static void load(const pmj_sweep *sweep, pmj_sampled_group *all, int w)
{
    pmj_load(sweep, &all->runs, w);
    const long long run = all->runs.live[w] ? all->runs.lanes[w].run : 0;
    for (int i = 0; i < PMJ_NH; ++i) {
        all->h[i][w] = sweep->hold[run * sweep->hold_stride + i];
    }
    all->sample[w] = 0.0;
    all->runs.low[w] = HUGE_VAL; /* no mode yet: the first sample finds it */
    all->runs.high[w] = -HUGE_VAL;
    all->overflow[w] = 0;
    all->window_R[w] = -1.0;
    for (int j = 0; j < PMJ_NK; ++j) {
        all->w[PMJ_NW + PMJ_NK + j][w] = 0.0;
    }
}

/* The lanes whose v has left the mode of the sample before: their new mode. */
static void note_modes(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask left)
{
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_lane *one = &all->runs.lanes[w];
        if (left[w]) {
            const pmj_actuator *actuator = &one->actuator;
            const int mode = pmj_mode_of(actuator, all->v[w]);
            one->switches += !all->runs.fresh[w] && actuator->labels[mode] != actuator->labels[one->mode];
            one->mode = mode;
            pmj_set_thresholds(&all->runs, w, mode);
        }
        if (all->runs.fresh[w]) {
            pmj_start_metrics(&all->runs.metrics, w, all->c[E][w], all->v[w], sweep->settled);
        }
    }
    all->runs.fresh = all->runs.fresh & 0LL;
}

/* The row at the horizon itself, of lane w. */
static void write_last(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, int w, double e)
{
    pmj_lane *one = &all->runs.lanes[w];
    for (; one->row < sweep->rows; one->row += 1) {
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * SHOWN;
        for (int i = 0; i < PMJ_NS; ++i) {
            entry[i] = all->runs.X[i][w];
        }
        entry[PMJ_NS] = all->v[w];
        entry[PMJ_NS + 1] = e;
    }
}

/* The value of v, its mode and metrics at the sample of each lane in `at`. */
static void take(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask at)
{
    if (sweep->looped) {
        pmj_chained_control(sweep, all, at);
    } else {
        pmj_sample_lanes(&all->runs.t, all->runs.X, all->h, all->runs.p, &all->v, all->w, all->c, all->next);
    }
    const pmj_mask left = ~((all->v > all->runs.low) & (all->v <= all->runs.high)) & at;
    if (pmj_any(left)) {
        note_modes(sweep, all, left);
    }
    all->runs.metrics.max_v = pmj_select(at, pmj_max(pmj_abs(all->v), all->runs.metrics.max_v), all->runs.metrics.max_v);
}

/* After a hold: the states at the next sample, and the runs that end there. A horizon that is a sample is treated as
 * one, though nothing follows; this is the same for all runs, since all have the same horizon. */
static void settle(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_lanes e, pmj_mask whole_hold,
                   pmj_mask last)
{
    pmj_lanes largest = pmj_all(0.0);
    pmj_mask bad = ~(pmj_abs(all->v) <= DBL_MAX) | all->overflow;
    for (int i = 0; i < PMJ_NX; ++i) {
        all->runs.X[i] = all->x[i];
    }
    for (int i = 0; i < N_CONTROLLER; ++i) {
        all->runs.X[PMJ_NX + i] = pmj_select(whole_hold, all->next[i], all->runs.X[PMJ_NX + i]);
    }
    for (int i = 0; i < PMJ_NS; ++i) {
        bad = bad | ~(pmj_abs(all->runs.X[i]) <= DBL_MAX);
        largest = pmj_max(pmj_abs(all->runs.X[i]), largest);
    }
    const pmj_mask diverged = largest > sweep->divergence;
    const pmj_mask closing = last & whole_hold & ~bad & ~diverged & all->runs.live;
    all->sample = all->sample + 1.0;
    all->runs.t = all->sample * sweep->sample_time;
    if (pmj_any(closing)) {
        take(sweep, all, closing);
        bad = bad | (closing & ~(pmj_abs(all->v) <= DBL_MAX));
    }
    const pmj_mask exhausted = all->runs.steps >= sweep->max_steps;
    const pmj_mask stuck = all->runs.stalled | all->runs.sliding;
    const pmj_mask ended = (bad | diverged | exhausted | last | stuck) & all->runs.live;
    if (!pmj_any(ended)) {
        return;
    }
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (ended[w]) {
            const int status = bad[w] ? PMJ_NON_FINITE
                               : diverged[w] ? PMJ_DIVERGED
                               : all->runs.sliding[w] ? PMJ_SLIDING
                               : all->runs.stalled[w] ? PMJ_STALLED
                               : last[w] ? PMJ_DONE : PMJ_TOO_MANY_STEPS;
            all->runs.t[w] = last[w] && !stuck[w] ? sweep->horizon : all->runs.t[w];
            if (results->trajectories && status == PMJ_DONE) {
                write_last(sweep, results, all, w, e[w]);
            }
            pmj_finish(sweep, results, &all->runs, w, status, status == PMJ_NON_FINITE ? NAN : e[w]);
            load(sweep, all, w);
        }
    }
    pmj_load_actuators(sweep, &all->runs);
}

/* One sample of every lane. */
static void advance(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all)
{
    all->runs.t = all->sample * sweep->sample_time;
    pmj_lanes end = (all->sample + 1.0) * sweep->sample_time;
    if (sweep->looped) {
        pmj_chained_instants(sweep, all, &all->runs.t, &end);
    }
    const double slack = PMJ_SAME_INSTANT * sweep->sample_time;
    const pmj_mask last = end + slack >= sweep->horizon;
    const pmj_mask whole_hold = end - slack <= sweep->horizon;
    const pmj_mask broken = all->runs.next_break <= all->runs.t + slack;
    if (pmj_any(broken)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (broken[w]) {
                pmj_enter_lane(sweep, &all->runs, w, all->runs.t[w] + slack);
                all->window_R[w] = -1.0; /* the guard of e is known for the segment before */
            }
        }
    }
    take(sweep, all, all->runs.live);
    const pmj_lanes length = pmj_select(whole_hold, pmj_all(sweep->sample_time), sweep->horizon - all->runs.t);
    for (int i = 0; i < PMJ_NX; ++i) {
        all->x[i] = all->runs.X[i];
    }
    const pmj_lanes e = sweep->looped ? pmj_chained_hold(sweep, results, all, end)
                                      : pmj_hold_lanes(sweep, results, all, all->runs.live, length);
    settle(sweep, results, all, e, whole_hold, last);
}

void pmj_sampled_batch(const pmj_sweep *sweep, const pmj_results *results)
{
    pmj_sampled_group all;
    memset(&all, 0, sizeof all);
    pmj_open(&all.runs);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        load(sweep, &all, w);
    }
    pmj_load_actuators(sweep, &all.runs);
    while (all.runs.busy > 0) {
        advance(sweep, results, &all);
    }
}
