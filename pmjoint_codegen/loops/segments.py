"""Break points of a reference that is data: the twin of ``loops/c/segments.c``.

Between two of them the reference is one expression of parameters, which end p. A step ends at a break point;
then the next segment's parameters replace them.
"""

from __future__ import annotations

import math

from pmjoint_codegen.loops.problem import Memory, Problem, Progress


def next_break(problem: Problem, progress: Progress) -> float:
    """The next break point, s; infinite if there is none."""
    return float(problem.breaks[progress.segment]) if progress.segment < problem.n_breaks else math.inf


def enter_segments(problem: Problem, progress: Progress, memory: Memory, t: float) -> bool:
    """Put the segment at time t into p; whether it has changed."""
    before = progress.segment
    while next_break(problem, progress) <= t:
        progress.segment += 1
        memory.segment[:] = problem.segments[progress.segment]
    return progress.segment > before
