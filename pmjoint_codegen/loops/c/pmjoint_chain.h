/* Sensor, actuator and clock of a sampled run, as arithmetic on single numbers: for the loop of single runs and for that of
 * sweeps. The twin is pmjoint_codegen/loops/chain.py: same arithmetic, same order.
 *
 ** Random numbers are a function of (seed, sample, draw) alone (SplitMix64), so runs, lanes and threads agree. A normal
 * number takes + - * / and square roots only, the logarithm included: it has the same bits everywhere.
 */
#ifndef PMJOINT_CHAIN_H
#define PMJOINT_CHAIN_H

#include <math.h>

/* One run's numbers: `Chain` of the twin, field by field. */
typedef struct {
    double zone;        /* width of the dead zone that the controller adds */
    double own;         /* the valve's own */
    double lower;       /* limits of the command */
    double upper;
    double reach;       /* greatest change of the command from sample to sample */
    double delay;       /* s */
    double samples;     /* samples until a command acts */
    double jitter;      /* s */
    double resolution;  /* of y; 0: none */
    double noise;       /* its standard deviation */
    double seed;
    double gain;        /* of the filter; 1: none */
    double period;      /* s */
} pmj_chain;

/* Entries of what is held since a sample; w follows. */
enum { PMJ_MEASURED, PMJ_FILTERED, PMJ_U, PMJ_COMMAND, PMJ_CLOCK, PMJ_NEXT, PMJ_ACTING };

static inline unsigned long long pmj_mixed(unsigned long long x)
{
    x += 0x9e3779b97f4a7c15ULL;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
    return x ^ (x >> 31);
}

/* Between 0 and 1, both excluded. */
static inline double pmj_uniform(double seed, long long k, unsigned long long draw)
{
    const unsigned long long bits = pmj_mixed(pmj_mixed(pmj_mixed((unsigned long long)seed) + (unsigned long long)k) + draw);
    return ((double)(bits >> 11) + 0.5) * 0x1p-53;
}

/* Natural logarithm, by the series of the inverse hyperbolic tangent. */
static inline double pmj_ln(double x)
{
    int e = 0;
    double m = frexp(x, &e);
    if (m < 0.70710678118654752) {
        m = m * 2.0;
        e -= 1;
    }
    const double f = (m - 1.0) / (m + 1.0);
    const double square = f * f;
    double sum = 0.0;
    for (int k = 23; k > 0; k -= 2) {
        sum = sum * square + 1.0 / (double)k;
    }
    return 2.0 * f * sum + (double)e * 0.69314718055994531;
}

/* A standard normal number, by Marsaglia's polar method. */
static inline double pmj_normal(double seed, long long k)
{
    for (unsigned long long draw = 1;; draw += 2) {
        const double a = 2.0 * pmj_uniform(seed, k, draw) - 1.0;
        const double b = 2.0 * pmj_uniform(seed, k, draw + 1) - 1.0;
        const double square = a * a + b * b;
        if (square < 1.0 && square > 0.0) {
            return a * sqrt(-2.0 * pmj_ln(square) / square);
        }
    }
}

/* The instant of sample k: late by up to the jitter, the first on time. */
static inline double pmj_instant(const pmj_chain *chain, long long k)
{
    const double t = (double)k * chain->period;
    return chain->jitter > 0.0 && k > 0 ? t + chain->jitter * pmj_uniform(chain->seed, k, 0) : t;
}

/* What the sensor reads at sample k. */
static inline double pmj_read(const pmj_chain *chain, double y, long long k)
{
    const double noisy = chain->noise > 0.0 ? y + chain->noise * pmj_normal(chain->seed, k) : y;
    return chain->resolution > 0.0 ? rint(noisy / chain->resolution) * chain->resolution : noisy;
}

/* What the controller makes of it, from what it made of the sample before. */
static inline double pmj_filtered(const pmj_chain *chain, double read, double before, long long k)
{
    return k == 0 || chain->gain == 1.0 ? read : before + chain->gain * (read - before);
}

static inline double pmj_between(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* The command, from v and the command before. */
static inline double pmj_command(const pmj_chain *chain, double v, double before)
{
    const double wanted = v > 0.0 ? v + chain->zone : v < 0.0 ? v - chain->zone : v;
    return pmj_between(pmj_between(wanted, before - chain->reach, before + chain->reach), chain->lower, chain->upper);
}

/* What is left of a command beyond a dead zone. */
static inline double pmj_left(double command, double zone)
{
    return command - pmj_between(command, -zone, zone);
}

/* The actuator's channel j for a command; `limits` are its offset, slope, lower and upper limit. */
static inline double pmj_channel_of(const pmj_chain *chain, const double *limits, int j, double command)
{
    if (j == 0) {
        return pmj_left(command, chain->zone);
    }
    return pmj_between(limits[0] + limits[1] * pmj_left(command, chain->own), limits[2], limits[3]);
}

#endif
