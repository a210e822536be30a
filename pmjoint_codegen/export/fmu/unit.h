/* A unit as both versions of the interface have it: the model and its phase, which are plain data. Functions that can fail
 * tell what is wrong, or NULL. */
#ifndef UNIT_H
#define UNIT_H

#include "model.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    model held;
    int phase;
} unit;

/* As right after the instantiation. */
static void unit_renew(unit *at)
{
    (void)memset(at, 0, sizeof(unit));
    model_defaults(&at->held);
    at->phase = INSTANTIATED;
}

static const char *unit_initialized(unit *at)
{
    const char *const trouble = (at->phase == INITIALIZING) ? model_begin(&at->held) : "the unit is not being initialised";
    at->phase = (trouble == NULL) ? STEPPING : at->phase;
    return trouble;
}

static const char *unit_step(unit *at, double time, double step)
{
    return (at->phase == STEPPING) ? model_step(&at->held, time, step) : "a step: the unit is not initialised, or terminated";
}

static const char *unit_get(unit *at, unsigned reference, int kind, double *value)
{
    if (model_kind(reference) != kind) {
        return "no variable of this type has that value reference";
    }
    if (at->phase <= INITIALIZING) {
        (void)model_begin(&at->held); /* the end of the initialisation tells what is wrong */
    }
    *value = model_get(&at->held, reference);
    return NULL;
}

static const char *unit_set(unit *at, unsigned reference, int kind, double value)
{
    if (model_kind(reference) != kind) {
        return "no variable of this type has that value reference";
    }
    if (!is_settable(model_role(reference), at->phase)) {
        return "a variable cannot be set now: an output, or fixed since the initialisation";
    }
    model_set(&at->held, reference, value);
    return NULL;
}

/* A copy of `from` in `*state`, which is allocated if it is NULL. */
static const char *unit_keep(void **state, const void *from)
{
    if (*state == NULL) {
        *state = calloc(1, sizeof(unit));
    }
    if (*state == NULL) {
        return "no memory for a state";
    }
    (void)memcpy(*state, from, sizeof(unit));
    return NULL;
}

static const char *unit_restore(unit *at, const void *state)
{
    if (state == NULL) {
        return "no state is given";
    }
    (void)memcpy(at, state, sizeof(unit));
    return NULL;
}

static const char *unit_serialize(const void *state, void *bytes, size_t size)
{
    if ((state == NULL) || (size < sizeof(unit))) {
        return "no state, or too few bytes for it";
    }
    (void)memcpy(bytes, state, sizeof(unit));
    return NULL;
}

static const char *unit_deserialize(void **state, const void *bytes, size_t size)
{
    return (size == sizeof(unit)) ? unit_keep(state, bytes) : "these bytes are no state of this unit";
}

#endif
