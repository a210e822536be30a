/* The batch loops as a program of their own: runs from standard input, results to standard output, in the bytes that
 * test_batch_program.py writes and reads. So they run where no Python is. */
#include "pmjoint_batch.h"

#include <stdio.h>
#include <stdlib.h>

enum { RUNS, ROWS, STATES, PARAMETERS, HOLD, HOLD_ROWS, SIZES };
enum { HORIZON, SAMPLE_TIME, TOLERANCE, DIVERGENCE, MAX_STEPS, MAX_STEP, SETTLED, LEBESGUE, NUMBERS };
enum { INSIDE, RATIOS, HOLD_RATIOS, RULE_SIZES };

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
    const double *lengths = numbers(RULE_SIZES);
    pmj_rule rule = {.lebesgue = number[LEBESGUE]};
    pmj_rule hold_rule = {.lebesgue = 0.0};
    rule.n_inside = (long long)lengths[INSIDE];
    rule.n_ratios = (long long)lengths[RATIOS];
    hold_rule.n_ratios = (long long)lengths[HOLD_RATIOS];
    rule.inside = numbers((size_t)lengths[INSIDE]); /* in the order in which they come */
    rule.ratios = numbers((size_t)lengths[RATIOS]);
    rule.factors = numbers((size_t)lengths[RATIOS]);
    hold_rule.ratios = numbers((size_t)lengths[HOLD_RATIOS]);
    hold_rule.factors = numbers((size_t)lengths[HOLD_RATIOS]);
    const double *value_factors = numbers((size_t)lengths[HOLD_RATIOS]);
    const double *x0 = numbers(runs * states);
    const double *p = numbers(runs * (size_t)size[PARAMETERS]);
    const double *hold = numbers((size_t)(size[HOLD] * size[HOLD_ROWS]));
    const double *reach = numbers(states);
    const pmj_sweep sweep = {
        .runs = size[RUNS],
        .rows = size[ROWS],
        .hold_stride = size[HOLD_ROWS] > 1 ? size[HOLD] : 0,
        .horizon = number[HORIZON],
        .sample_time = number[SAMPLE_TIME],
        .tolerance = number[TOLERANCE],
        .divergence = number[DIVERGENCE],
        .reach = reach,
        .max_steps = number[MAX_STEPS],
        .max_step = number[MAX_STEP],
        .settled = number[SETTLED],
        .rule = rule,
        .hold_rule = hold_rule,
        .hold_value_factors = value_factors,
        .x0 = x0,
        .p = p,
        .hold = hold,
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
