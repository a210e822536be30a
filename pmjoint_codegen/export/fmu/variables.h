/* What a variable is, for both versions of the interface. */
#ifndef VARIABLES_H
#define VARIABLES_H

#include <math.h>
#include <stddef.h>

enum { NO_VARIABLE, REAL, INTEGER, BOOLEAN }; /* kinds */
enum { OUTPUT, INPUT, TUNABLE, FIXED };       /* roles; FIXED until the initialisation ends: start values too */
enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

/* Whether a variable of that role can be set in that phase. */
static int is_settable(int role, int phase)
{
    const int early = (phase == INSTANTIATED) || (phase == INITIALIZING);
    return (role == INPUT) || (role == TUNABLE) || ((role == FIXED) && early);
}

/* What is wrong with a step, or NULL: it must begin where the last one ended, up to roundoff, and go forward. */
static const char *refusal(double own, double told, double step)
{
    if (!(isfinite(told + step) && (step >= 0.0))) {
        return "a step must be finite and go forward";
    }
    if (fabs(told - own) > (1e-9 * (1.0 + fabs(own)))) {
        return "a step must begin where the last one ended";
    }
    return NULL;
}

#endif
