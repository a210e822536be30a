/* The sampled controller of the paper's model, written by hand for this one model: the yardstick for the exported C.
 *
 * A step: filters (14) and compensator (23) over the hold that has ended, by its exact matrices; the law (29); the
 * limits (10). Everything of parameters alone is computed once.
 */

typedef struct {
    double c1e1, damping, k1, k2, ck1, ck2, b0, d1, limit, inverse, slope, spread, E[4], G[4], R[4], Q[4];
} hand_constants;

typedef struct {
    double xi1, xi2, Xi1, Xi2, l1, l2, r1, r2, y, v, u;
} hand_state;

/* p: d1 b0 u_max c1 c2 e1 e2 ck1 ck2 k1 k2; h: hold matrices. */
void hand_init(hand_constants *c, hand_state *s, const double *p, const double *h)
{
    static const hand_state zero;
    const double inverse = 1.0 / p[1], slope = -(p[3] + p[5]) * inverse;
    *s = zero;
    c->d1 = p[0], c->b0 = p[1], c->limit = p[2], c->ck1 = p[7], c->ck2 = p[8], c->k1 = p[9], c->k2 = p[10];
    c->inverse = inverse, c->slope = slope, c->c1e1 = p[3] + p[5], c->damping = p[4] + p[6] * slope * slope;
    c->spread = inverse * (p[3] + p[5] - p[7]);
    for (int i = 0; i < 4; ++i) {
        c->E[i] = h[i], c->G[i] = h[4 + i], c->R[i] = h[8 + i], c->Q[i] = h[12 + i];
    }
}

/* in: y, y_r, its first and second derivative; out: v, u, x_hat1, x_hat2, z1, z2. */
void hand_step(const hand_constants *c, hand_state *s, const double *in, double *out)
{
    const double *E = c->E, *G = c->G, *R = c->R, *Q = c->Q;
    const double in1 = c->k1 * s->y, in2 = c->k2 * s->y, drive = c->b0 * (s->u - s->v);
    const double xi1 = E[0] * s->xi1 + E[1] * s->xi2 + G[0] * in1 + G[1] * in2;
    const double xi2 = E[2] * s->xi1 + E[3] * s->xi2 + G[2] * in1 + G[3] * in2;
    const double Xi1 = E[0] * s->Xi1 + E[1] * s->Xi2 + G[1] * s->y, Xi2 = E[2] * s->Xi1 + E[3] * s->Xi2 + G[3] * s->y;
    const double l1 = E[0] * s->l1 + E[1] * s->l2 + G[1] * s->u, l2 = E[2] * s->l1 + E[3] * s->l2 + G[3] * s->u;
    const double r1 = R[0] * s->r1 + R[1] * s->r2 + Q[1] * drive, r2 = R[2] * s->r1 + R[3] * s->r2 + Q[3] * drive;
    const double y = in[0], z1 = y - in[1] - r1;
    const double omega = xi2 + c->d1 * Xi2;
    const double alpha = c->inverse * (-c->c1e1 * z1 - omega - c->ck1 * r1);
    const double z2 = l2 - alpha - c->inverse * in[2] - c->inverse * r2;
    const double rate = c->slope * (c->b0 * l2 + omega) - c->inverse * (c->k2 * (y - xi1) + c->d1 * (y - c->k2 * Xi1))
                        - c->slope * in[2] + c->spread * (r2 - c->ck1 * r1);
    const double v = rate - c->b0 * z1 - c->damping * z2 + c->k2 * l1 - c->inverse * (c->ck2 * r2 - in[3]);
    const double u = v > c->limit ? c->limit : v < -c->limit ? -c->limit : v;
    s->xi1 = xi1, s->xi2 = xi2, s->Xi1 = Xi1, s->Xi2 = Xi2, s->l1 = l1, s->l2 = l2, s->r1 = r1, s->r2 = r2;
    s->y = y, s->v = v, s->u = u;
    out[0] = v, out[1] = u, out[2] = xi1 + c->d1 * Xi1 + c->b0 * l1, out[3] = xi2 + c->d1 * Xi2 + c->b0 * l2;
    out[4] = z1, out[5] = z2;
}
