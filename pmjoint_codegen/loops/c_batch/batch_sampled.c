#include "pmjoint_runtime.h"
#include "sampled_lanes.h"

#include <float.h>
#include <string.h>

static void load(const pmj_sweep *sweep, pmj_sampled_group *all, int w)
{
    pmj_sampled_lane *one = &all->lanes[w];
    const int empty = all->next_run == sweep->runs;
    all->busy -= one->run >= 0 && empty;
    one->run = empty ? -1 : all->next_run;
    all->next_run += !empty;
    const long long run = empty ? 0 : one->run;
    for (int i = 0; i < PMJ_NS; ++i) {
        all->X[i][w] = empty ? 0.0 : sweep->x0[run * PMJ_NS + i];
    }
    for (int i = 0; i < PMJ_NP; ++i) {
        all->p[i][w] = sweep->p[run * PMJ_NP + i];
    }
    for (int i = 0; i < PMJ_NH; ++i) {
        all->h[i][w] = sweep->hold[run * sweep->hold_stride + i];
    }
    all->sample[w] = 0.0;
    all->tried[w] = 0.0;
    all->metrics.ise[w] = 0.0;
    all->metrics.max_e[w] = 0.0;
    all->metrics.max_v[w] = 0.0;
    all->metrics.settling[w] = 0.0;
    all->metrics.saturated[w] = 0.0;
    all->low[w] = HUGE_VAL; /* no mode yet: the first sample finds it */
    all->high[w] = -HUGE_VAL;
    all->live[w] = empty ? 0 : -1;
    all->fresh[w] = empty ? 0 : -1;
    all->stalled[w] = 0;
    all->overflow[w] = 0;
    all->sliding[w] = 0;
    all->window_R[w] = -1.0;
    pmj_first_disc(&sweep->rule, &all->likely, w);
    one->row = 0;
}

static void load_actuators(pmj_sampled_group *all)
{
    pmj_lanes limits[4 * PMJ_NW];
    actuation_lanes(all->p, limits);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_sampled_lane *one = &all->lanes[w];
        if (all->fresh[w]) {
            double channels[4 * PMJ_NW];
            for (int j = 0; j < 4 * PMJ_NW; ++j) {
                channels[j] = limits[j][w];
            }
            pmj_make_actuator(channels, &one->actuator);
            one->switches = 0;
        }
    }
}

static void finish(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, int w, int status, double e)
{
    const pmj_sampled_lane *one = &all->lanes[w];
    double *metrics = results->metrics + one->run * PMJ_METRICS;
    metrics[PMJ_STATUS] = (double)status;
    metrics[PMJ_TIME] = all->t[w];
    metrics[PMJ_STEPS] = all->tried[w];
    metrics[PMJ_SWITCHES] = (double)one->switches;
    metrics[PMJ_ISE] = all->metrics.ise[w];
    metrics[PMJ_MAX_ABS_E] = all->metrics.max_e[w];
    metrics[PMJ_SETTLING] = all->metrics.band[w] > 0.0 ? all->metrics.settling[w] : NAN;
    metrics[PMJ_SATURATED] = all->metrics.saturated[w];
    metrics[PMJ_MAX_ABS_V] = all->metrics.max_v[w];
    metrics[PMJ_FINAL_E] = e;
    metrics[PMJ_FINAL_SATURATED] = all->limited[w];
    for (int i = 0; i < PMJ_NS; ++i) {
        results->final[one->run * PMJ_NS + i] = all->X[i][w];
    }
    for (long long row = one->row; results->trajectories && row < sweep->rows; ++row) {
        for (int i = 0; i < PMJ_NS + 2; ++i) {
            results->trajectories[(one->run * sweep->rows + row) * (PMJ_NS + 2) + i] = NAN;
        }
    }
}

/* The lanes whose v has left the mode of the sample before: their new mode. */
static void note_modes(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask left)
{
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_sampled_lane *one = &all->lanes[w];
        if (left[w]) {
            const pmj_actuator *actuator = &one->actuator;
            const int mode = pmj_mode_of(actuator, all->v[w]);
            const int label = actuator->labels[mode];
            one->switches += !all->fresh[w] && label != one->label;
            one->mode = mode;
            one->label = label;
            all->low[w] = mode > 0 ? actuator->at[mode - 1] : -HUGE_VAL;
            all->high[w] = mode < actuator->thresholds ? actuator->at[mode] : HUGE_VAL;
            all->limited[w] = label != 0 ? 1.0 : 0.0;
        }
        if (all->fresh[w]) {
            all->metrics.band[w] = sweep->settled * fabs(all->c[E][w]);
            all->metrics.max_e[w] = fabs(all->c[E][w]);
        }
    }
    all->fresh = all->fresh & 0LL;
}

/* The row at the horizon itself, of lane w. */
static void write_last(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, int w, double e)
{
    pmj_sampled_lane *one = &all->lanes[w];
    for (; one->row < sweep->rows; one->row += 1) {
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * (PMJ_NS + 2);
        for (int i = 0; i < PMJ_NS; ++i) {
            entry[i] = all->X[i][w];
        }
        entry[PMJ_NS] = all->v[w];
        entry[PMJ_NS + 1] = e;
    }
}

/* What v is and does at the sample of each lane in `at`. */
static void take(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask at)
{
    sample_lanes(&all->t, all->X, all->h, all->p, &all->v, all->w, all->c, all->next);
    const pmj_mask left = ~((all->v > all->low) & (all->v <= all->high)) & at;
    if (pmj_any(left)) {
        note_modes(sweep, all, left);
    }
    all->metrics.max_v = pmj_select(at, pmj_max(pmj_abs(all->v), all->metrics.max_v), all->metrics.max_v);
}

/* After a hold: the states at the next sample, and the runs that end there. A horizon that is a sample is taken as one,
 * though nothing follows; if it is, it is for all runs, since all have the same. */
static void settle(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_lanes e, pmj_mask whole_hold,
                   pmj_mask last)
{
    pmj_lanes largest = pmj_all(0.0);
    pmj_mask bad = ~(pmj_abs(all->v) <= DBL_MAX) | all->overflow;
    for (int i = 0; i < PMJ_NX; ++i) {
        all->X[i] = all->x[i];
    }
    for (int i = 0; i < S; ++i) {
        all->X[PMJ_NX + i] = pmj_select(whole_hold, all->next[i], all->X[PMJ_NX + i]);
    }
    for (int i = 0; i < PMJ_NS; ++i) {
        bad = bad | ~(pmj_abs(all->X[i]) <= DBL_MAX);
        largest = pmj_max(pmj_abs(all->X[i]), largest);
    }
    const pmj_mask diverged = largest > sweep->divergence;
    const pmj_mask closing = last & whole_hold & ~bad & ~diverged & all->live;
    all->sample = all->sample + 1.0;
    all->t = all->sample * sweep->sample_time;
    if (pmj_any(closing)) {
        take(sweep, all, closing);
        bad = bad | (closing & ~(pmj_abs(all->v) <= DBL_MAX));
    }
    const pmj_mask exhausted = all->tried >= sweep->max_steps;
    const pmj_mask stuck = all->stalled | all->sliding;
    const pmj_mask ended = (bad | diverged | exhausted | last | stuck) & all->live;
    if (!pmj_any(ended)) {
        return;
    }
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (ended[w]) {
            const int status = bad[w] ? PMJ_NON_FINITE
                               : diverged[w] ? PMJ_DIVERGED
                               : all->sliding[w] ? PMJ_SLIDING
                               : all->stalled[w] ? PMJ_STALLED
                               : last[w] ? PMJ_DONE : PMJ_TOO_MANY_STEPS;
            all->t[w] = last[w] && !stuck[w] ? sweep->horizon : all->t[w];
            if (results->trajectories && status == PMJ_DONE) {
                write_last(sweep, results, all, w, e[w]);
            }
            finish(sweep, results, all, w, status, status == PMJ_NON_FINITE ? NAN : e[w]);
            load(sweep, all, w);
        }
    }
    load_actuators(all);
}

/* One sample of every lane. */
static void advance(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all)
{
    all->t = all->sample * sweep->sample_time;
    const pmj_lanes end = (all->sample + 1.0) * sweep->sample_time;
    const double slack = PMJ_SAME_INSTANT * sweep->sample_time;
    const pmj_mask last = end + slack >= sweep->horizon;
    const pmj_mask whole_hold = end - slack <= sweep->horizon;
    take(sweep, all, all->live);
    const pmj_lanes length = pmj_select(whole_hold, pmj_all(sweep->sample_time), sweep->horizon - all->t);
    for (int i = 0; i < PMJ_NX; ++i) {
        all->x[i] = all->X[i];
    }
    all->metrics.saturated = all->metrics.saturated + all->limited * length;
    const pmj_lanes e = pmj_hold_lanes(sweep, results, all, all->live, length);
    settle(sweep, results, all, e, whole_hold, last);
}

void pmj_sampled_batch(const pmj_sweep *sweep, const pmj_results *results)
{
    pmj_sampled_group all;
    memset(&all, 0, sizeof all);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        all.lanes[w].run = 0; /* taken, as far as `load` counts */
        all.busy += 1;
        load(sweep, &all, w);
    }
    load_actuators(&all);
    while (all.busy > 0) {
        advance(sweep, results, &all);
    }
}
