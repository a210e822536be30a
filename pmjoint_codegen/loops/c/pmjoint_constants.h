/* Numbers of the loops, in C. Their twins have the same in pmjoint_codegen/loops/constants.py; a test compares the two. */
#ifndef PMJOINT_CONSTANTS_H
#define PMJOINT_CONSTANTS_H

/* Memory: for C only. */
#define PMJ_MAX_ORDER 40 /* the highest Taylor order that fits the stack of the root isolation */
#define PMJ_MAX_NODES 16 /* the most nodes of a quadrature rule */

/* Numbers behind a row of channels, so that blocks of four may read and write past it. */
#define PMJ_PADDING 3

/* Roots of a step's polynomials. Halvings: below the last, an interval is narrower than the rounding of its ends. */
#define PMJ_MAX_DEPTH 48
#define PMJ_MAX_REFINEMENTS 100
#define PMJ_CLOSE 1e-9   /* relative: a Newton step below it is the last */
#define PMJ_ON_KINK 2    /* value of `touching` on a kink; on a threshold of v it is 1 */
#define PMJ_LET_GO 3     /* on a kink that has held the run until now */
#define PMJ_JUMPED 1e-6  /* part of an argument's change in a step: below it, the argument is on its zero, to rounding */

/* Below this step, relative to max(1 s, t), time does not advance. */
#define PMJ_SMALLEST_STEP 1e-14
/* No estimate ends a step nearer to an end of its range than this part of |low| + |high|: some roundings of either. */
/* A threshold on which rounding alone decides the side is ignored for this long, s. */
#define PMJ_UNDECIDED_STEP 1e-7
/* A step may deviate from the right-hand side by this multiple of the tolerance, anywhere. */
#define PMJ_DEFECT 10.0
/* After a step that the guard has cut, the next is at most this much longer. */
#define PMJ_GROWTH 2.5
/* The least and the greatest factor on a step with too large an error. */
#define PMJ_LEAST_SHRINK 0.55
#define PMJ_MOST_SHRINK 0.95
/* Factor that safely covers the rounding of a sum of magnitudes. */
#define PMJ_ROUNDED_UP 1.000000000001

/* Output instants closer to a sample than this fraction of the sample time count as the sample. */
#define PMJ_SAME_INSTANT 1e-9
/* Size of a window in x, as a multiple of a hold's need. */
#define PMJ_WINDOW 4.0
/* Gauss nodes and weights on (0, 1) for a hold that is one step: `quadrature.short_steps`. */
#define PMJ_SHORT_NODES {0.11270166537925831, 0.5, 0.8872983346207417}
#define PMJ_SHORT_WEIGHTS {0.2777777777777778, 0.4444444444444444, 0.2777777777777778}

/* How a run ended; loops/status.py has the messages. */
#define PMJ_RUNNING 0
#define PMJ_DONE 1
#define PMJ_DIVERGED 2
#define PMJ_NON_FINITE 3
#define PMJ_STALLED 4
#define PMJ_TOO_MANY_STEPS 5
#define PMJ_TOO_MANY_SWITCHES 6
#define PMJ_KERNEL_FAILED 7
#define PMJ_SLIDING 9 /* 8 marks runs of a sweep that are not computed */

/* What the caller of a controller's step has given besides y; loops/controller.py has the same. */
#define PMJ_GAVE_REFERENCE 1
#define PMJ_GAVE_APPLIED 2
/* Why a step was refused, besides PMJ_NON_FINITE and PMJ_KERNEL_FAILED. */
#define PMJ_READING_REFUSED 20
#define PMJ_REFERENCE_REFUSED 21
#define PMJ_APPLIED_REFUSED 22

#endif
