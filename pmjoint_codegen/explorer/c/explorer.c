/* One run of the closed loop for a page: the same kernels and loops as `pmjoint simulate`. */
#include "explorer.h"

#include <math.h>
#include <string.h>

#define PADDED(n) ((n) + PMJ_PADDING)
#define AT_LEAST(n) ((n) > 0 ? (n) : 1)

double explorer_p[PMJ_NP];
double explorer_filter[N_ORDER * N_ORDER];
double explorer_compensator[N_COMPENSATOR * N_COMPENSATOR];

static double state[PMJ_NS];
static double settings[SETTINGS];
static double limits[4 * PMJ_NW];
static double reach[PMJ_NS];
static double thresholds[MOST_THRESHOLDS];
static double modes[(MOST_THRESHOLDS + 1) * 2 * PMJ_NW];
static double chain[13];
static double breaks[MOST_BREAKS];
static double segments[(MOST_BREAKS + 1) * AT_LEAST(N_SEGMENT)];
static double times[MOST_ROWS];
static double results[RESULTS];
static double rows[MOST_ROWS * PMJ_NS];
static double signals[MOST_ROWS * N_SIGNALS];
static double peaks[PMJ_NS + 3];
static double peak_times[PMJ_NS + 3];
static double switch_times[MOST_SWITCHES];
static double switch_modes[MOST_SWITCHES];
static long long switched[MOST_SWITCHES];

static double hold[PMJ_NH];
static double coefficients[2 * PADDED((MOST_ORDER + 1) * MOST_CHANNELS)];
static double working[8][PADDED(MOST_CHANNELS)];
static double start_state[PMJ_NS];
static double g[2 * (PMJ_NW + AT_LEAST(PMJ_NK))];
static double w[PMJ_NW + 2 * AT_LEAST(PMJ_NK)];
static double window[2 + 2 * PMJ_NX];
static double sides[2 * AT_LEAST(PMJ_NK)];
static double holds[AT_LEAST(PMJ_NK * (2 + PMJ_NX))];
static double hold_times[PMJ_NK > 0 ? MOST_SWITCHES : 1];
static long long hold_kinks[PMJ_NK > 0 ? MOST_SWITCHES : 1];
static double sample[PMJ_NS];
static double row_samples[MOST_ROWS * PMJ_NS];
static double row_sample_times[MOST_ROWS];
static double held[6 + PMJ_NW];
static double row_held[LOOPED ? MOST_ROWS * (6 + PMJ_NW) : 1];
static double history[LOOPED ? MOST_HISTORY * PMJ_NW : 1];

static pmj_problem problem;
static pmj_progress progress;
static pmj_memory memory;

/* Kernels and the pointers to what they read and write. */
#define MOST_ARGUMENTS 8
#define KERNELS 10
static const double *arguments[KERNELS][MOST_ARGUMENTS];
static double *outcomes[KERNELS][MOST_ARGUMENTS];
static pmj_function functions[KERNELS];
static pmj_functions run;

static const pmj_function *bound(int place, pmj_kernel kernel)
{
    const pmj_function made = {kernel, arguments[place], outcomes[place], 0, 0};
    functions[place] = made;
    return &functions[place];
}

static void bind(int sampled)
{
    memset(&run, 0, sizeof run);
    run.plant.taylor = bound(0, sampled ? pmjoint_plant_taylor : pmjoint_taylor);
    run.plant.guard = bound(1, sampled ? pmjoint_plant_guard : pmjoint_guard);
    run.plant.rates = bound(2, sampled ? pmjoint_plant : pmjoint_closed_loop);
#if CAN_HOLD
    run.plant.held_taylor = bound(3, sampled ? pmjoint_plant_taylor_held : pmjoint_taylor_held);
    run.plant.held_guard = bound(4, sampled ? pmjoint_plant_guard_held : pmjoint_guard_held);
    run.plant.held_rates = bound(5, sampled ? pmjoint_plant_held : pmjoint_closed_loop_held);
    run.plant.holds = bound(6, pmjoint_holds);
#endif
    run.reference = bound(7, pmjoint_reference);
    run.law = bound(8, pmjoint_law);
    run.update = bound(9, pmjoint_sampled_update);
}

/* What differs from run to run; the rest is in explorer_model.h. */
static void pose(int sampled)
{
    static const pmj_problem continuous = {CONTINUOUS_PROBLEM};
    static const pmj_problem clocked = {SAMPLED_PROBLEM};
    problem = sampled ? clocked : continuous;
    problem.p = explorer_p;
    problem.limits = limits;
    problem.thresholds = thresholds;
    problem.n_thresholds = (long long)settings[N_THRESHOLDS];
    problem.modes = modes;
    problem.breaks = breaks;
    problem.segments = segments;
    problem.n_breaks = (long long)settings[N_BREAKS];
    problem.n_segment = N_SEGMENT;
    problem.times = times;
    problem.n_rows = (long long)settings[N_ROWS];
    problem.divergence = settings[DIVERGENCE];
    problem.max_switches = MOST_SWITCHES;
    problem.hold = hold;
    problem.chain = chain;
    problem.sample_time = sampled ? settings[SAMPLE_TIME] : 0.0;
    problem.n_history = sampled ? (long long)settings[N_HISTORY] : 0;
    problem.reach = reach;
    for (int i = 0; i < PMJ_NS; ++i) { /* as in pmjoint_codegen/loops/logits.py */
        reach[i] = boundless[i] ? HUGE_VAL : settings[DIVERGENCE];
    }
}

static void provide(void)
{
    const pmj_memory made = {
        .coefficients = coefficients,
        .state = start_state,
        .trial = working[0],
        .slope = working[1],
        .term_sums = working[2],
        .scales = working[3],
        .majorants = working[4],
        .rest = working[5],
        .rates = working[6],
        .g = g,
        .w = w,
        .window = window,
        .segment = explorer_p + PMJ_NP - N_SEGMENT,
        .sides = sides,
        .holds = holds,
        .hold_times = hold_times,
        .hold_kinks = hold_kinks,
        .sample = sample,
        .rows = rows,
        .row_samples = row_samples,
        .row_sample_times = row_sample_times,
        .held = held,
        .row_held = row_held,
        .history = history,
        .peaks = peaks,
        .peak_times = peak_times,
        .switch_times = switch_times,
        .switch_modes = switched,
    };
    memory = made;
    memset(coefficients, 0, sizeof coefficients);
    memset(working, 0, sizeof working);
    memset(g, 0, sizeof g);
    memset(w, 0, sizeof w);
    memset(history, 0, sizeof history);
    memset(held, 0, sizeof held);
    memset(row_sample_times, 0, sizeof row_sample_times);
    for (int i = 0; i < PMJ_NK; ++i) {
        sides[i] = 1.0;
    }
    for (int i = 0; i < 2 + 2 * PMJ_NX; ++i) {
        window[i] = -1.0;
    }
}

static void record(void)
{
    results[STATUS] = (double)progress.status;
    results[REACHED] = progress.t;
    results[ROW] = (double)progress.row;
    results[STEPS] = (double)progress.steps;
    results[INTEGRAL] = progress.integral;
    results[BAND] = progress.band;
    results[SETTLED] = progress.settled;
    results[FIRST_MODE] = (double)progress.first_mode;
    results[SWITCHES] = (double)progress.switches;
    results[TOUCHING] = (double)progress.touching;
    results[STUCK] = (double)progress.holds;
    for (long long i = 0; i < progress.switches; ++i) {
        switch_modes[i] = (double)switched[i];
    }
}

/* Where a place of the enumeration is. */
double *explorer_place(int place)
{
    double *const places[PLACES] = {
        explorer_p, state, settings,   limits, thresholds, modes,      chain,        breaks,       segments,
        times,      results, rows,     signals, peaks,     peak_times, switch_times, switch_modes, explorer_filter};
    return places[place];
}

/* The actuator's channels and the matrices of filters and compensator at the present p; 0 is success. */
int explorer_actuation(void)
{
    const double *arg[] = {explorer_p};
    double *out[] = {limits};
    double *filter[] = {explorer_filter};
    double *compensator[] = {explorer_compensator};
    return pmjoint_actuation(arg, out, 0, 0, 0) || pmjoint_filter_matrix(arg, filter, 0, 0, 0)
           || pmjoint_compensator_matrix(arg, compensator, 0, 0, 0);
}

/* Match the controller's state in X(0) to a measured y; 0 is success. */
int explorer_match(double y)
{
    const double t = 0.0;
    double y_r[N_RHO + 1];
    const double *at[] = {&t, explorer_p};
    double *reference[] = {y_r};
    const double *arg[] = {&y, y_r, explorer_p};
    double *out[] = {state + PMJ_NX};
    return pmjoint_reference(at, reference, 0, 0, 0) || pmjoint_start(arg, out, 0, 0, 0);
}

/* What the sensor reads of y at the first sample. */
double explorer_read(double y)
{
    pmj_chain link;
    memcpy(&link, chain, sizeof link);
    return pmj_read(&link, y, 0);
}

/* Prepare a run from X(0) = state. */
void explorer_begin(int sampled)
{
    bind(sampled);
    pose(sampled);
    provide();
    if (sampled) {
        explorer_hold(problem.sample_time, hold);
    }
    memcpy(start_state, state, sizeof state);
    pmj_begin(&problem, &progress, &memory);
    record();
}

/* Advance it by at most a number of steps or samples; gives its status. */
int explorer_advance(double budget)
{
    if (problem.n_history > 0) {
        pmj_chained(&problem, &run, &progress, &memory, (long long)budget);
    } else if (problem.sample_time > 0.0) {
        pmj_sampled(&problem, &run.plant, &progress, &memory, (long long)budget);
    } else {
        pmj_continuous(&problem, &run.plant, &progress, &memory, (long long)budget);
    }
    record();
    return (int)progress.status;
}

/* Signals at the rows that the run has reached; 0 is success. */
int explorer_signals(void)
{
    return explorer_report(&problem, &progress, &memory, signals);
}
