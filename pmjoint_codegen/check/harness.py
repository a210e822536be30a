"""A small C program that calls every kernel on given points, for tools that watch a program run.

It reads raw doubles and writes raw doubles. Every argument and result has its own block of exactly the right
size, allocated by malloc for each point: an access past the end is a memory error, and an unwritten result is
an uninitialised value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.bits import different_bits
from pmjoint_codegen.check.inputs.points import batches
from pmjoint_codegen.kernels.declarations import exported
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.manifest import Function, Manifest

Array = npt.NDArray[np.float64]

SEED = 20200531
POINTS = 3  # of each kind

_PROGRAM = """\
#include <stdio.h>
#include <stdlib.h>
#include "kernels.h"

typedef int (*kernel)(const double **, double **, long long int *, double *, int);
struct entry { kernel call; int inputs; int outputs; int sizes[16]; };

static const struct entry table[] = {
%(rows)s
};

static int evaluate(const struct entry *row) {
  double *block[16] = {0};
  const double *arg[16] = {0};
  double *res[16] = {0};
  int i, failed = 0;
  for (i = 0; i < row->inputs + row->outputs; ++i) {
    size_t size = (size_t) row->sizes[i];
    block[i] = malloc(size * sizeof(double));
    if (block[i] == NULL && size > 0) return 1;
    if (i < row->inputs) {
      if (fread(block[i], sizeof(double), size, stdin) != size) return 1;
      arg[i] = block[i];
    } else {
      res[i - row->inputs] = block[i];
    }
  }
  failed = row->call(arg, res, NULL, NULL, 0);
  for (i = 0; i < row->inputs + row->outputs; ++i) {
    if (i >= row->inputs) fwrite(block[i], sizeof(double), (size_t) row->sizes[i], stdout);
    free(block[i]);
  }
  return failed;
}

int main(void) {
  double which;
  while (fread(&which, sizeof which, 1, stdin) == 1)
    if (evaluate(&table[(int) which])) return 1;
  return 0;
}
"""


def program(manifest: Manifest) -> str:
    """Source text of the program for one model's kernels."""
    rows = ",\n".join(_row(function) for function in manifest.functions)
    return _PROGRAM % {"rows": rows}


def _row(function: Function) -> str:
    sizes = ", ".join(str(size) for _, size in (*function.inputs, *function.outputs))
    return f"  {{{exported(function.name)}, {len(function.inputs)}, {len(function.outputs)}, {{{sizes}}}}}"


def feed(evaluator: Evaluator) -> tuple[bytes, bytes]:
    """The input of the program, and its expected output.

    Args:
        evaluator: gives the expected results.
    """
    questions: list[Array] = []
    answers: list[Array] = []
    for index, function in enumerate(evaluator.manifest.functions):
        for batch in batches(evaluator, function, POINTS, SEED, extreme=True):
            results = evaluator.call(function.name, *batch.arguments)
            for row in range(POINTS):
                questions += [np.array([float(index)]), *(array[row] for array in batch.arguments)]
                answers += [array[row] for array in results]
    return _bytes(questions), _bytes(answers)


def _bytes(arrays: Sequence[Array]) -> bytes:
    return np.concatenate(arrays).tobytes()


def differing(expected: bytes, found: bytes) -> int:
    """Number of results that differ in any bit; NaNs are equal to each other, a missing result differs."""
    a, b = (np.frombuffer(data[: len(data) // 8 * 8]) for data in (expected, found))
    common = min(len(a), len(b))
    unequal = np.count_nonzero(different_bits(a[:common], b[:common]))
    return int(unequal + max(len(a), len(b)) - common)
