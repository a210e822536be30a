#include "guard_lanes.h"
#include "stepping.h"

pmj_lanes pmj_shrink_lanes(pmj_lanes miss, int order)
{
    const pmj_lanes factor = PMJ_MOST_SHRINK * pmj_rough_exp2(pmj_rough_log2(miss) * (-1.0 / (double)order));
    return pmj_max(pmj_min(factor, pmj_all(PMJ_MOST_SHRINK)), pmj_all(PMJ_LEAST_SHRINK));
}

/* Each lane's disc at a trial: the one of its last step first. */
static pmj_choice choose(const pmj_rule *rule, long long trial, const pmj_choice *likely)
{
    pmj_choice chosen = *likely;
    for (int w = 0; trial > 0 && w < PMJ_WIDTH; ++w) {
        const int disc = (int)trial - (trial <= likely->disc[w]);
        chosen.disc[w] = disc;
        chosen.ratio[w] = rule->ratios[disc];
        chosen.factor[w] = rule->factors[disc];
    }
    return chosen;
}

pmj_lanes pmj_search_discs(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                           pmj_lanes h, pmj_lanes smallest, pmj_mask pending, pmj_choice *likely)
{
    const int order = flow->order + (int)rule->n_inside + 1;
    while (pmj_any(pending)) {
        const pmj_choice kept = *likely; /* the order of trials must not change while lanes pass */
        pmj_lanes best = pmj_all(0.0);
        for (long long trial = 0; trial < rule->n_ratios && pmj_any(pending); ++trial) {
            const pmj_choice chosen = choose(rule, trial, &kept);
            const pmj_lanes miss = pmj_guard_miss(flow, tolerance, at, h, chosen.ratio, chosen.factor);
            const pmj_mask passed = (miss <= 1.0) & pending;
            pending = pending & ~passed;
            likely->ratio = pmj_select(passed, chosen.ratio, likely->ratio);
            likely->factor = pmj_select(passed, chosen.factor, likely->factor);
            for (int w = 0; w < PMJ_WIDTH; ++w) {
                likely->disc[w] = passed[w] ? chosen.disc[w] : likely->disc[w];
            }
            if (pmj_any(pending)) {
                best = pmj_max(pmj_shrink_lanes(miss, order), best);
            }
        }
        h = pmj_select(pending, h * best, h);
        const pmj_mask lost = pending & ~(h >= smallest);
        h = pmj_select(lost, pmj_all(0.0), h);
        pending = pending & ~lost;
    }
    return h;
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
    return pmj_passes(q, flow->order, level, touching, outward, h, tau);
}
