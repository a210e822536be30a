"""Exercises the units of the paper's model in FMPy; run as a program, so that a test can end it.

Takes the folder of the files and the version of the FMI; prints what it saw as JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

from pmjoint_codegen.export.fmu.loop import Unit

T = 0.001
LOCALS = ["xi1", "xi2", "Xi21", "lambda1", "lambda2"]
SHOWN = ["v", "command", "z1", "x_hat2"]


def fails(action: Callable[[], Any]) -> bool:
    """Say whether a call raises, as FMPy does for every status that is an error."""
    try:
        action()
    except Exception:
        return True
    return False


def changed_step(unit: Unit, values: dict[str, float], t: float) -> None:
    """Set variables and take a step."""
    unit.set(values)
    unit.step(t, T)


def controller(path: str, **values: float | bool) -> Unit:
    """An initialised controller."""
    unit = Unit(path, "controller")
    unit.begin({"y": 1.5, "y_r": 0.0, "dy_r": 1.0, **values})
    return unit


def samples(unit: Unit, first: int, count: int, names: list[str] = SHOWN) -> list[list[float]]:
    """Take some samples of a made-up output."""
    seen = []
    for k in range(first, first + count):
        unit.set({"y": 1.5 - 0.01 * k, "use_measured_u": True, "u_applied": 0.3 * k})
        unit.step(k * T, T)
        seen.append(unit.get(names))
    return seen


def states(unit: Unit, run: Callable[[Unit], Any], other: Unit) -> dict[str, Any]:
    """Go on from a state three times: at once, from the saved state, from its bytes in another instance."""
    saved = unit.fmu.getFMUState()
    data = unit.fmu.serializeFMUState(saved)
    found = {"on": run(unit)}
    unit.fmu.setFMUState(saved)
    found["again"] = run(unit)
    restored = other.fmu.deserializeFMUState(data)
    other.fmu.setFMUState(restored)
    found["elsewhere"] = run(other)
    unit.fmu.freeFMUState(saved)
    other.fmu.freeFMUState(restored)
    return found


def of_controller(path: str) -> dict[str, Any]:
    """What is seen of the controller."""
    seen: dict[str, Any] = {}
    one, two = controller(path), controller(path)
    seen["first"] = samples(one, 0, 5)
    seen["states"] = states(one, lambda unit: samples(unit, 5, 5), two)
    one.fmu.reset()
    one.begin({"y": 1.5, "y_r": 0.0, "dy_r": 1.0})
    seen["reset"] = samples(one, 0, 5)

    plain, changed, other = (
        controller(path, compensator=0.0),
        controller(path, compensator=0.0),
        controller(path, compensator=0.0, c1=20.0),
    )
    for unit in (plain, changed, other):
        samples(unit, 0, 10)
    changed.set({"c1": 20.0})
    seen["gain"] = [samples(unit, 10, 1, ["v", *LOCALS])[0] for unit in (plain, changed, other)]

    long, short, halves = controller(path), controller(path), controller(path)
    for unit in (long, short, halves):
        samples(unit, 0, 3)
    long.step(3 * T, 3 * T)
    for k in range(3, 6):
        short.step(k * T, T)
    seen["long"] = [unit.get([*SHOWN, *LOCALS]) for unit in (long, short)]
    seen["half"] = []
    for half in range(4):
        halves.set({"y": 1.0 + half})
        halves.step((3 + half / 2) * T, T / 2)
        seen["half"] += halves.get(["v"])

    seen["refused"] = {
        "sample_time while it runs": fails(lambda: one.set({"sample_time": 0.002})),
        "an output": fails(lambda: one.set({"v": 1.0})),
        "a step back": fails(lambda: one.step(5 * T, -T)),
        "a gap": fails(lambda: one.step(7 * T, T)),
        "no sample time": fails(lambda: controller(path, sample_time=0.0)),
        "a gain without sense": fails(lambda: changed_step(short, {"b0": 0.0}, 6 * T)),
        "another token": fails(lambda: Unit(path, "another", "{00000000-0000-0000-0000-000000000000}")),
    }
    return seen


def moved(unit: Unit, first: float, end: float, count: int) -> list[float]:
    """Step the plant to an end and show its states."""
    for k in range(count):
        h = (end - first) / count
        unit.step(first + k * h, h)
    return unit.get(["x1", "x2"])


def of_plant(path: str) -> dict[str, Any]:
    """What is seen of the plant."""
    seen: dict[str, Any] = {}
    units = [Unit(path, f"plant{i}") for i in range(4)]
    coarse, fine, tuned, other = units
    for unit in units:
        unit.begin({"x1": 0.7, "x2": -0.2, "u": 12.0})
    seen["start"] = coarse.get(["y", "x1", "x2", "u_applied"])
    seen["coarse"], seen["fine"] = moved(coarse, 0.0, 1.0, 1), moved(fine, 0.0, 1.0, 1000)
    moved(tuned, 0.0, 0.5, 1)
    tuned.set({"d1": 5.0, "x2_dot_added": 0.25})
    seen["tuned"] = moved(tuned, 0.5, 1.0, 1)
    seen["states"] = states(coarse, lambda unit: moved(unit, 1.0, 1.5, 7), other)
    seen["refused"] = {
        "a start value while it runs": fails(lambda: fine.set({"x1": 0.0})),
        "not a number": fails(lambda: changed_step(fine, {"d1": float("nan")}, 1.0)),
    }
    return seen


def main() -> None:
    """Look at both units."""
    folder, version = sys.argv[1:]
    found = {
        "controller": of_controller(f"{folder}/paper_controller.fmi{version}.fmu"),
        "plant": of_plant(f"{folder}/paper_plant.fmi{version}.fmu"),
    }
    sys.stdout.write("\n" + json.dumps(found) + "\n")  # FMPy prints what the units log


if __name__ == "__main__":
    main()
