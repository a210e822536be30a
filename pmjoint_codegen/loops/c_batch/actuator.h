/* The saturation modes of one run: (10), as intervals of v between thresholds; see pmjoint_codegen/loops/modes.py. */
#ifndef PMJOINT_ACTUATOR_H
#define PMJOINT_ACTUATOR_H

#include "lanes.h"

typedef struct {
    int thresholds;
    double at[2 * PMJ_NW];                       /* values of v, ascending */
    double modes[2 * PMJ_NW + 1][2 * PMJ_NW];    /* offset and slope of every channel of w */
    int labels[2 * PMJ_NW + 1];                  /* -1, 0, 1: u at its lower limit, inside, at its upper */
} pmj_actuator;

/* From (offset, slope, lower, upper) of every channel. */
void pmj_make_actuator(const double *limits, pmj_actuator *actuator);

/* Mode of a value of v: how many thresholds lie below it. */
int pmj_mode_of(const pmj_actuator *actuator, double v);

#endif
