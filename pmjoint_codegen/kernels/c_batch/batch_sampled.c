#include "actuator.h"
#include "guard_lanes.h"
#include "metrics.h"
#include "pmjoint_batch.h"
#include "pmjoint_runtime.h"
#include "stepping.h"

#include <float.h>
#include <string.h>

/* Channels of `plant_lanes`: x, e, then the arguments of kinks. */
#define E PMJ_NX
#define CHANNELS (PMJ_NX + 1 + PMJ_NK)
/* A window's reach in x, as a multiple of what a hold needs of it. */
#define WINDOW 4.0
#define S (PMJ_NS - PMJ_NX)
/* Output instants closer to a sample than this fraction of the sample time are the sample itself. */
#define SAME_INSTANT 1e-9

typedef struct {
    long long run; /* -1: the lane is empty */
    int mode;
    int label;
    int switches;
    int touching; /* the kink that the run stands on, or -1 */
    int flips;    /* changes of side since time last moved */
    pmj_actuator actuator;
    long long row;
} lane;

typedef struct {
    pmj_lanes c[(PMJ_HOLD_ORDER + 1) * CHANNELS];
    pmj_lanes p[PMJ_NP];
    pmj_lanes h[PMJ_NH];
    pmj_lanes X[PMJ_NS];      /* at the sample */
    pmj_lanes x[PMJ_NX];      /* plant states inside the hold */
    pmj_lanes next[S];        /* controller states at the next sample */
    pmj_lanes w[PMJ_NW + PMJ_NK]; /* what the actuator delivers, then sides */
    pmj_lanes window_t;       /* of which the guard is known: t and its reach, */
    pmj_lanes window_R;
    pmj_lanes window_x[PMJ_NX]; /* x and its reach */
    pmj_lanes window_P[PMJ_NX];
    pmj_lanes v;
    pmj_lanes sample;         /* index of the sample */
    pmj_lanes t;
    pmj_lanes tried;
    pmj_lanes low;            /* of the saturation mode at the last sample */
    pmj_lanes high;
    pmj_lanes limited;
    pmj_mask live;
    pmj_mask fresh;
    pmj_mask stalled;         /* the guard has found no step */
    pmj_mask overflow;        /* among these, those whose coefficients are no numbers */
    pmj_mask sliding;         /* both sides of a kink point back to it */
    pmj_choice likely;
    pmj_metrics metrics;
    lane lanes[PMJ_WIDTH];
    long long next_run;
    int busy;
} group;

static void load(const pmj_sweep *sweep, group *all, int w)
{
    lane *one = &all->lanes[w];
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

static void load_actuators(group *all)
{
    pmj_lanes limits[4 * PMJ_NW];
    actuation_lanes(all->p, limits);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        lane *one = &all->lanes[w];
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

static void finish(const pmj_sweep *sweep, const pmj_results *results, group *all, int w, int status, double e)
{
    const lane *one = &all->lanes[w];
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
static void note_modes(const pmj_sweep *sweep, group *all, pmj_mask left)
{
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        lane *one = &all->lanes[w];
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

/* Output rows of lane w within [t, t + h], or up to but not at its end: x and e go on inside the hold, all else is held. */
static void write_rows(const pmj_sweep *sweep, const pmj_results *results, group *all, int w, double t, double until)
{
    lane *one = &all->lanes[w];
    while (one->row < sweep->rows && sweep->times[one->row] < until) {
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * (PMJ_NS + 2);
        const double tau = sweep->times[one->row] > t ? sweep->times[one->row] - t : 0.0;
        for (int i = 0; i <= E; ++i) {
            double value = all->c[PMJ_HOLD_ORDER * CHANNELS + i][w];
            for (int k = PMJ_HOLD_ORDER - 1; k >= 0; --k) {
                value = value * tau + all->c[k * CHANNELS + i][w];
            }
            entry[i < PMJ_NX ? i : PMJ_NS + 1] = value;
        }
        for (int i = PMJ_NX; i < PMJ_NS; ++i) {
            entry[i] = all->X[i][w];
        }
        entry[PMJ_NS] = all->v[w];
        one->row += 1;
    }
}

/* The row at the horizon itself, of lane w. */
static void write_last(const pmj_sweep *sweep, const pmj_results *results, group *all, int w, double e)
{
    lane *one = &all->lanes[w];
    for (; one->row < sweep->rows; one->row += 1) {
        double *entry = results->trajectories + (one->run * sweep->rows + one->row) * (PMJ_NS + 2);
        for (int i = 0; i < PMJ_NS; ++i) {
            entry[i] = all->X[i][w];
        }
        entry[PMJ_NS] = all->v[w];
        entry[PMJ_NS + 1] = e;
    }
}

/* Whether one step to the end of the hold keeps the last two terms below the tolerance. */
static pmj_mask whole(const pmj_sweep *sweep, const group *all, const pmj_lanes *scales, pmj_lanes h)
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

static pmj_flow plant_flow(void)
{
    static const int states[] = PMJ_PLANT_BENT_STATES_LIST;
    static const int rests[] = PMJ_PLANT_BENT_RESTS_LIST;
    const pmj_flow flow = {
        CHANNELS, PMJ_NX, -1, PMJ_HOLD_ORDER, states, PMJ_PLANT_BENT_STATES, rests, PMJ_PLANT_BENT_RESTS,
        plant_guard_lanes, plant_rates_lanes,
    };
    return flow;
}

/* How much of what is allowed holds of a length miss, from the guard on discs of radius R in time and P of each x. */
static pmj_lanes hold_miss(const pmj_sweep *sweep, const group *all, pmj_lanes t, const pmj_lanes *x, pmj_lanes R,
                           const pmj_lanes *P, pmj_lanes length, int disc)
{
    pmj_lanes rest[CHANNELS];
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    plant_guard_lanes(&t, x, all->w, all->p, &R, P, rest);
    for (int i = 0; i < CHANNELS; ++i) {
        const pmj_lanes miss = i < PMJ_NX ? sweep->hold_rule.factors[disc] * rest[i] * length
                                          : sweep->hold_value_factors[disc] * rest[i];
        bad = bad | ~(miss <= DBL_MAX);
        most = pmj_max(miss, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most) * (1.0 / (PMJ_DEFECT * sweep->tolerance));
}

/* The lanes whose window holds the discs of radius R around t, and where x goes on them. */
static pmj_mask covered(const group *all, double R)
{
    static const int bent[] = PMJ_PLANT_BENT_STATES_LIST;
    pmj_mask inside = pmj_abs(all->t - all->window_t) + R <= all->window_R;
    for (int k = 0; k < PMJ_PLANT_BENT_STATES; ++k) {
        const int i = bent[k];
        const pmj_lanes spread = pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, pmj_all(R));
        inside = inside & (pmj_abs(all->c[i] - all->window_x[i]) + spread <= all->window_P[i]);
    }
    return inside;
}

/* The lanes of `asked` whose holds the guard shows to be one step of the sample's own coefficients; see kernels/c/sampled.c. */
static pmj_mask shown(const pmj_sweep *sweep, group *all, pmj_mask asked, pmj_lanes length)
{
    const double R = sweep->hold_rule.ratios[0] * sweep->sample_time;
    const pmj_lanes reach = pmj_all(2.0 * R);
    const pmj_lanes t = all->t + R;
    pmj_lanes P[PMJ_NX];
    pmj_mask good = covered(all, R) & asked;
    if (!pmj_any(asked & ~good)) {
        return good;
    }
    for (int i = 0; i < PMJ_NX; ++i) {
        P[i] = WINDOW * pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, pmj_all(R));
    }
    const pmj_lanes miss = 2.0 * hold_miss(sweep, all, t, all->c, reach, P, pmj_all(sweep->sample_time), 0);
    const pmj_mask anew = asked & ~good;
    const pmj_mask fits = anew & (miss <= 1.0);
    all->window_t = pmj_select(anew, t, all->window_t);
    all->window_R = pmj_select(anew, pmj_select(fits, reach, pmj_all(-1.0)), all->window_R);
    for (int i = 0; i < PMJ_NX; ++i) {
        all->window_x[i] = pmj_select(anew, all->c[i], all->window_x[i]);
        all->window_P[i] = pmj_select(anew, P[i], all->window_P[i]);
    }
    good = good | fits;
    for (long long disc = 0; disc < sweep->hold_rule.n_ratios && pmj_any(asked & ~good); ++disc) {
        const pmj_lanes radius = sweep->hold_rule.ratios[disc] * length;
        for (int i = 0; i < PMJ_NX; ++i) {
            P[i] = pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, radius);
        }
        good = good | (asked & (hold_miss(sweep, all, all->t, all->c, radius, P, length, (int)disc) <= 1.0));
    }
    return good;
}

/* The lanes in which no argument of a kink reaches 0 within the holds. */
static pmj_mask smooth(const group *all, pmj_lanes length)
{
    pmj_mask good = ~(pmj_mask){0};
    for (int i = E + 1; i < CHANNELS; ++i) {
        good = good & (pmj_spread(all->c, CHANNELS, PMJ_HOLD_ORDER, i, length) < pmj_abs(all->c[i]));
    }
    return good;
}

/* Steps of the lanes in `on` that take several for a hold: guarded, compared, up to the first kink; `kink` is that or -1.
 * Lanes at a kink that is passed at once make no step. */
static pmj_lanes long_steps(const pmj_sweep *sweep, const pmj_flow *flow, group *all, pmj_mask on, pmj_lanes t,
                            pmj_lanes left, const pmj_lanes *scales, int *kink)
{
    const pmj_stand at = {&t, all->c, all->w, all->p, scales, pmj_all(0.0)};
    const pmj_lanes smallest = pmj_min(PMJ_SMALLEST_STEP * pmj_max(t + left, pmj_all(1.0)), left);
    pmj_lanes most = pmj_min(left, pmj_all(sweep->max_step));
    pmj_lanes taken = pmj_all(0.0);
    most = pmj_min(pmj_step(all->c, scales, CHANNELS, PMJ_HOLD_ORDER, sweep->tolerance), most);
    while (pmj_any(on)) {
        pmj_lanes h = pmj_guarded_lanes(flow, &sweep->rule, sweep->tolerance, &at, most, smallest, on, &all->likely);
        const pmj_mask lost = on & ~(h > 0.0);
        all->stalled = all->stalled | lost;
        for (int i = 0; i < (PMJ_HOLD_ORDER + 1) * CHANNELS; ++i) { /* the run then counts as not finite */
            all->overflow = all->overflow | (lost & ~(pmj_abs(all->c[i]) <= DBL_MAX));
        }
        on = on & ~lost;
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            lane *one = &all->lanes[w];
            kink[w] = on[w] ? -1 : kink[w];
            for (int j = 0; on[w] && j < PMJ_NK; ++j) {
                double when = 0.0;
                const int outward = all->w[PMJ_NW + j][w] > 0.0 ? -1 : 1;
                if (pmj_passes_lane(flow, all->c, w, E + 1 + j, 0.0, one->touching == j, outward, h[w], &when)) {
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

/* Lane w goes to the other side of a kink. */
static void flip(group *all, int w, int kink)
{
    lane *one = &all->lanes[w];
    all->w[PMJ_NW + kink][w] = -all->w[PMJ_NW + kink][w];
    all->window_R[w] = -1.0;
    one->touching = kink;
    one->flips += 1;
    if (one->flips > 2 * PMJ_NK) {
        all->sliding[w] = -1;
    }
}

/* Integrate the plant of the lanes in `on` for the time `length` under constant w; `c` comes expanded at t.
 * Gives the error at the end. */
static pmj_lanes hold(const pmj_sweep *sweep, const pmj_results *results, group *all, pmj_mask on, pmj_lanes length)
{
    const pmj_flow flow = plant_flow();
    pmj_lanes left = pmj_select(on, length, pmj_all(0.0));
    pmj_lanes t = all->t;
    pmj_lanes a[PMJ_HOLD_ORDER + 1];
    pmj_lanes scales[CHANNELS];
    pmj_lanes e = all->c[E];
    int kink[PMJ_WIDTH];
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        all->lanes[w].touching = -1;
        all->lanes[w].flips = 0;
        kink[w] = -1;
    }
    for (int j = 0; j < PMJ_NK; ++j) {
        const pmj_lanes side = pmj_select(all->c[E + 1 + j] < 0.0, pmj_all(-1.0), pmj_all(1.0));
        /* On the other side the right-hand side is another function: the window is of no use. */
        all->window_R = pmj_select(side == all->w[PMJ_NW + j], all->window_R, pmj_all(-1.0));
        all->w[PMJ_NW + j] = side;
    }
    pmj_inverse_scales(all->c, CHANNELS, scales);
    pmj_mask once = whole(sweep, all, scales, left) & smooth(all, left) & (left <= sweep->max_step) & on;
    once = once & shown(sweep, all, once, left);
    if (PMJ_NK > 0 && pmj_any(on & ~once)) { /* where an argument is 0, the sample has neither side */
        pmj_lanes c[(PMJ_HOLD_ORDER + 1) * CHANNELS];
        plant_lanes(&t, all->x, all->w, all->p, c);
        for (int i = 0; i < (PMJ_HOLD_ORDER + 1) * CHANNELS; ++i) {
            all->c[i] = pmj_select(once, all->c[i], c[i]);
        }
    }
    for (;;) {
        const pmj_mask going = (left > 0.0) & ~all->stalled & ~all->sliding;
        pmj_lanes h = pmj_select(going, left, pmj_all(0.0));
        if (pmj_any(going & ~once)) {
            h = pmj_select(once, h, long_steps(sweep, &flow, all, going & ~once, t, left, scales, kink));
        }
        pmj_scale(all->c + E, CHANNELS, PMJ_HOLD_ORDER, h, a);
        pmj_note_error(&all->metrics, a, PMJ_HOLD_ORDER, pmj_mean_square(a, PMJ_HOLD_ORDER), t, h, going & (h > 0.0));
        all->tried = all->tried + pmj_select(going, pmj_all(1.0), pmj_all(0.0));
        for (int w = 0; results->trajectories && w < PMJ_WIDTH; ++w) {
            if (going[w]) {
                const double slack = h[w] < left[w] ? 0.0 : SAME_INSTANT * sweep->sample_time;
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
                all->lanes[w].touching = -1;
                all->lanes[w].flips = 0;
            }
            if (going[w] && kink[w] >= 0) {
                flip(all, w, kink[w]);
                kink[w] = -1;
            }
        }
        t = t + h;
        left = pmj_select(h < left, left - h, pmj_all(0.0));
        if (!pmj_any((left > 0.0) & ~all->stalled & ~all->sliding)) {
            return e;
        }
        once = (pmj_mask){0};
        plant_lanes(&t, all->x, all->w, all->p, all->c);
        pmj_inverse_scales(all->c, CHANNELS, scales);
    }
}

/* What v is and does at the sample of each lane in `at`. */
static void take(const pmj_sweep *sweep, group *all, pmj_mask at)
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
static void settle(const pmj_sweep *sweep, const pmj_results *results, group *all, pmj_lanes e, pmj_mask whole_hold,
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
static void advance(const pmj_sweep *sweep, const pmj_results *results, group *all)
{
    all->t = all->sample * sweep->sample_time;
    const pmj_lanes end = (all->sample + 1.0) * sweep->sample_time;
    const double slack = SAME_INSTANT * sweep->sample_time;
    const pmj_mask last = end + slack >= sweep->horizon;
    const pmj_mask whole_hold = end - slack <= sweep->horizon;
    take(sweep, all, all->live);
    const pmj_lanes length = pmj_select(whole_hold, pmj_all(sweep->sample_time), sweep->horizon - all->t);
    for (int i = 0; i < PMJ_NX; ++i) {
        all->x[i] = all->X[i];
    }
    all->metrics.saturated = all->metrics.saturated + all->limited * length;
    const pmj_lanes e = hold(sweep, results, all, all->live, length);
    settle(sweep, results, all, e, whole_hold, last);
}

void pmj_sampled_batch(const pmj_sweep *sweep, const pmj_results *results)
{
    group all;
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
