/* Stick: a kink that holds the run; see emit/stick.py. Both loops use this. */
#ifndef PMJOINT_STICK_H
#define PMJOINT_STICK_H

#include "pmjoint_runtime.h"

/* The kernels for the present step: those of a plant that is held while a kink holds the run. */
static inline const pmj_function *pmj_taylor_now(const pmj_kernels *run, const pmj_progress *progress)
{
    return progress->held < 0 ? run->taylor : run->held_taylor;
}

static inline const pmj_function *pmj_guard_now(const pmj_kernels *run, const pmj_progress *progress)
{
    return progress->held < 0 ? run->guard : run->held_guard;
}

static inline const pmj_function *pmj_rates_now(const pmj_kernels *run, const pmj_progress *progress)
{
    return progress->held < 0 ? run->rates : run->held_rates;
}

/* Set `memory->w`: the output of the actuator at a value of v in the present mode, then the sides. */
void pmj_deliver(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, double v);

/* Whether kink j can hold the run at `memory->state` under `memory->w`: 1, 0, or -1 if the kernel fails. `*side` becomes
 * the side with which it would. */
int pmj_can_hold(const pmj_problem *problem, const pmj_kernels *run, const pmj_memory *memory, double t, long long j,
                 double *side);

/* From time t, kink j holds the run, exactly on its zero if one state alone decides that. Follows `pmj_can_hold`. */
void pmj_hold_on(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, long long j);

/* A kink that can hold the run begins to if its argument is exactly 0, as at a start from rest: 1, else 0, or -1 if a
 * kernel fails. */
int pmj_find_rest(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory,
                  const double *arguments);

/* At time t, the kink that holds the run lets go, to the side whose sign `side` has. `first` is the value of `touching` on
 * kink 0. */
void pmj_let_go(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, double side,
                long long first);

/* The run arrives at kink j at time t, or the kink that holds it has reached `side` and lets go. It stops there, or passes
 * to the other side. */
void pmj_meet(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, const pmj_memory *memory,
              double t, long long j, double side, long long first);

#endif
