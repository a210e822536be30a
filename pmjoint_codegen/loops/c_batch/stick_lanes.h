/* Stick, lane by lane: loops/c/stick.c over vectors. Of models without a kink that can hold a run nothing is left of it. */
#ifndef PMJOINT_STICK_LANES_H
#define PMJOINT_STICK_LANES_H

#include "runs.h"

/* The lanes that a kink holds, by the flags behind their sides. */
static inline pmj_mask pmj_held(const pmj_lanes *sides)
{
    pmj_mask held = {0};
    for (int j = 0; j < PMJ_NK; ++j) {
        held = held | (sides[PMJ_NK + j] != 0.0);
    }
    return held;
}

/* 1.0 in the lanes that a kink holds. */
static inline pmj_lanes pmj_stuck(const pmj_lanes *sides)
{
#ifdef PMJ_HOLDS
    return pmj_select(pmj_held(sides), pmj_all(1.0), pmj_all(0.0));
#else
    (void)sides;
    return pmj_all(0.0);
#endif
}

/* Results of a kernel, and for the lanes that a kink holds those of its twin for them. */
#ifdef PMJ_HOLDS
#define PMJ_EITHER(sides, size, result, kernel, twin, ...)     \
    do {                                                       \
        const pmj_mask either_held = pmj_held(sides);          \
        kernel(__VA_ARGS__, result);                           \
        if (pmj_any(either_held)) {                            \
            pmj_lanes either_other[size];                      \
            twin(__VA_ARGS__, either_other);                   \
            for (int either_i = 0; either_i < (size); ++either_i) { \
                result[either_i] = pmj_select(either_held, either_other[either_i], result[either_i]); \
            }                                                  \
        }                                                      \
    } while (0)
#else
#define PMJ_EITHER(sides, size, result, kernel, twin, ...) kernel(__VA_ARGS__, result)
#endif

/* Lane w arrives at a kink, or the kink that holds it has reached `side` and lets go: it stops there, or passes. x and
 * `sides`, with the flags, are changed; `w_lanes` is what the actuator delivers, then the sides; `first` is the value of
 * `touching` on kink 0. */
void pmj_meet_lane(pmj_runs *runs, pmj_lanes t, pmj_lanes *x, const pmj_lanes *w_lanes, pmj_lanes *sides, int w, int kink,
                   double side, int first);

/* Under a new output of the actuator: whether the kink that holds lane w still does; or whether one of those with the
 * argument 0 begins to. 1 if anything changes. */
int pmj_find_rest_lane(pmj_runs *runs, pmj_lanes t, pmj_lanes *x, const pmj_lanes *w_lanes, pmj_lanes *sides, int w,
                       const pmj_lanes *arguments, int first);

/* When lane w passes kink j, whose side is `side`, or that lets go of it: see `pmj_first_kink` in loops/c/guard.c. */
int pmj_passes_kink(const pmj_flow *flow, const pmj_lanes *c, const pmj_lane *one, int w, int first_channel, int j,
                    double side, int first, double h, double *when);

#endif
