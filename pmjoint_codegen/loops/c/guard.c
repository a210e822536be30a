/* Whether a step follows the right-hand side throughout, and where it meets a kink: for both loops. The step is that of a
 * Taylor kernel whose first channels have rates and whose others are values; see loops/guard.py. */
#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>

int pmj_all_finite(const double *values, long long n)
{
    for (long long i = 0; i < n; ++i) {
        if (!(fabs(values[i]) <= DBL_MAX)) {
            return 0;
        }
    }
    return 1;
}

/* Mode of a value of v: how many thresholds lie below it. */
long long pmj_mode_at(const pmj_problem *problem, double v)
{
    long long mode = 0;
    while (mode < problem->n_thresholds && v > problem->thresholds[mode]) {
        ++mode;
    }
    return mode;
}

/* Whether any state is beyond its limit of divergence. */
int pmj_beyond(const pmj_problem *problem, const double *X)
{
    for (long long i = 0; i < problem->n_states; ++i) {
        if (fabs(X[i]) > problem->reach[i]) {
            return 1;
        }
    }
    return 0;
}

/* The largest of `values`, each relative to its channel's scale; for rates, over a step of size h. Infinite if one is
 * NaN. High gains leave more rounding in v than its present value shows, so its scale is its peak so far. */
double pmj_largest(const pmj_problem *problem, const pmj_memory *memory, const double *values, double h)
{
    const double peak = memory->peaks[problem->n_states] > 1.0 ? memory->peaks[problem->n_states] : 1.0;
    const long long v = problem->sample_time > 0.0 ? -1 : problem->n_states;
    double most = 0.0;
    for (long long i = 0; i < problem->n_channels; ++i) {
        const double scale = i == v ? 1.0 / peak : i < problem->n_rates ? h * memory->scales[i] : memory->scales[i];
        const double value = fabs(values[i]) * scale;
        if (!(value <= most)) {
            most = value <= DBL_MAX ? value : HUGE_VAL;
        }
    }
    return most;
}

/* The longest step up to h whose polynomials the guard shows to follow the right-hand side throughout, if their defect at
 * the points of comparison is small; 0 if there is none above `smallest`, -1 if the kernel fails. */
double pmj_guarded(const pmj_problem *problem, const pmj_function *guard, pmj_progress *progress,
                   const pmj_memory *memory, const double *actuation, const double *c, double h, double smallest)
{
    const long long width = problem->n_channels;
    const long long order = problem->order + problem->n_inside + 1;
    const double allowed = 1.0 / (PMJ_DEFECT * problem->tolerance);
    guard->arg[0] = &progress->t;
    guard->arg[1] = c;
    guard->arg[2] = actuation;
    guard->arg[3] = problem->p;
    guard->arg[5] = memory->majorants;
    guard->res[0] = memory->rest;
    while (h >= smallest) {
        double best = 0.0;
        const long long likely = progress->disc;
        for (long long trial = 0; trial < problem->n_ratios; ++trial) {
            const long long disc = trial == 0 ? likely : trial - (trial <= likely); /* the last one first */
            const double R = problem->ratios[disc] * h;
            guard->arg[4] = &R;
            pmj_bounds(c + width, width, problem->order - 1, R, 0, memory->majorants);
            for (long long i = 0; i < problem->n_rates; ++i) {
                memory->majorants[i] = memory->majorants[i] * R;
            }
            if (pmj_apply(guard)) {
                return -1.0;
            }
            const double miss = problem->factors[disc] * pmj_largest(problem, memory, memory->rest, h) * allowed;
            if (miss <= 1.0) {
                progress->disc = disc;
                return h;
            }
            const double factor = pmj_shrink(miss, order);
            best = factor > best ? factor : best;
        }
        h = h * best;
    }
    return 0.0;
}

/* How far the polynomials are from the right-hand side at the time `at` of a step of size tau that starts at t, relative
 ** to the channels' scales; -1 if the kernel fails. */
double pmj_defect(const pmj_problem *problem, const pmj_function *rates, double t, const pmj_memory *memory,
                  const double *actuation, const double *c, double at, double tau)
{
    const long long n = problem->n_rates;
    const double when = t + at;
    double *values = memory->rates;
    double *slopes = memory->majorants; /* the guard no longer needs them */
    pmj_arrive(c, problem->n_channels, problem->order, at, values, slopes);
    rates->arg[0] = &when;
    rates->arg[1] = values;
    rates->arg[2] = actuation;
    rates->arg[3] = problem->p;
    rates->res[0] = memory->rest;
    for (long long i = n; i <= problem->n_channels - problem->n_kinks; ++i) { /* each value, then the kinks */
        if (i < problem->n_channels) {
            rates->res[i - n + 1] = memory->rest + i;
        }
    }
    if (pmj_apply(rates)) {
        return -1.0;
    }
    for (long long i = 0; i < problem->n_channels; ++i) {
        memory->rest[i] = (i < n ? slopes[i] : values[i]) - memory->rest[i];
    }
    return pmj_largest(problem, memory, memory->rest, tau);
}

/* Whether a channel certainly stays between two values up to h. The bound is its linear part plus the most that the higher
 * terms can add; `memory->term_sums` bounds them. */
int pmj_stays(const pmj_problem *problem, const pmj_memory *memory, const double *c, long long channel, double low,
              double high, double h)
{
    const double start = c[channel];
    const double rise = c[problem->n_channels + channel] * h;
    const double beside = memory->term_sums[channel] * PMJ_ROUNDED_UP - fabs(start) - fabs(rise);
    const double least = start + (rise < 0.0 ? rise : 0.0) - beside;
    const double most = start + (rise > 0.0 ? rise : 0.0) + beside;
    return least > low && most < high;
}

/* When a channel passes `level`; see `pmj_passes`. */
int pmj_channel_passes(const pmj_problem *problem, const double *c, long long channel, double level, int touching,
                       int outward, double h, double *tau)
{
    double q[PMJ_MAX_ORDER + 1];
    for (long long k = 0; k <= problem->order; ++k) {
        q[k] = c[k * problem->n_channels + channel];
    }
    return pmj_passes(q, problem->order, level, touching, outward, h, tau);
}

/* When the side of a kink that holds the run leaves [-1, 1]; the same results as of `pmj_channel_passes`. */
static int lets_go(const pmj_problem *problem, const pmj_memory *memory, const double *c, long long channel, double h, double *tau)
{
    int found = 0;
    if (pmj_stays(problem, memory, c, channel, -1.0, 1.0, h)) {
        return 0;
    }
    for (int side = -1; side <= 1; side += 2) {
        found |= pmj_channel_passes(problem, c, channel, (double)side, 0, side, *tau, tau);
    }
    return found;
}

/* The kink that is passed first within h and before `*tau`, which then becomes the time until that, or the kink `held` if
 * it lets go of the run before; or -1. At the start, the run is on kink `touching`, or n_kinks more if it has just let go.
 * Where rounding alone moves the run from side to side, as at rest on the kink of abs, a kink is passed at the tolerance. */
long long pmj_first_kink(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, const double *c,
                         long long touching, double h, double *tau)
{
    const long long first = problem->n_channels - problem->n_kinks;
    long long found = -1;
    double when = 0.0;
    for (long long j = 0; j < problem->n_kinks; ++j) {
        const int above = memory->sides[j] > 0.0;
        const double low = above ? 0.0 : -HUGE_VAL;
        const double high = above ? HUGE_VAL : 0.0;
        const double outward = above ? -1.0 : 1.0;
        int on = touching == j ? PMJ_ON_KINK : touching == problem->n_kinks + j ? PMJ_LET_GO : 0;
        double level = 0.0;
        if (progress->flips > problem->n_kinks && fabs(c[first + j]) <= problem->tolerance
            && fabs(c[problem->n_channels + first + j]) <= problem->tolerance) {
            on = 0;
            level = outward * problem->tolerance;
        }
        if (j == progress->held) {
            found = lets_go(problem, memory, c, first + j, h, tau) ? j : found;
        } else if ((on || !pmj_stays(problem, memory, c, first + j, low, high, h))
                   && pmj_channel_passes(problem, c, first + j, level, on, (int)outward, *tau, &when)) {
            found = j;
            *tau = when;
        }
    }
    return found;
}

/* The last instant so far at which e, the first channel of `c`, is outside its band, over a step from progress->t of
 * size tau that ends at `end` with the value `last`. */
void pmj_note_settled(pmj_progress *progress, const double *c, long long width, long long order, double last, double tau,
                      double end)
{
    if (fabs(last) > progress->band) {
        progress->settled = end;
        return;
    }
    const double when = pmj_last_outside(c, width, order, tau, progress->band);
    progress->settled = when >= 0.0 ? progress->t + when : progress->settled;
}
