"""Controller unit and plant unit in one loop in FMPy.

Run as a program, it reads a job as JSON from standard input and prints JSON: units are foreign code in the
process, so that a caller starts a process of its own and can end it.

The order of a sample is that of ``simulate --controller sampled``: at t_k the plant's y is read, the
controller takes its step from t_k, and what it commands is held while the plant goes from t_k to t_k+1.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from types import TracebackType
from typing import Any


@dataclass(frozen=True)
class Job:
    """What to run.

    Attributes:
        controller: path of its file.
        plant: path of its file.
        period: s, from sample to sample.
        reference: y_r and its derivatives at each sample, as many samples as are to be run.
        told: names of y_r and its derivatives.
        command: name of the plant's input.
        resolution: of the sensor between the units; 0: none.
        values: of the plant's parameters and start values, by name.
        gains: of the controller, by name.
        recorded: outputs of the plant.
    """

    controller: str
    plant: str
    period: float
    reference: list[list[float]]
    told: list[str]
    command: str = "u"
    resolution: float = 0.0
    values: dict[str, float] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    recorded: list[str] = field(default_factory=lambda: ["y"])

    def text(self) -> str:
        """The job as JSON."""
        return json.dumps(asdict(self))


class Unit:
    """An instantiated unit of either version; `with` frees it."""

    def __init__(self, path: str, name: str, token: str = "") -> None:
        """Unpack and instantiate it; the token is its own unless another is given."""
        from fmpy import extract, read_model_description
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.description = read_model_description(path, validate=False)
        self.folder = extract(path)
        self.is_3 = self.description.fmiVersion.startswith("3")
        self.references = {item.name: item.valueReference for item in self.description.modelVariables}
        self.kinds = {item.name: item.type for item in self.description.modelVariables}
        token = token or self.description.guid or self.description.instantiationToken
        identifier = self.description.coSimulation.modelIdentifier
        made: Any = FMU3Slave if self.is_3 else FMU2Slave
        self.fmu = made(guid=token, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=name)
        self.fmu.instantiate()

    def __enter__(self) -> Unit:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Free the instance and its files."""
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)

    def set(self, values: Mapping[str, float | bool]) -> None:
        """Set variables by name."""
        for name, value in values.items():
            self._access("set", self.kinds[name])([self.references[name]], [value])

    def get(self, names: Sequence[str]) -> list[float]:
        """Real variables by name."""
        return list(self._access("get", "Real")([self.references[name] for name in names]))

    def _access(self, verb: str, kind: str) -> Any:
        wanted = {"Real": "Float64", "Integer": "Int32"}.get(kind, kind) if self.is_3 else kind
        return getattr(self.fmu, f"{verb}{wanted}")

    def begin(self, values: Mapping[str, float | bool]) -> None:
        """Initialise it with some values."""
        self.set(values)
        if not self.is_3:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, t: float, h: float) -> None:
        """One communication step."""
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)


def looped(job: Job) -> dict[str, list[float]]:
    """The run: output -> its value at each sample, with v and u_command of the controller."""
    columns: dict[str, list[float]] = {name: [] for name in (*job.recorded, "v", "command")}
    with Unit(job.plant, "plant") as plant, Unit(job.controller, "controller") as controller:
        plant.begin(job.values)
        begun = dict(zip(job.told, job.reference[0], strict=True))
        controller.begin({**job.gains, "sample_time": job.period, **begun, "y": _read(plant, job)})
        for k, reference in enumerate(job.reference):
            t = k * job.period
            for name, value in zip(job.recorded, plant.get(job.recorded), strict=True):
                columns[name].append(value)
            controller.set({"y": _read(plant, job), **dict(zip(job.told, reference, strict=True))})
            controller.step(t, job.period)
            v, command = controller.get(["v", "command"])
            columns["v"].append(v)
            columns["command"].append(command)
            plant.set({job.command: command})
            plant.step(t, job.period)
    return columns


def _read(plant: Unit, job: Job) -> float:
    """What the sensor reads."""
    (y,) = plant.get(["y"])
    return round(y / job.resolution) * job.resolution if job.resolution > 0.0 else y


def problems(path: str) -> list[str]:
    """What FMPy's validation finds."""
    from fmpy.validation import validate_fmu

    return [str(problem) for problem in validate_fmu(path)]


def main() -> None:
    """Validate both files and run them."""
    job = Job(**json.loads(sys.stdin.read()))
    found = {path: problems(path) for path in (job.controller, job.plant)}
    columns = {} if any(found.values()) else looped(job)
    json.dump({"problems": found, "columns": columns}, sys.stdout)


if __name__ == "__main__":
    main()
