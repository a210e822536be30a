#include "hold.h"
#include "pmjoint_chain.h"
#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define N_CONTROLLER (PMJ_NS - PMJ_NX) /* the controller's states */
#define HELD (PMJ_ACTING + PMJ_NW)
#define MOST 10                        /* derivatives of y_r, z and alpha: the order is 9 at most */

/* y_r at the controller's own time, which may lie in another segment than the plant's; 0 is success. */
static int follow(const pmj_problem *problem, const pmj_controller *controller, const pmj_progress *progress,
                  const pmj_memory *memory, double clock)
{
    const double slack = PMJ_SAME_INSTANT * problem->sample_time;
    const long long own = pmj_segment_at(problem, progress, clock + slack);
    const int other = own != progress->segment;
    if (other) {
        pmj_put_segment(problem, memory, own);
    }
    const int failed = pmj_follow(controller, clock);
    if (other) {
        pmj_put_segment(problem, memory, progress->segment);
    }
    return failed;
}

/* X(0), e(0) and y'(0), under the w that acts; 0 is success. */
static int note_start(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, const pmj_memory *memory)
{
    plant->rates->arg[0] = &progress->t;
    plant->rates->arg[1] = memory->state;
    plant->rates->arg[2] = memory->w;
    plant->rates->arg[3] = problem->p;
    plant->rates->res[0] = memory->rest;
    plant->rates->res[1] = memory->rest + PMJ_NX;
    plant->rates->res[2] = memory->rest + PMJ_NX + 1;
    if (pmj_apply(plant->rates)) {
        return 1;
    }
    progress->band = problem->settled * fabs(memory->rest[E]);
    for (int i = 0; i < PMJ_NS; ++i) {
        pmj_note_value(memory->sample[i], 0.0, memory->peaks + i, memory->peak_times + i);
    }
    pmj_note_value(memory->rest[E], 0.0, memory->peaks + PEAK_E, memory->peak_times + PEAK_E);
    if (problem->notes_rate) {
        pmj_note_value(memory->rest[0], 0.0, memory->peaks + PEAK_RATE, memory->peak_times + PEAK_RATE);
    }
    return 0;
}

/* Let every command act that is due at t; return the instant at which the next one is due. */
static double take_due(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double t)
{
    const pmj_chain *chain = (const pmj_chain *)problem->chain;
    const double slack = PMJ_SAME_INSTANT * chain->period;
    double *held = memory->held;
    for (;;) {
        const long long next = (long long)held[PMJ_NEXT];
        const double due = pmj_instant(chain, next) + chain->delay;
        if (next > progress->sample) {
            return HUGE_VAL;
        }
        if (due > t + slack) {
            return due;
        }
        const long long source = next - (long long)chain->samples;
        if (source >= 0) {
            memcpy(held + PMJ_ACTING, memory->history + (source % problem->n_history) * PMJ_NW, PMJ_NW * sizeof(double));
        }
        held[PMJ_NEXT] = (double)(next + 1);
        memcpy(memory->w, held + PMJ_ACTING, PMJ_NW * sizeof(double));
    }
}

/* Measure, compute and command: what is held from this sample on, and the controller's next states; 0 is success. */
static int take_sample(const pmj_problem *problem, const pmj_functions *run, const pmj_progress *progress,
                       const pmj_memory *memory, double *v, double *next)
{
    const pmj_chain *chain = (const pmj_chain *)problem->chain;
    const long long k = progress->sample;
    double *held = memory->held;
    double *sent = memory->history + (k % problem->n_history) * PMJ_NW;
    if (k == 0) { /* before the first sample the command is 0, or what the limits leave of it */
        held[PMJ_COMMAND] = pmj_between(0.0, chain->lower, chain->upper);
        held[PMJ_NEXT] = 0.0;
        for (int j = 0; j < PMJ_NW; ++j) {
            held[PMJ_ACTING + j] = pmj_channel_of(chain, problem->limits + 4 * j, j, held[PMJ_COMMAND]);
        }
        memcpy(memory->w, held + PMJ_ACTING, PMJ_NW * sizeof(double));
    }
    double y_r[MOST];
    double z[MOST];
    double alpha[MOST];
    const pmj_sample_values at = {memory->sample + PMJ_NX, held, v, z, alpha, y_r};
    const pmj_controller controller = {.reference = run->reference,
                                       .law = run->law,
                                       .update = run->update,
                                       .p = problem->p,
                                       .hold = problem->hold,
                                       .chain = problem->chain,
                                       .y_r = y_r};
    held[PMJ_CLOCK] = (double)k * chain->period;
    if (follow(problem, &controller, progress, memory, held[PMJ_CLOCK])
        || pmj_decide(&controller, &at, pmj_read(chain, memory->sample[0], k), k)) {
        return 1;
    }
    for (int j = 0; j < PMJ_NW; ++j) {
        sent[j] = pmj_channel_of(chain, problem->limits + 4 * j, j, held[PMJ_COMMAND]);
    }
    return pmj_advance(&controller, &at, held[PMJ_U], next);
}

/* Rows from..to-1 show what is held now. */
static void keep_held(const pmj_memory *memory, long long from, long long to)
{
    for (long long row = from; row < to; ++row) {
        memcpy(memory->row_held + row * HELD, memory->held, HELD * sizeof(double));
    }
}

/* The plant from one sample to the next, cut where the command that acts changes. */
static void hold_pieces(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress,
                        const pmj_memory *memory, double t, double end, double due)
{
    const double slack = PMJ_SAME_INSTANT * problem->sample_time;
    const double horizon = problem->times[problem->n_rows - 1];
    const double last = horizon < end - slack ? horizon : end; /* the horizon may lie inside this hold */
    while (progress->status == PMJ_RUNNING && progress->t < last) {
        const int cut = due < end - slack && due < last;
        const long long before = progress->row;
        pmj_long_hold(problem, plant, progress, memory, cut ? due : last, cut ? due : end - slack, t);
        keep_held(memory, before, progress->row);
        if (cut && progress->status == PMJ_RUNNING) {
            due = take_due(problem, progress, memory, due);
            if (pmj_enter_break(problem, plant->rates, progress, memory, progress->t)) {
                progress->status = PMJ_KERNEL_FAILED;
            }
        }
    }
}

static void whole_sample(const pmj_problem *problem, const pmj_functions *run, pmj_progress *progress, const pmj_memory *memory)
{
    const pmj_chain *chain = (const pmj_chain *)problem->chain;
    const double slack = PMJ_SAME_INSTANT * chain->period;
    const double t = pmj_instant(chain, progress->sample);
    double v = 0.0;
    double next[N_CONTROLLER];
    memcpy(memory->state, memory->sample, PMJ_NS * sizeof(double));
    progress->t = t;
    progress->evaluations += 1;
    if (pmj_enter_break(problem, run->plant.rates, progress, memory, t + slack)
        || take_sample(problem, run, progress, memory, &v, next)) {
        progress->status = PMJ_KERNEL_FAILED;
        return;
    }
    pmj_note_value(v, t, memory->peaks + PEAK_V, memory->peak_times + PEAK_V);
    if (!(fabs(v) <= DBL_MAX)) {
        progress->status = PMJ_NON_FINITE;
        return;
    }
    pmj_note_mode(problem, progress, memory, t, v);
    const double due = take_due(problem, progress, memory, t);
    const long long before = progress->row;
    if (progress->sample == 0) {
        keep_held(memory, 0, 1);
    }
    if (progress->sample == 0 && note_start(problem, &run->plant, progress, memory)) {
        progress->status = PMJ_KERNEL_FAILED;
    }
    if (progress->sample == 0 && pmj_beyond(problem, memory->sample)) {
        progress->status = PMJ_DIVERGED;
    }
    while (progress->row < problem->n_rows && problem->times[progress->row] <= t + slack) {
        pmj_next_row(progress, memory, t);
    }
    keep_held(memory, before, progress->row);
    if (progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
    }
    hold_pieces(problem, &run->plant, progress, memory, t, pmj_instant(chain, progress->sample + 1), due);
    if (progress->status == PMJ_RUNNING && progress->row == problem->n_rows) {
        progress->status = PMJ_DONE;
    }
    if (progress->status == PMJ_RUNNING) {
        pmj_settle(problem, progress, memory, next);
        progress->sample += 1;
    }
}

/* Advance the sampled loop with sensor, actuator and clock by at most `budget` samples; see `pmj_sampled`. Every hold takes
 * the steps of a long one: it may be cut where a delayed command begins to act. */
void pmj_chained(const pmj_problem *problem, const pmj_functions *run, pmj_progress *progress, pmj_memory *memory,
                 long long budget)
{
    for (long long i = 0; i < budget && progress->status == PMJ_RUNNING; ++i) {
        whole_sample(problem, run, progress, memory);
    }
}
