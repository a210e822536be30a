"""The rows that are made from those of `table`: `LOOPS` for single runs, `LANES` for sweeps."""

from __future__ import annotations

from collections.abc import Iterable

from pmjoint_codegen.emit.lanes import LANE_ORDER, arrive, bernstein, control, matrices, same, stacked
from pmjoint_codegen.emit.sampling import HOLD_ORDER, PLANT_ORDER, sample
from pmjoint_codegen.emit.table import Composed, Guard, Made, Taylor

LOOPS: tuple[Made, ...] = (
    Taylor(
        "taylor",
        "closed_loop",
        "X",
        None,
        "(11), (14), (23), (29)",
        "Taylor coefficients of what closed_loop gives",
    ),
    Guard(
        "guard",
        "closed_loop",
        "X",
        about="nonlinear part of what closed_loop gives on a disc around t, as a bound",
    ),
    Taylor("plant_taylor", "plant", "x", PLANT_ORDER, "(11)", "Taylor coefficients of what plant gives"),
    Guard(
        "plant_guard",
        "plant",
        "x",
        about="nonlinear part of what plant gives on a disc around t, as a bound",
    ),
    Composed(
        "sample",
        ("reference", "law", "actuation", "plant", "sampled_update"),
        sample,
        "(10), (11), (14), (23), (29)",
        "one sample: v, w, plant_taylor under w, the next s",
    ),
)
LANES: tuple[Made, ...] = (
    Composed("actuation_lanes", ("actuation",), same),
    Composed("matrices_lanes", ("filter_matrix", "compensator_matrix"), matrices),
    Composed("reference_lanes", ("reference",), same),
    Composed("start_lanes", ("start",), same),
    Taylor("taylor_lanes", "closed_loop", "X", LANE_ORDER),
    Composed("guard_lanes", ("guard",), same),
    Composed("rates_lanes", ("closed_loop",), stacked),
    Composed("arrive_lanes", ("closed_loop",), arrive),
    Composed("bernstein_lanes", (), bernstein),
    Taylor("plant_lanes", "plant", "x", HOLD_ORDER),
    Composed("plant_guard_lanes", ("plant_guard",), same),
    Composed("plant_rates_lanes", ("plant",), stacked),
    Composed("sample_lanes", ("sample",), same),
    Composed("control_lanes", ("reference", "law"), control),
    Composed("update_lanes", ("sampled_update",), same),
)
# Of a plant that a kink can hold; their functions have the channels of those without `_held`.
HELD_LOOPS: tuple[Made, ...] = (
    Taylor("taylor_held", "closed_loop_held", "X", None, "", "coefficients of what closed_loop_held gives"),
    Guard("guard_held", "closed_loop_held", "X", about="the guard of closed_loop_held"),
    Taylor(
        "plant_taylor_held",
        "plant_held",
        "x",
        PLANT_ORDER,
        "",
        "coefficients of what plant_held gives",
    ),
    Guard("plant_guard_held", "plant_held", "x", about="the guard of plant_held"),
)
HELD_LANES: tuple[Made, ...] = (
    Taylor("taylor_held_lanes", "closed_loop_held", "X", LANE_ORDER),
    Composed("guard_held_lanes", ("guard_held",), same),
    Composed("rates_held_lanes", ("closed_loop_held",), stacked),
    Taylor("plant_held_lanes", "plant_held", "x", HOLD_ORDER),
    Composed("plant_guard_held_lanes", ("plant_guard_held",), same),
    Composed("plant_rates_held_lanes", ("plant_held",), stacked),
    Composed("holds_lanes", ("holds",), same),
)


def loop_rows(names: Iterable[str]) -> tuple[Made, ...]:
    """The rows of single runs of a model, from the names in its `kernel_table`."""
    return (*LOOPS, *HELD_LOOPS) if "holds" in names else LOOPS


def lane_rows(names: Iterable[str]) -> tuple[Made, ...]:
    """The rows of its sweeps."""
    return (*LANES, *HELD_LANES) if "holds" in names else LANES
