/* The saturation modes of one run: (10), as intervals of v between thresholds; see pmjoint_codegen/loops/modes.py. */
#ifndef PMJOINT_ACTUATOR_H
#define PMJOINT_ACTUATOR_H

#include "lanes.h"
#include "pmjoint_chain.h"

/* Two of each channel, and five of a valve with a dead zone. */
#define PMJ_MOST_THRESHOLDS (2 * PMJ_NW + 5)
#define PMJ_CHAIN_SIZE ((long long)(sizeof(pmj_chain) / sizeof(double)))

typedef struct {
    int thresholds;
    double at[PMJ_MOST_THRESHOLDS];              /* values of v, ascending */
    double modes[PMJ_MOST_THRESHOLDS + 1][2 * PMJ_NW]; /* offset and slope of every channel of w */
    int labels[PMJ_MOST_THRESHOLDS + 1];         /* -1, 0, 1: u at its lower limit, inside, at its upper */
} pmj_actuator;

/* From (offset, slope, lower, upper) of every channel; those other than u follow the valve with a dead zone, if any. */
void pmj_make_actuator(const double *limits, const pmj_chain *valve, pmj_actuator *actuator);

/* Mode of a value of v: how many thresholds lie below it. */
int pmj_mode_of(const pmj_actuator *actuator, double v);

#endif
