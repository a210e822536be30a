#include "continuous_lanes.h"
#include "pmjoint_runtime.h"
#include "stepping.h"

#include <float.h>
#include <string.h>

/* The actuator's output at lane w's v, then the sides, for the plant's kernels. */
static void deliver(const pmj_group *all, int w, double v, pmj_lanes *out)
{
    for (int j = 0; j < PMJ_NW; ++j) {
        out[j] = pmj_all(all->g[2 * j][w] + all->g[2 * j + 1][w] * v);
    }
    for (int j = 0; j < PMJ_NK; ++j) {
        out[PMJ_NW + j] = all->g[2 * PMJ_NW + j];
    }
}

/* Lane w meets the kink that its step ends at, or that lets go of it there; v and that channel are given. */
static void cross_kink(pmj_group *all, int w, double v, double side)
{
    pmj_lane *one = &all->runs.lanes[w];
    const int kink = one->crossing - one->actuator.thresholds;
    pmj_lanes out[PMJ_NW + PMJ_NK];
    deliver(all, w, v, out);
    pmj_meet_lane(&all->runs, all->runs.t, all->runs.X, out, all->g + 2 * PMJ_NW, w, kink, side, one->actuator.thresholds);
    one->crossing = -1;
}

/* The slow path for lane w: the step to the first threshold or kink within h. 0 if it is passed without a step. */
static int search(pmj_group *all, const pmj_flow *flow, const pmj_lanes *c, int w, double h)
{
    pmj_lane *one = &all->runs.lanes[w];
    const int thresholds = one->actuator.thresholds;
    double when = 0.0;
    one->crossing = -1;
    one->next_mode = one->mode;
    if (one->undecided > one->actuator.thresholds) {
        all->h[w] = h < PMJ_UNDECIDED_STEP ? h : PMJ_UNDECIDED_STEP;
        return 1;
    }
    if (one->mode > 0
        && pmj_passes_lane(flow, c, w, V, one->actuator.at[one->mode - 1], one->touching == one->mode - 1, -1, h, &when)) {
        one->crossing = one->mode - 1;
        one->next_mode = one->mode - 1;
        h = when;
    }
    if (one->mode < thresholds
        && pmj_passes_lane(flow, c, w, V, one->actuator.at[one->mode], one->touching == one->mode, 1, h, &when)) {
        one->crossing = one->mode;
        one->next_mode = one->mode + 1;
        h = when;
    }
    for (int j = 0; j < PMJ_NK; ++j) {
        if (pmj_passes_kink(flow, c, one, w, E + 1, j, all->g[2 * PMJ_NW + j][w], thresholds, h, &when)) {
            one->crossing = thresholds + j;
            one->next_mode = one->mode;
            h = when;
        }
    }
    all->h[w] = h;
    if (one->crossing >= 0) {
        all->alert[w] = -1;
        pmj_set_mode(all, w, one->next_mode);
        if (h == 0.0 && one->crossing >= thresholds) {
            cross_kink(all, w, c[V][w], c[E + 1 + one->crossing - thresholds][w]);
            all->touching[w] = -1;
            return 0;
        }
        if (h == 0.0) {
            pmj_cross(all, w, all->runs.t[w]);
            one->undecided += 1;
            all->touching[w] = -1;
            all->stuck[w] = -1;
            return 0;
        }
    }
    return 1;
}

/* A run begins: its sides, and its mode from v(0). 1 if the coefficients are valid on these sides in that mode. */
static int begin(const pmj_sweep *sweep, pmj_group *all, const pmj_lanes *c, int w)
{
    pmj_lane *one = &all->runs.lanes[w];
    int moved = 0;
    for (int j = 0; j < PMJ_NK; ++j) {
        const double side = c[E + 1 + j][w] < 0.0 ? -1.0 : 1.0;
        moved |= side != all->g[2 * PMJ_NW + j][w];
        all->g[2 * PMJ_NW + j][w] = side;
    }
    one->passes += 1;
    if (moved && one->passes <= PMJ_NK) {
        return 0; /* an argument depends on the sides before its own */
    }
    all->runs.fresh[w] = 0;
    pmj_start_metrics(&all->runs.metrics, w, c[E][w], c[V][w], sweep->settled);
    one->mode = pmj_mode_of(&one->actuator, c[V][w]);
    pmj_set_mode(all, w, one->mode);
    pmj_lanes out[PMJ_NW + PMJ_NK];
    deliver(all, w, c[V][w], out);
    moved |= pmj_find_rest_lane(&all->runs, all->runs.t, all->runs.X, out, all->g + 2 * PMJ_NW, w, c + E + 1,
                                one->actuator.thresholds);
    return one->mode == 0 && !moved;
}

static int finite_rows(const pmj_lanes *c, int w, int rows)
{
    for (int i = 0; i < rows * CHANNELS; ++i) {
        if (!(fabs(c[i][w]) <= DBL_MAX)) {
            return 0;
        }
    }
    return 1;
}

/* The error of the trial steps relative to the allowed one: at their ends, where `next` comes from the kernels, and inside. */
static pmj_lanes missed(const pmj_sweep *sweep, const pmj_flow *flow, const pmj_group *all, const pmj_lanes *next)
{
    const pmj_stand at = {&all->t_before, next, all->g, all->runs.p, all->scales, all->control};
    pmj_lanes found[CHANNELS];
    for (int i = 0; i < CHANNELS; ++i) {
        found[i] = i < PMJ_NS ? all->slope[i] - next[CHANNELS + i] : all->ends[i - PMJ_NS] - next[i];
    }
    const pmj_lanes end = sweep->rule.lebesgue / (PMJ_DEFECT * sweep->tolerance)
                          * pmj_largest_lanes(flow, &at, found, all->h);
    return pmj_max(all->missed, end);
}

/* Lane w returns to the start of its step and tries a part of it; the status, if that is too small. */
static int reject(pmj_group *all, const pmj_lanes *next, int w, double part)
{
    pmj_lane *one = &all->runs.lanes[w];
    const double smallest = PMJ_SMALLEST_STEP * (all->t_before[w] > 1.0 ? all->t_before[w] : 1.0);
    for (int i = 0; i < PMJ_NS; ++i) {
        all->runs.X[i][w] = all->X_before[i][w];
    }
    all->runs.t[w] = all->t_before[w];
    all->h_most[w] = part * all->h[w];
    one->crossing = -1;
    pmj_set_mode(all, w, one->mode);
    if (!(all->h_most[w] >= smallest)) {
        return finite_rows(next, w, 2) ? PMJ_STALLED : PMJ_NON_FINITE;
    }
    return PMJ_RUNNING;
}

/* The work for an accepted step of lane w besides the arithmetic common to all lanes; the status. Beyond a kink the
 * coefficients differ: the lane is not `ready`. */
static int settle(const pmj_sweep *sweep, pmj_group *all, const pmj_lanes *next, int w, int *ready)
{
    pmj_lane *one = &all->runs.lanes[w];
    const int moved = all->runs.t[w] > all->t_before[w];
    one->undecided = moved ? 0 : one->undecided + 1;
    one->flips = moved ? 0 : one->flips;
    one->touching = -1;
    if (one->crossing >= one->actuator.thresholds) {
        cross_kink(all, w, next[V][w], all->ends[E + 1 + one->crossing - one->actuator.thresholds - PMJ_NS][w]);
        *ready = 0;
    } else if (one->crossing >= 0) {
        pmj_cross(all, w, all->runs.t[w]);
    }
    all->touching[w] = one->touching >= 0 ? -1 : 0;
    all->stuck[w] = one->undecided > 0 ? -1 : 0;
    all->alert[w] = all->touching[w] | all->stuck[w];
    for (int i = 0; i < PMJ_NS; ++i) {
        if (fabs(all->runs.X[i][w]) > sweep->reach[i]) {
            return PMJ_DIVERGED;
        }
    }
    if (all->runs.t[w] >= all->runs.next_break[w]) {
        pmj_enter_lane(sweep, &all->runs, w, all->runs.t[w]);
        all->entered[w] = -1;
        *ready = 0;
    }
    return all->runs.t[w] >= sweep->horizon ? PMJ_DONE : PMJ_RUNNING;
}

/* A segment of the reference has begun: where it jumps, so does v. 1 if the coefficients are valid in its mode. */
static int resume(pmj_group *all, const pmj_lanes *c, int w)
{
    pmj_lane *one = &all->runs.lanes[w];
    const int mode = pmj_mode_of(&one->actuator, c[V][w]);
    all->entered[w] = 0;
    if (mode == one->mode) {
        return 1;
    }
    one->next_mode = mode;
    pmj_cross(all, w, all->runs.t[w]);
    pmj_set_mode(all, w, mode);
    all->touching[w] = 0;
    all->alert[w] = all->stuck[w];
    return 0;
}

/* Process the trial steps. Gives the lanes whose coefficients `next` are valid for a step. */
static pmj_mask judge(const pmj_sweep *sweep, const pmj_results *results, const pmj_flow *flow, pmj_group *all,
                      const pmj_lanes *c, const pmj_lanes *next)
{
    const pmj_lanes miss = missed(sweep, flow, all, next);
    const pmj_mask accepted = (miss <= 1.0) & all->on_trial;
    const pmj_mask rejected = all->on_trial & ~accepted;
    pmj_mask beyond = pmj_abs(all->runs.X[0]) > sweep->reach[0];
    for (int i = 1; i < PMJ_NS; ++i) {
        beyond |= pmj_abs(all->runs.X[i]) > sweep->reach[i];
    }
    const pmj_span step = {
        accepted,  all->t_before, all->h,      all->e,
        PMJ_ORDER, all->v,        PMJ_ORDER,   all->square,
        all->limited_before,      pmj_stuck(all->g_before + 2 * PMJ_NW),
    };
    pmj_note_step(&all->runs.metrics, &step);
    pmj_note_control(&all->runs.metrics, all->v, PMJ_ORDER, accepted);
    all->runs.steps = all->runs.steps + pmj_select(accepted, pmj_all(1.0), pmj_all(0.0));
    all->h_most = pmj_select(accepted, pmj_all(HUGE_VAL), all->h_most);
    const pmj_mask ended = (all->runs.t >= pmj_min(all->runs.next_break, pmj_all(sweep->horizon))) | beyond;
    const pmj_mask spent_all = all->tried >= sweep->max_steps;
    const pmj_mask cut = all->h_guarded < all->h_first;
    all->last_cut = pmj_select(accepted, pmj_select(cut, all->h_guarded, pmj_all(HUGE_VAL)), all->last_cut);
    const pmj_mask special = rejected | all->runs.fresh | all->entered | all->runs.stalled | all->runs.sliding | (spent_all & all->runs.live) | (accepted & (ended | all->alert));
    pmj_mask ready = all->runs.live & ~all->runs.fresh & ~all->entered & ~rejected;
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
    const pmj_lanes parts = pmj_shrink_lanes(miss, PMJ_ORDER);
    int loaded = 0;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        int status = PMJ_RUNNING;
        if (!special[w] || !all->runs.live[w]) {
            continue;
        }
        if (all->runs.fresh[w]) {
            ready[w] = begin(sweep, all, next, w) ? -1 : 0;
            status = finite_rows(next, w, 2) ? PMJ_RUNNING : PMJ_NON_FINITE;
        } else if (all->entered[w]) {
            ready[w] = resume(all, next, w) ? -1 : 0;
        } else if (rejected[w]) {
            status = reject(all, next, w, parts[w]);
        } else if (accepted[w]) {
            int go = 1;
            status = settle(sweep, all, next, w, &go);
            ready[w] = go ? ready[w] : 0;
        }
        if (status == PMJ_RUNNING && (all->runs.stalled[w] || all->runs.sliding[w])) {
            status = all->runs.sliding[w] ? PMJ_SLIDING
                     : finite_rows(c, w, PMJ_ORDER + 1) ? PMJ_STALLED : PMJ_NON_FINITE;
        }
        if (status == PMJ_RUNNING && spent_all[w]) {
            status = PMJ_TOO_MANY_STEPS;
        }
        if (status != PMJ_RUNNING) {
            pmj_finish(sweep, results, &all->runs, w, status, status == PMJ_DONE || status == PMJ_DIVERGED ? next[E][w] : NAN);
            pmj_load_lane(sweep, all, w);
            ready[w] = 0;
            loaded = 1;
        }
    }
    if (loaded) {
        pmj_enter(sweep, all);
    }
    return ready;
}

/* The lanes in which v may leave its mode within the steps, or an argument of a kink its side. */
static pmj_mask risky(const pmj_group *all, const pmj_lanes *c, pmj_mask ready)
{
    pmj_lanes a[PMJ_ORDER + 1];
    pmj_scale(c + V, CHANNELS, PMJ_ORDER, all->h, a);
    pmj_mask found = pmj_may_leave(a, PMJ_ORDER, all->runs.low, all->runs.high, ready, all->touching) | (ready & all->stuck);
    for (int j = 0; j < PMJ_NK; ++j) {
        const pmj_mask above = all->g[2 * PMJ_NW + j] > 0.0;
        const pmj_mask held = all->g[2 * PMJ_NW + PMJ_NK + j] != 0.0;
        const pmj_lanes low = pmj_select(held, pmj_all(-1.0), pmj_select(above, pmj_all(0.0), pmj_all(-HUGE_VAL)));
        const pmj_lanes high = pmj_select(held, pmj_all(1.0), pmj_select(above, pmj_all(HUGE_VAL), pmj_all(0.0)));
        pmj_scale(c + E + 1 + j, CHANNELS, PMJ_ORDER, all->h, a);
        found = found | pmj_may_leave(a, PMJ_ORDER, low, high, ready, all->touching);
    }
    return found;
}

/* The steps that the guard accepts, in the lanes that are ready; those in which it finds none are `stalled`. */
static pmj_mask guard(const pmj_sweep *sweep, const pmj_flow *flow, pmj_group *all, const pmj_stand *at,
                      pmj_lanes remaining, pmj_mask ready)
{
    const pmj_lanes least = pmj_min(PMJ_SMALLEST_STEP * pmj_max(all->runs.t, pmj_all(1.0)), remaining);
    all->h_first = all->h;
    all->h = pmj_guarded_lanes(flow, &sweep->rule, sweep->tolerance, at, all->h, least, ready, &all->runs.likely);
    all->h_guarded = all->h;
    all->runs.stalled = ready & ~(all->h > 0.0);
    return ready & ~all->runs.stalled;
}

/* Make a step in the lanes that are ready; the others do not advance. */
static void advance(const pmj_sweep *sweep, const pmj_flow *flow, pmj_group *all, const pmj_lanes *c, pmj_mask ready)
{
    const pmj_lanes last = pmj_min(all->runs.next_break, pmj_all(sweep->horizon)); /* where the steps must end */
    const pmj_lanes remaining = last - all->runs.t;
    pmj_lanes X[PMJ_NS];
    for (int i = 0; i < 2 * (PMJ_NW + PMJ_NK); ++i) {
        all->g_before[i] = all->g[i];
    }
    all->limited_before = all->runs.limited;
    pmj_inverse_scales(c, CHANNELS, all->scales);
    all->control = pmj_inverse_scale(all->runs.metrics.max_v);
    const pmj_stand at = {&all->runs.t, c, all->g_before, all->runs.p, all->scales, all->control};
    all->h = pmj_min(pmj_step(c, all->scales, CHANNELS, PMJ_ORDER, sweep->tolerance), remaining);
    all->h = pmj_min(pmj_min(all->h, all->h_most), pmj_all(sweep->max_step));
    all->h = pmj_min(all->h, PMJ_GROWTH * all->last_cut);
    ready = guard(sweep, flow, all, &at, remaining, ready);
    const pmj_mask near = risky(all, c, ready);
    if (pmj_any(near)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (near[w]) {
                ready[w] = search(all, flow, c, w, all->h[w]) ? -1 : 0;
            }
        }
    }
    all->missed = pmj_all(0.0);
    for (long long j = 0; j < sweep->rule.n_inside; ++j) {
        const pmj_lanes miss = pmj_missed_lanes(flow, &sweep->rule, sweep->tolerance, &at, all->h, sweep->rule.inside[j]);
        all->missed = pmj_max(miss, all->missed);
    }
    all->tried = all->tried + 1.0;
    const pmj_lanes end = pmj_select(all->h < remaining, all->runs.t + all->h, last);
    all->t_before = all->runs.t;
    all->runs.t = pmj_select(ready, end, all->runs.t);
    pmj_arrive_lanes(c, &all->h, X, all->slope, all->ends, all->v, all->e, &all->square);
    for (int i = 0; i < PMJ_NS; ++i) {
        all->X_before[i] = all->runs.X[i];
        all->runs.X[i] = pmj_select(ready, X[i], all->runs.X[i]);
    }
    all->on_trial = ready;
}

void pmj_continuous_batch(const pmj_sweep *sweep, const pmj_results *results)
{
    const pmj_flow flow = pmj_closed_loop();
    pmj_group all;
    int current = 0;
    memset(&all, 0, sizeof all);
    pmj_open(&all.runs);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        pmj_load_lane(sweep, &all, w);
    }
    pmj_enter(sweep, &all);
    while (all.runs.busy > 0) {
        PMJ_EITHER(all.g + 2 * PMJ_NW, (PMJ_ORDER + 1) * CHANNELS, all.c[1 - current], pmj_taylor_lanes,
                   pmj_taylor_held_lanes, &all.runs.t, all.runs.X, all.g, all.runs.p);
        const pmj_mask ready = judge(sweep, results, &flow, &all, all.c[current], all.c[1 - current]);
        current = 1 - current;
        advance(sweep, &flow, &all, all.c[current], ready);
    }
}
