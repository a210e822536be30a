#include "stick.h"

#include <math.h>

void pmj_deliver(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double v)
{
    const double *g = problem->modes + progress->mode * 2 * problem->n_actuated;
    for (long long i = 0; i < problem->n_actuated; ++i) {
        memory->w[i] = g[2 * i] + g[2 * i + 1] * v;
    }
    for (long long j = 0; j < 2 * problem->n_kinks; ++j) {
        memory->w[problem->n_actuated + j] = memory->sides[j];
    }
}

int pmj_can_hold(const pmj_problem *problem, const pmj_kernels *run, const pmj_memory *memory, double t, long long j,
                 double *side)
{
    const long long n = problem->n_kinks;
    run->holds->arg[0] = &t;
    run->holds->arg[1] = memory->state;
    run->holds->arg[2] = memory->w;
    run->holds->arg[3] = problem->p;
    run->holds->res[0] = memory->holds;
    run->holds->res[1] = memory->holds + n;
    run->holds->res[2] = memory->holds + 2 * n;
    if (pmj_apply(run->holds)) {
        return -1;
    }
    *side = memory->holds[j];
    return fabs(*side) <= 1.0 && memory->holds[n + j] < 0.0;
}

/* Record that kink j begins to hold the run, or lets go. */
static void note_change(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, long long j)
{
    if (progress->holds < problem->max_switches) {
        memory->hold_times[progress->holds] = t;
        memory->hold_kinks[progress->holds] = j;
        progress->holds += 1;
    } else {
        progress->status = PMJ_TOO_MANY_SWITCHES;
    }
}

/* The flag of kink j, where kernels read it. */
static void flag(const pmj_problem *problem, const pmj_memory *memory, long long j, double value)
{
    memory->sides[problem->n_kinks + j] = value;
    memory->w[problem->n_actuated + problem->n_kinks + j] = value;
    memory->window[1] = -1.0; /* the right-hand side is another function */
}

void pmj_hold_on(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, long long j)
{
    const double *place = memory->holds + 2 * problem->n_kinks + j * problem->n_plant;
    for (long long i = 0; i < problem->n_plant; ++i) {
        memory->state[i] = place[i];
    }
    progress->held = j;
    progress->touching = -1;
    flag(problem, memory, j, 1.0);
    note_change(problem, progress, memory, t, j);
}

int pmj_find_rest(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory,
                  const double *arguments)
{
    double side = 0.0;
    for (long long j = 0; run->holds && j < problem->n_kinks; ++j) {
        const int holds = arguments[j] == 0.0 ? pmj_can_hold(problem, run, memory, progress->t, j, &side) : 0;
        if (holds > 0) {
            pmj_hold_on(problem, progress, memory, progress->t, j);
        }
        if (holds) {
            return holds;
        }
    }
    return 0;
}

void pmj_let_go(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, double side,
                long long first)
{
    const long long j = progress->held;
    memory->sides[j] = side < 0.0 ? -1.0 : 1.0;
    memory->w[problem->n_actuated + j] = memory->sides[j];
    progress->held = -1;
    progress->touching = first + problem->n_kinks + j;
    flag(problem, memory, j, 0.0);
    note_change(problem, progress, memory, t, j);
}

void pmj_meet(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory,
              double t, long long j, double side, long long first)
{
    double would = 0.0;
    int holds = 0;
    progress->flips += 1;
    if (progress->held == j) {
        pmj_let_go(problem, progress, memory, t, side, first);
    } else {
        if (progress->held < 0 && run->holds) {
            holds = pmj_can_hold(problem, run, memory, t, j, &would);
        }
        if (holds > 0) {
            pmj_hold_on(problem, progress, memory, t, j);
        } else {
            memory->sides[j] = -memory->sides[j];
            memory->w[problem->n_actuated + j] = memory->sides[j];
            memory->window[1] = -1.0;
            progress->touching = first + j;
        }
    }
    if (holds < 0) {
        progress->status = PMJ_KERNEL_FAILED;
    } else if (progress->flips > 2 * problem->n_kinks) {
        progress->status = PMJ_SLIDING;
    }
}
