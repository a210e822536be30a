/* What a sweep reports of a run, gathered step by step from the polynomials of e and v; see pmjoint_codegen/sweep/metrics.py.
 *
 * A polynomial is given by a_k = c_k h^k, so that s = 0 is the start of the step and s = 1 its end.
 */
#ifndef PMJOINT_METRICS_H
#define PMJOINT_METRICS_H

#include "lanes.h"

typedef struct {
    pmj_lanes ise;
    pmj_lanes max_e;
    pmj_lanes max_v;
    pmj_lanes band;      /* |e| within which it has settled */
    pmj_lanes settling;  /* the last instant so far at which |e| exceeds the band */
    pmj_lanes saturated; /* time in modes other than 0 */
} pmj_metrics;

/* a[k] = c[k * width] h^k. */
void pmj_scale(const pmj_lanes *c, int width, int degree, pmj_lanes h, pmj_lanes *a);

/* Sum of |a_k|, k >= 2: how far the polynomial can go from the line a_0 + a_1 s. */
pmj_lanes pmj_reach(const pmj_lanes *a, int degree);

/* Take in the error over steps [t, t + h] of the lanes in `taken`; `square` is the mean of e^2. */
void pmj_note_error(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_lanes square, pmj_lanes t, pmj_lanes h,
                    pmj_mask taken);

/* Integral over s in [0, 1] of the polynomial's square, by three Gauss nodes: for the short steps of a hold. */
pmj_lanes pmj_mean_square(const pmj_lanes *a, int degree);

/* Take in v over the same. */
void pmj_note_control(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_mask taken);

/* The lanes of `among` in which the polynomial may leave the open interval (low, high) on [0, 1], or on (0, 1] where it is
 * `touching` an end at s = 0; none that does is missing. */
pmj_mask pmj_may_leave(const pmj_lanes *a, int degree, pmj_lanes low, pmj_lanes high, pmj_mask among,
                       pmj_mask touching);

#endif
