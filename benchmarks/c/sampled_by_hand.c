/* The paper's sampled closed loop, written by hand for this one model: what a good programmer would do, and the yardstick for
 * generated code. One source: scalar with the C library's sine, or, with -DHAND_WIDTH=8 (4, 2), vectors with libmvec's.
 *
 * Per sample: y_r = sin t, the law (29), the actuator (10), the exact zero-order-hold update of filters (14) and compensator (23), the
 * plant (11), (37) by five Taylor terms over the hold; integral of e^2 by three Gauss nodes, largest |e|, |v|, time at a limit.
 */
#include <math.h>

#define ORDER 5
#define STATES 10
#define METRICS 4

#ifdef HAND_WIDTH
typedef double real __attribute__((vector_size(8 * HAND_WIDTH)));
typedef long long mask __attribute__((vector_size(8 * HAND_WIDTH)));
#define WIDTH HAND_WIDTH
#if HAND_WIDTH == 8
#define SIN _ZGVeN8v_sin
#define COS _ZGVeN8v_cos
#elif HAND_WIDTH == 4
#define SIN _ZGVdN4v_sin
#define COS _ZGVdN4v_cos
#else
#define SIN _ZGVbN2v_sin
#define COS _ZGVbN2v_cos
#endif
real SIN(real);
real COS(real);
static inline real choose(mask where, real a, real b) { return (real)((where & (mask)a) | (~where & (mask)b)); }
static inline real magnitude(real a) { return (real)((mask)a & 0x7fffffffffffffffLL); }
#else
typedef double real;
typedef int mask;
#define WIDTH 1
#define SIN sin
#define COS cos
static inline real choose(mask where, real a, real b) { return where ? a : b; }
static inline real magnitude(real a) { return fabs(a); }
#endif

/* x: [STATES] start and end; p: d1 b0 u_max c1 c2 e1 e2 ck1 ck2 k1 k2; h: hold matrices; m: ISE, max |e|, max |v|, saturated. */
void by_hand(real *x, const real *p, const double *h, double T, long long samples, real *m)
{
    const real d1 = p[0], b0 = p[1], limit = p[2], c1 = p[3], c2 = p[4], e1 = p[5], e2 = p[6], ck1 = p[7], ck2 = p[8];
    const real k1 = p[9], k2 = p[10], inverse = 1.0 / b0, slope = -(c1 + e1) * inverse, zero = d1 - d1;
    const double *E = h, *G = h + 4, *R = h + 8, *Q = h + 12;
    real x1 = x[0], x2 = x[1], xi1 = x[2], xi2 = x[3], Xi1 = x[4], Xi2 = x[5], l1 = x[6], l2 = x[7], r1 = x[8], r2 = x[9];
    real ise = zero, most_e = zero, most_v = zero, saturated = zero;
    for (long long i = 0; i < samples; ++i) {
        const double t = (double)i * T;
        const double s = sin(t), c = cos(t);
        const real z1 = x1 - s - r1;
        const real omega = xi2 + d1 * Xi2;
        const real alpha = inverse * (-(c1 + e1) * z1 - omega - ck1 * r1);
        const real z2 = l2 - alpha - inverse * c - inverse * r2;
        const real rate = slope * (b0 * l2 + omega) - inverse * (k2 * (x1 - xi1) + d1 * (x1 - k2 * Xi1)) - slope * c
                          + inverse * (c1 + e1 - ck1) * (r2 - ck1 * r1);
        const real v = rate - b0 * z1 - (c2 + e2 * slope * slope) * z2 + k2 * l1 - inverse * (ck2 * r2 + s);
        const real u = choose(v > limit, limit, choose(v < -limit, -limit, v));
        /* Taylor coefficients of the plant */
        real a[ORDER + 1], b[ORDER + 1], sine[ORDER], cosine[ORDER];
        const double w[ORDER] = {c, -s, -c / 2, s / 6, c / 24};
        a[0] = x1;
        b[0] = x2;
        sine[0] = SIN(x2);
        cosine[0] = COS(x2);
        for (int k = 0; k < ORDER; ++k) {
            real d = zero;
            if (k > 0) {
                real up = zero, down = zero;
                for (int j = 1; j <= k; ++j) {
                    up += (double)j * b[j] * cosine[k - j];
                    down += (double)j * b[j] * sine[k - j];
                }
                sine[k] = up * (1.0 / k);
                cosine[k] = down * (-1.0 / k);
            }
            for (int j = 0; j <= k; ++j) {
                d += sine[j] * w[k - j];
            }
            a[k + 1] = b[k] * (1.0 / (k + 1));
            b[k + 1] = (d1 * a[k] + 0.1 * d + (k == 0 ? b0 * u : zero)) * (1.0 / (k + 1));
        }
        /* what a sweep reports: e over the hold */
        const double q[ORDER + 1] = {s, c, -s / 2, -c / 6, s / 24, c / 120};
        const double nodes[3] = {0.11270166537925831, 0.5, 0.8872983346207417};
        const double weights[3] = {0.2777777777777778, 0.4444444444444444, 0.2777777777777778};
        for (int n = 0; n < 3; ++n) {
            real e = a[ORDER] - q[ORDER];
            for (int k = ORDER - 1; k >= 0; --k) {
                e = e * (T * nodes[n]) + (a[k] - q[k]);
            }
            ise += (T * weights[n]) * e * e;
        }
        most_e = choose(magnitude(x1 - s) > most_e, magnitude(x1 - s), most_e);
        most_v = choose(magnitude(v) > most_v, magnitude(v), most_v);
        saturated += choose(magnitude(v) > limit, zero + T, zero);
        /* the controller's exact hold */
        const real in1 = k1 * x1, in2 = k2 * x1, drive = b0 * (u - v);
        const real n1 = E[0] * xi1 + E[1] * xi2 + G[0] * in1 + G[1] * in2, n2 = E[2] * xi1 + E[3] * xi2 + G[2] * in1 + G[3] * in2;
        const real m1 = E[0] * Xi1 + E[1] * Xi2 + G[1] * x1, m2 = E[2] * Xi1 + E[3] * Xi2 + G[3] * x1;
        const real o1 = E[0] * l1 + E[1] * l2 + G[1] * u, o2 = E[2] * l1 + E[3] * l2 + G[3] * u;
        const real s1 = R[0] * r1 + R[1] * r2 + Q[1] * drive, s2 = R[2] * r1 + R[3] * r2 + Q[3] * drive;
        xi1 = n1, xi2 = n2, Xi1 = m1, Xi2 = m2, l1 = o1, l2 = o2, r1 = s1, r2 = s2;
        x1 = a[ORDER];
        x2 = b[ORDER];
        for (int k = ORDER - 1; k >= 0; --k) {
            x1 = x1 * T + a[k];
            x2 = x2 * T + b[k];
        }
    }
    x[0] = x1, x[1] = x2, x[2] = xi1, x[3] = xi2, x[4] = Xi1, x[5] = Xi2, x[6] = l1, x[7] = l2, x[8] = r1, x[9] = r2;
    m[0] = ise, m[1] = most_e, m[2] = most_v, m[3] = saturated;
}

/* Rows of states and parameters, one trajectory a row, in groups of WIDTH; `runs` is a multiple of it. */
void by_hand_many(double *x, const double *p, const double *h, double T, long long samples, long long runs, double *m)
{
    for (long long first = 0; first < runs; first += WIDTH) {
        real X[STATES], P[11], M[METRICS];
        for (int w = 0; w < WIDTH; ++w) {
            for (int i = 0; i < STATES; ++i) {
                ((double *)&X[i])[w] = x[(first + w) * STATES + i];
            }
            for (int i = 0; i < 11; ++i) {
                ((double *)&P[i])[w] = p[(first + w) * 11 + i];
            }
        }
        by_hand(X, P, h, T, samples, M);
        for (int w = 0; w < WIDTH; ++w) {
            for (int i = 0; i < STATES; ++i) {
                x[(first + w) * STATES + i] = ((double *)&X[i])[w];
            }
            for (int i = 0; i < METRICS; ++i) {
                m[(first + w) * METRICS + i] = ((double *)&M[i])[w];
            }
        }
    }
}
