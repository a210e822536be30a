#include "pmjoint_runtime.h"

#include <math.h>

/* Reset a run to start from `memory->state`: `progress` and `memory` become as when they were made. */
void pmj_begin(const pmj_problem *problem, pmj_progress *progress, pmj_memory *memory)
{
    const pmj_progress fresh = {.touching = -1, .row = 1, .last_cut = HUGE_VAL};
    *progress = fresh;
    pmj_first_segment(problem, progress, memory);
    for (long long i = 0; i < problem->n_states; ++i) {
        memory->rows[i] = memory->state[i];
        memory->sample[i] = memory->state[i];
        if (problem->sample_time > 0.0) {
            memory->row_samples[i] = memory->state[i];
        }
    }
    for (long long i = 0; i < problem->n_states + 3; ++i) {
        memory->peaks[i] = 0.0;
        memory->peak_times[i] = 0.0;
    }
}
