#include "pmjoint_runtime.h"

#include <math.h>
#include <string.h>
#if defined(__AVX__)
#include <immintrin.h>
#endif

/* Channels side by side, as many as a register holds; memory is padded by three, so that a block may reach past a row. */
#if defined(__AVX__)
#define BLOCK 4
#else
#define BLOCK 2
#endif
/* Adding and taking away 1.5 * 2^52 rounds to a whole number. */
#define ROUNDER 6755399441055744.0

/* A block of channels: vectors of the extension common to GCC and Clang, each lane rounding as a double does. */
typedef double block __attribute__((vector_size(8 * BLOCK)));
typedef long long mask __attribute__((vector_size(8 * BLOCK)));

static inline block load(const double *from)
{
    block b;
    memcpy(&b, from, sizeof b);
    return b;
}

/* The first n numbers of a block, then zeros. */
static inline block load_some(const double *from, long long n)
{
    block b = {0.0};
    for (long long i = 0; i < n; ++i) {
        b[i] = from[i];
    }
    return b;
}

static inline void store(double *to, block b)
{
    memcpy(to, &b, sizeof b);
}

static inline block magnitude(block b)
{
    return (block)((mask)b & 0x7fffffffffffffffLL);
}

/* a where a > b, else b, also where a is NaN. */
#if defined(__AVX__)
static inline block larger(block a, block b)
{
    return (block)_mm256_max_pd((__m256d)a, (__m256d)b);
}
#else
static inline block larger(block a, block b)
{
    const mask where = a > b;
    return (block)((where & (mask)a) | (~where & (mask)b));
}
#endif

/* Values and slopes of all channels at tau. Even and odd powers apart, p = E(tau^2) + tau O(tau^2): half as long a chain as one Horner scheme. */
void pmj_arrive(const double *c, long long width, long long order, double tau, double *values, double *slopes)
{
    const block square = tau * tau + (block){0.0};
    const long long top = order - order % 2; /* the highest even power */
    for (long long first = 0; first < width; first += BLOCK) {
        const double *row = c + top * width + first;
        block even = load(row);
        block odd = {0.0};
        block even_slope = {0.0};
        block odd_slope = {0.0};
        if (order > top) {
            odd = load(row + width);
        }
        for (long long k = top; k > 0; k -= 2) {
            odd_slope = odd_slope * square + odd;
            odd = odd * square + load(row - width);
            row -= 2 * width;
            even_slope = even_slope * square + even;
            even = even * square + load(row);
        }
        store(values + first, even + tau * odd);
        store(slopes + first, odd + (2.0 * tau) * (even_slope + tau * odd_slope));
    }
}

/* Sums of the magnitudes of the terms at tau >= 0, bounds on all values up to tau, of the channels from the block of
 * `from`. */
void pmj_bounds(const double *c, long long width, long long order, double tau, long long from, double *term_sums)
{
    const block square = tau * tau + (block){0.0};
    const long long top = order - order % 2;
    for (long long first = from - from % BLOCK; first < width; first += BLOCK) {
        const double *row = c + top * width + first;
        block even = magnitude(load(row));
        block odd = {0.0};
        if (order > top) {
            odd = magnitude(load(row + width));
        }
        for (long long k = top; k > 0; k -= 2) {
            odd = odd * square + magnitude(load(row - width));
            row -= 2 * width;
            even = even * square + magnitude(load(row));
        }
        store(term_sums + first, even + tau * odd);
    }
}

void pmj_values(const double *c, long long width, long long order, double tau, double *out, long long n)
{
    const block square = tau * tau + (block){0.0};
    const long long top = order - order % 2;
    for (long long first = 0; first < n; first += BLOCK) {
        const double *row = c + top * width + first;
        block even = load(row);
        block odd = {0.0};
        if (order > top) {
            odd = load(row + width);
        }
        for (long long k = top; k > 0; k -= 2) {
            odd = odd * square + load(row - width);
            row -= 2 * width;
            even = even * square + load(row);
        }
        double sum[BLOCK];
        store(sum, even + tau * odd);
        for (long long i = first; i < n && i < first + BLOCK; ++i) {
            out[i] = sum[i - first];
        }
    }
}

/* Values of the first channel at n instants. */
void pmj_channel(const double *c, long long width, long long order, const double *tau, double *out, long long n)
{
    const long long top = order - order % 2;
    for (long long first = 0; first < n; first += BLOCK) {
        const block instants = first + BLOCK <= n ? load(tau + first) : load_some(tau + first, n - first);
        const block square = instants * instants;
        block even = (block){0.0} + c[top * width];
        block odd = {0.0};
        if (order > top) {
            odd = odd + c[order * width];
        }
        for (long long k = top; k > 0; k -= 2) {
            odd = odd * square + c[(k - 1) * width];
            even = even * square + c[(k - 2) * width];
        }
        double sum[BLOCK];
        store(sum, even + instants * odd);
        for (long long i = first; i < n && i < first + BLOCK; ++i) {
            out[i] = sum[i - first];
        }
    }
}

/* Powers of two from 1/max(1, |c_0|) to twice that, zeros behind the last channel. */
void pmj_scales(const double *c, long long width, double *scales)
{
    const block one = (block){0.0} + 1.0;
    for (long long first = 0; first < width; first += BLOCK) {
        const mask exponent = (mask)larger(magnitude(load(c + first)), one) & 0x7ff0000000000000LL;
        store(scales + first, (block)(0x7fe0000000000000LL - exponent));
    }
    for (long long i = width; i % BLOCK != 0; ++i) {
        scales[i] = 0.0;
    }
}

/* The largest |c_k| of a row, relative to max(1, |c_0|); NaN is ignored. */
static double norm(const double *row, const double *scales, long long width)
{
    block most = {0.0};
    for (long long first = 0; first < width; first += BLOCK) {
        most = larger(magnitude(load(row + first)) * load(scales + first), most);
    }
    double largest = most[0];
    for (int i = 1; i < BLOCK; ++i) {
        largest = most[i] > largest ? most[i] : largest;
    }
    return largest;
}

/* log2 of a non-negative number, to 0.01; 0 counts as tiny, infinity as huge. */
static double rough_log2(double a)
{
    long long bits;
    double m;
    memcpy(&bits, &a, sizeof bits);
    const double whole = (double)((bits >> 52) - 1023);
    bits = (bits & 0x000fffffffffffffLL) | 0x3ff0000000000000LL;
    memcpy(&m, &bits, sizeof m);
    return whole + ((2.0 - m * (1.0 / 3.0)) * m - 5.0 / 3.0);
}

/* 2^a to 0.1 %, |a| < 1000. */
static double rough_exp2(double a)
{
    const double n = a + ROUNDER;
    const double f = a - (n - ROUNDER);
    const double m = ((f * 0.0558 + 0.2402) * f + 0.6931) * f + 1.0;
    unsigned long long bits; /* the exponent of ROUNDER is shifted out */
    double power;
    memcpy(&bits, &n, sizeof bits);
    bits = (bits + 1023) << 52;
    memcpy(&power, &bits, sizeof power);
    return m * power;
}

/* Factor on a step whose error is `miss` times the allowed one, by the error's order: 0.55 to 0.95. */
double pmj_shrink(double miss, long long order)
{
    const double factor = PMJ_MOST_SHRINK * rough_exp2(rough_log2(miss) * (-1.0 / (double)order));
    return factor > PMJ_MOST_SHRINK ? PMJ_MOST_SHRINK : factor > PMJ_LEAST_SHRINK ? factor : PMJ_LEAST_SHRINK;
}

double pmj_allowed_step(const double *c, const double *scales, long long width, long long order, double tolerance,
                        double safety)
{
    const double allowed = rough_log2(tolerance);
    const double last = rough_log2(norm(c + order * width, scales, width));
    const double before = rough_log2(norm(c + (order - 1) * width, scales, width));
    const double root = (allowed - last) * (1.0 / (double)order);
    const double other = (allowed - before) * (1.0 / (double)(order - 1));
    return safety * rough_exp2(root < other ? root : other);
}
