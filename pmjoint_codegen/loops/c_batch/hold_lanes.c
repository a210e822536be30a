#include "pmjoint_runtime.h"
#include "sampled_lanes.h"
#include "stepping.h"

#include <float.h>

/* Output rows of lane w within [t, t + h], or up to but not at its end: x and e change inside the hold, all else is as at the sample. */
static void write_rows(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, int w, double t, double until)
{
    pmj_lane *one = &all->runs.lanes[w];
    while (one->row < sweep->rows && sweep->times[one->row] < until) {
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * SHOWN;
        const double tau = sweep->times[one->row] > t ? sweep->times[one->row] - t : 0.0;
        for (int i = 0; i <= E; ++i) {
            double value = all->c[PMJ_HOLD_ORDER * CHANNELS + i][w];
            for (int k = PMJ_HOLD_ORDER - 1; k >= 0; --k) {
                value = value * tau + all->c[k * CHANNELS + i][w];
            }
            entry[i < PMJ_NX ? i : PMJ_NS + 1] = value;
        }
        for (int i = PMJ_NX; i < PMJ_NS; ++i) {
            entry[i] = all->runs.X[i][w];
        }
        entry[PMJ_NS] = all->v[w];
        one->row += 1;
    }
}

/* Whether one step to the end of the hold keeps the last two terms below the tolerance. */
static pmj_mask whole(const pmj_sweep *sweep, const pmj_sampled_group *all, const pmj_lanes *scales, pmj_lanes h)
{
    const pmj_lanes stretched = h * (1.0 / pmj_safety(PMJ_HOLD_ORDER));
    pmj_lanes power = stretched;
    for (int k = 2; k < PMJ_HOLD_ORDER; ++k) {
        power = power * stretched;
    }
    const pmj_lanes before = pmj_norm(all->c + (PMJ_HOLD_ORDER - 1) * CHANNELS, scales, CHANNELS) * power;
    const pmj_lanes last = pmj_norm(all->c + PMJ_HOLD_ORDER * CHANNELS, scales, CHANNELS) * (power * stretched);
    return (before <= sweep->tolerance) & (last <= sweep->tolerance);
}

/* The guard of the plant, and that of lanes that a kink holds. */
static void plant_guard(const pmj_lanes *t, const pmj_lanes *x, const pmj_lanes *w, const pmj_lanes *p, const pmj_lanes *R,
                        const pmj_lanes *P, pmj_lanes *restrict rest)
{
    PMJ_EITHER(w + PMJ_NW, CHANNELS, rest, pmj_plant_guard_lanes, pmj_plant_guard_held_lanes, t, x, w, p, R, P);
}

/* Its rates, and those of lanes that a kink holds. */
static void plant_rates(const pmj_lanes *t, const pmj_lanes *x, const pmj_lanes *w, const pmj_lanes *p,
                        pmj_lanes *restrict rates)
{
    PMJ_EITHER(w + PMJ_NW, CHANNELS, rates, pmj_plant_rates_lanes, pmj_plant_rates_held_lanes, t, x, w, p);
}

/* Its coefficients, and those of lanes that a kink holds. */
static void expand(const pmj_sampled_group *all, pmj_lanes t, pmj_lanes *restrict c)
{
    PMJ_EITHER(all->w + PMJ_NW, (PMJ_HOLD_ORDER + 1) * CHANNELS, c, pmj_plant_lanes, pmj_plant_held_lanes, &t, all->x,
               all->w, all->runs.p);
}

static pmj_flow plant_flow(void)
{
    static const int states[] = PMJ_PLANT_BENT_STATES_LIST;
    static const int rests[] = PMJ_PLANT_BENT_RESTS_LIST;
    const pmj_flow flow = {
        CHANNELS, PMJ_NX, -1, PMJ_HOLD_ORDER, states, PMJ_PLANT_BENT_STATES, rests, PMJ_PLANT_BENT_RESTS,
        plant_guard, plant_rates,
    };
    return flow;
}

/* The error of holds relative to the allowed one, from the guard on discs of radius R in time and P of each x. */
static pmj_lanes hold_miss(const pmj_sweep *sweep, const pmj_sampled_group *all, pmj_lanes t, const pmj_lanes *x, pmj_lanes R,
                           const pmj_lanes *P, pmj_lanes length, int disc)
{
    pmj_lanes rest[CHANNELS];
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    pmj_plant_guard_lanes(&t, x, all->w, all->runs.p, &R, P, rest);
    for (int i = 0; i < CHANNELS; ++i) {
        const pmj_lanes miss = i < PMJ_NX ? sweep->hold_rule.factors[disc] * rest[i] * length
                                          : sweep->hold_value_factors[disc] * rest[i];
        bad = bad | ~(miss <= DBL_MAX);
        most = pmj_max(miss, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most) * (1.0 / (PMJ_DEFECT * sweep->tolerance));
}

/* The lanes whose window contains the discs of radius R around t, and the range of x on them. */
static pmj_mask covered(const pmj_sampled_group *all, double R)
{
    static const int bent[] = PMJ_PLANT_BENT_STATES_LIST;
    pmj_mask inside = pmj_abs(all->runs.t - all->window_t) + R <= all->window_R;
    for (int k = 0; k < PMJ_PLANT_BENT_STATES; ++k) {
        const int i = bent[k];
        const pmj_lanes spread = pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, pmj_all(R));
        inside = inside & (pmj_abs(all->c[i] - all->window_x[i]) + spread <= all->window_P[i]);
    }
    return inside;
}

/* The lanes of `asked` whose holds the guard shows to be one step of the sample's own coefficients; see loops/c/sampled.c. */
static pmj_mask shown(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask asked, pmj_lanes length)
{
    const double R = sweep->hold_rule.ratios[0] * sweep->sample_time;
    const pmj_lanes radius = pmj_all(2.0 * R);
    const pmj_lanes t = all->runs.t + R;
    pmj_lanes P[PMJ_NX];
    pmj_mask good = {0};
    if (PMJ_WINDOWS) {
        good = covered(all, R) & asked;
    }
    if (!pmj_any(asked & ~good)) {
        return good;
    }
    if (PMJ_WINDOWS) {
        for (int i = 0; i < PMJ_NX; ++i) {
            P[i] = PMJ_WINDOW * pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, pmj_all(R));
        }
        const pmj_lanes miss = 2.0 * hold_miss(sweep, all, t, all->c, radius, P, pmj_all(sweep->sample_time), 0);
        const pmj_mask anew = asked & ~good;
        const pmj_mask fits = anew & (miss <= 1.0);
        all->window_t = pmj_select(anew, t, all->window_t);
        all->window_R = pmj_select(anew, pmj_select(fits, radius, pmj_all(-1.0)), all->window_R);
        for (int i = 0; i < PMJ_NX; ++i) {
            all->window_x[i] = pmj_select(anew, all->c[i], all->window_x[i]);
            all->window_P[i] = pmj_select(anew, P[i], all->window_P[i]);
        }
        good = good | fits;
    }
    for (long long disc = 0; disc < sweep->hold_rule.n_ratios && pmj_any(asked & ~good); ++disc) {
        const pmj_lanes disc_radius = sweep->hold_rule.ratios[disc] * length;
        for (int i = 0; i < PMJ_NX; ++i) {
            P[i] = pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, disc_radius);
        }
        good = good | (asked & (hold_miss(sweep, all, all->runs.t, all->c, disc_radius, P, length, (int)disc) <= 1.0));
    }
    return good;
}

/* The lanes in which no argument of a kink reaches 0 within the holds. */
static pmj_mask smooth(const pmj_sampled_group *all, pmj_lanes length)
{
    pmj_mask good = ~(pmj_mask){0};
    for (int i = E + 1; i < CHANNELS; ++i) {
        good = good & (pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, length) < pmj_abs(all->c[i]));
    }
    return good;
}

/* Steps of the lanes in `on` that need several per hold: guarded, compared, up to the first kink; `kink` is that or -1.
 * Lanes at a kink that is passed at once make no step. */
static pmj_lanes long_steps(const pmj_sweep *sweep, const pmj_flow *flow, pmj_sampled_group *all, pmj_mask on, pmj_lanes t,
                            pmj_lanes left, const pmj_lanes *scales, int *kink)
{
    const pmj_stand at = {&t, all->c, all->w, all->runs.p, scales, pmj_all(0.0)};
    const pmj_lanes smallest = pmj_min(PMJ_SMALLEST_STEP * pmj_max(t + left, pmj_all(1.0)), left);
    pmj_lanes most = pmj_min(left, pmj_all(sweep->max_step));
    pmj_lanes taken = pmj_all(0.0);
    most = pmj_min(pmj_step(all->c, scales, CHANNELS, PMJ_HOLD_ORDER, sweep->tolerance), most);
    while (pmj_any(on)) {
        pmj_lanes h = pmj_guarded_lanes(flow, &sweep->rule, sweep->tolerance, &at, most, smallest, on, &all->runs.likely);
        const pmj_mask lost = on & ~(h > 0.0);
        all->runs.stalled = all->runs.stalled | lost;
        for (int i = 0; i < (PMJ_HOLD_ORDER + 1) * CHANNELS; ++i) { /* the run then counts as not finite */
            all->overflow = all->overflow | (lost & ~(pmj_abs(all->c[i]) <= DBL_MAX));
        }
        on = on & ~lost;
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            pmj_lane *one = &all->runs.lanes[w];
            kink[w] = on[w] ? -1 : kink[w];
            for (int j = 0; on[w] && j < PMJ_NK; ++j) {
                double when = 0.0;
                if (pmj_passes_kink(flow, all->c, one, w, E + 1, j, all->w[PMJ_NW + j][w], 0, h[w], &when)) {
                    kink[w] = j;
                    h[w] = when;
                }
            }
        }
        pmj_lanes miss = pmj_missed_lanes(flow, &sweep->rule, sweep->tolerance, &at, h, 1.0);
        for (long long j = 0; j < sweep->rule.n_inside; ++j) {
            miss = pmj_max(pmj_missed_lanes(flow, &sweep->rule, sweep->tolerance, &at, h, sweep->rule.inside[j]), miss);
        }
        const pmj_mask good = on & ((miss <= 1.0) | (h == 0.0));
        taken = pmj_select(good, h, taken);
        on = on & ~good;
        most = pmj_select(on, h * pmj_shrink_lanes(miss, PMJ_HOLD_ORDER), most);
    }
    return taken;
}

/* The lanes whose run ends inside the hold. */
static pmj_mask stopped(const pmj_sweep *sweep, const pmj_sampled_group *all)
{
    return all->runs.stalled | all->runs.sliding | (all->runs.steps >= sweep->max_steps);
}

/* Integrate the plant of the lanes in `on` for the time `length` under constant w; `c` is expanded at t.
 * Gives the error at the end. */
pmj_lanes pmj_hold_lanes(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_mask on,
                         pmj_lanes length)
{
    const pmj_flow flow = plant_flow();
    pmj_lanes left = pmj_select(on, length, pmj_all(0.0));
    pmj_lanes t = all->runs.t;
    pmj_lanes a[PMJ_HOLD_ORDER + 1];
    pmj_lanes scales[CHANNELS];
    pmj_lanes e = all->c[E];
    /* Break points of the reference up to this instant lie inside the hold. */
    const pmj_lanes until = t + length - PMJ_SAME_INSTANT * sweep->sample_time;
    int kink[PMJ_WIDTH];
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        all->runs.lanes[w].touching = -1;
        all->runs.lanes[w].flips = 0;
        kink[w] = -1;
    }
    for (int j = 0; j < PMJ_NK; ++j) {
        const pmj_lanes side = pmj_select(all->c[E + 1 + j] < 0.0, pmj_all(-1.0), pmj_all(1.0));
        /* On the other side the right-hand side is another function: the window is invalid. */
        all->window_R = pmj_select(side == all->w[PMJ_NW + j], all->window_R, pmj_all(-1.0));
        all->w[PMJ_NW + j] = side;
    }
    pmj_inverse_scales(all->c, CHANNELS, scales);
    pmj_mask once = whole(sweep, all, scales, left) & smooth(all, left) & (left <= sweep->max_step) & on;
    once = once & ~pmj_held(all->w + PMJ_NW) & ~(all->runs.next_break < until);
    once = once & shown(sweep, all, once, left);
    for (int w = 0; PMJ_NK > 0 && w < PMJ_WIDTH; ++w) {
        if (on[w] && !once[w]
            && pmj_find_rest_lane(&all->runs, t, all->x, all->w, all->w + PMJ_NW, w, all->c + E + 1, 0)) {
            all->window_R[w] = -1.0;
        }
    }
    if (PMJ_NK > 0 && pmj_any(on & ~once)) { /* where an argument is 0, the sample has neither side */
        pmj_lanes c[(PMJ_HOLD_ORDER + 1) * CHANNELS];
        expand(all, t, c);
        for (int i = 0; i < (PMJ_HOLD_ORDER + 1) * CHANNELS; ++i) {
            all->c[i] = pmj_select(once, all->c[i], c[i]);
        }
    }
    for (;;) {
        const pmj_mask going = (left > 0.0) & ~stopped(sweep, all);
        const pmj_mask broken = going & (all->runs.next_break < until);
        const pmj_lanes part = pmj_select(broken, all->runs.next_break - t, left); /* up to where the step may go */
        pmj_lanes h = pmj_select(going, left, pmj_all(0.0));
        if (pmj_any(going & ~once)) {
            h = pmj_select(once, h, long_steps(sweep, &flow, all, going & ~once, t, part, scales, kink));
        }
        const pmj_mask reached = broken & (h >= part);
        pmj_scale(all->c + E, CHANNELS, PMJ_HOLD_ORDER, h, a);
        const pmj_span step = {
            going & (h > 0.0), t, h, a, PMJ_HOLD_ORDER, &all->v, 0, pmj_mean_square(a, PMJ_HOLD_ORDER), all->runs.limited,
            pmj_stuck(all->w + PMJ_NW),
        };
        pmj_note_step(&all->runs.metrics, &step);
        all->runs.steps = all->runs.steps + pmj_select(going, pmj_all(1.0), pmj_all(0.0));
        for (int w = 0; results->trajectories && w < PMJ_WIDTH; ++w) {
            if (going[w]) {
                const double slack = h[w] < left[w] ? 0.0 : PMJ_SAME_INSTANT * sweep->sample_time;
                write_rows(sweep, results, all, w, t[w], t[w] + h[w] - slack);
            }
        }
        for (int i = 0; i <= E; ++i) {
            pmj_lanes value = all->c[PMJ_HOLD_ORDER * CHANNELS + i];
            for (int k = PMJ_HOLD_ORDER - 1; k >= 0; --k) {
                value = value * h + all->c[k * CHANNELS + i];
            }
            if (i < PMJ_NX) {
                all->x[i] = pmj_select(going, value, all->x[i]);
            } else {
                e = pmj_select(going, value, e);
            }
        }
        for (int w = 0; PMJ_NK > 0 && w < PMJ_WIDTH; ++w) {
            if (going[w] && h[w] > 0.0) {
                all->runs.lanes[w].touching = -1;
                all->runs.lanes[w].flips = 0;
            }
            if (going[w] && kink[w] >= 0) {
                double side = 0.0;
                for (int k = PMJ_HOLD_ORDER; k >= 0; --k) {
                    side = side * h[w] + all->c[k * CHANNELS + E + 1 + kink[w]][w];
                }
                pmj_meet_lane(&all->runs, t + h, all->x, all->w, all->w + PMJ_NW, w, kink[w], side, 0);
                all->window_R[w] = -1.0;
                kink[w] = -1;
            }
        }
        t = pmj_select(reached, all->runs.next_break, t + h);
        left = pmj_select(h < left, left - h, pmj_all(0.0));
        if (pmj_any(reached)) {
            for (int w = 0; w < PMJ_WIDTH; ++w) {
                if (reached[w]) {
                    pmj_enter_lane(sweep, &all->runs, w, t[w]);
                    all->window_R[w] = -1.0; /* the guard of e is known for the segment before */
                }
            }
        }
        if (!pmj_any((left > 0.0) & ~stopped(sweep, all))) {
            return e;
        }
        once = (pmj_mask){0};
        expand(all, t, all->c);
        pmj_inverse_scales(all->c, CHANNELS, scales);
    }
}
