/* What a page sees of the closed loop: places to put settings into, functions that use them, places to read from.
 *
 * There is one run at a time, so its memory is static. The page finds a place by its number, below; the order is also that
 * of PLACES in web/engine.js. Everything is a double: whole numbers too.
 */
#ifndef PMJOINT_EXPLORER_H
#define PMJOINT_EXPLORER_H

#include "explorer_model.h"

enum {
    PLACE_P,            /* [PMJ_NP] parameters */
    PLACE_STATE,        /* [PMJ_NS] X(0) */
    PLACE_SETTINGS,     /* [SETTINGS] */
    PLACE_LIMITS,       /* [4 nw] written by explorer_actuation */
    PLACE_THRESHOLDS,   /* [MOST_THRESHOLDS] */
    PLACE_MODES,        /* [MOST_THRESHOLDS + 1][2 nw] */
    PLACE_CHAIN,        /* [13] */
    PLACE_BREAKS,       /* [MOST_BREAKS] */
    PLACE_SEGMENTS,     /* [MOST_BREAKS + 1][n_segment] */
    PLACE_TIMES,        /* [MOST_ROWS] output instants */
    PLACE_RESULTS,      /* [RESULTS] */
    PLACE_ROWS,         /* [rows][PMJ_NS] X at the output instants */
    PLACE_SIGNALS,      /* [rows][N_SIGNALS] */
    PLACE_PEAKS,        /* [PMJ_NS + 3] */
    PLACE_PEAK_TIMES,   /* the same */
    PLACE_SWITCH_TIMES, /* [switches] */
    PLACE_SWITCH_MODES, /* the same */
    PLACE_FILTER,       /* [n^2] A0, written by explorer_actuation */
    PLACES
};

/* Entries of the settings. */
enum { HORIZON, SAMPLE_TIME, DIVERGENCE, N_ROWS, N_THRESHOLDS, N_BREAKS, N_HISTORY, SETTINGS };

/* Entries of the results. */
enum { STATUS, REACHED, ROW, STEPS, INTEGRAL, BAND, SETTLED, FIRST_MODE, SWITCHES, TOUCHING, STUCK, RESULTS };

#define MOST_ROWS 10001
#define MOST_THRESHOLDS 32
#define MOST_SWITCHES 20000
#define MOST_BREAKS 4096
#define MOST_HISTORY 4096

/* Memory of the run. */
extern double explorer_p[];
extern double explorer_filter[];
extern double explorer_compensator[];

/* hold_matrices.c: the matrices of `sampled_update` for the hold of `sample_time` */
void explorer_hold(double sample_time, double *hold);

/* signals.c: signals at the output instants, from the run's rows */
int explorer_report(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double *signals);

#endif
