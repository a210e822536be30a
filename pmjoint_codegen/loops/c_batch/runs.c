#include "runs.h"
#include "pmjoint_runtime.h"

void pmj_open(pmj_runs *runs)
{
    runs->busy = PMJ_WIDTH;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        runs->lanes[w].run = 0;
    }
}

static double break_after(const pmj_sweep *sweep, long long segment)
{
    return segment < sweep->n_breaks ? sweep->breaks[segment] : HUGE_VAL;
}

void pmj_put_segment_lane(const pmj_sweep *sweep, pmj_runs *runs, int w, long long segment)
{
    for (long long i = 0; i < sweep->n_segment; ++i) {
        runs->p[PMJ_NP - sweep->n_segment + i][w] = sweep->segments[segment * sweep->n_segment + i];
    }
}

long long pmj_segment_at_lane(const pmj_sweep *sweep, const pmj_runs *runs, int w, double t)
{
    long long segment = runs->lanes[w].segment;
    while (segment < sweep->n_breaks && sweep->breaks[segment] <= t) {
        segment += 1;
    }
    while (segment > 0 && sweep->breaks[segment - 1] > t) {
        segment -= 1;
    }
    return segment;
}

void pmj_enter_lane(const pmj_sweep *sweep, pmj_runs *runs, int w, double t)
{
    pmj_lane *one = &runs->lanes[w];
    while (runs->next_break[w] <= t) {
        one->segment += 1;
        runs->next_break[w] = break_after(sweep, one->segment);
    }
    pmj_put_segment_lane(sweep, runs, w, one->segment);
}

void pmj_load(const pmj_sweep *sweep, pmj_runs *runs, int w)
{
    pmj_lane *one = &runs->lanes[w];
    const int empty = runs->waiting == sweep->runs;
    runs->busy -= one->run >= 0 && empty;
    one->run = empty ? -1 : runs->waiting;
    runs->waiting += !empty;
    const long long run = empty ? 0 : one->run;
    for (int i = 0; i < PMJ_NS; ++i) {
        runs->X[i][w] = empty ? 0.0 : sweep->x0[run * PMJ_NS + i];
    }
    for (int i = 0; i < PMJ_NP; ++i) {
        runs->p[i][w] = sweep->p[run * PMJ_NP + i];
    }
    one->segment = 0;
    runs->next_break[w] = break_after(sweep, 0);
    runs->t[w] = 0.0;
    runs->steps[w] = 0.0;
    runs->live[w] = empty ? 0 : -1;
    runs->fresh[w] = empty ? 0 : -1;
    runs->stalled[w] = 0;
    runs->sliding[w] = 0;
    pmj_first_disc(&sweep->rule, &runs->likely, w);
    pmj_clear_metrics(&runs->metrics, w);
    one->mode = 0;
    one->touching = -1;
    one->held = -1;
    one->flips = 0;
    one->tolerance = sweep->tolerance;
    one->switches = 0;
    one->sticks = 0;
    one->row = 0;
    one->crossing = -1;
    one->undecided = 0;
    one->passes = 0;
    one->before = 0;
    one->last_switch = -1.0;
}

void pmj_load_actuators(const pmj_sweep *sweep, pmj_runs *runs)
{
    pmj_lanes limits[4 * PMJ_NW];
    pmj_actuation_lanes(runs->p, limits);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (runs->fresh[w]) {
            double channels[4 * PMJ_NW];
            for (int j = 0; j < 4 * PMJ_NW; ++j) {
                channels[j] = limits[j][w];
            }
            const double *chain = sweep->chain ? sweep->chain + runs->lanes[w].run * PMJ_CHAIN_SIZE : 0;
            pmj_make_actuator(channels, (const pmj_chain *)chain, &runs->lanes[w].actuator);
        }
    }
}

void pmj_set_thresholds(pmj_runs *runs, int w, int mode)
{
    const pmj_actuator *actuator = &runs->lanes[w].actuator;
    runs->low[w] = mode > 0 ? actuator->at[mode - 1] : -HUGE_VAL;
    runs->high[w] = mode < actuator->thresholds ? actuator->at[mode] : HUGE_VAL;
    runs->limited[w] = actuator->labels[mode] != 0 ? 1.0 : 0.0;
}

void pmj_finish(const pmj_sweep *sweep, const pmj_results *results, const pmj_runs *runs, int w, int status, double e)
{
    const pmj_lane *one = &runs->lanes[w];
    double *metrics = results->metrics + one->run * PMJ_METRICS;
#define WRITE(column, value) metrics[column] = value;
    PMJ_AT_END(WRITE)
#undef WRITE
    for (int i = 0; i < PMJ_NS; ++i) {
        results->final[one->run * PMJ_NS + i] = runs->X[i][w];
    }
    for (long long row = one->row; results->trajectories && row < sweep->rows; ++row) {
        for (int i = 0; i < SHOWN; ++i) {
            results->trajectories[(one->run * sweep->rows + row) * SHOWN + i] = NAN;
        }
    }
}
