#include "lanes.h"
#include "pmjoint_batch.h"

long long pmj_width(void)
{
    return PMJ_WIDTH;
}

void pmj_matrices(long long runs, const double *p, double *matrices)
{
    pmj_lanes values[PMJ_NP];
    pmj_lanes result[PMJ_NM];
    for (long long first = 0; first < runs; first += PMJ_WIDTH) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            const long long run = first + w < runs ? first + w : runs - 1;
            for (int i = 0; i < PMJ_NP; ++i) {
                values[i][w] = p[run * PMJ_NP + i];
            }
        }
        pmj_matrices_lanes(values, result);
        for (int w = 0; w < PMJ_WIDTH && first + w < runs; ++w) {
            for (int i = 0; i < PMJ_NM; ++i) {
                matrices[(first + w) * PMJ_NM + i] = result[i][w];
            }
        }
    }
}

void pmj_starts(long long runs, const double *y, const double *p, double *states)
{
    const pmj_lanes start[1] = {{0.0}}; /* t = 0 */
    pmj_lanes output[1];
    pmj_lanes reference[PMJ_NR];
    pmj_lanes values[PMJ_NP];
    pmj_lanes result[PMJ_NS - PMJ_NX];
    for (long long first = 0; first < runs; first += PMJ_WIDTH) {
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            const long long run = first + w < runs ? first + w : runs - 1;
            output[0][w] = y[run];
            for (int i = 0; i < PMJ_NP; ++i) {
                values[i][w] = p[run * PMJ_NP + i];
            }
        }
        pmj_reference_lanes(start, values, reference);
        pmj_start_lanes(output, reference, values, result);
        for (int w = 0; w < PMJ_WIDTH && first + w < runs; ++w) {
            for (int i = 0; i < PMJ_NS - PMJ_NX; ++i) {
                states[(first + w) * (PMJ_NS - PMJ_NX) + i] = result[i][w];
            }
        }
    }
}
