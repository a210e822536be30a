/* The elementary functions over lanes, one by one: what the gate of `lanes.c` evaluates a tape with. */
#include "pmjoint_lanes.h"

#define PROBE(name)                                                                                                    \
    void probe_##name(const pmj_lanes *a, pmj_lanes *result);                                                          \
    void probe_##name(const pmj_lanes *a, pmj_lanes *result)                                                           \
    {                                                                                                                  \
        *result = pmj_##name(*a);                                                                                      \
    }

PROBE(sin)
PROBE(cos)
PROBE(tan)
PROBE(tanh)
PROBE(exp)
PROBE(log)

void probe_pow(const pmj_lanes *a, const pmj_lanes *b, pmj_lanes *result);
void probe_pow(const pmj_lanes *a, const pmj_lanes *b, pmj_lanes *result)
{
    *result = pmj_pow(*a, *b);
}
