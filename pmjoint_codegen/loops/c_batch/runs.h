/* The runs in the lanes of a group: the data common to both loops, and how runs enter and leave. */
#ifndef PMJOINT_RUNS_H
#define PMJOINT_RUNS_H

#include "actuator.h"
#include "guard_lanes.h"
#include "metrics.h"
#include "pmjoint_batch.h"

/* Entries of a row of a trajectory: X, v, e. */
#define SHOWN (PMJ_NS + 2)

/* Data of a lane that is rarely needed. */
typedef struct {
    long long run;        /* -1: the lane is empty */
    pmj_actuator actuator;
    long long segment;    /* the reference's present one */
    int mode;
    int touching;         /* kink j (sampled), or threshold, or their number + j (continuous), that the run is on, PMJ_NK more if it has let go, or -1 */
    int held;             /* the kink that holds the run, or -1 */
    int flips;            /* changes of side at kinks since time last advanced */
    int switches;
    double tolerance;     /* local error */
    int sticks;           /* times that a kink began to hold the run */
    long long row;        /* next output instant */
    int next_mode;        /* continuous: mode after the trial step */
    int crossing;         /* where the trial step ends, coded as `touching` */
    int undecided;        /* switches since time last advanced */
    int passes;           /* evaluations used to find the sides at the start */
    int before;           /* mode before the last switch */
    double last_switch;
} pmj_lane;

typedef struct {
    pmj_lanes X[PMJ_NS];
    pmj_lanes p[PMJ_NP];
    pmj_lanes t;
    pmj_lanes next_break; /* of the reference; infinite if there is none */
    pmj_lanes steps;      /* accepted */
    pmj_lanes low;        /* thresholds on both sides of the mode */
    pmj_lanes high;
    pmj_lanes limited;    /* 1.0 in a mode where u is at a limit */
    pmj_mask live;        /* the lane has a run */
    pmj_mask fresh;       /* a run has just been loaded: its mode is not known */
    pmj_mask stalled;     /* the guard has found no step */
    pmj_mask sliding;     /* both sides of a kink point back to it */
    pmj_choice likely;
    pmj_metrics metrics;
    pmj_lane lanes[PMJ_WIDTH];
    long long waiting;    /* the first waiting run */
    int busy;             /* lanes that are not empty */
} pmj_runs;

/* Before the first `pmj_load`: every lane counts as taken. */
void pmj_open(pmj_runs *runs);

/* Load the next waiting run into lane w, or leave the lane empty. */
void pmj_load(const pmj_sweep *sweep, pmj_runs *runs, int w);

/* The reference's segment at a time of lane w that may lie before its present one; any segment, put into its p. */
long long pmj_segment_at_lane(const pmj_sweep *sweep, const pmj_runs *runs, int w, double t);
void pmj_put_segment_lane(const pmj_sweep *sweep, pmj_runs *runs, int w, long long segment);

/* Put the reference's segment at time t into p of lane w. */
void pmj_enter_lane(const pmj_sweep *sweep, pmj_runs *runs, int w, double t);

/* Set the actuator of every lane that has just been loaded: one call for the group. */
void pmj_load_actuators(const pmj_sweep *sweep, pmj_runs *runs);

/* The thresholds beside a mode of lane w, and whether u is at a limit in it. */
void pmj_set_thresholds(pmj_runs *runs, int w, int mode);

/* Record how the run of lane w ended, with the error e. */
void pmj_finish(const pmj_sweep *sweep, const pmj_results *results, const pmj_runs *runs, int w, int status, double e);

#endif
