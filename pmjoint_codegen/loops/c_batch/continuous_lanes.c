#include "continuous_lanes.h"

void pmj_set_mode(pmj_group *all, int w, int mode)
{
    for (int j = 0; j < 2 * PMJ_NW; ++j) {
        all->g[j][w] = all->runs.lanes[w].actuator.modes[mode][j];
    }
    pmj_set_thresholds(&all->runs, w, mode);
}

void pmj_load_lane(const pmj_sweep *sweep, pmj_group *all, int w)
{
    pmj_load(sweep, &all->runs, w);
    all->h[w] = 0.0;
    all->h_most[w] = HUGE_VAL;
    all->last_cut[w] = HUGE_VAL;
    for (int j = 0; j < PMJ_NK; ++j) {
        all->g[2 * PMJ_NW + j][w] = 1.0;
        all->g[2 * PMJ_NW + PMJ_NK + j][w] = 0.0;
    }
    all->tried[w] = 0.0;
    all->on_trial[w] = 0;
    all->entered[w] = 0;
    all->alert[w] = 0;
    all->touching[w] = 0;
    all->stuck[w] = 0;
}

void pmj_enter(const pmj_sweep *sweep, pmj_group *all)
{
    pmj_load_actuators(sweep, &all->runs);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (all->runs.fresh[w]) {
            pmj_set_mode(all, w, 0);
        }
    }
}

void pmj_cross(pmj_group *all, int w, double t)
{
    pmj_lane *one = &all->runs.lanes[w];
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
    pmj_lane *one = &all->runs.lanes[w];
    while (one->row < sweep->rows && sweep->times[one->row] <= all->runs.t[w]) {
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
