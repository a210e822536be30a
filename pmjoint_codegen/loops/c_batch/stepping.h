/* The step that a polynomial's last coefficients allow, lane by lane (Jorba and Zou 2005). */
#ifndef PMJOINT_STEPPING_H
#define PMJOINT_STEPPING_H

#include "pmjoint_lanes.h"

/* A power of two from 1/max(1, |a|) to twice that: relative errors without a division. */
static inline pmj_lanes pmj_inverse_scale(pmj_lanes a)
{
    const pmj_mask exponent = pmj_bits(pmj_max(pmj_abs(a), pmj_all(1.0))) & 0x7ff0000000000000LL;
    return (pmj_lanes)(0x7fe0000000000000LL - exponent);
}

/* Factor on the step that the last two coefficients allow. */
static inline double pmj_safety(int order)
{
    return exp(-0.7 / (double)(order - 1));
}

static inline void pmj_inverse_scales(const pmj_lanes *c, int channels, pmj_lanes *scales)
{
    for (int i = 0; i < channels; ++i) {
        scales[i] = pmj_inverse_scale(c[i]);
    }
}

/* The largest |c_k| of a row, relative to max(1, |c_0|). */
static inline pmj_lanes pmj_norm(const pmj_lanes *row, const pmj_lanes *scales, int channels)
{
    pmj_lanes norm = pmj_all(0.0);
    for (int i = 0; i < channels; ++i) {
        norm = pmj_max(pmj_abs(row[i]) * scales[i], norm);
    }
    return norm;
}

/* log2 of a non-negative number, to 0.01; 0 counts as tiny, infinity and NaN as huge. */
static inline pmj_lanes pmj_rough_log2(pmj_lanes a)
{
    const pmj_mask bits = pmj_bits(a);
    const pmj_lanes whole = (pmj_lanes)(((bits >> 52) & 0x7ffLL) | 0x4330000000000000LL) - 4503599627371519.0;
    const pmj_lanes m = (pmj_lanes)((bits & 0x000fffffffffffffLL) | 0x3ff0000000000000LL);
    return whole + ((2.0 - m * (1.0 / 3.0)) * m - 5.0 / 3.0);
}

/* 2^a to 0.1 %, |a| < 1000. */
static inline pmj_lanes pmj_rough_exp2(pmj_lanes a)
{
    const pmj_lanes n = a + PMJ_ROUNDER;
    const pmj_lanes f = a - (n - PMJ_ROUNDER);
    const pmj_lanes m = ((f * 0.0558 + 0.2402) * f + 0.6931) * f + 1.0;
    return m * (pmj_lanes)((pmj_bits(n) + 1023LL) << 52);
}

/* The step that keeps the last two terms below the tolerance. The root needs no more digits than a safety factor has. */
static inline pmj_lanes pmj_step(const pmj_lanes *c, const pmj_lanes *scales, int channels, int order, double tolerance)
{
    const pmj_lanes last = pmj_norm(c + order * channels, scales, channels) * (1.0 / tolerance);
    const pmj_lanes before = pmj_norm(c + (order - 1) * channels, scales, channels) * (1.0 / tolerance);
    const pmj_lanes root = pmj_rough_log2(last) * (-1.0 / (double)order);
    const pmj_lanes other = pmj_rough_log2(before) * (-1.0 / (double)(order - 1));
    return pmj_safety(order) * pmj_rough_exp2(pmj_min(root, other));
}

#endif
