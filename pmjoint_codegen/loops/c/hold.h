/* Holds of the sampled loop. For holds of one step: the checks of the polynomials computed with a sample, written so that
 * the compiler can unroll them and keep them in registers.
 */
#ifndef PMJOINT_HOLD_H
#define PMJOINT_HOLD_H

#include "pmjoint_runtime.h"
#include "sampled.h"

#include <math.h>

/* Channels of the coefficients: x, then e = y - y_r, then the arguments of kinks. */
#define ORDER PMJ_HOLD_ORDER
#define CHANNELS (PMJ_NX + 1 + PMJ_NK)
#define E PMJ_NX
/* Entries of the peaks: X, v, e, y'. */
#define PEAK_V PMJ_NS
#define PEAK_E (PMJ_NS + 1)
#define PEAK_RATE (PMJ_NS + 2)

/* By default, compilers do not unroll short loops. */
#if defined(__GNUC__)
#define UNROLLED _Pragma("GCC unroll 16")
#else
#define UNROLLED
#endif

/* The largest |c_(N-1)| and |c_N|, relative to max(1, |c_0|), at which a hold of this length is one step: a series whose
 * N-th term equals the tolerance, and the one before in proportion, neglects less. */
typedef struct {
    double before;
    double last;
} bounds;

static inline bounds bounds_of(const pmj_problem *problem, double length)
{
    const double ratio = length / problem->hold_fraction;
    double power = ratio;
    for (int k = 2; k < ORDER; ++k) {
        power = power * ratio;
    }
    const bounds found = {1.0 / power, 1.0 / (power * ratio)};
    return found;
}

static inline int within(const double *c, bounds bound)
{
    int all = 1;
    UNROLLED
    for (int i = 0; i < CHANNELS; ++i) {
        const double size = fabs(c[i]);
        const double scale = size > 1.0 ? size : 1.0;
        all = all && fabs(c[(ORDER - 1) * CHANNELS + i]) <= bound.before * scale
              && fabs(c[ORDER * CHANNELS + i]) <= bound.last * scale;
    }
    return all;
}

/* One channel's polynomial, by Horner. */
static inline double value(const double *c, int channel, double tau)
{
    double sum = c[ORDER * CHANNELS + channel];
    UNROLLED
    for (int k = ORDER - 1; k >= 0; --k) {
        sum = sum * tau + c[k * CHANNELS + channel];
    }
    return sum;
}

/* Sum of the magnitudes of its terms: a bound on its magnitude on [0, tau]. Rounding is monotonic, so it bounds `value` too. */
static inline double term_sum(const double *c, int channel, double tau)
{
    double sum = fabs(c[ORDER * CHANNELS + channel]);
    UNROLLED
    for (int k = ORDER - 1; k >= 0; --k) {
        sum = sum * tau + fabs(c[k * CHANNELS + channel]);
    }
    return sum;
}

/* How far a channel can move from its start while time is anywhere in a disc of radius R. */
static inline double spread(const double *c, int channel, double R)
{
    double sum = fabs(c[ORDER * CHANNELS + channel]);
    UNROLLED
    for (int k = ORDER - 1; k >= 1; --k) {
        sum = sum * R + fabs(c[k * CHANNELS + channel]);
    }
    return sum * R;
}

/* Whether the guard's window contains the disc of radius R around t, and the range of x on it. */
static inline int covered(const double *window, const double *c, double t, double R)
{
    int all = PMJ_WINDOWS && fabs(t - window[0]) + R <= window[1];
    UNROLLED
    for (int i = 0; i < PMJ_NX; ++i) {
        all = all && fabs(c[i] - window[2 + i]) + spread(c, i, R) <= window[2 + PMJ_NX + i];
    }
    return all;
}

/* Whether no kink is met: every argument stays away from 0. */
static inline int smooth(const double *c, double tau)
{
    int all = 1;
    UNROLLED
    for (int i = E + 1; i < CHANNELS; ++i) {
        all = all && spread(c, i, tau) < fabs(c[i]);
    }
    return all;
}

/* Integral of e^2 over a hold that is one step, by three Gauss nodes. */
static inline double integral(const double *c, double size)
{
    const double nodes[3] = PMJ_SHORT_NODES;
    const double weights[3] = PMJ_SHORT_WEIGHTS;
    double a[ORDER + 1];
    double power = size;
    double sum = 0.0;
    a[0] = c[E];
    UNROLLED
    for (int k = 1; k <= ORDER; ++k) {
        a[k] = c[k * CHANNELS + E] * power;
        power = power * size;
    }
    UNROLLED
    for (int i = 0; i < 3; ++i) {
        double e = a[ORDER];
        UNROLLED
        for (int k = ORDER - 1; k >= 0; --k) {
            e = e * nodes[i] + a[k];
        }
        sum = sum + e * e * weights[i];
    }
    return size * sum;
}

/* hold.c: the next output row, as at the sample at time t_sample, to be filled with the plant's states */
double *pmj_next_row(pmj_progress *progress, const pmj_memory *memory, double t_sample);

/* hold.c: take the segments of the reference that have begun by `until`; only e may jump. 0 is success. */
int pmj_enter_break(const pmj_problem *problem, const pmj_function *rates, pmj_progress *progress,
                    const pmj_memory *memory, double until);

/* Integrate the plant under constant w, of the sample at time t_sample, to `end` in as many steps as it takes. */
void pmj_long_hold(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory,
                   double end, double rows_until, double t_sample);

/* sampled.c: record the mode of v at a sample, and its change */
void pmj_note_mode(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, double v);

/* sampled.c: the state at the next sample, and its peaks; or the status that ends the run */
void pmj_settle(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, const double *next);

/* Integrate the plant under constant w for the time `length`, to `end`; the sample's coefficients are in memory. */
void pmj_hold(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory,
              double length, double end, double rows_until);

#endif
