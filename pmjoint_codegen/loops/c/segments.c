#include "pmjoint_runtime.h"

#include <math.h>
#include <string.h>

double pmj_next_break(const pmj_problem *problem, const pmj_progress *progress)
{
    return progress->segment < problem->n_breaks ? problem->breaks[progress->segment] : HUGE_VAL;
}

long long pmj_segment_at(const pmj_problem *problem, const pmj_progress *progress, double t)
{
    long long segment = progress->segment;
    while (segment < problem->n_breaks && problem->breaks[segment] <= t) {
        segment += 1;
    }
    while (segment > 0 && problem->breaks[segment - 1] > t) {
        segment -= 1;
    }
    return segment;
}

void pmj_put_segment(const pmj_problem *problem, const pmj_memory *memory, long long segment)
{
    memcpy(memory->segment, problem->segments + segment * problem->n_segment,
           (size_t)problem->n_segment * sizeof(double));
}

/* The segment with this index is the present one. */
static void take(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, long long segment)
{
    progress->segment = segment;
    pmj_put_segment(problem, memory, segment);
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
