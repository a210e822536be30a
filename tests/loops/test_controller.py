"""The controller's arithmetic, compiled and interpreted: the bits of a sampled run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.controller import Controller
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.run import Run
from tests.sampled_runs import T, loaded, sampled

Array = npt.NDArray[np.float64]

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")
ADAPTIVE = ("paper-adaptive", "joint-load")


@pytest.fixture(params=["compiled", "interpreted"])
def evaluator(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def columns(run: Run, names: list[str]) -> Array:
    return np.column_stack([run[name] for name in names])


def reported(manifest: Manifest) -> tuple[list[str], list[str]]:
    """Columns of x_hat and z."""
    return [f"x_hat{i}" for i in range(1, manifest.n + 1)], [f"z{i}" for i in range(1, manifest.rho + 1)]


def assert_follows(controller: Controller, run: Run, y: str, u: str) -> None:
    """From the readings of a run, everything that it recorded of its controller, to the bit."""
    manifest = controller.evaluator.manifest
    names = [*("v", u), *reported(manifest)[0], *reported(manifest)[1]]
    names += [item.name for item in manifest.states[manifest.nx :]]
    whole = columns(run, names)
    for k, (reading, row) in enumerate(zip(run[y].tolist(), whole, strict=True)):
        if not np.all(np.isfinite([reading, *row])):
            with pytest.raises((SimulationError, UsageError)):
                controller.step(reading)
            event("not finite")
            return
        sent = controller.step(reading)
        found = np.array([controller.v, sent, *controller.x_hat, *controller.z, *controller.s])
        assert found.tobytes() == row.tobytes(), (
            k,
            dict(zip(names, zip(found, row, strict=True), strict=True)),
        )
    assert controller.sample == len(whole)


def drawn(data: st.DataObject, loop: ClosedLoop) -> dict[str, Any]:
    manifest = loop.manifest
    gains = [f"{kind}{i}" for kind in ("c", "e", "ck") for i in range(1, manifest.rho + 1)]
    values = {item.name: float(item.value) for item in manifest.settable}
    factor = st.floats(0.5, 2.0)
    chosen = data.draw(st.sets(st.sampled_from(gains), max_size=3))
    return {
        "parameters": {name: values[name] * data.draw(factor) for name in sorted(chosen)},
        "x0": [x * data.draw(st.floats(-2.0, 2.0)) for x in manifest.simulation.x0],
        "sample_time": data.draw(st.sampled_from([0.0005, 0.001, 0.003, 0.01])),
        "start": data.draw(st.sampled_from(["zero", "matched"])),
        "compensator": None if "Theta" in manifest.blocks else data.draw(st.sampled_from([None, False])),
    }


@pytest.mark.parametrize("model", (*MODELS, *ADAPTIVE))
@settings(max_examples=10)
@given(data=st.data())
def test_it_has_the_bits_of_a_sampled_run(model: str, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["compiled", "compiled", "interpreted"]))
    saturation = data.draw(st.sampled_from([None, "braking"])) if model in ("paper", "joint-damped") else None
    loop = loaded(model, "compiled", saturation)
    asked = drawn(data, loop)
    if saturation:
        asked["compensator"] = None
    steps = 60 if kind == "interpreted" else 300
    run = sampled(loop, horizon=steps * asked["sample_time"], **asked)
    event("saturated" if run.switches or run.initial_mode else "not saturated")
    own = {key: value for key, value in asked.items() if key != "x0"}
    reading = "y_m" if "resolution" in loop.manifest.chain else "y"
    assert_follows(loaded(model, kind, saturation).controller(**own), run, reading, "u")


def test_it_has_the_bits_of_a_run_with_sensor_filter_rate_dead_zone_and_data(
    bench: Callable[[str], ClosedLoop], evaluator: str
) -> None:
    run = sampled(bench("compiled"))
    command = run["u_command"]
    assert min(command) == -0.9 and max(command) > 1.5  # a limit acts,
    assert np.isclose(np.abs(np.diff(command)), 60 * T).sum() > 10  # so do the rate
    assert np.abs(run["y_f"] - run["y_m"]).max() > 1e-4  # and the filter
    assert_follows(bench(evaluator).controller(), run, "y_m", "u_command")
    controller = bench(evaluator).controller()
    for k, reading in enumerate(run["y_m"].tolist()):
        controller.step(reading)
        assert controller.u == run["u"][k]


def test_data_that_a_loop_did_not_have_becomes_its_reference(evaluator: str) -> None:
    data = {"steps": [[0, 0], [0.02, 0.4]], "filter": 50}
    run = sampled(loaded("paper"), reference=data, horizon=0.1)
    assert_follows(loaded("paper", evaluator).controller(sample_time=T, reference=data), run, "y", "u")
