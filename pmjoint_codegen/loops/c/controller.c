/* The controller at one sample, for the loop with sensor, actuator and clock and for callers with a plant of their own: the
 * twin of pmjoint_codegen/loops/controller.py.
 */
#include "pmjoint_chain.h"
#include "pmjoint_runtime.h"

#include <float.h>
#include <math.h>
#include <string.h>

static int is_finite(double value)
{
    return fabs(value) <= DBL_MAX;
}

/* y_r and its derivatives at the controller's own time. */
int pmj_follow(const pmj_controller *controller, double clock)
{
    const pmj_function *reference = controller->reference;
    reference->arg[0] = &clock;
    reference->arg[1] = controller->p;
    reference->res[0] = controller->y_r;
    return pmj_apply(reference);
}

/* Sample k: from a reading and from the values of the last sample, which `at` contains, v of (29) and what is held. */
int pmj_decide(const pmj_controller *controller, const pmj_sample_values *at, double read, long long k)
{
    const pmj_chain *chain = (const pmj_chain *)controller->chain;
    const pmj_function *law = controller->law;
    double *held = at->held;
    held[PMJ_MEASURED] = read;
    held[PMJ_FILTERED] = pmj_filtered(chain, read, held[PMJ_FILTERED], k);
    law->arg[0] = held + PMJ_FILTERED;
    law->arg[1] = at->s;
    law->arg[2] = at->y_r;
    law->arg[3] = controller->p;
    law->res[0] = at->z;
    law->res[1] = at->alpha;
    law->res[2] = at->v;
    if (pmj_apply(law)) {
        return 1;
    }
    held[PMJ_COMMAND] = pmj_command(chain, at->v[0], held[PMJ_COMMAND]);
    held[PMJ_U] = pmj_left(held[PMJ_COMMAND], chain->zone);
    return 0;
}

/* The controller's state at the next sample, if u acts until then. */
int pmj_advance(const pmj_controller *controller, const pmj_sample_values *at, double u, double *next)
{
    const pmj_function *update = controller->update;
    update->arg[0] = at->held + PMJ_FILTERED;
    update->arg[1] = at->s;
    update->arg[2] = at->y_r;
    update->arg[3] = &u;
    update->arg[4] = at->v;
    update->arg[5] = controller->hold;
    update->arg[6] = controller->p;
    update->res[0] = next;
    return pmj_apply(update);
}

/* The state at this sample into `then`: the hold that ends now has known its u only since. */
static int arrive(const pmj_controller *controller, double y, double u)
{
    double *s = controller->then.s;
    if (controller->sample > 0) {
        return pmj_advance(controller, &controller->now, u, s);
    }
    memcpy(s, controller->now.s, (size_t)controller->n_s * sizeof(double));
    if (!controller->matches) {
        return 0;
    }
    const pmj_function *start = controller->start;
    start->arg[0] = &y;
    start->arg[1] = controller->y_r;
    start->arg[2] = controller->p;
    start->res[0] = s;
    return pmj_apply(start);
}

/* One sample: y is read, `applied` was told to the actuator since the last one, if given; y_r is in memory, if given. Unless
 * it gives 0, nothing that the next step depends on has changed. */
int pmj_controller_step(pmj_controller *controller, double y, double applied, int given)
{
    const pmj_chain *chain = (const pmj_chain *)controller->chain;
    const pmj_sample_values *now = &controller->now;
    const pmj_sample_values *then = &controller->then;
    const long long k = controller->sample;
    const int told = (given & PMJ_GAVE_APPLIED) && k > 0;
    if (!is_finite(y)) {
        return PMJ_READING_REFUSED;
    }
    if (told && !is_finite(applied)) {
        return PMJ_APPLIED_REFUSED;
    }
    if (!(given & PMJ_GAVE_REFERENCE) && pmj_follow(controller, (double)k * chain->period)) {
        return PMJ_KERNEL_FAILED;
    }
    if (!pmj_all_finite(controller->y_r, controller->n_reference)) {
        return PMJ_REFERENCE_REFUSED;
    }
    if (arrive(controller, y, told ? pmj_left(applied, chain->zone) : now->held[PMJ_U])) {
        return PMJ_KERNEL_FAILED;
    }
    memcpy(then->held, now->held, PMJ_CLOCK * sizeof(double));
    memcpy(then->y_r, controller->y_r, (size_t)controller->n_reference * sizeof(double));
    if (pmj_decide(controller, then, y, k)) {
        return PMJ_KERNEL_FAILED;
    }
    if (!pmj_all_finite(then->s, controller->n_values)) {
        return PMJ_NON_FINITE;
    }
    memcpy(now->s, then->s, (size_t)controller->n_values * sizeof(double));
    controller->sample = k + 1;
    return 0;
}
