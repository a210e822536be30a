#include "chained_lanes.h"
#include "pmjoint_chain.h"
#include "pmjoint_runtime.h"

#include <float.h>

static const pmj_chain *chain_of(const pmj_sweep *sweep, const pmj_sampled_group *all, int w)
{
    const long long run = all->runs.lanes[w].run;
    return (const pmj_chain *)(sweep->chain + (run > 0 ? run : 0) * PMJ_CHAIN_SIZE);
}

/* The actuator's channels of lane w for a command. */
static void send(const pmj_chain *chain, const pmj_lanes *limits, int w, double command, double *sent)
{
    for (int j = 0; j < PMJ_NW; ++j) {
        const double row[4] = {limits[4 * j][w], limits[4 * j + 1][w], limits[4 * j + 2][w], limits[4 * j + 3][w]};
        sent[j] = pmj_channel_of(chain, row, j, command);
    }
}

/* Lane w of the commands that wait: channel j of the one of sample k. */
static double *kept(const pmj_sweep *sweep, long long k, int j, int w)
{
    return sweep->history + ((k % sweep->n_history) * PMJ_NW + j) * PMJ_WIDTH + w;
}

void pmj_chained_instants(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_lanes *t, pmj_lanes *end)
{
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        const pmj_chain *chain = chain_of(sweep, all, w);
        (*t)[w] = pmj_instant(chain, (long long)all->sample[w]);
        (*end)[w] = pmj_instant(chain, (long long)all->sample[w] + 1);
    }
}

void pmj_chained_control(const pmj_sweep *sweep, pmj_sampled_group *all, pmj_mask at)
{
    pmj_lanes clock = all->sample * sweep->sample_time;
    if (pmj_any(all->runs.fresh & at)) {
        pmj_lanes c[(PMJ_HOLD_ORDER + 1) * CHANNELS];
        pmj_actuation_lanes(all->runs.p, all->limits);
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (all->runs.fresh[w] && at[w]) {
                const pmj_chain *chain = chain_of(sweep, all, w);
                double sent[PMJ_NW];
                all->command[w] = pmj_between(0.0, chain->lower, chain->upper);
                all->acting[w] = 0;
                send(chain, all->limits, w, all->command[w], sent);
                for (int j = 0; j < PMJ_NW; ++j) {
                    all->w[j][w] = sent[j];
                }
            }
        }
        pmj_plant_lanes(&all->runs.t, all->runs.X, all->w, all->runs.p, c); /* for e(0) */
        for (int i = 0; i < CHANNELS; ++i) {
            all->c[i] = c[i];
        }
    }
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (at[w]) {
            const pmj_chain *chain = chain_of(sweep, all, w);
            const long long k = (long long)all->sample[w];
            all->y[w] = pmj_filtered(chain, pmj_read(chain, all->runs.X[0][w], k), all->y[w], k);
        }
    }
    /* The controller's own time may lie in another segment of the reference than the plant's. */
    const double slack = PMJ_SAME_INSTANT * sweep->sample_time;
    for (int w = 0; sweep->n_breaks > 0 && w < PMJ_WIDTH; ++w) {
        pmj_put_segment_lane(sweep, &all->runs, w, pmj_segment_at_lane(sweep, &all->runs, w, clock[w] + slack));
    }
    pmj_control_lanes(&clock, &all->y, all->runs.X + PMJ_NX, all->runs.p, &all->v, all->y_r);
    for (int w = 0; sweep->n_breaks > 0 && w < PMJ_WIDTH; ++w) {
        pmj_put_segment_lane(sweep, &all->runs, w, all->runs.lanes[w].segment);
    }
}

/* The commands of the samples of the live lanes, and the controller's next states. */
static void command(const pmj_sweep *sweep, pmj_sampled_group *all)
{
    pmj_lanes u = pmj_all(0.0);
    for (int w = 0; w < PMJ_WIDTH; ++w) {
        if (all->runs.live[w]) {
            const pmj_chain *chain = chain_of(sweep, all, w);
            double sent[PMJ_NW];
            all->command[w] = pmj_command(chain, all->v[w], all->command[w]);
            send(chain, all->limits, w, all->command[w], sent);
            for (int j = 0; j < PMJ_NW; ++j) {
                *kept(sweep, (long long)all->sample[w], j, w) = sent[j];
            }
            u[w] = sent[0];
        }
    }
    pmj_update_lanes(&all->y, all->runs.X + PMJ_NX, all->y_r, &u, &all->v, all->h, all->runs.p, all->next);
}

/* Let every command of lane w act that is due at t; return the instant at which the next one is due. */
static double take_due(const pmj_sweep *sweep, pmj_sampled_group *all, int w, double t)
{
    const pmj_chain *chain = chain_of(sweep, all, w);
    const double slack = PMJ_SAME_INSTANT * chain->period;
    for (;;) {
        const long long next = all->acting[w];
        const double due = pmj_instant(chain, next) + chain->delay;
        if (next > (long long)all->sample[w]) {
            return HUGE_VAL;
        }
        if (due > t + slack) {
            return due;
        }
        const long long source = next - (long long)chain->samples;
        for (int j = 0; source >= 0 && j < PMJ_NW; ++j) {
            all->w[j][w] = *kept(sweep, source, j, w);
        }
        all->acting[w] = next + 1;
    }
}

/* The plant's coefficients at t, with the sides on which the arguments of kinks are there. */
static void expand(pmj_sampled_group *all)
{
    for (int j = 0; j < PMJ_NK; ++j) { /* an argument depends on the sides before its own */
        pmj_plant_lanes(&all->runs.t, all->x, all->w, all->runs.p, all->c);
        all->w[PMJ_NW + j] = pmj_select(all->c[E + 1 + j] < 0.0, pmj_all(-1.0), pmj_all(1.0));
    }
    pmj_plant_lanes(&all->runs.t, all->x, all->w, all->runs.p, all->c);
}

pmj_lanes pmj_chained_hold(const pmj_sweep *sweep, const pmj_results *results, pmj_sampled_group *all, pmj_lanes end)
{
    const double slack = PMJ_SAME_INSTANT * sweep->sample_time;
    const pmj_lanes last = pmj_select(sweep->horizon < end - slack, pmj_all(sweep->horizon), end);
    pmj_lanes e = pmj_all(0.0);
    command(sweep, all);
    for (;;) {
        const pmj_mask stuck = all->runs.stalled | all->runs.sliding | (all->runs.steps >= sweep->max_steps);
        const pmj_mask on = all->runs.live & (all->runs.t < last) & ~stuck;
        pmj_lanes until = last;
        if (!pmj_any(on)) {
            return e;
        }
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            if (on[w]) {
                const double due = take_due(sweep, all, w, all->runs.t[w]);
                until[w] = due < end[w] - slack && due < last[w] ? due : last[w];
                if (all->runs.next_break[w] <= all->runs.t[w]) {
                    pmj_enter_lane(sweep, &all->runs, w, all->runs.t[w]);
                }
            }
        }
        expand(all);
        const pmj_lanes found = pmj_hold_lanes(sweep, results, all, on, until - all->runs.t);
        e = pmj_select(on, found, e);
        all->runs.t = pmj_select(on, until, all->runs.t);
    }
}
