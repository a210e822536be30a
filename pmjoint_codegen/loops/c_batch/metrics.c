#include "metrics.h"

/* Halvings of a step in the search for its extremum or last exceedance. */
#define MAX_DEPTH 40
/* An extremum is found to this, relative. */
#define EXTREMUM 1e-10
/* An instant is found to this, of the step. */
#define NARROW 1e-12
#define MAX_ROUNDS 60
#define MAX_DEGREE 40
/* Rounding of Bernstein coefficients, relative to the sum of |a_k|: degree^2 additions, generously. */
#define NOISE 1e-12

void pmj_scale(const pmj_lanes *c, int width, int degree, pmj_lanes h, pmj_lanes *a)
{
    pmj_lanes power = h;
    a[0] = c[0];
    for (int k = 1; k <= degree; ++k) {
        a[k] = c[k * width] * power;
        power = power * h;
    }
}

pmj_lanes pmj_reach(const pmj_lanes *a, int degree)
{
    pmj_lanes sum = pmj_abs(a[2]);
    for (int k = 3; k <= degree; ++k) {
        sum = sum + pmj_abs(a[k]);
    }
    return sum;
}

pmj_lanes pmj_mean_square(const pmj_lanes *a, int degree)
{
    static const double nodes[3] = {0.11270166537925831, 0.5, 0.8872983346207417};
    static const double weights[3] = {0.2777777777777778, 0.4444444444444444, 0.2777777777777778};
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
        bernstein_lanes(a, b);
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

/* Halve by de Casteljau: `left` becomes the first half, `right` the second. */
static void halve(double *left, double *right, int degree)
{
    right[degree] = left[degree];
    for (int level = 1; level <= degree; ++level) {
        for (int j = degree; j >= level; --j) {
            left[j] = 0.5 * (left[j - 1] + left[j]);
        }
        right[degree - level] = left[degree];
    }
}

/* Where the sign of sum_k a_k s^k changes in (low, high), being `before` at low: Newton, kept inside by bisection. */
static double root(const double *a, int degree, double low, double high, int before)
{
    double s = 0.5 * (low + high);
    for (int round = 0; round < MAX_ROUNDS; ++round) {
        double value = a[degree];
        double slope = 0.0;
        for (int k = degree - 1; k >= 0; --k) {
            slope = slope * s + value;
            value = value * s + a[k];
        }
        if ((value > 0.0) == (before > 0)) {
            low = s;
        } else {
            high = s;
        }
        double next = slope != 0.0 ? s - value / slope : low;
        if (!(next > low && next < high)) {
            next = 0.5 * (low + high);
        }
        if (fabs(next - s) <= NARROW) {
            return next;
        }
        s = next;
    }
    return s;
}

/* Parts of [0, 1] that remain to be looked at: Bernstein coefficients, where each begins, how wide it is. */
typedef struct {
    double b[MAX_DEPTH + 1][MAX_DEGREE + 1];
    double low[MAX_DEPTH + 1];
    double width[MAX_DEPTH + 1];
    int top;
} parts;

static void whole(parts *all, const pmj_lanes *b, int degree, int lane)
{
    for (int j = 0; j <= degree; ++j) {
        all->b[0][j] = b[j][lane];
    }
    all->low[0] = 0.0;
    all->width[0] = 1.0;
    all->top = 0;
}

/* Halve the top part; its left half (`left_first`) or its right one comes out on top. */
static void split(parts *all, int degree, int left_first)
{
    const int top = all->top;
    const double half = 0.5 * all->width[top];
    for (int j = 0; j <= degree; ++j) {
        all->b[top + 1][j] = all->b[top][j];
    }
    if (left_first) {
        halve(all->b[top + 1], all->b[top], degree);
    } else {
        halve(all->b[top], all->b[top + 1], degree);
    }
    all->low[top + 1] = all->low[top];
    all->low[left_first ? top : top + 1] += half;
    all->width[top] = half;
    all->width[top + 1] = half;
    all->top = top + 1;
}

static double hull(const double *b, int degree)
{
    double most = 0.0;
    for (int j = 0; j <= degree; ++j) {
        most = fabs(b[j]) > most ? fabs(b[j]) : most;
    }
    return most;
}

/* Changes of sign among b_(j+1) - b_j: no more extrema than that lie inside. */
static int turns(const double *b, int degree, int *before)
{
    int changes = 0;
    int last = 0;
    for (int j = 0; j < degree; ++j) {
        const int sign = (b[j + 1] > b[j]) - (b[j + 1] < b[j]);
        changes += last != 0 && sign != 0 && sign != last;
        *before = last == 0 ? sign : *before;
        last = sign != 0 ? sign : last;
    }
    return changes;
}

/* The largest magnitude of lane's polynomial on [0, 1], or `best` if that is larger. */
static double largest(const pmj_lanes *a, const pmj_lanes *b, int degree, int lane, double best)
{
    parts all;
    double own[MAX_DEGREE + 1];
    double slope[MAX_DEGREE + 1] = {0.0};
    for (int k = 0; k <= degree; ++k) {
        own[k] = a[k][lane];
        slope[k > 0 ? k - 1 : 0] = (double)k * own[k];
    }
    whole(&all, b, degree, lane);
    while (all.top >= 0) {
        const int top = all.top;
        const double *part = all.b[top];
        int before = 0;
        best = fabs(part[0]) > best ? fabs(part[0]) : best;
        best = fabs(part[degree]) > best ? fabs(part[degree]) : best;
        if (!(hull(part, degree) > best * (1.0 + EXTREMUM)) || top == MAX_DEPTH || all.width[top] < NARROW) {
            all.top -= 1;
        } else if (turns(part, degree, &before) == 1) {
            const double s = root(slope, degree - 1, all.low[top], all.low[top] + all.width[top], before);
            double value = own[degree];
            for (int k = degree - 1; k >= 0; --k) {
                value = value * s + own[k];
            }
            best = fabs(value) > best ? fabs(value) : best;
            all.top -= 1;
        } else {
            split(&all, degree, 1);
        }
    }
    return best;
}

/* The last s in [0, 1] at which the magnitude exceeds `band`, or -1. */
static double last_outside(const pmj_lanes *a, const pmj_lanes *b, int degree, int lane, double band)
{
    parts all;
    whole(&all, b, degree, lane);
    while (all.top >= 0) {
        const int top = all.top;
        const double *part = all.b[top];
        const double end = all.low[top] + all.width[top];
        int before = 0;
        if (fabs(part[degree]) > band) {
            return end;
        }
        if (!(hull(part, degree) > band)) {
            all.top -= 1;
        } else if (fabs(part[0]) > band && turns(part, degree, &before) == 0) {
            double shifted[MAX_DEGREE + 1];
            for (int k = 0; k <= degree; ++k) {
                shifted[k] = a[k][lane];
            }
            shifted[0] -= part[0] > 0.0 ? band : -band;
            return root(shifted, degree, all.low[top], end, part[0] > 0.0 ? 1 : -1);
        } else if (top == MAX_DEPTH || all.width[top] < NARROW) {
            return end;
        } else {
            split(&all, degree, 0);
        }
    }
    return -1.0;
}

/* Raise `peak` to the largest magnitude on the step where the inside may exceed it; the ends are in it already. */
static void look_inside(pmj_lanes *peak, const pmj_lanes *a, const pmj_lanes *b, int degree, pmj_mask among)
{
    const pmj_mask inside = (hulls(b, degree) > *peak * (1.0 + EXTREMUM)) & among;
    if (pmj_any(inside)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            (*peak)[w] = inside[w] ? largest(a, b, degree, w, (*peak)[w]) : (*peak)[w];
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

void pmj_note_error(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_lanes square, pmj_lanes t, pmj_lanes h,
                    pmj_mask taken)
{
    const pmj_lanes end = total(a, degree);
    const pmj_lanes bound = pmj_max(pmj_abs(a[0]), pmj_abs(a[0] + a[1])) + pmj_reach(a, degree);
    const pmj_mask at_end = (pmj_abs(end) > metrics->band) & taken;
    const pmj_mask outside = (bound > metrics->band) & taken & ~at_end;
    metrics->ise = metrics->ise + pmj_select(taken, h * square, pmj_all(0.0));
    metrics->settling = pmj_select(at_end, t + h, metrics->settling);
    metrics->max_e = raised(metrics->max_e, a[0], end, taken);
    const pmj_mask larger = (bound > metrics->max_e) & taken;
    if (pmj_any(larger | outside)) {
        pmj_lanes b[MAX_DEGREE + 1];
        bernstein(a, degree, b);
        look_inside(&metrics->max_e, a, b, degree, larger);
        const pmj_mask inside = (hulls(b, degree) > metrics->band) & outside;
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            const double s = inside[w] ? last_outside(a, b, degree, w, metrics->band[w]) : -1.0;
            metrics->settling[w] = s >= 0.0 ? t[w] + s * h[w] : metrics->settling[w];
        }
    }
}

void pmj_note_control(pmj_metrics *metrics, const pmj_lanes *a, int degree, pmj_mask taken)
{
    metrics->max_v = raised(metrics->max_v, a[0], total(a, degree), taken);
    const pmj_lanes bound = pmj_max(pmj_abs(a[0]), pmj_abs(a[0] + a[1])) + pmj_reach(a, degree);
    const pmj_mask larger = (bound > metrics->max_v) & taken;
    if (pmj_any(larger)) {
        pmj_lanes b[MAX_DEGREE + 1];
        bernstein(a, degree, b);
        look_inside(&metrics->max_v, a, b, degree, larger);
    }
}

pmj_mask pmj_may_leave(const pmj_lanes *a, int degree, pmj_lanes low, pmj_lanes high, pmj_mask among,
                       pmj_mask touching)
{
    const pmj_lanes reach = pmj_reach(a, degree);
    const pmj_lanes line = a[0] + a[1];
    const pmj_mask clear = (pmj_min(a[0], line) - reach > low) & (pmj_max(a[0], line) + reach < high);
    pmj_mask near = (~clear | touching) & among;
    if (pmj_any(near)) {
        pmj_lanes b[MAX_DEGREE + 1];
        const pmj_lanes size = pmj_abs(a[0]) + pmj_abs(a[1]) + reach;
        pmj_mask within = touching | ((a[0] > low) & (a[0] < high));
        bernstein(a, degree, b);
        for (int j = 1; j <= degree; ++j) {
            within = within & (b[j] - NOISE * size > low) & (b[j] + NOISE * size < high);
        }
        near = near & ~within;
    }
    return near;
}
