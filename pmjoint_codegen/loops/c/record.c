#include "pmjoint_runtime.h"

#include <math.h>

/* Reset a run to start from `memory->state`: `progress` and `memory` become as when they were made. */
void pmj_begin(const pmj_problem *problem, pmj_progress *progress, pmj_memory *memory)
{
    const pmj_progress fresh = {.touching = -1, .row = 1, .last_cut = HUGE_VAL, .held = -1};
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
    for (long long j = 0; j < problem->n_kinks; ++j) {
        memory->sides[problem->n_kinks + j] = 0.0;
    }
}

/* Record a change of mode at time t; a touch, there and back at one instant, is none. */
void pmj_note_switch(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, long long mode)
{
    const long long n = progress->switches;
    const long long before = n > 1 ? memory->switch_modes[n - 2] : progress->first_mode;
    if (n > 0 && memory->switch_times[n - 1] == t && before == mode) {
        progress->switches -= 1;
    } else if (t == 0.0) {
        progress->first_mode = mode;
    } else if (n < problem->max_switches) {
        memory->switch_times[n] = t;
        memory->switch_modes[n] = mode;
        progress->switches += 1;
    } else {
        progress->status = PMJ_TOO_MANY_SWITCHES;
    }
}
