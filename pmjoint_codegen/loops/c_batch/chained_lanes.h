/* Samples of lanes with sensor, actuator and clock; see loops/c/chained.c, which does the same for one run. */
#ifndef PMJOINT_CHAINED_LANES_H
#define PMJOINT_CHAINED_LANES_H

#include "sampled_lanes.h"

/* The instants of this sample and of the next. */
void pmj_chained_instants(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_lanes *t, pmj_lanes *end);

/* What the sensor reads at the samples of the lanes in `at`, and v; where a run is fresh, e(0) too. */
void pmj_chained_control(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask at);

/* Command, then integrate the plant from t to the next sample or the horizon, cut where the command that acts changes.
 * Gives the error at the end. */
pmj_lanes pmj_chained_hold(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_lanes end);

#endif
