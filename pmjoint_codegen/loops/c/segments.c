#include "pmjoint_runtime.h"

#include <math.h>
#include <string.h>

double pmj_next_break(const pmj_problem *problem, const pmj_progress *progress)
{
    return progress->segment < problem->n_breaks ? problem->breaks[progress->segment] : HUGE_VAL;
}

/* Put the reference's segment into p: the one with this index. */
static void take(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long segment)
{
    progress->segment = segment;
    memcpy(memory->segment, problem->segments + segment * problem->n_segment,
           (size_t)problem->n_segment * sizeof(double));
}

void pmj_first_segment(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory)
{
    if (problem->n_segment > 0) {
        take(problem, progress, memory, 0);
    }
}

int pmj_enter_segments(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t)
{
    const long long before = progress->segment;
    while (pmj_next_break(problem, progress) <= t) {
        take(problem, progress, memory, progress->segment + 1);
    }
    return progress->segment > before;
}
