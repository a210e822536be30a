#include "guard_lanes.h"
#include "pmjoint_runtime.h"
#include "stepping.h"

#include <float.h>

pmj_lanes pmj_shrink_lanes(pmj_lanes miss, int order)
{
    const pmj_lanes factor = 0.95 * pmj_rough_exp2(pmj_rough_log2(miss) * (-1.0 / (double)order));
    return pmj_max(pmj_min(factor, pmj_all(0.95)), pmj_all(0.55));
}

/* One value relative to its channel's scale. */
static inline pmj_lanes relative(const pmj_flow *flow, const pmj_stand *at, pmj_lanes value, int i, pmj_lanes h)
{
    const pmj_lanes scale = i == flow->v ? at->control : i < flow->rates ? h * at->scales[i] : at->scales[i];
    return pmj_abs(value) * scale;
}

pmj_lanes pmj_largest_lanes(const pmj_flow *flow, const pmj_stand *at, const pmj_lanes *values, pmj_lanes h)
{
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    for (int i = 0; i < flow->channels; ++i) {
        const pmj_lanes value = relative(flow, at, values[i], i, h);
        bad = bad | ~(value <= DBL_MAX);
        most = pmj_max(value, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most);
}

/* The same of the nonlinear parts: those of the other channels are 0. */
static pmj_lanes largest_rest(const pmj_flow *flow, const pmj_stand *at, const pmj_lanes *rest, pmj_lanes h)
{
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    for (int k = 0; k < flow->n_rests; ++k) {
        const int i = flow->rests[k];
        const pmj_lanes value = relative(flow, at, rest[i], i, h);
        bad = bad | ~(value <= DBL_MAX);
        most = pmj_max(value, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most);
}

/* The radius and the factor of each lane's disc at a trial: the one of its last step first. */
static void choose(const pmj_rule *rule, long long trial, const int *likely, pmj_lanes *ratio, pmj_lanes *factor,
                   int *disc)
{
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        disc[w] = trial == 0 ? likely[w] : (int)trial - (trial <= likely[w]);
        (*ratio)[w] = rule->ratios[disc[w]];
        (*factor)[w] = rule->factors[disc[w]];
    }
}

/* What steps of size h miss of what is allowed, from the guard on discs of `ratio` steps. */
static pmj_lanes guard_miss(const pmj_flow *flow, double tolerance, const pmj_stand *at, pmj_lanes h, pmj_lanes ratio,
                            pmj_lanes factor)
{
    pmj_lanes P[PMJ_MOST_CHANNELS];
    pmj_lanes rest[PMJ_MOST_CHANNELS];
    const pmj_lanes R = ratio * h;
    for (int k = 0; k < flow->n_states; ++k) {
        P[flow->states[k]] = pmj_spread(at->c, flow->channels, flow->order, flow->states[k], R);
    }
    flow->guard(at->t, at->c, at->g, at->p, &R, P, rest);
    return factor * largest_rest(flow, at, rest, h) * (1.0 / (PMJ_DEFECT * tolerance));
}

/* The long way: where the likely disc does not do for all lanes that are asked for. */
static pmj_lanes search(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at, pmj_lanes h,
                        pmj_lanes smallest, pmj_mask pending, int *likely)
{
    const int order = flow->order + (int)rule->n_inside + 1;
    int kept[PMJ_WIDTH];
    while (pmj_any(pending)) {
        pmj_lanes best = pmj_all(0.0);
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            kept[w] = likely[w]; /* the order of trials must not change while lanes pass */
        }
        for (long long trial = 0; trial < rule->n_ratios && pmj_any(pending); ++trial) {
            pmj_lanes ratio = h;
            pmj_lanes factor = h;
            int disc[PMJ_WIDTH];
            choose(rule, trial, kept, &ratio, &factor, disc);
            const pmj_lanes miss = guard_miss(flow, tolerance, at, h, ratio, factor);
            const pmj_mask passed = (miss <= 1.0) & pending;
            best = pmj_max(pmj_shrink_lanes(miss, order), best);
            pending = pending & ~passed;
            for (int w = 0; w < PMJ_WIDTH; ++w) {
                likely[w] = passed[w] ? disc[w] : likely[w];
            }
        }
        h = pmj_select(pending, h * best, h);
        const pmj_mask lost = pending & ~(h >= smallest);
        h = pmj_select(lost, pmj_all(0.0), h);
        pending = pending & ~lost;
    }
    return h;
}

pmj_lanes pmj_guarded_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                            pmj_lanes h, pmj_lanes smallest, pmj_mask on, int *likely)
{
    int alike = 1;
    if (flow->n_rests == 0) {
        return h;
    }
    for (int w = 1; w < PMJ_WIDTH; ++w) {
        alike &= likely[w] == likely[0];
    }
    if (alike) {
        const pmj_lanes ratio = pmj_all(rule->ratios[likely[0]]);
        const pmj_lanes miss = guard_miss(flow, tolerance, at, h, ratio, pmj_all(rule->factors[likely[0]]));
        if (!pmj_any(on & ~(miss <= 1.0))) {
            return h;
        }
    }
    return search(flow, rule, tolerance, at, h, smallest, on, likely);
}

pmj_lanes pmj_missed_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                           pmj_lanes h, double part)
{
    pmj_lanes values[PMJ_MOST_CHANNELS];
    pmj_lanes found[PMJ_MOST_CHANNELS];
    const pmj_lanes tau = h * part;
    const pmj_lanes t = *at->t + tau;
    for (int i = 0; i < flow->channels; ++i) {
        values[i] = at->c[flow->order * flow->channels + i];
        for (int k = flow->order - 1; k >= 0; --k) {
            values[i] = values[i] * tau + at->c[k * flow->channels + i];
        }
    }
    flow->right(&t, values, at->g, at->p, found);
    for (int i = 0; i < flow->rates; ++i) {
        pmj_lanes slope = (double)flow->order * at->c[flow->order * flow->channels + i];
        for (int k = flow->order - 1; k >= 1; --k) {
            slope = slope * tau + (double)k * at->c[k * flow->channels + i];
        }
        values[i] = slope;
    }
    for (int i = 0; i < flow->channels; ++i) {
        found[i] = values[i] - found[i];
    }
    return rule->lebesgue / (PMJ_DEFECT * tolerance) * pmj_largest_lanes(flow, at, found, h);
}

int pmj_passes_lane(const pmj_flow *flow, const pmj_lanes *c, int w, int channel, double level, int touching,
                    int outward, double h, double *tau)
{
    double q[PMJ_MAX_ORDER + 1];
    for (int k = 0; k <= flow->order; ++k) {
        q[k] = c[k * flow->channels + channel][w];
    }
    q[0] = touching ? 0.0 : q[0] - level;
    const long long zeros = pmj_leading_zeros(q, flow->order, h);
    if (q[zeros] * outward > 0.0) {
        *tau = 0.0;
        return 1;
    }
    return pmj_first_crossing(q + zeros, flow->order - zeros, h, tau);
}
