"""A kernel's tape evaluated over whatever can be added and multiplied: symbols, or Python text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pmjoint_codegen.kernels.tape import Tape

Operations = Mapping[str, Callable[..., Any]]


def arithmetic(functions: Any, constant: Callable[[float], Any] = float) -> Operations:
    """Return every operation of a tape, with sin, cos, exp and the like from a module.

    Args:
        functions: has sin, cos, tan, tanh, exp, log and sqrt.
        constant: makes a number of the algebra.
    """
    elementary = {
        name: getattr(functions, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt")
    }
    return {
        **elementary,
        "const": constant,
        "neg": lambda a: -a,
        "sq": lambda a: a * a,
        "twice": lambda a: a + a,
        "inv": lambda a: constant(1.0) / a,
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b,
        "pow": lambda a, b: a**b,
        "fmin": lambda a, _: a,  # of u alone, which no peer reads: it saturates v itself
        "fmax": lambda a, _: a,
    }


def evaluate(tape: Tape, arguments: Sequence[Sequence[Any]], operations: Operations) -> list[list[Any]]:
    """Return each result of a tape, entry by entry.

    Args:
        tape: of a kernel.
        arguments: one sequence an input.
        operations: as `arithmetic` makes them.
    """
    values: list[Any] = []
    results = [[operations["const"](0.0)] * size for _, size in tape.outputs]
    for item in tape.instructions:
        if item.operation == "output":
            result, entry, value = item.operands
            results[result][entry] = values[value]
        elif item.operation == "input":
            values.append(arguments[item.operands[0]][item.operands[1]])
        elif item.operation == "const":
            values.append(operations["const"](item.value))
        else:
            values.append(operations[item.operation](*(values[i] for i in item.operands)))
    return results


def python_function(tape: Tape, names: Sequence[str]) -> Callable[..., Any]:
    """Return a tape as a Python function of plain sequences that gives its first result as a list.

    Args:
        tape: of a kernel.
        names: of the arguments.
    """
    symbols = {"neg": "-{0}", "sq": "{0} * {0}", "twice": "{0} + {0}", "inv": "1.0 / {0}", "add": "{0} + {1}"}
    symbols |= {
        "fmin": "min({0}, {1})",
        "fmax": "max({0}, {1})",
        "sub": "{0} - {1}",
        "mul": "{0} * {1}",
        "div": "{0} / {1}",
        "pow": "{0} ** {1}",
    }
    lines, count = [f"def function({', '.join(names)}):"], 0
    wanted = ["0.0"] * tape.outputs[0][1]
    for item in tape.instructions:
        if item.operation == "output":
            if item.operands[0] == 0:
                wanted[item.operands[1]] = f"a{item.operands[2]}"
            continue
        if item.operation == "input":
            text = f"{names[item.operands[0]]}[{item.operands[1]}]"
        elif item.operation == "const":
            text = repr(item.value)
        else:
            form = symbols.get(item.operation, item.operation + "({0})")
            text = form.format(*(f"a{i}" for i in item.operands))
        lines.append(f"    a{count} = {text}")
        count += 1
    lines.append(f"    return [{', '.join(wanted)}]")
    scope: dict[str, Any] = {}
    exec("from math import *\n" + "\n".join(lines), scope)
    function: Callable[..., Any] = scope["function"]
    return function
