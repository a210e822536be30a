#include "runs.h"
#include "pmjoint_runtime.h"

void pmj_open(pmj_runs *runs)
{
    runs->busy = PMJ_WIDTH;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        runs->lanes[w].run = 0;
    }
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
    one->flips = 0;
    one->switches = 0;
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

void pmj_flip(pmj_runs *runs, pmj_lanes *side, int w, int touching)
{
    pmj_lane *one = &runs->lanes[w];
    (*side)[w] = -(*side)[w];
    one->touching = touching;
    one->flips += 1;
    if (one->flips > 2 * PMJ_NK) {
        runs->sliding[w] = -1;
    }
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
