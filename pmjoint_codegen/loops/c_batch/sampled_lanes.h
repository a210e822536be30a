/* The lanes of the sampled loop: their contents, and their holds. */
#ifndef PMJOINT_SAMPLED_LANES_H
#define PMJOINT_SAMPLED_LANES_H

#include "stick_lanes.h"

/* Channels of `plant_lanes`: x, e, then the arguments of kinks. */
#define E PMJ_NX
#define CHANNELS (PMJ_NX + 1 + PMJ_NK)
#define N_CONTROLLER (PMJ_NS - PMJ_NX) /* the controller's states */

typedef struct {
    pmj_runs runs;            /* X at the sample */
    pmj_lanes c[(PMJ_HOLD_ORDER + 1) * CHANNELS];
    pmj_lanes h[PMJ_NH];
    pmj_lanes x[PMJ_NX];      /* plant states inside the hold */
    pmj_lanes next[N_CONTROLLER];        /* controller states at the next sample */
    pmj_lanes w[PMJ_NW + 2 * PMJ_NK]; /* the actuator's output, then sides and flags */
    pmj_lanes window_t;       /* for which the guard is known: t and its radius, */
    pmj_lanes window_R;
    pmj_lanes window_x[PMJ_NX]; /* x and its radii */
    pmj_lanes window_P[PMJ_NX];
    pmj_lanes v;
    pmj_lanes sample;         /* index of the sample */
    pmj_lanes y;              /* with sensor, actuator and clock: what the law takes for y, */
    pmj_lanes y_r[PMJ_RHO + 1]; /* the reference and its derivatives, */
    pmj_lanes command;        /* the last command, */
    pmj_lanes limits[4 * PMJ_NW]; /* offset, slope, lower and upper limit of each channel, */
    long long acting[PMJ_WIDTH]; /* and the first sample whose command does not act yet */
    pmj_mask overflow;        /* the stalled lanes whose coefficients are NaN */
} pmj_sampled_group;

/* Integrate the plant of the lanes in `on` for the time `length` under constant w; `c` is expanded at t.
 * Gives the error at the end. */
pmj_lanes pmj_hold_lanes(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_mask on,
                         pmj_lanes length);

#endif
