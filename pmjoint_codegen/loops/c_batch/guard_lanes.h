/* Whether steps follow the right-hand side throughout, lane by lane: loops/c/guard.c over vectors. */
#ifndef PMJOINT_GUARD_LANES_H
#define PMJOINT_GUARD_LANES_H

#include "lanes.h"
#include "pmjoint_batch.h"
#include "pmjoint_runtime.h"

#include <float.h>

/* The most channels that either loop has. */
#define PMJ_MOST_CHANNELS (PMJ_NS + 2 + PMJ_NK)

/* A right-hand side over lanes: the first `rates` of its channels have rates, the others are values; `v` is the index
 * of the control among them, or -1. */
typedef struct {
    int channels;
    int rates;
    int v;
    int order;
    const int *states;   /* [n_states] those that are not linear in some channel */
    int n_states;
    const int *rests;    /* [n_rests] channels that are not linear in all of them */
    int n_rests;
    void (*guard)(const pmj_lanes *t, const pmj_lanes *X, const pmj_lanes *g, const pmj_lanes *p, const pmj_lanes *R,
                  const pmj_lanes *P, pmj_lanes *restrict rest);
    void (*right)(const pmj_lanes *t, const pmj_lanes *X, const pmj_lanes *g, const pmj_lanes *p,
                  pmj_lanes *restrict rates);
} pmj_flow;

/* The disc that proved each lane's last step, with its radius as a multiple of the step and its factor. */
typedef struct {
    int disc[PMJ_WIDTH];
    pmj_lanes ratio;
    pmj_lanes factor;
} pmj_choice;

/* The data of a step. */
typedef struct {
    const pmj_lanes *t;
    const pmj_lanes *c;      /* [(order + 1) channels] */
    const pmj_lanes *g;      /* actuation, then sides */
    const pmj_lanes *p;
    const pmj_lanes *scales; /* [channels] 1/max(1, |c_0|) */
    pmj_lanes control;       /* 1/max(1, |v|), v at its peak so far */
} pmj_stand;

/* Factor on a step whose error is `miss` times the allowed one, by the error's order: 0.55 to 0.95. */
pmj_lanes pmj_shrink_lanes(pmj_lanes miss, int order);

/* How far a channel can move from its start while time is anywhere in a disc of radius R. */
static inline pmj_lanes pmj_spread(const pmj_lanes *c, int channels, int order, int channel, pmj_lanes R)
{
    pmj_lanes sum = pmj_abs(c[order * channels + channel]);
    for (int k = order - 1; k >= 1; --k) {
        sum = sum * R + pmj_abs(c[k * channels + channel]);
    }
    return sum * R;
}

/* One value relative to its channel's scale. */
static inline pmj_lanes pmj_relative(const pmj_flow *flow, const pmj_stand *at, pmj_lanes value, int i, pmj_lanes h)
{
    const pmj_lanes scale = i == flow->v ? at->control : i < flow->rates ? h * at->scales[i] : at->scales[i];
    return pmj_abs(value) * scale;
}

/* The largest of `values`, each relative to its channel's scale, for rates over a step of size h; infinite for NaN. */
static inline pmj_lanes pmj_largest_lanes(const pmj_flow *flow, const pmj_stand *at, const pmj_lanes *values, pmj_lanes h)
{
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    for (int i = 0; i < flow->channels; ++i) {
        const pmj_lanes value = pmj_relative(flow, at, values[i], i, h);
        bad = bad | ~(value <= DBL_MAX);
        most = pmj_max(value, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most);
}

/* The same for nonlinear parts: those of the other channels are 0. */
static inline pmj_lanes pmj_largest_rest(const pmj_flow *flow, const pmj_stand *at, const pmj_lanes *rest, pmj_lanes h)
{
    pmj_lanes most = pmj_all(0.0);
    pmj_mask bad = {0};
    for (int k = 0; k < flow->n_rests; ++k) {
        const int i = flow->rests[k];
        const pmj_lanes value = pmj_relative(flow, at, rest[i], i, h);
        bad = bad | ~(value <= DBL_MAX);
        most = pmj_max(value, most);
    }
    return pmj_select(bad, pmj_all(HUGE_VAL), most);
}

/* The error of steps of size h relative to the allowed one, from the guard on discs of `ratio` steps. */
static inline pmj_lanes pmj_guard_miss(const pmj_flow *flow, double tolerance, const pmj_stand *at, pmj_lanes h, pmj_lanes ratio,
                            pmj_lanes factor)
{
    pmj_lanes P[PMJ_MOST_CHANNELS];
    pmj_lanes rest[PMJ_MOST_CHANNELS];
    const pmj_lanes R = ratio * h;
    for (int k = 0; k < flow->n_states; ++k) {
        P[flow->states[k]] = pmj_spread(at->c, flow->channels, flow->order, flow->states[k], R);
    }
    flow->guard(at->t, at->c, at->g, at->p, &R, P, rest);
    return factor * pmj_largest_rest(flow, at, rest, h) * (1.0 / (PMJ_DEFECT * tolerance));
}

/* Lane w begins with the first disc. */
static inline void pmj_first_disc(const pmj_rule *rule, pmj_choice *likely, int w)
{
    likely->disc[w] = 0;
    likely->ratio[w] = rule->ratios[0];
    likely->factor[w] = rule->factors[0];
}

/* The slow path of `pmj_guarded_lanes`, if the likely disc is not enough for all lanes in `pending`. */
pmj_lanes pmj_search_discs(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                           pmj_lanes h, pmj_lanes smallest, pmj_mask pending, pmj_choice *likely);

/* The longest steps up to h, in the lanes of `on`, that the guard shows to be sound; 0 if there is none above
 * `smallest`. `likely` is the disc that proved each lane's last step. */
static inline pmj_lanes pmj_guarded_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                            pmj_lanes h, pmj_lanes smallest, pmj_mask on, pmj_choice *likely)
{
    const pmj_mask lost = ~(h >= smallest);
    h = pmj_select(lost, pmj_all(0.0), h);
    on = on & ~lost;
    if (flow->n_rests == 0) {
        return h;
    }
    const pmj_lanes miss = pmj_guard_miss(flow, tolerance, at, h, likely->ratio, likely->factor);
    if (!pmj_any(on & ~(miss <= 1.0))) {
        return h;
    }
    return pmj_search_discs(flow, rule, tolerance, at, h, smallest, on, likely);
}

/* The error of steps of size h relative to the allowed one, at the fraction `part` of them. */
pmj_lanes pmj_missed_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                           pmj_lanes h, double part);

/* When lane w's channel passes `level` in a direction, from 0 to before h; see loops/c/guard.c. */
int pmj_passes_lane(const pmj_flow *flow, const pmj_lanes *c, int w, int channel, double level, int touching,
                    int outward, double h, double *tau);

#endif
