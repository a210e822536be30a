#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>

/* Channels evaluated side by side; coefficient memory is padded by one less, so that a block may read past a row. */
#define BLOCK 4

/* out[i] = sum_k c[k*width + i] tau^k, by Horner, for i < n. */
void pmj_evaluate(const double *c, long long width, long long order, double tau, double *out, long long n)
{
    for (long long first = 0; first < n; first += BLOCK) {
        const double *row = c + order * width + first;
        double sum[BLOCK];
        for (int i = 0; i < BLOCK; ++i) {
            sum[i] = row[i];
        }
        for (long long k = order - 1; k >= 0; --k) {
            row -= width;
            for (int i = 0; i < BLOCK; ++i) {
                sum[i] = sum[i] * tau + row[i];
            }
        }
        for (int i = 0; i < BLOCK && first + i < n; ++i) {
            out[first + i] = sum[i];
        }
    }
}

/* The step that keeps the last two terms below the tolerance (Jorba and Zou 2005); HUGE_VAL if both vanish. */
double pmj_step_size(const double *c, long long width, long long order, double tolerance, double safety)
{
    double size = HUGE_VAL;
    for (long long k = order - 1; k <= order; ++k) {
        double norm = 0.0;
        for (long long i = 0; i < width; ++i) {
            const double scale = fabs(c[i]);
            const double term = fabs(c[k * width + i]) / (scale > 1.0 ? scale : 1.0);
            norm = term > norm ? term : norm;
        }
        if (norm > 0.0) {
            const double allowed = pow(tolerance / norm, 1.0 / (double)k);
            size = allowed < size ? allowed : size;
        }
    }
    return size * safety;
}

/* b := Bernstein coefficients on [0, 1] of sum_k a_k s^k. */
static void to_bernstein(const double *a, long long degree, double *b)
{
    /* b_j = sum_k C(j, k)/C(degree, k) a_k, as running differences: scale, then sum up degree times. */
    double binomial = 1.0; /* exact, and the same from both ends: half the chain of divisions */
    for (long long k = 0; 2 * k <= degree; ++k) {
        b[k] = a[k] / binomial;
        b[degree - k] = a[degree - k] / binomial;
        binomial = binomial * (double)(degree - k) / (double)(k + 1);
    }
    for (long long level = 1; level <= degree; ++level) {
        for (long long j = degree; j >= level; --j) {
            b[j] += b[j - 1];
        }
    }
}

static int sign_outside(double value, double noise)
{
    return (value > noise) - (value < -noise);
}

/* Sign changes among b without noise; the first and the last sign that is not noise (0: none). */
static int variations(const double *b, long long degree, double noise, int *first, int *last)
{
    int changes = 0;
    *first = 0;
    *last = 0;
    for (long long j = 0; j <= degree; ++j) {
        const int sign = sign_outside(b[j], noise);
        if (sign != 0) {
            changes += *last != 0 && sign != *last;
            *first = *first != 0 ? *first : sign;
            *last = sign;
        }
    }
    return changes;
}

/* Halve by de Casteljau: `left` becomes the first half, `right` the second. */
static void halve(double *left, double *right, long long degree)
{
    right[degree] = left[degree];
    for (long long level = 1; level <= degree; ++level) {
        for (long long j = degree; j >= level; --j) {
            left[j] = 0.5 * (left[j - 1] + left[j]);
        }
        right[degree - level] = left[degree];
    }
}

/* Where the polyline through the Bernstein coefficients leaves the side `before`: close to the polynomial's root. */
static double guess(const double *b, long long degree, double low, double width, int before, double noise)
{
    long long j = 1;
    while (j < degree && sign_outside(b[j], noise) != -before) {
        ++j;
    }
    return low + width * ((double)(j - 1) + b[j - 1] / (b[j - 1] - b[j])) / (double)degree;
}

/* The root of sum_k a_k s^k in (low, high), where the sign `before` ends: Newton's method, kept inside by bisection.
 * Its last step is not repeated: the remaining error is the square of a relative error below PMJ_CLOSE. */
static double refine(const double *a, long long degree, double start, double low, double high, int before,
                     double noise)
{
    double s = start > low && start < high ? start : 0.5 * (low + high);
    for (int round = 0; round < PMJ_MAX_REFINEMENTS; ++round) {
        double value = a[degree];
        double slope = 0.0;
        for (long long k = degree - 1; k >= 0; --k) {
            slope = slope * s + value;
            value = value * s + a[k];
        }
        const double newton = slope != 0.0 ? s - value / slope : NAN;
        if (fabs(value) <= noise) {
            return s;
        }
        if ((value > 0.0) == (before > 0)) {
            low = s;
        } else {
            high = s;
        }
        const int inside = newton > low && newton < high;
        if (fabs(newton - s) <= PMJ_CLOSE * s) {
            return inside ? newton : s;
        }
        s = inside ? newton : 0.5 * (low + high);
    }
    return s;
}

/* Bound on the rounding error at a zero of a polynomial whose terms add up to `size`. */
static double noise_of(long long degree, double size)
{
    return 4.0 * (double)(degree + 1) * DBL_EPSILON * size;
}

/* Descartes' rule on [0, 1], halving where it is inconclusive, from left to right: the first roots, at most `most`. */
static long long isolate(const double *a, long long degree, double size, double *roots, long long most)
{
    double stack[PMJ_MAX_DEPTH + 2][PMJ_MAX_ORDER + 1];
    double low[PMJ_MAX_DEPTH + 2];
    double width[PMJ_MAX_DEPTH + 2];
    const double noise = noise_of(degree, size);
    long long found = 0;
    int top = 0;
    int before = 0;
    to_bernstein(a, degree, stack[0]);
    low[0] = 0.0;
    width[0] = 1.0;
    while (top >= 0 && found < most) {
        int first = 0;
        int last = 0;
        const int changes = variations(stack[top], degree, noise, &first, &last);
        if (before != 0 && first != 0 && first != before) {
            roots[found++] = low[top]; /* the sign changed at the border, to rounding */
            before = first;
            continue;
        }
        if (changes <= 1 || width[top] <= ldexp(1.0, -PMJ_MAX_DEPTH)) {
            if (changes == 1) {
                roots[found++] = refine(a, degree, guess(stack[top], degree, low[top], width[top], first, noise),
                                        low[top], low[top] + width[top], first, 0.25 * DBL_EPSILON * size);
            } else if (first != last) {
                roots[found++] = low[top] + 0.5 * width[top];
            }
            before = last != 0 ? last : before;
            --top;
            continue;
        }
        /* The right half takes this place, the left half goes on top of it. */
        for (long long j = 0; j <= degree; ++j) {
            stack[top + 1][j] = stack[top][j];
        }
        halve(stack[top + 1], stack[top], degree);
        width[top] *= 0.5;
        low[top + 1] = low[top];
        width[top + 1] = width[top];
        low[top] += width[top];
        ++top;
    }
    return found;
}

/* How many of the lowest coefficients are zero, or rounding, relative to the terms at h; the highest does not count. */
long long pmj_leading_zeros(const double *q, long long degree, double h)
{
    long long zeros = 0;
    while (zeros < degree) {
        double power = 1.0;
        double size = 0.0;
        for (long long k = zeros; k <= degree; ++k) {
            size += fabs(q[k]) * power;
            power *= h;
        }
        if (!(fabs(q[zeros]) <= noise_of(degree - zeros, size) && size <= DBL_MAX)) {
            break;
        }
        ++zeros;
    }
    return zeros;
}

/* Where in (0, h) sum_k q_k tau^k changes its sign, ascending: the first `most` of them; returns how many.
 * A zero at h itself is left to the next step; a zero without change of sign does not count. */
long long pmj_crossings(const double *q, long long degree, double h, double *roots, long long most)
{
    double a[PMJ_MAX_ORDER + 1];
    double power = 1.0;
    double rest = 0.0;
    for (long long k = 0; k <= degree; ++k) {
        a[k] = q[k] * power;
        power *= h;
        rest += k > 0 ? fabs(a[k]) : 0.0;
    }
    const double size = rest + fabs(a[0]);
    if (degree < 1 || fabs(a[0]) > rest || !(size <= DBL_MAX)) {
        return 0;
    }
    const long long found = isolate(a, degree, size, roots, most);
    for (long long i = 0; i < found; ++i) {
        roots[i] *= h;
    }
    return found;
}

/* The value of q at the start of a step of size h: 0 where the run stands on q's zero. When a kink changes its side, the
 * argument of another may jump past its zero without taking that value. It is well inside its new side then. Outside, it is
 * on its zero to rounding, however little it moves: as where a run comes to rest on the kink of abs. */
static double on_level(const double *q, long long degree, double h, int touching, int outward)
{
    double rest = 0.0;
    double power = 1.0;
    for (long long k = 1; k <= degree; ++k) {
        power *= h;
        rest += fabs(q[k]) * power;
    }
    return touching == 0 || (touching == PMJ_ON_KINK && -q[0] * outward > PMJ_JUMPED * rest) ? q[0] : 0.0;
}

/* When a polynomial passes `level` in a direction (`outward` is +1 upwards, -1 downwards), from 0 to before h.
 * 1 and the time after the step's start; 0 if it does not. On the level, to rounding, the first derivative that does not
 * vanish decides, and the zero at the start is divided out before the search. `q` is used up. */
int pmj_passes(double *q, long long degree, double level, int touching, int outward, double h, double *tau)
{
    q[0] -= level;
    q[0] = on_level(q, degree, h, touching, outward);
    if (touching == PMJ_LET_GO && degree > 1 && q[1] * outward > 0.0) {
        q[1] = 0.0; /* it leaves at a rate of 0, to rounding */
    }
    const long long zeros = pmj_leading_zeros(q, degree, h);
    if (q[zeros] * outward > 0.0) {
        *tau = 0.0;
        return 1;
    }
    return pmj_crossings(q + zeros, degree - zeros, h, tau, 1) > 0;
}

/* Keep the largest magnitude and its time; NaN counts as the largest. */
void pmj_note_value(double value, double t, double *peak, double *peak_time)
{
    if (!(fabs(value) <= *peak)) {
        *peak = fabs(value);
        *peak_time = t;
    }
}

/* The largest magnitude of one channel inside a step: it is where the slope changes its sign. */
void pmj_note_extremum(const double *c, long long width, long long order, double t, double tau, double *peak,
                       double *peak_time)
{
    double slope[PMJ_MAX_ORDER];
    double when[PMJ_MAX_ORDER];
    double power = 1.0;
    double bound = 0.0;
    for (long long k = 0; k <= order; ++k) {
        bound += fabs(c[k * width]) * power;
        power *= tau;
        if (k > 0) {
            slope[k - 1] = (double)k * c[k * width];
        }
    }
    const long long turns = bound > *peak ? pmj_crossings(slope, order - 1, tau, when, PMJ_MAX_ORDER) : 0;
    for (long long i = 0; i < turns; ++i) {
        double value = c[order * width];
        for (long long k = order - 1; k >= 0; --k) {
            value = value * when[i] + c[k * width];
        }
        pmj_note_value(value, t + when[i], peak, peak_time);
    }
}

/* Peaks of the first n channels over a step that starts at t: at its end, and inside. */
void pmj_note_peaks(const double *c, long long width, long long order, long long n, double t, double tau,
                    const double *end, double *peaks, double *peak_times)
{
    for (long long i = 0; i < n; ++i) {
        pmj_note_value(end[i], t + tau, peaks + i, peak_times + i);
        pmj_note_extremum(c + i, width, order, t, tau, peaks + i, peak_times + i);
    }
}

/* The largest magnitude of the rate of one channel over a step that starts at t: at its end, and inside. */
void pmj_note_rate(const double *c, long long width, long long order, double t, double tau, double *peak,
                   double *peak_time)
{
    double rate[PMJ_MAX_ORDER];
    double end = 0.0;
    for (long long k = order; k > 0; --k) {
        rate[k - 1] = (double)k * c[k * width];
        end = end * tau + rate[k - 1];
    }
    pmj_note_peaks(rate, 1, order - 1, 1, t, tau, &end, peak, peak_time);
}

/* Whether the magnitude of one channel passes `limit` inside a step of size *tau, which then becomes the time until that. */
int pmj_exceeds(const double *c, long long width, long long order, double limit, double *tau)
{
    double q[PMJ_MAX_ORDER + 1];
    double power = 1.0;
    double bound = 0.0;
    int found = 0;
    for (long long k = 0; k <= order; ++k) {
        q[k] = c[k * width];
        bound += fabs(q[k]) * power;
        power *= *tau;
    }
    if (!(bound > limit)) {
        return 0;
    }
    for (int side = -1; side <= 1; side += 2) {
        q[0] = c[0] + (double)side * limit;
        found |= pmj_crossings(q, order, *tau, tau, 1) > 0;
    }
    return found;
}

/* The last time in [0, tau) at which the magnitude of one channel goes from above `band` to below it, or -1. */
double pmj_last_outside(const double *c, long long width, long long order, double tau, double band)
{
    double q[PMJ_MAX_ORDER + 1];
    double when[PMJ_MAX_ORDER];
    double last = -1.0;
    double power = 1.0;
    double bound = 0.0;
    for (long long k = 0; k <= order; ++k) {
        bound += fabs(c[k * width]) * power;
        power *= tau;
    }
    if (!(bound > band)) {
        return -1.0;
    }
    for (int side = -1; side <= 1; side += 2) {
        for (long long k = 0; k <= order; ++k) {
            q[k] = c[k * width];
        }
        q[0] += (double)side * band;
        const long long roots = pmj_crossings(q, order, tau, when, PMJ_MAX_ORDER);
        last = roots > 0 && when[roots - 1] > last ? when[roots - 1] : last;
    }
    return last;
}
