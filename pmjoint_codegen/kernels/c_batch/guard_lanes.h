/* Whether steps follow the right-hand side all along, lane by lane: kernels/c/guard.c over vectors. */
#ifndef PMJOINT_GUARD_LANES_H
#define PMJOINT_GUARD_LANES_H

#include "lanes.h"
#include "pmjoint_batch.h"

/* The most channels that either loop has. */
#define PMJ_MOST_CHANNELS (PMJ_NS + 2 + PMJ_NK)

/* A right-hand side over lanes: the first `rates` of its channels have rates, the others are values; `v` is the place
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

/* Where a step stands. */
typedef struct {
    const pmj_lanes *t;
    const pmj_lanes *c;      /* [(order + 1) channels] */
    const pmj_lanes *g;      /* actuation, then sides */
    const pmj_lanes *p;
    const pmj_lanes *scales; /* [channels] 1/max(1, |c_0|) */
    pmj_lanes control;       /* 1/max(1, |v|), v at its peak so far */
} pmj_stand;

/* Factor on a step that misses by `miss` times what is allowed, an error of the given order: 0.55 to 0.95. */
pmj_lanes pmj_shrink_lanes(pmj_lanes miss, int order);

/* The largest of `values`, each relative to its channel's scale, of rates over a step of size h; infinite for no number. */
pmj_lanes pmj_largest_lanes(const pmj_flow *flow, const pmj_stand *at, const pmj_lanes *values, pmj_lanes h);

/* How far a channel can go from its start where time goes anywhere in a disc of radius R. */
static inline pmj_lanes pmj_spread(const pmj_lanes *c, int channels, int order, int channel, pmj_lanes R)
{
    pmj_lanes sum = pmj_abs(c[order * channels + channel]);
    for (int k = order - 1; k >= 1; --k) {
        sum = sum * R + pmj_abs(c[k * channels + channel]);
    }
    return sum * R;
}

/* The longest steps up to h, in the lanes of `on`, that the guard shows to be sound; 0 where there is none above
 * `smallest`. `likely` is the disc that showed each lane's last step. */
pmj_lanes pmj_guarded_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                            pmj_lanes h, pmj_lanes smallest, pmj_mask on, int *likely);

/* How much of what is allowed steps of size h miss at the time `part` of them. */
pmj_lanes pmj_missed_lanes(const pmj_flow *flow, const pmj_rule *rule, double tolerance, const pmj_stand *at,
                           pmj_lanes h, double part);

/* When lane w's channel passes `level` in a direction, from 0 to before h; see kernels/c/guard.c. */
int pmj_passes_lane(const pmj_flow *flow, const pmj_lanes *c, int w, int channel, double level, int touching,
                    int outward, double h, double *tau);

#endif
