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
