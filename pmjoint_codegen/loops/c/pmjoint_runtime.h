/* Runs of the closed loop over generated kernels: the C twin of the Python loops in pmjoint_codegen/loops.
 *
 * The Python modules polynomial.py, continuous.py and sampled.py do the same arithmetic in the same order; read
 * them first. Nothing here allocates, has static state or depends on a model: kernels, sizes, limits and scratch
 * memory all come from the caller. Only sampled.c takes its two kernels and their sizes from the model's sampled.h.
 * Times are in seconds; states have the units of model.json.
 *
 * Python reads the declarations below without preprocessing: keep `#` lines free of declarations.
 */
#ifndef PMJOINT_RUNTIME_H
#define PMJOINT_RUNTIME_H

#include "pmjoint_constants.h"

/* A generated kernel in CasADi's calling convention: 0 is success. */
typedef int (*pmj_kernel)(const double **arg, double **res, long long *iw, double *w, int mem);

/* A kernel with the scratch arrays that its `_work` asks for. */
typedef struct {
    pmj_kernel call;
    const double **arg;
    double **res;
    long long *iw;
    double *w;
} pmj_function;

/* The kernels for a run's steps: sampled, those of the plant. The last four are null pointers if no kink can hold the run. */
typedef struct {
    const pmj_function *taylor;
    const pmj_function *guard;
    const pmj_function *rates;
    const pmj_function *held_taylor; /* the same while a kink holds the run */
    const pmj_function *held_guard;
    const pmj_function *held_rates;
    const pmj_function *holds;       /* whether it does */
} pmj_kernels;

/* The kernels of a sampled run with sensor, actuator and clock. */
typedef struct {
    pmj_kernels plant;
    const pmj_function *reference;
    const pmj_function *law;
    const pmj_function *update;
} pmj_functions;

/* What a controller has at a sample. */
typedef struct {
    double *s;     /* [ns] its state */
    double *held;  /* [4 or more] what is held from the sample on: reading, filtered reading, u, command */
    double *v;     /* [1] */
    double *z;     /* [rho] */
    double *alpha; /* [rho - 1] */
    double *y_r;   /* [rho + 1] */
} pmj_sample_values;

/* A controller: its kernels, its constants and its memory. */
typedef struct {
    const pmj_function *reference;
    const pmj_function *law;
    const pmj_function *update;
    const pmj_function *start; /* used by pmj_controller_step alone */
    const double *p;           /* parameters */
    const double *hold;        /* zero-order-hold matrices of `sampled_update` */
    const double *chain;       /* a `pmj_chain` of pmjoint_chain.h */
    double *y_r;               /* [n_reference] of the next sample, as given or as `pmj_follow` finds it */
    pmj_sample_values now;     /* at the last sample: one block of memory, which begins with s */
    pmj_sample_values then;    /* at this one, until it is accepted: a block of the same size */
    long long n_values;        /* length of a block */
    long long n_reference;     /* rho + 1 */
    long long n_s;             /* length of s */
    long long sample;          /* index of the next sample */
    long long matches;         /* whether the first sample matches the state to its reading */
} pmj_controller;

/* The constants of a run. Arrays are row-major; sizes in brackets. */
typedef struct {
    long long n_plant;        /* nx: plant states x, first in X */
    long long n_states;       /* nX: plant states, then controller states */
    long long n_channels;     /* of the Taylor kernel: X, v, e (sampled: x, e), then the arguments of kinks */
    long long n_rates;        /* channels that have rates: nX (sampled: nx) */
    long long n_kinks;        /* nk */
    long long n_actuated;     /* nw: channels of w, the first is u */
    long long order;          /* N of the Taylor kernels */
    long long n_thresholds;   /* values of v at which a channel of w enters or leaves a limit */
    const double *thresholds; /* [n_thresholds] ascending */
    const double *modes;      /* [(n_thresholds + 1)][2 nw]: offset and slope of each channel of w inside a mode */
    const double *p;          /* parameters */
    const double *breaks;     /* [n_breaks] instants at which the reference's next segment begins, ascending, inside the run */
    const double *segments;   /* [n_breaks + 1][n_segment] what ends p on each */
    long long n_breaks;
    long long n_segment;      /* 0: the reference is an expression of t */
    const double *hold;       /* sampled: zero-order-hold matrices of `sampled_update` */
    const double *chain;      /* sampled: a `pmj_chain` of pmjoint_chain.h; used by pmj_chained alone */
    const double *limits;     /* [nw][4]: offset, slope, lower and upper limit of each channel of w */
    long long n_history;      /* commands that are kept, since they act later; 0: no chain */
    const double *nodes;      /* [n_nodes] Gauss nodes on (0, 1) for the integral of e^2 */
    const double *weights;    /* [n_nodes] */
    long long n_nodes;        /* 0: no metrics of e */
    long long n_searched;     /* continuous: channels whose largest magnitudes are also searched for inside steps */
    long long notes_rate;     /* whether the largest magnitude of the rate of channel 0, y, is recorded */
    const double *inside;     /* [n_inside] points of a step, as fractions of it, at which it is compared with the rates */
    long long n_inside;
    double lebesgue;          /* factor on the largest defect found there and at the end */
    const double *ratios;     /* [n_ratios] radii of discs, as multiples of a step */
    const double *factors;    /* [n_ratios] bound on a step's error, as a multiple of the nonlinear part on the disc */
    long long n_ratios;
    double max_step;          /* s; infinite by default */
    double settled;           /* fraction of |e(0)|: e has settled once it stays within it */
    const double *times;      /* [n_rows] output instants, ascending, the first 0, the last the horizon */
    long long n_rows;
    double sample_time;       /* s; 0: continuous */
    const double *hold_ratios;        /* sampled: [n_hold_ratios] radii of discs, as multiples of a hold; the first for windows */
    const double *hold_rate_factors;  /* sampled: bound on the error of a hold of order `sample`, as a multiple of the nonlinear */
    const double *hold_value_factors; /* part on the disc: of rates, and of values */
    long long n_hold_ratios;
    double tolerance;         /* local error, relative to max(1, |value|) */
    double safety;            /* factor on the step that the last two coefficients allow */
    double hold_fraction;     /* sampled: part of the radius of convergence up to which a hold is one step */
    double divergence;        /* sampled: |X_i| above it ends the run */
    const double *reach;      /* continuous: [nX] the same state by state; infinite where one may go anywhere */
    long long max_steps;
    long long max_switches;
} pmj_problem;

/* The progress of a run: all that must survive between two calls. */
typedef struct {
    double t;
    double integral;          /* of e^2 from 0 to t */
    double band;              /* |e| within which it has settled */
    double settled;           /* the last instant so far at which |e| exceeds the band */
    double last_cut;          /* the last step, if the guard cut it, else infinite */
    long long status;         /* PMJ_... */
    long long mode;           /* index of the interval of v between thresholds */
    long long first_mode;     /* at t = 0 */
    long long touching;       /* threshold that v is on at t, n_thresholds + j on kink j, n_kinks more if it has let go, or -1 */
    long long idle;           /* switches since time last advanced */
    long long flips;          /* changes of side at a kink since time last advanced */
    long long row;            /* output rows written */
    long long steps;          /* accepted steps of the state */
    long long rejected;       /* steps repeated at half the size */
    long long evaluations;    /* calls of the Taylor kernel */
    long long switches;       /* changes of mode */
    long long sample;         /* sampled: index of the next sample */
    long long buffer;         /* which half of the coefficient memory is current */
    long long disc;           /* the disc that proved the last step sound */
    long long held;           /* the kink that holds the run, or -1 */
    long long holds;          /* how often a kink has begun to hold it, or has let go */
    long long segment;        /* index of the reference's present segment */
} pmj_progress;

/* Memory that a run writes. */
typedef struct {
    double *coefficients;     /* [2 ((N + 1) channels + 3)]: this step's and the next's, padded for blocked reading */
    double *state;            /* [nX]: X at t */
    double *trial;            /* [channels + 3]: values at the end of a trial step, padded */
    double *slope;            /* [channels + 3]: slopes there, padded */
    double *term_sums;        /* [channels + 3]: sums of the magnitudes of their terms there, padded */
    double *scales;           /* [channels + 3]: 1/max(1, |c_0|) at the step's start, to a power of two, padded */
    double *majorants;        /* [channels + 3]: how far channels can move on a disc, padded */
    double *rest;             /* [channels]: results of the guard */
    double *rates;            /* [channels + 3]: values inside a step, padded */
    double *g;                /* continuous: [2 nw + 2 nk]: the mode, then sides */
    double *w;                /* [nw + 2 nk]: w, then sides */
    double *window;           /* sampled: [2 + 2 nx]: t and its radius, x and its radii, for which the guard is known */
    double *segment;          /* [n_segment]: the end of the problem's p */
    double *sides;            /* [2 nk]: on which side of each kink the run is, +1 or -1; then 1 for the one that holds it */
    double *holds;            /* [nk (2 + nx)]: results of the kernel that says whether a kink holds */
    double *hold_times;       /* [max_switches], or [0] without kinks: when one begins to hold the run, lets go, and so on */
    long long *hold_kinks;    /* the same: which */
    double *sample;           /* sampled: [nX], X at the last sample */
    double *rows;             /* [n_rows][nX]; the first row is filled in at the start */
    double *row_samples;      /* sampled: [n_rows][nX], X at the last sample before each row */
    double *row_sample_times; /* sampled: [n_rows] */
    double *held;             /* chain: [6 + nw], what is held since the last sample */
    double *row_held;         /* chain: [n_rows][6 + nw], the same at each row */
    double *history;          /* chain: [n_history][nw], w of the last commands */
    double *peaks;            /* [nX + 3]: largest |X_i|, |v|, |e| and, if requested, |dy/dt| so far */
    double *peak_times;       /* the same */
    double *switch_times;     /* [max_switches] */
    long long *switch_modes;  /* [max_switches] */
} pmj_memory;

/* polynomial.c */
void pmj_evaluate(const double *c, long long width, long long order, double tau, double *out, long long n);
double pmj_step_size(const double *c, long long width, long long order, double tolerance, double safety);
long long pmj_leading_zeros(const double *q, long long degree, double h);
long long pmj_crossings(const double *q, long long degree, double h, double *roots, long long most);
int pmj_passes(double *q, long long degree, double level, int touching, int outward, double h, double *tau);
void pmj_note_value(double value, double t, double *peak, double *peak_time);
void pmj_note_extremum(const double *c, long long width, long long order, double t, double tau, double *peak,
                       double *peak_time);
void pmj_note_peaks(const double *c, long long width, long long order, long long n, double t, double tau,
                    const double *end, double *peaks, double *peak_times);
void pmj_note_rate(const double *c, long long width, long long order, double t, double tau, double *peak,
                   double *peak_time);

int pmj_exceeds(const double *c, long long width, long long order, double limit, double *tau);
double pmj_last_outside(const double *c, long long width, long long order, double tau, double band);

/* steps.c: results have room for whole blocks of four channels, except `out`, which has n */
void pmj_arrive(const double *c, long long width, long long order, double tau, double *values, double *slopes);
void pmj_bounds(const double *c, long long width, long long order, double tau, long long from, double *term_sums);
void pmj_values(const double *c, long long width, long long order, double tau, double *out, long long n);
void pmj_channel(const double *c, long long width, long long order, const double *tau, double *out, long long n);
void pmj_scales(const double *c, long long width, double *scales);
double pmj_shrink(double miss, long long order);
double pmj_allowed_step(const double *c, const double *scales, long long width, long long order, double tolerance,
                        double safety);

/* segments.c: break points of the reference */
double pmj_next_break(const pmj_problem *problem, const pmj_progress *progress); /* infinite if there is none */
void pmj_first_segment(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory);
/* The segment at a time that may lie before the present one; a segment put into p without being the present one. */
long long pmj_segment_at(const pmj_problem *problem, const pmj_progress *progress, double t);
void pmj_put_segment(const pmj_problem *problem, const pmj_memory *memory, long long segment);
/* Put the segment at time t into p; whether it has changed. */
int pmj_enter_segments(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t);

/* record.c */
void pmj_begin(const pmj_problem *problem, pmj_progress *progress, pmj_memory *memory);
/* Record a change of mode at time t; a touch, there and back at one instant, is none. */
void pmj_note_switch(const pmj_problem *problem, pmj_progress *progress, const pmj_memory *memory, double t, long long mode);

/* continuous.c */
void pmj_continuous(const pmj_problem *problem, const pmj_kernels *run, pmj_progress *progress, pmj_memory *memory,
                    long long budget);

/* sampled.c */
void pmj_sampled(const pmj_problem *problem, const pmj_kernels *plant, pmj_progress *progress, pmj_memory *memory,
                 long long budget);

/* controller.c: 0 is success */
int pmj_follow(const pmj_controller *controller, double clock);
int pmj_decide(const pmj_controller *controller, const pmj_sample_values *at, double read, long long k);
int pmj_advance(const pmj_controller *controller, const pmj_sample_values *at, double u, double *next);
int pmj_controller_step(pmj_controller *controller, double y, double applied, int given);

/* chained.c */
void pmj_chained(const pmj_problem *problem, const pmj_functions *run, pmj_progress *progress, pmj_memory *memory,
                 long long budget);

/* guard.c */
int pmj_all_finite(const double *values, long long n);
long long pmj_mode_at(const pmj_problem *problem, double v);
int pmj_beyond(const pmj_problem *problem, const double *X);
double pmj_largest(const pmj_problem *problem, const pmj_memory *memory, const double *values, double h);
double pmj_guarded(const pmj_problem *problem, const pmj_function *guard, pmj_progress *progress,
                   const pmj_memory *memory, const double *actuation, const double *c, double h, double smallest);
double pmj_defect(const pmj_problem *problem, const pmj_function *rates, double t, const pmj_memory *memory,
                  const double *actuation, const double *c, double at, double tau);
int pmj_stays(const pmj_problem *problem, const pmj_memory *memory, const double *c, long long channel, double low,
              double high, double h);
int pmj_channel_passes(const pmj_problem *problem, const double *c, long long channel, double level, int touching,
                       int outward, double h, double *tau);
long long pmj_first_kink(const pmj_problem *problem, const pmj_progress *progress, const pmj_memory *memory, const double *c,
                         long long touching, double h, double *tau);
void pmj_note_settled(pmj_progress *progress, const double *c, long long width, long long order, double last, double tau,
                      double end);

/* map.c */
int pmj_apply(const pmj_function *kernel);
int pmj_map(const pmj_function *kernel, long long rows, long long n_arg, const double **arg,
            const long long *arg_stride, long long n_res, double **res, const long long *res_stride);

#endif
