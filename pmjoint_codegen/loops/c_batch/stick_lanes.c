#include "stick_lanes.h"
#include "pmjoint_runtime.h"

#include <math.h>

#ifdef PMJ_HOLDS
/* Whether kink j can hold lane w, the side with which it would, and its zero. */
static int can_hold(const pmj_runs *runs, pmj_lanes t, const pmj_lanes *x, const pmj_lanes *w_lanes, int w, int j,
                    double *side, double *place)
{
    pmj_lanes value[PMJ_NK];
    pmj_lanes pull[PMJ_NK];
    pmj_lanes places[PMJ_NK * PMJ_NX];
    pmj_holds_lanes(&t, x, w_lanes, runs->p, value, pull, places);
    for (int i = 0; i < PMJ_NX; ++i) {
        place[i] = places[j * PMJ_NX + i][w];
    }
    *side = value[j][w];
    return fabs(*side) <= 1.0 && pull[j][w] < 0.0;
}

static void hold_on(pmj_lane *one, pmj_lanes *x, pmj_lanes *sides, int w, int j, const double *place)
{
    for (int i = 0; i < PMJ_NX; ++i) {
        x[i][w] = place[i];
    }
    one->held = j;
    one->sticks += 1;
    one->touching = -1;
    sides[PMJ_NK + j][w] = 1.0;
}

static void let_go(pmj_lane *one, pmj_lanes *sides, int w, double side, int first)
{
    const int j = one->held;
    sides[j][w] = side < 0.0 ? -1.0 : 1.0;
    sides[PMJ_NK + j][w] = 0.0;
    one->held = -1;
    one->touching = first + PMJ_NK + j;
}
#endif

void pmj_meet_lane(pmj_runs *runs, pmj_lanes t, pmj_lanes *x, const pmj_lanes *w_lanes, pmj_lanes *sides, int w, int kink,
                   double side, int first)
{
    pmj_lane *one = &runs->lanes[w];
    int passes = 1;
#ifdef PMJ_HOLDS
    double place[PMJ_NX];
    if (one->held == kink) {
        let_go(one, sides, w, side, first);
        passes = 0;
    } else if (one->held < 0 && can_hold(runs, t, x, w_lanes, w, kink, &side, place)) {
        hold_on(one, x, sides, w, kink, place);
        passes = 0;
    }
#else
    (void)t;
    (void)x;
    (void)w_lanes;
    (void)side;
#endif
    if (passes) {
        sides[kink][w] = -sides[kink][w];
        one->touching = first + kink;
    }
    one->flips += 1;
    if (one->flips > 2 * PMJ_NK) {
        runs->sliding[w] = -1;
    }
}

int pmj_find_rest_lane(pmj_runs *runs, pmj_lanes t, pmj_lanes *x, const pmj_lanes *w_lanes, pmj_lanes *sides, int w,
                       const pmj_lanes *arguments, int first)
{
#ifdef PMJ_HOLDS
    pmj_lane *one = &runs->lanes[w];
    double side = 0.0;
    double place[PMJ_NX];
    if (one->held >= 0) {
        const int goes = !can_hold(runs, t, x, w_lanes, w, one->held, &side, place);
        if (goes) {
            let_go(one, sides, w, side, first);
        }
        return goes;
    }
    for (int j = 0; j < PMJ_NK; ++j) {
        if (arguments[j][w] == 0.0 && can_hold(runs, t, x, w_lanes, w, j, &side, place)) {
            hold_on(one, x, sides, w, j, place);
            return 1;
        }
    }
#else
    (void)runs;
    (void)t;
    (void)x;
    (void)w_lanes;
    (void)sides;
    (void)w;
    (void)arguments;
    (void)first;
#endif
    return 0;
}

int pmj_passes_kink(const pmj_flow *flow, const pmj_lanes *c, const pmj_lane *one, int w, int first_channel, int j,
                    double side, int first, double h, double *when)
{
    const double outward = side > 0.0 ? -1.0 : 1.0;
    int on = one->touching == first + j ? PMJ_ON_KINK : one->touching == first + PMJ_NK + j ? PMJ_LET_GO : 0;
    if (one->held != j) {
        double level = 0.0;
        if (one->flips > PMJ_NK && fabs(c[first_channel + j][w]) <= one->tolerance
            && fabs(c[flow->channels + first_channel + j][w]) <= one->tolerance) {
            on = 0;
            level = outward * one->tolerance;
        }
        return pmj_passes_lane(flow, c, w, first_channel + j, level, on, (int)outward, h, when);
    }
    int found = 0;
    for (int end = -1; end <= 1; end += 2) {
        if (pmj_passes_lane(flow, c, w, first_channel + j, (double)end, 0, end, h, when)) {
            found = 1;
            h = *when;
        }
    }
    return found;
}
