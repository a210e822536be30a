/* The runs in the lanes of a group: what both loops keep of them, and how they enter and leave. */
#ifndef PMJOINT_RUNS_H
#define PMJOINT_RUNS_H

#include "actuator.h"
#include "guard_lanes.h"
#include "metrics.h"
#include "pmjoint_batch.h"

/* Entries of a row of a trajectory: X, v, e. */
#define SHOWN (PMJ_NS + 2)

/* What a lane needs only now and then. */
typedef struct {
    long long run;        /* -1: the lane is empty */
    pmj_actuator actuator;
    int mode;
    int touching;         /* kink j (sampled), or threshold, or their number + j (continuous), that the run stands on, or -1 */
    int flips;            /* changes of side at kinks since time last moved */
    int switches;
    long long row;        /* next output instant */
    int next_mode;        /* continuous: mode after the step on trial */
    int crossing;         /* where the step on trial ends, as `touching` has it */
    int undecided;        /* switches since time last moved */
    int passes;           /* evaluations that the sides at the start have taken */
    int before;           /* mode before the last switch */
    double last_switch;
} pmj_lane;

typedef struct {
    pmj_lanes X[PMJ_NS];
    pmj_lanes p[PMJ_NP];
    pmj_lanes t;
    pmj_lanes steps;      /* accepted */
    pmj_lanes low;        /* thresholds on both sides of the mode */
    pmj_lanes high;
    pmj_lanes limited;    /* 1.0 in a mode where u stands at a limit */
    pmj_mask live;        /* a run is in the lane */
    pmj_mask fresh;       /* a run has just been loaded: its mode is not known */
    pmj_mask stalled;     /* the guard has found no step */
    pmj_mask sliding;     /* both sides of a kink point back to it */
    pmj_choice likely;
    pmj_metrics metrics;
    pmj_lane lanes[PMJ_WIDTH];
    long long waiting;    /* the first run that waits */
    int busy;             /* lanes that are not empty */
} pmj_runs;

/* Before the first `pmj_load`: every lane is taken, as far as that counts. */
void pmj_open(pmj_runs *runs);

/* The next waiting run into lane w, or an empty lane that stands still. */
void pmj_load(const pmj_sweep *sweep, pmj_runs *runs, int w);

/* The actuator of every lane that has just been loaded: one call for the group. */
void pmj_load_actuators(pmj_runs *runs);

/* The thresholds beside a mode of lane w, and whether u stands at a limit in it. */
void pmj_set_thresholds(pmj_runs *runs, int w, int mode);

/* Lane w goes to the other side of a kink, on which it then stands. */
void pmj_flip(pmj_runs *runs, pmj_lanes *side, int w, int touching);

/* Write down how the run of lane w ended, with which error e. */
void pmj_finish(const pmj_sweep *sweep, const pmj_results *results, const pmj_runs *runs, int w, int status, double e);

#endif
