/* PMJ_WIDTH trajectories side by side: one double of each in a vector, and the arithmetic on it that kernels need.
 *
 ** Vectors are the extension common to GCC and Clang. Every operation works on each lane separately and rounds as the
 * same operation on a single double does; the functions below use + - * / and comparisons alone. So a lane's result
 * depends neither on its neighbours nor on the width, and is the same on every machine that rounds to IEEE 754.
 */
#ifndef PMJOINT_LANES_H
#define PMJOINT_LANES_H

#include <math.h>
#if defined(__AVX__)
#include <immintrin.h>
#endif

#ifndef PMJ_WIDTH
#define PMJ_WIDTH 2
#endif

typedef double pmj_lanes __attribute__((vector_size(8 * PMJ_WIDTH)));
typedef long long pmj_mask __attribute__((vector_size(8 * PMJ_WIDTH)));

/* Adding and taking away 1.5 * 2^52 rounds to a whole number, and shows it in the low bits. */
#define PMJ_ROUNDER 6755399441055744.0
/* Arguments beyond it are reduced by the C library, lane by lane: three parts of pi/2 are exact up to here. */
#define PMJ_LARGEST_ANGLE 1.0e6

static inline pmj_lanes pmj_all(double value)
{
    const pmj_lanes zero = {0.0};
    return zero + value;
}

static inline pmj_mask pmj_bits(pmj_lanes a)
{
    return (pmj_mask)a;
}

static inline pmj_lanes pmj_select(pmj_mask where, pmj_lanes a, pmj_lanes b)
{
    return (pmj_lanes)((where & (pmj_mask)a) | (~where & (pmj_mask)b));
}

static inline pmj_lanes pmj_abs(pmj_lanes a)
{
    return (pmj_lanes)((pmj_mask)a & 0x7fffffffffffffffLL);
}

/* a where a < b, else b; a where a > b, else b; whether any lane of a mask is set: one instruction where there is one. */
#if defined(__AVX512F__) && PMJ_WIDTH == 8
static inline pmj_lanes pmj_min(pmj_lanes a, pmj_lanes b)
{
    return (pmj_lanes)_mm512_min_pd((__m512d)a, (__m512d)b);
}

static inline pmj_lanes pmj_max(pmj_lanes a, pmj_lanes b)
{
    return (pmj_lanes)_mm512_max_pd((__m512d)a, (__m512d)b);
}

static inline int pmj_any(pmj_mask mask)
{
    return _mm512_test_epi64_mask((__m512i)mask, (__m512i)mask) != 0;
}
#elif defined(__AVX__) && PMJ_WIDTH == 4
static inline pmj_lanes pmj_min(pmj_lanes a, pmj_lanes b)
{
    return (pmj_lanes)_mm256_min_pd((__m256d)a, (__m256d)b);
}

static inline pmj_lanes pmj_max(pmj_lanes a, pmj_lanes b)
{
    return (pmj_lanes)_mm256_max_pd((__m256d)a, (__m256d)b);
}

static inline int pmj_any(pmj_mask mask)
{
    return !_mm256_testz_si256((__m256i)mask, (__m256i)mask);
}
#else
static inline pmj_lanes pmj_min(pmj_lanes a, pmj_lanes b)
{
    return pmj_select(a < b, a, b);
}

static inline pmj_lanes pmj_max(pmj_lanes a, pmj_lanes b)
{
    return pmj_select(a > b, a, b);
}

static inline int pmj_any(pmj_mask mask)
{
    long long together = 0;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        together |= mask[w];
    }
    return together != 0;
}
#endif

static inline pmj_lanes pmj_sqrt(pmj_lanes a)
{
    pmj_lanes root = a;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        root[w] = sqrt(a[w]);
    }
    return root;
}

/* A constant exponent that is neither whole nor half: by the C library, lane by lane. */
static inline pmj_lanes pmj_pow(pmj_lanes a, pmj_lanes exponent)
{
    pmj_lanes power = a;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        power[w] = pow(a[w], exponent[w]);
    }
    return power;
}

/* Sine and cosine: reduction by pi/2 in three parts (Cody and Waite), then the polynomials of fdlibm. */
static inline void pmj_sincos(pmj_lanes a, pmj_lanes *sine, pmj_lanes *cosine)
{
    pmj_lanes n = a * 0.63661977236758138 + PMJ_ROUNDER;
    const pmj_mask quadrant = pmj_bits(n);
    n = n - PMJ_ROUNDER;
    pmj_lanes r = a - n * 1.57079632673412561417;
    r = r - n * 6.07710050630396597660e-11;
    r = r - n * 2.02226624879595063154e-21;
    const pmj_lanes z = r * r;
    pmj_lanes s = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08;
    s = s * z + 2.75573137070700676789e-06;
    s = s * z - 1.98412698298579493134e-04;
    s = s * z + 8.33333333332248946124e-03;
    s = s * z - 1.66666666666666324348e-01;
    s = r + r * z * s;
    pmj_lanes c = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11;
    c = c * z - 2.75573143513906633035e-07;
    c = c * z + 2.48015872894767294178e-05;
    c = c * z - 1.38888888888741095749e-03;
    c = c * z + 4.16666666666666019037e-02;
    c = 1.0 - (0.5 * z - z * z * c);
    const pmj_mask odd = -(quadrant & 1LL);
    const pmj_mask turn_s = (quadrant & 2LL) << 62;
    const pmj_mask turn_c = ((quadrant + 1LL) & 2LL) << 62;
    *sine = (pmj_lanes)(pmj_bits(pmj_select(odd, c, s)) ^ turn_s);
    *cosine = (pmj_lanes)(pmj_bits(pmj_select(odd, s, c)) ^ turn_c);
    const pmj_mask beyond = ~(pmj_abs(a) <= PMJ_LARGEST_ANGLE);
    if (pmj_any(beyond)) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            (*sine)[w] = beyond[w] ? sin(a[w]) : (*sine)[w];
            (*cosine)[w] = beyond[w] ? cos(a[w]) : (*cosine)[w];
        }
    }
}

static inline pmj_lanes pmj_sin(pmj_lanes a)
{
    pmj_lanes sine;
    pmj_lanes cosine;
    pmj_sincos(a, &sine, &cosine);
    return sine;
}

static inline pmj_lanes pmj_cos(pmj_lanes a)
{
    pmj_lanes sine;
    pmj_lanes cosine;
    pmj_sincos(a, &sine, &cosine);
    return cosine;
}

static inline pmj_lanes pmj_tan(pmj_lanes a)
{
    pmj_lanes sine;
    pmj_lanes cosine;
    pmj_sincos(a, &sine, &cosine);
    return sine / cosine;
}

/* exp: a = n ln 2 + r, the series of exp(r) on |r| <= 0.347, and 2^n in two factors so that neither overflows. */
static inline pmj_lanes pmj_exp(pmj_lanes a)
{
    const pmj_lanes inside = pmj_select(a > 750.0, pmj_all(750.0), pmj_select(a < -800.0, pmj_all(-800.0), a));
    pmj_lanes n = inside * 1.44269504088896340736 + PMJ_ROUNDER;
    const pmj_mask whole = pmj_bits(n) - 0x4338000000000000LL;
    n = n - PMJ_ROUNDER;
    const pmj_lanes r = (inside - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    pmj_lanes sum = r * 1.6059043836821613e-10 + 2.08767569878681e-09;
    sum = sum * r + 2.505210838544172e-08;
    sum = sum * r + 2.755731922398589e-07;
    sum = sum * r + 2.7557319223985893e-06;
    sum = sum * r + 2.48015873015873e-05;
    sum = sum * r + 1.984126984126984e-04;
    sum = sum * r + 1.3888888888888889e-03;
    sum = sum * r + 8.333333333333333e-03;
    sum = sum * r + 4.1666666666666664e-02;
    sum = sum * r + 1.6666666666666666e-01;
    sum = sum * r + 0.5;
    sum = 1.0 + (r + r * r * sum);
    const pmj_mask half = whole >> 1;
    const pmj_lanes first = (pmj_lanes)((half + 1023LL) << 52);
    const pmj_lanes second = (pmj_lanes)((whole - half + 1023LL) << 52);
    return sum * first * second;
}

/* Natural logarithm: a = 2^n m with m in [sqrt 1/2, sqrt 2), then fdlibm's series in f/(2 + f), f = m - 1. */
static inline pmj_lanes pmj_log(pmj_lanes a)
{
    const pmj_mask tiny = a < 2.2250738585072014e-308;
    const pmj_mask raised = pmj_bits(pmj_select(tiny, a * 18014398509481984.0, a)) + 0x00095f6200000000LL;
    const pmj_mask whole = (raised >> 52) - (1023LL + (tiny & 54LL));
    const pmj_lanes n = (pmj_lanes)(whole + 0x4338000000000000LL) - PMJ_ROUNDER;
    const pmj_lanes f = (pmj_lanes)((raised & 0x000fffffffffffffLL) + 0x3fe6a09e00000000LL) - 1.0;
    const pmj_lanes s = f / (2.0 + f);
    const pmj_lanes z = s * s;
    pmj_lanes sum = z * 1.479819860511658591e-01 + 1.531383769920937332e-01;
    sum = sum * z + 1.818357216161805012e-01;
    sum = sum * z + 2.222219843214978396e-01;
    sum = sum * z + 2.857142874366239149e-01;
    sum = sum * z + 3.999999999940941908e-01;
    sum = (sum * z + 6.666666666666735130e-01) * z;
    const pmj_lanes half = 0.5 * f * f;
    const pmj_lanes value = n * 6.93147180369123816490e-01
                            - ((half - (s * (half + sum) + n * 1.90821492927058770002e-10)) - f);
    const pmj_lanes below = pmj_select(a == 0.0, pmj_all(-HUGE_VAL), pmj_all(NAN));
    return pmj_select(a > 0.0, pmj_select(a < HUGE_VAL, value, a), below);
}

/* tanh: Cephes' rational form up to 0.625, beyond it 1 - 2/(exp(2a) + 1). */
static inline pmj_lanes pmj_tanh(pmj_lanes a)
{
    const pmj_lanes size = pmj_abs(a);
    const pmj_lanes z = a * a;
    const pmj_lanes above = (z * -9.64399179425052238628e-1 - 9.92877231001918586564e1) * z - 1.61468768441708447952e3;
    const pmj_lanes below = ((z + 1.12811678491632931402e2) * z + 2.23548839060100448583e3) * z + 4.84406305325125486048e3;
    const pmj_lanes small = a + a * z * (above / below);
    const pmj_lanes large = 1.0 - 2.0 / (pmj_exp(2.0 * size) + 1.0);
    const pmj_mask sign = pmj_bits(a) & ~0x7fffffffffffffffLL;
    return pmj_select(size < 0.625, small, (pmj_lanes)(pmj_bits(large) | sign));
}

/* exp(|a|)/2 of an argument that is too large for exp itself. */
static inline pmj_lanes pmj_half_exp(pmj_lanes size)
{
    return pmj_select(size > 709.0, pmj_exp(size - 709.0) * 4.109203730777486e+307, 0.5 * pmj_exp(size));
}

/* sinh: its series up to 1, beyond it exp(|a|)/2 - 1/(2 exp(|a|)). */
static inline pmj_lanes pmj_sinh(pmj_lanes a)
{
    const pmj_lanes size = pmj_abs(a);
    const pmj_lanes z = a * a;
    pmj_lanes sum = z * 8.22063524662433e-18 + 2.8114572543455206e-15;
    sum = sum * z + 7.647163731819816e-13;
    sum = sum * z + 1.6059043836821613e-10;
    sum = sum * z + 2.505210838544172e-08;
    sum = sum * z + 2.7557319223985893e-06;
    sum = sum * z + 0.0001984126984126984;
    sum = sum * z + 0.008333333333333333;
    sum = sum * z + 0.16666666666666666;
    const pmj_lanes grown = pmj_half_exp(size);
    const pmj_mask sign = pmj_bits(a) & ~0x7fffffffffffffffLL;
    const pmj_lanes large = (pmj_lanes)(pmj_bits(grown - 0.25 / grown) | sign);
    return pmj_select(size < 1.0, a + a * z * sum, large);
}

static inline pmj_lanes pmj_cosh(pmj_lanes a)
{
    const pmj_lanes grown = pmj_half_exp(pmj_abs(a));
    return grown + 0.25 / grown;
}

/* atan: reduction to |x| <= 7/16 by the atan of 1/2, 1, 3/2 and infinity, then the polynomial of fdlibm. */
static inline pmj_lanes pmj_atan(pmj_lanes a)
{
    const pmj_lanes size = pmj_abs(a);
    const pmj_mask first = size < 0.4375;
    const pmj_mask second = size < 0.6875;
    const pmj_mask third = size < 1.1875;
    const pmj_mask fourth = size < 2.4375;
    pmj_lanes above = pmj_select(fourth, size - 1.5, pmj_all(-1.0));
    pmj_lanes below = pmj_select(fourth, 1.0 + 1.5 * size, size);
    pmj_lanes high = pmj_select(fourth, pmj_all(9.82793723247329054082e-01), pmj_all(1.57079632679489655800e+00));
    pmj_lanes low = pmj_select(fourth, pmj_all(1.39033110312309984516e-17), pmj_all(6.12323399573676603587e-17));
    above = pmj_select(third, size - 1.0, above);
    below = pmj_select(third, size + 1.0, below);
    high = pmj_select(third, pmj_all(7.85398163397448278999e-01), high);
    low = pmj_select(third, pmj_all(3.06161699786838301793e-17), low);
    above = pmj_select(second, 2.0 * size - 1.0, above);
    below = pmj_select(second, 2.0 + size, below);
    high = pmj_select(second, pmj_all(4.63647609000806093515e-01), high);
    low = pmj_select(second, pmj_all(2.26987774529616870924e-17), low);
    const pmj_lanes x = pmj_select(first, size, above / below);
    const pmj_lanes z = x * x;
    const pmj_lanes w = z * z;
    pmj_lanes even = w * 1.62858201153657823623e-02 + 4.97687799461593236017e-02;
    even = even * w + 6.66107313738753120669e-02;
    even = even * w + 9.09088713343650656196e-02;
    even = even * w + 1.42857142725034663711e-01;
    even = even * w + 3.33333333333329318027e-01;
    pmj_lanes odd = w * -3.65315727442169155270e-02 - 5.83357013379057348645e-02;
    odd = odd * w - 7.69187620504482999495e-02;
    odd = odd * w - 1.11111104054623557880e-01;
    odd = odd * w - 1.99999999998764832476e-01;
    const pmj_lanes rest = x * (z * even + w * odd);
    const pmj_lanes value = pmj_select(first, x - rest, high - ((rest - low) - x));
    return (pmj_lanes)(pmj_bits(value) | (pmj_bits(a) & ~0x7fffffffffffffffLL));
}

/* A function of the C library, lane by lane. */
static inline pmj_lanes pmj_each(double (*function)(double), pmj_lanes a)
{
    pmj_lanes value = a;
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        value[w] = function(a[w]);
    }
    return value;
}

#endif
