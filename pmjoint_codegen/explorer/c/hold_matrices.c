/* exp(A T) and its integral: the C twin of pmjoint_codegen/loops/hold.py, same arithmetic, same order. */
#include "explorer.h"

#include <math.h>
#include <string.h>

#define RADIUS 0.5
#define DEGREE 14
#define BALANCING 4
#define MOST 16

static double row_sum(const double *M, int size, int i)
{
    double sum = M[i * size];
    for (int j = 1; j < size; ++j) {
        sum = sum + M[i * size + j];
    }
    return sum;
}

static double column_sum(const double *M, int size, int j)
{
    double sum = M[j];
    for (int i = 1; i < size; ++i) {
        sum = sum + M[i * size + j];
    }
    return sum;
}

/* Towards minus infinity, as Python's // is. */
static int half(int exponent)
{
    return exponent >= 0 ? exponent / 2 : -((1 - exponent) / 2);
}

static void balance(double *M, int size)
{
    for (int round = 0; round < (size > 1 ? BALANCING : 0); ++round) {
        for (int i = 0; i < size; ++i) {
            const double row = row_sum(M, size, i) - M[i * size + i];
            const double column = column_sum(M, size, i) - M[i * size + i];
            const int both = row > 0.0 && column > 0.0;
            int exponent = 0;
            (void)frexp((both ? row : 1.0) / (both ? column : 1.0), &exponent);
            const double factor = ldexp(1.0, half(exponent));
            for (int j = 0; j < size; ++j) {
                M[i * size + j] /= factor;
            }
            for (int j = 0; j < size; ++j) {
                M[j * size + i] *= factor;
            }
        }
    }
}

static int halvings(const double *A, int size, double sample_time)
{
    double M[MOST * MOST];
    double norm = 0.0;
    int exponent = 0;
    for (int i = 0; i < size * size; ++i) {
        M[i] = fabs(A[i]);
    }
    balance(M, size);
    for (int i = 0; i < size; ++i) {
        const double sum = row_sum(M, size, i);
        norm = sum > norm ? sum : norm;
    }
    norm = norm * sample_time;
    (void)frexp((norm < HUGE_VAL ? norm : 0.0) / RADIUS, &exponent);
    return exponent > 0 ? exponent : 0;
}

static void product(const double *one, const double *other, int size, double *out)
{
    for (int i = 0; i < size; ++i) {
        for (int j = 0; j < size; ++j) {
            double sum = one[i * size] * other[j];
            for (int k = 1; k < size; ++k) {
                sum = sum + one[i * size + k] * other[k * size + j];
            }
            out[i * size + j] = sum;
        }
    }
}

static void exponential(const double *A, int size, double sample_time, double *E, double *F)
{
    double step[MOST * MOST];
    double total[MOST * MOST];
    double next[MOST * MOST];
    const int s = halvings(A, size, sample_time);
    const double h = ldexp(sample_time, -s);
    const int count = size * size;
    for (int i = 0; i < count; ++i) {
        step[i] = A[i] * h;
        total[i] = (i % (size + 1) == 0 ? 1.0 : 0.0) / (double)(DEGREE + 1);
    }
    for (int k = DEGREE; k > 0; --k) {
        product(step, total, size, next);
        for (int i = 0; i < count; ++i) {
            total[i] = ((i % (size + 1) == 0 ? 1.0 : 0.0) + next[i]) / (double)k;
        }
    }
    product(step, total, size, next);
    for (int i = 0; i < count; ++i) {
        E[i] = (i % (size + 1) == 0 ? 1.0 : 0.0) + next[i];
        F[i] = total[i] * h;
    }
    for (int done = 0; done < s; ++done) {
        product(E, F, size, next);
        for (int i = 0; i < count; ++i) {
            F[i] = F[i] + next[i];
        }
        product(E, E, size, next);
        memcpy(E, next, (size_t)count * sizeof(double));
    }
}

void explorer_hold(double sample_time, double *hold)
{
    const int n = N_ORDER * N_ORDER;
    const int other = N_COMPENSATOR * N_COMPENSATOR;
    exponential(explorer_filter, N_ORDER, sample_time, hold, hold + n);
    exponential(explorer_compensator, N_COMPENSATOR, sample_time, hold + 2 * n, hold + 2 * n + other);
}
