#include "metrics.h"
#include "pmjoint_runtime.h"

/* An extremum that would raise a peak by less than this, relative, is not searched for. */
#define EXTREMUM 1e-10
/* Rounding of Bernstein coefficients, relative to the sum of |a_k|: degree^2 additions, a safe bound. */
#define NOISE 1e-12

void pmj_clear_metrics(pmj_metrics *metrics, int w)
{
    metrics->max_e[w] = 0.0;
    metrics->max_v[w] = 0.0;
    metrics->settling[w] = 0.0;
    for (int i = 0; i < PMJ_METRICS; ++i) {
        metrics->sums[i][w] = 0.0;
    }
}

void pmj_start_metrics(pmj_metrics *metrics, int w, double e, double v, double settled)
{
    metrics->band[w] = settled * fabs(e);
    metrics->max_e[w] = fabs(e);
    metrics->max_v[w] = fabs(v);
}

void pmj_scale(const pmj_lanes *c, int width, int degree, pmj_lanes h, pmj_lanes *a)
{
    pmj_lanes power = h;
    a[0] = c[0];
    for (int k = 1; k <= degree; ++k) {
        a[k] = c[k * width] * power;
        power = power * h;
    }
}

/* Sum of |a_k|, k >= 2: how far the polynomial can deviate from the line a_0 + a_1 s. */
static pmj_lanes bend(const pmj_lanes *a, int degree)
{
    pmj_lanes sum = pmj_abs(a[2]);
    for (int k = 3; k <= degree; ++k) {
        sum = sum + pmj_abs(a[k]);
    }
    return sum;
}

pmj_lanes pmj_mean_square(const pmj_lanes *a, int degree)
{
    static const double nodes[3] = PMJ_SHORT_NODES;
    static const double weights[3] = PMJ_SHORT_WEIGHTS;
    pmj_lanes sum = pmj_all(0.0);
    for (int i = 0; i < 3; ++i) {
        pmj_lanes value = a[degree];
        for (int k = degree - 1; k >= 0; --k) {
            value = value * nodes[i] + a[k];
        }
        sum = sum + value * value * weights[i];
    }
    return sum;
}

/* Bernstein coefficients on [0, 1] of sum_k a_k s^k: their largest and smallest bound the polynomial, closely. */
static void bernstein(const pmj_lanes *a, int degree, pmj_lanes *b)
{
    if (degree == PMJ_ORDER) {
        pmj_bernstein_lanes(a, b);
        return;
    }
    double binomial = 1.0;
    for (int k = 0; k <= degree; ++k) {
        b[k] = a[k] * (1.0 / binomial);
        binomial = binomial * (double)(degree - k) / (double)(k + 1);
    }
    for (int level = 1; level <= degree; ++level) {
        for (int j = degree; j >= level; --j) {
            b[j] = b[j] + b[j - 1];
        }
    }
}

static pmj_lanes hulls(const pmj_lanes *b, int degree)
{
    pmj_lanes most = pmj_abs(b[0]);
    for (int j = 1; j <= degree; ++j) {
        most = pmj_max(pmj_abs(b[j]), most);
    }
    return most;
}

/* The polynomial of one lane, for the functions of polynomial.c. */
static void take_lane(const pmj_lanes *a, int degree, int w, double *one)
{
    for (int k = 0; k <= degree; ++k) {
        one[k] = a[k][w];
    }
}

/* Raise `peak` to the largest magnitude on the step if the inside may exceed it; it includes the ends already. */
static void look_inside(pmj_lanes *peak, const pmj_lanes *a, const pmj_lanes *b, int degree, pmj_mask among)
{
    const pmj_mask inside = (hulls(b, degree) > *peak * (1.0 + EXTREMUM)) & among;
    if (pmj_any(inside)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (inside[w]) {
                double one[PMJ_MAX_ORDER + 1];
                double most = (*peak)[w];
                double when = 0.0;
                take_lane(a, degree, w, one);
                pmj_note_extremum(one, 1, degree, 0.0, 1.0, &most, &when);
                (*peak)[w] = most;
            }
        }
    }
}

/* Raise `peak` to |a_0| and to the magnitude `end` at the step's end. */
static pmj_lanes raised(pmj_lanes peak, pmj_lanes start, pmj_lanes end, pmj_mask taken)
{
    return pmj_select(taken, pmj_max(pmj_max(pmj_abs(start), pmj_abs(end)), peak), peak);
}

static pmj_lanes total(const pmj_lanes *a, int degree)
{
    pmj_lanes sum = a[degree];
    for (int k = degree - 1; k >= 0; --k) {
        sum = sum + a[k];
    }
    return sum;
}

/* The largest |e| and when it settles. */
static void note_error(pmj_metrics *metrics, const pmj_span *step)
{
    const pmj_lanes *a = step->e;
    const int degree = step->e_degree;
    const pmj_lanes end = total(a, degree);
    const pmj_lanes bound = pmj_max(pmj_abs(a[0]), pmj_abs(a[0] + a[1])) + bend(a, degree);
    const pmj_mask at_end = (pmj_abs(end) > metrics->band) & step->taken;
    const pmj_mask outside = (bound > metrics->band) & step->taken & ~at_end;
    metrics->settling = pmj_select(at_end, step->t + step->h, metrics->settling);
    metrics->max_e = raised(metrics->max_e, a[0], end, step->taken);
    const pmj_mask larger = (bound > metrics->max_e) & step->taken;
    if (pmj_any(larger | outside)) {
        pmj_lanes b[PMJ_MAX_ORDER + 1];
        bernstein(a, degree, b);
        look_inside(&metrics->max_e, a, b, degree, larger);
        const pmj_mask inside = (hulls(b, degree) > metrics->band) & outside;
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (inside[w]) {
                double one[PMJ_MAX_ORDER + 1];
                take_lane(a, degree, w, one);
                const double s = pmj_last_outside(one, 1, degree, 1.0, metrics->band[w]);
                metrics->settling[w] = s >= 0.0 ? step->t[w] + s * step->h[w] : metrics->settling[w];
            }
        }
    }
}

void pmj_note_step(pmj_metrics *metrics, const pmj_span *step)
{
#define ADD(column, value) metrics->sums[column] = metrics->sums[column] + pmj_select(step->taken, value, pmj_all(0.0));
    PMJ_ADDED(ADD)
#undef ADD
    note_error(metrics, step);
}

void pmj_note_control(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_mask taken)
{
    metrics->max_v = raised(metrics->max_v, a[0], total(a, degree), taken);
    const pmj_lanes bound = pmj_max(pmj_abs(a[0]), pmj_abs(a[0] + a[1])) + bend(a, degree);
    const pmj_mask larger = (bound > metrics->max_v) & taken;
    if (pmj_any(larger)) {
        pmj_lanes b[PMJ_MAX_ORDER + 1];
        bernstein(a, degree, b);
        look_inside(&metrics->max_v, a, b, degree, larger);
    }
}

pmj_mask pmj_may_leave(const pmj_lanes *a, int degree, pmj_lanes low, pmj_lanes high, pmj_mask among,
                       pmj_mask touching)
{
    const pmj_lanes beside = bend(a, degree);
    const pmj_lanes line = a[0] + a[1];
    const pmj_mask clear = (pmj_min(a[0], line) - beside > low) & (pmj_max(a[0], line) + beside < high);
    pmj_mask near = (~clear | touching) & among;
    if (pmj_any(near)) {
        pmj_lanes b[PMJ_MAX_ORDER + 1];
        const pmj_lanes size = pmj_abs(a[0]) + pmj_abs(a[1]) + beside;
        pmj_mask within = touching | ((a[0] > low) & (a[0] < high));
        bernstein(a, degree, b);
        for (int j = 1; j <= degree; ++j) {
            within = within & (b[j] - NOISE * size > low) & (b[j] + NOISE * size < high);
        }
        near = near & ~within;
    }
    return near;
}
