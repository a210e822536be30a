#include "continuous_lanes.h"
#include "pmjoint_runtime.h"
#include "stepping.h"

#include <float.h>
#include <string.h>

/* A step's polynomial may miss the right-hand side at its end by this multiple of the tolerance. */
#define DEFECT 64.0
/* A threshold on which rounding alone decides the side is left alone for this long, s. */
#define UNDECIDED_STEP 1e-7

/* A lane's v, a_k = c_k, into q; see continuous.c: 1 and the time until v passes threshold `index` outwards, or 0. */
static int passes(const pmj_lane *one, const pmj_lanes *c, int w, int index, int outward, double h, double *tau)
{
    double q[PMJ_ORDER + 1];
    for (int k = 0; k <= PMJ_ORDER; ++k) {
        q[k] = c[k * CHANNELS + V][w];
    }
    q[0] = one->touching == index ? 0.0 : q[0] - one->actuator.at[index];
    const long long zeros = pmj_leading_zeros(q, PMJ_ORDER, h);
    if (q[zeros] * outward > 0.0) {
        *tau = 0.0;
        return 1;
    }
    return pmj_first_crossing(q + zeros, PMJ_ORDER - zeros, h, tau);
}

/* The long way for lane w: the step to the first threshold within h. 0 where the mode changes without one. */
static int search(pmj_group *all, const pmj_lanes *c, int w, double h)
{
    pmj_lane *one = &all->lanes[w];
    double when = 0.0;
    one->crossing = -1;
    one->next_mode = one->mode;
    if (one->undecided > one->actuator.thresholds) {
        all->h[w] = h < UNDECIDED_STEP ? h : UNDECIDED_STEP;
        return 1;
    }
    if (one->mode > 0 && passes(one, c, w, one->mode - 1, -1, h, &when)) {
        one->crossing = one->mode - 1;
        one->next_mode = one->mode - 1;
        h = when;
    }
    if (one->mode < one->actuator.thresholds && passes(one, c, w, one->mode, 1, h, &when)) {
        one->crossing = one->mode;
        one->next_mode = one->mode + 1;
        h = when;
    }
    all->h[w] = h;
    if (one->crossing >= 0) {
        all->alert[w] = -1;
        pmj_set_mode(all, w, one->next_mode);
        if (h == 0.0) {
            pmj_cross(all, w, all->t[w]);
            one->undecided += 1;
            all->touching[w] = -1;
            all->stuck[w] = -1;
            return 0;
        }
    }
    return 1;
}

/* A run begins: its mode from v(0). 1 where the coefficients hold in that mode. */
static int begin(pmj_group *all, const pmj_lanes *c, int w)
{
    pmj_lane *one = &all->lanes[w];
    all->fresh[w] = 0;
    all->metrics.band[w] = PMJ_SETTLED * fabs(c[E][w]);
    all->metrics.max_e[w] = fabs(c[E][w]);
    all->metrics.max_v[w] = fabs(c[V][w]);
    one->mode = pmj_mode_of(&one->actuator, c[V][w]);
    pmj_set_mode(all, w, one->mode);
    return one->mode == 0;
}

static int finite_rows(const pmj_lanes *c, int w)
{
    for (int i = 0; i < 2 * CHANNELS; ++i) {
        if (!(fabs(c[i][w]) <= DBL_MAX)) {
            return 0;
        }
    }
    return 1;
}

/* Where the step on trial fits: the slope at its end against the right-hand side there. NaN fits nowhere. */
static pmj_mask fits(const pmj_sweep *sweep, const pmj_group *all, const pmj_lanes *next)
{
    const double allowed = DEFECT * sweep->tolerance;
    pmj_mask good = all->on_trial;
    for (int i = 0; i <= V; ++i) {
        const pmj_lanes miss = pmj_abs(all->slope[i] - next[CHANNELS + i]) * all->scales[i];
        good = good & (miss * all->h <= allowed);
    }
    return good;
}

/* Lane w goes back to where its step began and tries half of it; the status, where that is too small. */
static int reject(pmj_group *all, const pmj_lanes *next, int w)
{
    pmj_lane *one = &all->lanes[w];
    const double smallest = PMJ_SMALLEST_STEP * (all->t_before[w] > 1.0 ? all->t_before[w] : 1.0);
    for (int i = 0; i < PMJ_NS; ++i) {
        all->X[i][w] = all->X_before[i][w];
    }
    all->t[w] = all->t_before[w];
    all->h_most[w] = 0.5 * all->h[w];
    one->crossing = -1;
    pmj_set_mode(all, w, one->mode);
    if (!(all->h_most[w] >= smallest)) {
        return finite_rows(next, w) ? PMJ_STALLED : PMJ_NON_FINITE;
    }
    return PMJ_RUNNING;
}

/* What an accepted step of lane w leaves to do beyond the arithmetic that all lanes share; the status. */
static int settle(const pmj_sweep *sweep, pmj_group *all, int w)
{
    pmj_lane *one = &all->lanes[w];
    one->undecided = all->t[w] > all->t_before[w] ? 0 : one->undecided + 1;
    one->touching = -1;
    if (one->crossing >= 0) {
        pmj_cross(all, w, all->t[w]);
    }
    all->touching[w] = one->touching >= 0 ? -1 : 0;
    all->stuck[w] = one->undecided > 0 ? -1 : 0;
    all->alert[w] = all->touching[w] | all->stuck[w];
    for (int i = 0; i < PMJ_NS; ++i) {
        if (fabs(all->X[i][w]) > sweep->divergence) {
            return PMJ_DIVERGED;
        }
    }
    return all->t[w] >= sweep->horizon ? PMJ_DONE : PMJ_RUNNING;
}

/* Take in what the steps on trial have come to. Gives the lanes whose coefficients `next` hold for a step. */
static pmj_mask judge(const pmj_sweep *sweep, const pmj_results *results, pmj_group *all, const pmj_lanes *c,
                      const pmj_lanes *next)
{
    const pmj_mask accepted = fits(sweep, all, next);
    const pmj_mask rejected = all->on_trial & ~accepted;
    pmj_lanes largest = pmj_abs(all->X[0]);
    for (int i = 1; i < PMJ_NS; ++i) {
        largest = pmj_max(pmj_abs(all->X[i]), largest);
    }
    pmj_note_error(&all->metrics, all->e, PMJ_ORDER, all->square, all->t_before, all->h, accepted);
    pmj_note_control(&all->metrics, all->v, PMJ_ORDER, accepted);
    const pmj_lanes spent = pmj_select(accepted, all->h, pmj_all(0.0));
    all->accepted = all->accepted + pmj_select(accepted, pmj_all(1.0), pmj_all(0.0));
    all->h_most = pmj_select(accepted, pmj_all(HUGE_VAL), all->h_most);
    /* A crossing has set the next mode's `limited` already: those lanes are put right below. */
    all->metrics.saturated = all->metrics.saturated + spent * all->limited;
    const pmj_mask ended = (all->t >= sweep->horizon) | (largest > sweep->divergence);
    const pmj_mask spent_all = all->tried >= sweep->max_steps;
    const pmj_mask special = rejected | all->fresh | (spent_all & all->live) | (accepted & (ended | all->alert));
    pmj_mask ready = all->live & ~all->fresh & ~rejected;
    if (results->trajectories) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (accepted[w]) {
                pmj_write_rows(sweep, results, all, c, w);
            }
        }
    }
    if (!pmj_any(special)) {
        return ready;
    }
    int loaded = 0;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_lane *one = &all->lanes[w];
        int status = PMJ_RUNNING;
        if (!special[w] || !all->live[w]) {
            continue;
        }
        if (all->fresh[w]) {
            ready[w] = begin(all, next, w) ? -1 : 0;
            status = finite_rows(next, w) ? PMJ_RUNNING : PMJ_NON_FINITE;
        } else if (rejected[w]) {
            status = reject(all, next, w);
        } else if (accepted[w]) {
            if (one->crossing >= 0) {
                const double new_limited = all->limited[w];
                const double old_limited = one->actuator.labels[one->mode] != 0 ? 1.0 : 0.0;
                all->metrics.saturated[w] += all->h[w] * (old_limited - new_limited);
            }
            status = settle(sweep, all, w);
        }
        if (status == PMJ_RUNNING && spent_all[w]) {
            status = PMJ_TOO_MANY_STEPS;
        }
        if (status != PMJ_RUNNING) {
            pmj_finish(sweep, results, all, next, w, status);
            pmj_load(sweep, all, w);
            ready[w] = 0;
            loaded = 1;
        }
    }
    if (loaded) {
        pmj_load_actuators(all);
    }
    return ready;
}

/* Make a step in the lanes that are ready; the others stand still. */
static void advance(const pmj_sweep *sweep, pmj_group *all, const pmj_lanes *c, pmj_mask ready)
{
    const pmj_lanes remaining = sweep->horizon - all->t;
    pmj_lanes a[PMJ_ORDER + 1];
    pmj_lanes X[PMJ_NS];
    pmj_inverse_scales(c, CHANNELS, all->scales);
    all->h = pmj_min(pmj_step(c, all->scales, CHANNELS, PMJ_ORDER, sweep->tolerance), remaining);
    all->h = pmj_min(all->h, all->h_most);
    pmj_scale(c + V, CHANNELS, PMJ_ORDER, all->h, a);
    const pmj_mask risky = pmj_may_leave(a, PMJ_ORDER, all->low, all->high, ready, all->touching) | (ready & all->stuck);
    if (pmj_any(risky)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (risky[w]) {
                ready[w] = search(all, c, w, all->h[w]) ? -1 : 0;
            }
        }
    }
    all->tried = all->tried + 1.0;
    const pmj_lanes end = pmj_select(all->h < remaining, all->t + all->h, pmj_all(sweep->horizon));
    all->t_before = all->t;
    all->t = pmj_select(ready, end, all->t);
    arrive_lanes(c, &all->h, X, all->slope, all->v, all->e, &all->square);
    for (int i = 0; i < PMJ_NS; ++i) {
        all->X_before[i] = all->X[i];
        all->X[i] = pmj_select(ready, X[i], all->X[i]);
    }
    all->on_trial = ready;
}

void pmj_continuous_batch(const pmj_sweep *sweep, const pmj_results *results)
{
    pmj_group all;
    int current = 0;
    memset(&all, 0, sizeof all);
    all.busy = PMJ_WIDTH;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        all.lanes[w].run = 0; /* taken, as far as `load` counts */
        pmj_load(sweep, &all, w);
    }
    pmj_load_actuators(&all);
    while (all.busy > 0) {
        taylor_lanes(&all.t, all.X, all.g, all.p, all.c[1 - current]);
        const pmj_mask ready = judge(sweep, results, &all, all.c[current], all.c[1 - current]);
        current = 1 - current;
        advance(sweep, &all, all.c[current], ready);
    }
}
