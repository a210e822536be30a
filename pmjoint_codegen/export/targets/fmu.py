"""Target ``fmu``: co-simulation units of controller and plant (FMI 2.0 and 3.0), run in one loop in FMPy."""

from __future__ import annotations

import importlib.util
import json
import platform
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pmjoint_codegen.compile.compiler import find_compiler, install_line
from pmjoint_codegen.errors import CheckFailed, MissingToolError, installing
from pmjoint_codegen.export.fmu.archive import PLATFORMS, Builder
from pmjoint_codegen.export.fmu.comparison import Expected, expected_of, not_compared
from pmjoint_codegen.export.fmu.loop import Job
from pmjoint_codegen.export.fmu.package import CONTROLLER, PLANT, file_name, units
from pmjoint_codegen.export.fmu.plant import PlantUnit
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target

_LIMIT: Final = 120.0  # s; a run of both units takes a few
_NAMES: Final = {"FMI 2.0": 2, "FMI 3.0": 3}


def deliver(order: Order) -> Delivery:
    """Four files: controller and plant, in FMI 2.0 and 3.0."""
    builders, missing = _builders(order)
    found = units(order.derivation, order.identity, order.precision, builders)
    built = [builder.platform.folder_3 for builder in builders]
    line = f"binaries for {', '.join(built)}; sources in every file" if built else f"sources alone: {missing}"
    files: Mapping[str, str | bytes] = {**found}
    return Delivery(files, Report({"platforms": built}, (line,)))


def _builders(order: Order) -> tuple[list[Builder], str]:
    """One for this platform if there is a compiler, and one for each platform that is asked for."""
    here, missing = _here(), ""
    builders = []
    if here in PLATFORMS and here not in order.platforms:
        compiler = find_compiler(order.environment, order.notify)
        if compiler is None:
            missing = f"no C compiler is found; install one: {install_line()}"
        else:
            builders.append(Builder(PLATFORMS[here], compiler.command))
    elif here not in PLATFORMS:
        missing = f"{here} is no platform of the FMI"
    if order.platforms:
        builders += [Builder.by_ziglang(name, order.environment) for name in dict.fromkeys(order.platforms)]
    return builders, missing


def _here() -> str:
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine())
    return f"{machine}-{platform.system().lower()}"


def run(order: Order, folder: Path) -> Report:
    """Validate the files, run them in one loop in FMPy, compare with ``simulate --controller sampled``."""
    if importlib.util.find_spec("fmpy") is None:
        remedy = f"install it: {installing('pmjoint-codegen[fmu]')}"
        raise MissingToolError("fmpy is needed to run the units", remedy=remedy)
    unit = PlantUnit(order.derivation)
    why = not_compared(order.derivation)
    expected = expected_of(order.derivation, order.file, [*unit.first]) if not why else None
    record: dict[str, Any] = {}
    lines = []
    for name, version in _NAMES.items():
        columns = _looped(order, folder, unit, version, expected)
        if expected is None:
            lines.append(f"{name}: valid, and runs; not compared with simulate: {why}")
            continue
        differences = expected.differences(columns)
        record |= {f"fmi{version}_{key}_difference": value for key, value in differences.items()}
        record |= {f"{key}_bound": value for key, value in expected.bounds.items()}
        told = ", ".join(f"{key} by {value:.1e}" for key, value in differences.items())
        bounds = ", ".join(f"{value:.1e}" for value in expected.bounds.values())
        text = f"{name}: controller and plant in FMPy differ from simulate --controller sampled in {told}"
        if any(not value <= expected.bounds[key] for key, value in differences.items()):
            raise CheckFailed(f"{text}, more than {bounds}", where=str(folder))
        lines.append(f"{text} (bound {bounds}, {expected.samples} samples)")
    return Report(record, tuple(lines))


def _looped(
    order: Order, folder: Path, unit: PlantUnit, version: int, expected: Expected | None
) -> dict[str, list[float]]:
    """Outputs of one run, in a process of its own that is ended if it takes too long."""
    s, model = order.derivation.signals, order.derivation.model
    zeros = [[0.0] * len(s.y_r)] * 100
    values = {item.symbol: item.value for item in model.parameters}
    resolution = model.chain.get("resolution")
    controller, plant = (
        str(folder / file_name(order.identity, part, version)) for part in (CONTROLLER, PLANT)
    )
    name = Path(controller).name
    job = Job(
        controller,
        plant,
        model.simulation.sample_time,
        zeros if expected is None else expected.reference,
        [y_r.name for y_r in s.y_r],
        unit.input_name,
        0.0 if resolution is None else values[resolution],
    )
    command = [sys.executable, "-m", "pmjoint_codegen.export.fmu.loop"]
    try:
        done = subprocess.run(
            command, input=job.text(), capture_output=True, text=True, timeout=_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        raise CheckFailed(f"FMPy takes more than {_LIMIT:g} s for {name}", where=str(folder)) from None
    if done.returncode != 0:
        told = [line for line in done.stdout.splitlines() if line.startswith("[ERROR]")]
        last = (told or done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise CheckFailed(f"FMPy cannot run {name}: {last.removeprefix('[ERROR] ')}", where=str(folder))
    found = json.loads(done.stdout)
    for path, problems in found["problems"].items():
        if problems:
            raise CheckFailed(f"FMPy's validation: {problems[0]}", where=path)
    columns: dict[str, list[float]] = found["columns"]
    return columns


TARGET: Final = Target(deliver, run)
