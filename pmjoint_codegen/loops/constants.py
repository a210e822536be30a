"""Numbers of the loops, for the Python twins; ``loops/c/pmjoint_constants.h`` has the same for the C."""

from __future__ import annotations

from typing import Final

PADDING: Final = 3  # numbers behind a row of channels, so that blocks of four may read and write past it

# Halvings of a step in the search for a root: below it, an interval is narrower than the rounding of its
# ends.
MAX_DEPTH: Final = 48
MAX_REFINEMENTS: Final = 100
CLOSE: Final = 1e-9  # relative: a Newton step below it is the last
ON_KINK: Final = 2  # value of `touching` on a kink; on a threshold of v it is 1
LET_GO: Final = 3  # on a kink that has held the run until now
JUMPED: Final = (
    1e-6  # part of an argument's change in a step: below it, the argument is on its zero, to rounding
)

SMALLEST_STEP: Final = 1e-14  # relative to max(1 s, t): below it, time does not advance
UNDECIDED_STEP: Final = 1e-7  # s; the step that ignores the thresholds
DEFECT: Final = (
    10.0  # a step may deviate from the right-hand side by this multiple of the tolerance, anywhere
)
GROWTH: Final = 2.5  # after a step that the guard has cut, the next is at most this much longer
LEAST_SHRINK: Final = 0.55  # a step with too large an error is multiplied by at least this, and
MOST_SHRINK: Final = 0.95  # at most this
ROUNDED_UP: Final = 1.0 + 1e-12  # factor that safely covers the rounding of a sum of magnitudes

# Output instants closer to a sample than this fraction of the sample time count as the sample.
SAME_INSTANT: Final = 1e-9
WINDOW: Final = 4.0  # size of a window in x, as a multiple of a hold's need

# What the caller of a controller's step has given besides y, and why a step was refused.
GAVE_REFERENCE: Final = 1
GAVE_APPLIED: Final = 2
READING_REFUSED: Final = 20
REFERENCE_REFUSED: Final = 21
APPLIED_REFUSED: Final = 22
