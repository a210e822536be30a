/* The lanes of the continuous loop: their contents, and how runs enter and leave them. */
#ifndef PMJOINT_CONTINUOUS_LANES_H
#define PMJOINT_CONTINUOUS_LANES_H

#include "stick_lanes.h"

/* Channels of `taylor_lanes`: X, v, e, then the arguments of kinks. */
#define V PMJ_NS
#define E (PMJ_NS + 1)
#define CHANNELS (PMJ_NS + 2 + PMJ_NK)

/* A group of lanes. */
typedef struct {
    pmj_runs runs;
    pmj_lanes c[2][(PMJ_ORDER + 1) * CHANNELS]; /* coefficients: of the trial step, and at its end */
    pmj_lanes X_before[PMJ_NS]; /* where the trial step began */
    pmj_lanes g[2 * (PMJ_NW + PMJ_NK)]; /* the mode, then sides and flags */
    pmj_lanes g_before[2 * (PMJ_NW + PMJ_NK)]; /* of the trial step */
    pmj_lanes slope[PMJ_NS];
    pmj_lanes ends[CHANNELS - PMJ_NS]; /* values of the other channels at the end of the trial step */
    pmj_lanes missed;     /* the trial step's error at points inside it, relative to the allowed one */
    pmj_lanes scales[CHANNELS]; /* 1/max(1, |c_0|) of the trial step */
    pmj_lanes control;    /* the same of v at its peak so far */
    pmj_lanes v[PMJ_ORDER + 1];  /* of the trial step, a_k = c_k h^k */
    pmj_lanes e[PMJ_ORDER + 1];
    pmj_lanes square;     /* mean of e^2 over it */
    pmj_lanes t_before;
    pmj_lanes h;          /* of the trial step */
    pmj_lanes h_most;     /* the remaining length of a rejected step, else infinite */
    pmj_lanes h_guarded;  /* the length that the guard accepted */
    pmj_lanes h_first;    /* the length requested of it */
    pmj_lanes last_cut;   /* the last step, if the guard cut it, else infinite */
    pmj_lanes tried;      /* steps tried */
    pmj_lanes limited_before; /* `limited` of the trial step: a crossing at its end sets the next mode's */
    pmj_mask on_trial;    /* there is a step whose end is not checked yet */
    pmj_mask entered;     /* the reference's next segment has begun: the mode of v there is not known */
    pmj_mask alert;       /* a trial step ends at a threshold, or began on one */
    pmj_mask touching;    /* v is on a threshold of the mode */
    pmj_mask stuck;       /* rounding decides the mode: time has not advanced */
} pmj_group;

/* The guard, and that of lanes that a kink holds. */
static inline void pmj_loop_guard(const pmj_lanes *t, const pmj_lanes *X, const pmj_lanes *g, const pmj_lanes *p,
                                  const pmj_lanes *R, const pmj_lanes *P, pmj_lanes *restrict rest)
{
    PMJ_EITHER(g + 2 * PMJ_NW, CHANNELS, rest, pmj_guard_lanes, pmj_guard_held_lanes, t, X, g, p, R, P);
}

/* The rates, and those of lanes that a kink holds. */
static inline void pmj_loop_rates(const pmj_lanes *t, const pmj_lanes *X, const pmj_lanes *g, const pmj_lanes *p,
                                  pmj_lanes *restrict rates)
{
    PMJ_EITHER(g + 2 * PMJ_NW, CHANNELS, rates, pmj_rates_lanes, pmj_rates_held_lanes, t, X, g, p);
}

/* The closed loop, for the checks of its steps; a constant that the compiler sees. */
static inline pmj_flow pmj_closed_loop(void)
{
    static const int states[] = PMJ_LOOP_BENT_STATES_LIST;
    static const int rests[] = PMJ_LOOP_BENT_RESTS_LIST;
    const pmj_flow flow = {
        CHANNELS, PMJ_NS, V, PMJ_ORDER, states, PMJ_LOOP_BENT_STATES, rests, PMJ_LOOP_BENT_RESTS, pmj_loop_guard, pmj_loop_rates,
    };
    return flow;
}

/* Put lane w into a mode. */
void pmj_set_mode(pmj_group *all, int w, int mode);

/* Load the next waiting run into lane w; `pmj_enter` sets its actuator. */
void pmj_load_lane(const pmj_sweep *sweep, pmj_group *all, int w);

/* Set the actuators of all lanes that have just been loaded, in the first mode. */
void pmj_enter(const pmj_sweep *sweep, pmj_group *all);

/* The mode of lane w changes at t; a touch, there and back at one instant, is none. */
void pmj_cross(pmj_group *all, int w, double t);

/* Output rows of lane w in its accepted step, from the polynomial `c` that began at t_before. */
void pmj_write_rows(const pmj_sweep *sweep, const pmj_results *results, pmj_group *all, const pmj_lanes *c, int w);

#endif
