/* Many runs of the closed loop at once, each in its own lane: the C side of pmjoint_codegen/sweep.
 *
 * A lane has its own time, step, saturation mode and parameters; when its run ends, the next waiting run takes the lane.
 * Nothing here allocates or keeps state between calls, and calls on disjoint runs may run in several threads.
 *
 * Python reads the declarations below without preprocessing: keep `#` lines free of declarations.
 */
#ifndef PMJOINT_BATCH_H
#define PMJOINT_BATCH_H

#include "metric_rows.h" /* PMJ_METRICS */

/* How steps are checked against the right-hand side; see loops/guard.py. */
typedef struct {
    const double *inside;    /* [n_inside] points of comparison, as fractions of a step, besides its end */
    long long n_inside;
    double lebesgue;         /* factor on the largest defect found there */
    const double *ratios;    /* [n_ratios] radii of discs, as multiples of a step */
    const double *factors;   /* [n_ratios] bound on a step's error, as a multiple of the nonlinear part on the disc */
    long long n_ratios;
} pmj_rule;

/* The runs. Arrays are row-major, one row per run; sizes in brackets. */
typedef struct {
    long long runs;
    const double *x0;        /* [runs][nX] X(0) */
    const double *p;         /* [runs][np] parameters */
    const double *hold;      /* sampled: [runs or 1][nh] matrices of the zero-order hold */
    long long hold_stride;   /* sampled: nh, or 0 where one serves all runs */
    const double *breaks;    /* [n_breaks] instants at which the reference's next segment begins, ascending, inside the run */
    const double *segments;  /* [n_breaks + 1][n_segment] what ends p on each */
    long long n_breaks;
    long long n_segment;     /* 0: the reference is an expression of t */
    const double *chain;     /* [runs][13] a `pmj_chain` of pmjoint_chain.h each; null: none */
    long long looped;        /* sampled: whether the loop acts on sensor, actuator and clock */
    double *history;         /* looped: [n_history][nw][width] memory for commands that act later */
    long long n_history;
    const double *times;     /* [rows] output instants of X, v and e, ascending, from 0; may be null */
    long long rows;
    double horizon;          /* s */
    double sample_time;      /* s; sampled */
    double tolerance;        /* local error, relative to max(1, |value|) */
    double max_step;         /* s */
    double settled;          /* fraction of |e(0)|: e has settled once it stays within it */
    pmj_rule rule;           /* of steps of `taylor_lanes`; sampled: of `plant_lanes` */
    pmj_rule hold_rule;      /* sampled: of holds without points of comparison; factors are those of rates */
    const double *hold_value_factors; /* [hold_rule.n_ratios] of values */
    double divergence;       /* sampled: |X_i| above it ends a run */
    const double *reach;     /* continuous: [nX] the same state by state; infinite where one may go anywhere */
    double max_steps;        /* limit of steps tried */
} pmj_sweep;

/* Their results. */
typedef struct {
    double *metrics;         /* [runs][PMJ_METRICS] */
    double *final;           /* [runs][nX] X at the horizon, or where the run ended */
    double *trajectories;    /* [runs][rows][nX + 2]: X, v, e; null without `times` */
} pmj_results;

/* batch_continuous.c */
void pmj_continuous_batch(const pmj_sweep *sweep, const pmj_results *results);

/* batch_sampled.c */
void pmj_sampled_batch(const pmj_sweep *sweep, const pmj_results *results);

/* matrices.c: A0 of (14) and Ar of (23), [runs][PMJ_NM] */
void pmj_matrices(long long runs, const double *p, double *matrices);

/* matrices.c: the controller's state matched to y(0), [runs][nX - nx]; y is [runs] */
void pmj_starts(long long runs, const double *y, const double *p, double *states);

/* matrices.c: the number of lanes that the library was built for */
long long pmj_width(void);

#endif
