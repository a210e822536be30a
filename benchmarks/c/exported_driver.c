/* Loops around the exported controller of the paper's model and the hand-written one, each in a file of its own. */
#include <stddef.h>

#include "pmjoint_paper.h"

typedef struct {
    double numbers[64]; /* more than either of the hand-written structures has */
} room;

void hand_init(room *c, room *s, const double *p, const double *h);
void hand_step(const room *c, room *s, const double *in, double *out);

/* in: rows of y, y_r, its derivatives; v: of every row. */
void exported_many(const double *in, double *v, long long rows)
{
    pmjoint_paper_params params;
    pmjoint_paper_constants constants;
    pmjoint_paper_state state;
    pmjoint_paper_input given = {0};
    pmjoint_paper_output out;
    pmjoint_paper_defaults(&params);
    pmjoint_paper_init(&constants, &state, &params, &given);
    for (long long k = 0; k < rows; ++k) {
        given.y = in[4 * k];
        given.y_r = in[(4 * k) + 1];
        given.dy_r = in[(4 * k) + 2];
        given.d2y_r = in[(4 * k) + 3];
        pmjoint_paper_step(&constants, &state, &given, &out);
        v[k] = out.v;
    }
}

void by_hand_many(const double *in, double *v, long long rows, const double *p, const double *h)
{
    static const room zero;
    room constants = zero, state = zero;
    double out[6];
    hand_init(&constants, &state, p, h);
    for (long long k = 0; k < rows; ++k) {
        hand_step(&constants, &state, in + (4 * k), out);
        v[k] = out[0];
    }
}
