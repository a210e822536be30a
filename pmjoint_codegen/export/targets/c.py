"""Target ``c``: a folder of readable C99, tested with ``make test``."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Final

from pmjoint_codegen.compile.compiler import INSTALL, find_compiler, install_line
from pmjoint_codegen.errors import BuildError, CheckFailed, MissingToolError
from pmjoint_codegen.export.package import Export, cost_of, export_c
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target
from pmjoint_codegen.export.tracking import tracking_of
from pmjoint_codegen.export.tree import DOUBLE

_LIMIT: Final = 300.0  # s; a build takes one


def deliver(order: Order) -> Delivery:
    """The controller's folder, and what its precision costs."""
    made = export_c(order.derivation, order.identity, order.precision, order.hold)
    cost = cost_of(made.program, made.precision)
    unit = order.derivation.model.u_unit
    line = (
        f"{order.precision.name} moves v by at most {cost.bound:.2g} {unit} where |v| reaches "
        f"{cost.largest:.3g} {unit} (derived bound, over the samples of the self test)"
    )
    report = Report({"v_error_bound": cost.bound, "v_largest": cost.largest}, (line,))
    return Delivery(made.files, report if order.precision == DOUBLE else _with_tracking(report, made))


def _with_tracking(report: Report, made: Export) -> Report:
    """The report with what the precision costs in closed loop."""
    cost = tracking_of(made.program, made.precision)
    d = made.program.derivation
    unit = str(d.units.of(d.signals.y))
    over = f"over {cost.seconds:.3g} s of the example's run"
    bounded = cost.y <= cost.largest
    line = (
        f"{made.precision.name} moves y in closed loop by at most {cost.y:.2g} {unit} where |y| reaches "
        f"{cost.largest:.3g} {unit} (first-order bound, {over})"
        if bounded
        else f"no useful bound on what {made.precision.name} does to y in closed loop was found, {over}: "
        "rounding errors may come to move y as far as it goes; lower gains or --precision double help"
    )
    found = {
        "y_error_bound": cost.y if bounded else None,
        "y_largest": cost.largest,
        "y_seconds": cost.seconds,
    }
    return Report({**report.record, **found}, (*report.lines, line))


def run(order: Order, folder: Path) -> Report:
    """``make test``: build without a warning, run the self test and the example."""
    make = shutil.which("make", path=order.environment.get("PATH"))
    compiler = find_compiler(order.environment, order.notify)
    if make is None or compiler is None:
        absent = "make" if make is None else "a C compiler"
        remedy = f"{INSTALL} make" if make is None else install_line()
        raise MissingToolError(f"{absent} is needed to run the export", remedy=f"install it: {remedy}")
    command = [make, "--no-print-directory", "-C", str(folder), f"CC={shlex.join(compiler.command)}", "test"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT, check=False)
    if done.returncode != 0:
        told = (done.stdout + done.stderr).strip()
        if "warning" in told or "error:" in told:
            raise BuildError("the export does not build", where=str(folder), output=told)
        raise CheckFailed(told.splitlines()[-1], where=str(folder))
    last = done.stdout.strip().splitlines()[-1]
    return Report({"ran": last}, (f"make test: {last}",))


TARGET: Final = Target(deliver, run, bakes=True)
