/* The metrics of a run in a sweep, gathered step by step from the polynomials of e and v; see pmjoint_codegen/loops/metrics.py.
 *
 * A polynomial is given by a_k = c_k h^k, so that s = 0 is the start of the step and s = 1 its end.
 */
#ifndef PMJOINT_METRICS_H
#define PMJOINT_METRICS_H

#include "lanes.h"
#include "metric_rows.h"

typedef struct {
    pmj_lanes max_e;
    pmj_lanes max_v;
    pmj_lanes band;      /* |e| within which it has settled */
    pmj_lanes settling;  /* the last instant so far at which |e| exceeds the band */
    pmj_lanes sums[PMJ_METRICS]; /* of the rows with sums; the others' are not used */
} pmj_metrics;

/* Steps from t to t + h, as rows use them: those of the lanes in `taken`. */
typedef struct {
    pmj_mask taken;
    pmj_lanes t;
    pmj_lanes h;
    const pmj_lanes *e;
    int e_degree;
    const pmj_lanes *v;  /* sampled: of degree 0 */
    int v_degree;
    pmj_lanes square;    /* mean of e^2 */
    pmj_lanes limited;   /* 1.0 where u is at a limit */
    pmj_lanes stuck;     /* 1.0 where a kink holds the plant */
} pmj_span;

/* Reset lane w. */
void pmj_clear_metrics(pmj_metrics *metrics, int w);

/* A run of lane w begins with e and v; it has settled once e stays within a fraction of that. */
void pmj_start_metrics(pmj_metrics *metrics, int w, double e, double v, double settled);

/* a[k] = c[k * width] h^k. */
void pmj_scale(const pmj_lanes *c, int width, int degree, pmj_lanes h, pmj_lanes *a);

/* Process steps: sums, and the error's largest magnitude and settling. */
void pmj_note_step(pmj_metrics *metrics, const pmj_span *step);

/* Integral over s in [0, 1] of the polynomial's square, by three Gauss nodes: for the short steps of a hold. */
pmj_lanes pmj_mean_square(const pmj_lanes *a, int degree);

/* Process v over steps. */
void pmj_note_control(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_mask taken);

/* The lanes of `among` in which the polynomial may leave the open interval (low, high) on [0, 1], or on (0, 1] if it is
 * `touching` an end at s = 0; no lane that leaves it is missed. */
pmj_mask pmj_may_leave(const pmj_lanes *a, int degree, pmj_lanes low, pmj_lanes high, pmj_mask among,
                       pmj_mask touching);

#endif
