#include "continuous_lanes.h"
#include "pmjoint_runtime.h"

void pmj_set_mode(pmj_group *all, int w, int mode)
{
    const pmj_actuator *actuator = &all->lanes[w].actuator;
    for (int j = 0; j < 2 * PMJ_NW; ++j) {
        all->g[j][w] = actuator->modes[mode][j];
    }
    all->low[w] = mode > 0 ? actuator->at[mode - 1] : -HUGE_VAL;
    all->high[w] = mode < actuator->thresholds ? actuator->at[mode] : HUGE_VAL;
    all->limited[w] = actuator->labels[mode] != 0 ? 1.0 : 0.0;
}

void pmj_load(const pmj_sweep *sweep, pmj_group *all, int w)
{
    pmj_lane *one = &all->lanes[w];
    const int empty = all->next == sweep->runs;
    all->busy -= one->run >= 0 && empty;
    one->run = empty ? -1 : all->next;
    all->next += !empty;
    const double *x0 = sweep->x0 + (empty ? 0 : one->run) * PMJ_NS;
    const double *p = sweep->p + (empty ? 0 : one->run) * PMJ_NP;
    for (int i = 0; i < PMJ_NS; ++i) {
        all->X[i][w] = empty ? 0.0 : x0[i];
    }
    for (int i = 0; i < PMJ_NP; ++i) {
        all->p[i][w] = p[i];
    }
    all->t[w] = 0.0;
    all->h[w] = 0.0;
    all->h_most[w] = HUGE_VAL;
    all->last_cut[w] = HUGE_VAL;
    for (int j = 0; j < PMJ_NK; ++j) {
        all->g[2 * PMJ_NW + j][w] = 1.0;
    }
    all->tried[w] = 0.0;
    all->accepted[w] = 0.0;
    all->metrics.ise[w] = 0.0;
    all->metrics.max_e[w] = 0.0;
    all->metrics.max_v[w] = 0.0;
    all->metrics.settling[w] = 0.0;
    all->metrics.saturated[w] = 0.0;
    all->live[w] = empty ? 0 : -1;
    all->fresh[w] = empty ? 0 : -1;
    all->on_trial[w] = 0;
    all->alert[w] = 0;
    all->touching[w] = 0;
    all->stuck[w] = 0;
    all->stalled[w] = 0;
    all->sliding[w] = 0;
    pmj_first_disc(&sweep->rule, &all->likely, w);
    one->flips = 0;
    one->passes = 0;
    one->row = 0;
}

void pmj_load_actuators(pmj_group *all)
{
    pmj_lanes limits[4 * PMJ_NW];
    actuation_lanes(all->p, limits);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_lane *one = &all->lanes[w];
        if (all->fresh[w]) {
            double channels[4 * PMJ_NW];
            for (int j = 0; j < 4 * PMJ_NW; ++j) {
                channels[j] = limits[j][w];
            }
            pmj_make_actuator(channels, &one->actuator);
            one->mode = 0;
            one->touching = -1;
            one->crossing = -1;
            one->undecided = 0;
            one->switches = 0;
            one->before = 0;
            one->last_switch = -1.0;
            pmj_set_mode(all, w, 0);
        }
    }
}

void pmj_finish(const pmj_sweep *sweep, const pmj_results *results, pmj_group *all, const pmj_lanes *c, int w,
                   int status)
{
    const pmj_lane *one = &all->lanes[w];
    double *metrics = results->metrics + one->run * PMJ_METRICS;
    metrics[PMJ_STATUS] = (double)status;
    metrics[PMJ_TIME] = all->t[w];
    metrics[PMJ_STEPS] = all->accepted[w];
    metrics[PMJ_SWITCHES] = (double)one->switches;
    metrics[PMJ_ISE] = all->metrics.ise[w];
    metrics[PMJ_MAX_ABS_E] = all->metrics.max_e[w];
    metrics[PMJ_SETTLING] = all->metrics.band[w] > 0.0 ? all->metrics.settling[w] : NAN;
    metrics[PMJ_SATURATED] = all->metrics.saturated[w];
    metrics[PMJ_MAX_ABS_V] = all->metrics.max_v[w];
    metrics[PMJ_FINAL_E] = status == PMJ_DONE || status == PMJ_DIVERGED ? c[E][w] : NAN;
    metrics[PMJ_FINAL_SATURATED] = all->limited[w];
    for (int i = 0; i < PMJ_NS; ++i) {
        results->final[one->run * PMJ_NS + i] = all->X[i][w];
    }
    for (long long row = one->row; results->trajectories && row < sweep->rows; ++row) {
        double *entry = results->trajectories + (one->run * sweep->rows + row) * SHOWN;
        for (int i = 0; i < SHOWN; ++i) {
            entry[i] = NAN;
        }
    }
}

void pmj_flip(pmj_group *all, int w, int j)
{
    pmj_lane *one = &all->lanes[w];
    pmj_lanes *side = &all->g[2 * PMJ_NW + j];
    (*side)[w] = -(*side)[w];
    one->touching = one->actuator.thresholds + j;
    one->crossing = -1;
    one->flips += 1;
    if (one->flips > 2 * PMJ_NK) {
        all->sliding[w] = -1;
    }
}

void pmj_cross(pmj_group *all, int w, double t)
{
    pmj_lane *one = &all->lanes[w];
    const int old = one->mode;
    one->mode = one->next_mode;
    one->touching = one->crossing;
    one->crossing = -1;
    if (one->actuator.labels[old] == one->actuator.labels[one->mode]) {
        return;
    }
    if (one->last_switch == t && one->before == one->mode) {
        one->switches -= 1;
        one->last_switch = -1.0;
    } else {
        one->switches += t > 0.0;
        one->before = old;
        one->last_switch = t;
    }
}

void pmj_write_rows(const pmj_sweep *sweep, const pmj_results *results, pmj_group *all, const pmj_lanes *c, int w)
{
    pmj_lane *one = &all->lanes[w];
    while (one->row < sweep->rows && sweep->times[one->row] <= all->t[w]) {
        const double tau = sweep->times[one->row] - all->t_before[w];
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * SHOWN;
        for (int i = 0; i < SHOWN; ++i) {
            double value = c[PMJ_ORDER * CHANNELS + i][w];
            for (int k = PMJ_ORDER - 1; k >= 0; --k) {
                value = value * tau + c[k * CHANNELS + i][w];
            }
            entry[i] = value;
        }
        one->row += 1;
    }
}
