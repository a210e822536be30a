/* Numbers of the loops, in C. Their twins have the same in pmjoint_codegen/loops/constants.py; a test compares the two. */
#ifndef PMJOINT_CONSTANTS_H
#define PMJOINT_CONSTANTS_H

/* Memory: of C alone. */
#define PMJ_MAX_ORDER 40 /* the highest Taylor order that the root isolation holds on its stack */
#define PMJ_MAX_NODES 16 /* the most nodes of a quadrature rule */

/* Numbers behind a row of channels, so that blocks of four may read and write past it. */
#define PMJ_PADDING 3

/* Roots of a step's polynomials. Halvings: below the last, an interval is narrower than the rounding of its ends. */
#define PMJ_MAX_DEPTH 48
#define PMJ_MAX_REFINEMENTS 100
#define PMJ_CLOSE 1e-9   /* relative: a Newton step below it is the last */
#define PMJ_ON_KINK 2    /* what `touching` is on a kink; on a threshold of v it is 1 */
#define PMJ_JUMPED 1e-6  /* part of what an argument moves in a step: one that stands on its zero is within rounding */

/* Below this step, relative to max(1 s, t), time does not move any more. */
#define PMJ_SMALLEST_STEP 1e-14
/* A threshold on which rounding alone decides the side is left alone for this long, s. */
#define PMJ_UNDECIDED_STEP 1e-7
/* A step may miss the right-hand side by this multiple of the tolerance, anywhere. */
#define PMJ_DEFECT 10.0
/* After a step that the guard has cut, the next is at most so much longer. */
#define PMJ_GROWTH 2.5
/* The least and the most by which a step that misses too much is multiplied. */
#define PMJ_LEAST_SHRINK 0.55
#define PMJ_MOST_SHRINK 0.95
/* Factor that covers the rounding of a sum of magnitudes, generously. */
#define PMJ_ROUNDED_UP 1.000000000001

/* Output instants closer to a sample than this fraction of the sample time are the sample itself. */
#define PMJ_SAME_INSTANT 1e-9
/* Size of a window in x, as a multiple of what a hold needs of it. */
#define PMJ_WINDOW 4.0
/* Gauss nodes and weights on (0, 1) for a hold that is one step: `quadrature.short_steps`. */
#define PMJ_SHORT_NODES {0.11270166537925831, 0.5, 0.8872983346207417}
#define PMJ_SHORT_WEIGHTS {0.2777777777777778, 0.4444444444444444, 0.2777777777777778}

/* How a run ended; loops/status.py puts it into words. */
#define PMJ_RUNNING 0
#define PMJ_DONE 1
#define PMJ_DIVERGED 2
#define PMJ_NON_FINITE 3
#define PMJ_STALLED 4
#define PMJ_TOO_MANY_STEPS 5
#define PMJ_TOO_MANY_SWITCHES 6
#define PMJ_KERNEL_FAILED 7
#define PMJ_SLIDING 9 /* 8 is a sweep's word for runs that are not made */

#endif
