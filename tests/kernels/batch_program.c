/* The batch loops as a program of their own: runs from standard input, results to standard output, in the bytes that
 * test_batch_program.py writes and reads. So they run where no Python is. */
#include "pmjoint_batch.h"

#include <stdio.h>
#include <stdlib.h>

enum { RUNS, ROWS, STATES, PARAMETERS, HOLD, HOLD_ROWS, SIZES };
enum { HORIZON, SAMPLE_TIME, TOLERANCE, DIVERGENCE, MAX_STEPS, NUMBERS };

static double *numbers(size_t count)
{
    double *memory = calloc(count + 1, sizeof *memory); /* one more: nothing is asked for at times */
    if (memory == NULL || fread(memory, sizeof *memory, count, stdin) != count) {
        exit(2);
    }
    return memory;
}

static void tell(const double *values, size_t count)
{
    if (fwrite(values, sizeof *values, count, stdout) != count) {
        exit(3);
    }
}

int main(void)
{
    long long size[SIZES];
    if (fread(size, sizeof *size, SIZES, stdin) != SIZES) {
        return 1;
    }
    const size_t runs = (size_t)size[RUNS];
    const size_t rows = (size_t)size[ROWS];
    const size_t states = (size_t)size[STATES];
    const double *number = numbers(NUMBERS);
    const pmj_sweep sweep = {
        .runs = size[RUNS],
        .rows = size[ROWS],
        .hold_stride = size[HOLD_ROWS] > 1 ? size[HOLD] : 0,
        .horizon = number[HORIZON],
        .sample_time = number[SAMPLE_TIME],
        .tolerance = number[TOLERANCE],
        .divergence = number[DIVERGENCE],
        .max_steps = number[MAX_STEPS],
        .x0 = numbers(runs * states),
        .p = numbers(runs * (size_t)size[PARAMETERS]),
        .hold = numbers((size_t)(size[HOLD] * size[HOLD_ROWS])),
        .times = numbers(rows),
    };
    const pmj_results results = {
        .metrics = calloc(runs * PMJ_METRICS, sizeof(double)),
        .final = calloc(runs * states, sizeof(double)),
        .trajectories = calloc(runs * rows * (states + 2) + 1, sizeof(double)),
    };
    if (results.metrics == NULL || results.final == NULL || results.trajectories == NULL) {
        return 2;
    }
    (sweep.sample_time > 0.0 ? pmj_sampled_batch : pmj_continuous_batch)(&sweep, &results);
    tell(results.metrics, runs * PMJ_METRICS);
    tell(results.final, runs * states);
    tell(results.trajectories, runs * rows * (states + 2));
    return 0;
}
