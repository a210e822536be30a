"""``model.json``: everything that the runtime knows about a generated model.

The toolchain writes it, the runtime reads it; neither needs the other. All records are frozen; tuples keep
the order of the kernels' input and output vectors.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from pmjoint_codegen.chain import LOWER, UPPER
from pmjoint_codegen.errors import OtherVersionError, StaleError
from pmjoint_codegen.initial import Start, Variable
from pmjoint_codegen.reference.command import Command
from pmjoint_codegen.storage import sha256
from pmjoint_codegen.values import OWN_SUFFIX, SI, Rule, from_si

FILE_NAME: Final = "model.json"
LANES: Final = "lanes.c"
SCHEMA: Final = 3
LOGIT: Final = "_logit"  # end of the name of an estimate's state, where that is not the estimate itself
ADAPTATION: Final = "adaptation"  # kind of guesses and of what estimates depend on
SEGMENT: Final = "reference"  # kind of the parameters of a reference's present segment, at the end of p
_REMEDY: Final = "run pmjoint regenerate"


@dataclass(frozen=True)
class Parameter:
    """One entry of the parameter vector p.

    Attributes:
        name: as on the command line.
        value: default, as the kernels take it: in SI units for a joint.
        unit: physical unit, as in the model file.
        about: one line for the reader.
        kind: ``plant``, ``gain``, ``switch``, `ADAPTATION` or ``own``: the plant's own value, such as
            ``J_plant``, of a parameter that the controller uses too. It equals that one unless set.
            `SEGMENT`: a coefficient of a reference that is data; a run has these from its reference alone.
        scale: how many SI units `unit` is, as a decimal; "1" if kernels take values as given.
    """

    name: str
    value: float
    unit: str
    about: str
    kind: str
    scale: str = SI


@dataclass(frozen=True)
class Function:
    """One kernel.

    Attributes:
        name: name in C.
        inputs: (label, length) of each argument.
        outputs: (label, length) of each result.
        equation: paper numbers.
        about: one line for the reader.
        operations: number of elementary operations.
    """

    name: str
    inputs: tuple[tuple[str, int], ...]
    outputs: tuple[tuple[str, int], ...]
    equation: str
    about: str
    operations: int


@dataclass(frozen=True)
class GuardRule:
    """Where a step's polynomials are compared with the right-hand side, and the bound on the remainder.

    Attributes:
        order: N of the polynomials.
        inside: points n_j inside the step, as fractions of it; its end is compared as well.
        lebesgue: L, factor on the largest defect found at these points.
        remainder: W of the remainder ``W / (s^N prod_j (s - n_j)) s/(s - 1)``, with the end among the n_j.
    """

    order: int
    inside: tuple[float, ...]
    lebesgue: float
    remainder: float


@dataclass(frozen=True)
class Simulation:
    """Default run.

    Attributes:
        reference: y_r as a function of t.
        disturbance: one expression per state.
        x0: initial states, those of `Manifest.start`.
        horizon: s.
        output_step: s.
        sample_time: s.
        compensator: whether (23) is driven.
        start: of the controller, ``zero`` or ``matched``.
        command: the reference where it is data; it stands in the model file alone, not in ``model.json``.
    """

    reference: str
    disturbance: tuple[str, ...]
    x0: tuple[float, ...]
    horizon: float
    output_step: float
    sample_time: float
    compensator: bool
    start: str
    command: Command | None = None

    @property
    def reference_text(self) -> str:
        """The reference in one line."""
        return self.reference if self.command is None else self.command.text


@dataclass(frozen=True, repr=False)
class Manifest:
    """A generated model.

    Attributes:
        name: folder under ``generated/``.
        title: one line for people.
        source: where model and numbers come from.
        model_hash: of everything in the model file.
        versions: of the tools that shape the text.
        n: order of the design's plant.
        m: number of its zeros.
        rho: relative degree.
        p: length of theta.
        nx: states of the simulated plant.
        nw: entries of w, what the actuator delivers.
        order: highest Taylor coefficient N.
        limit: name of the parameter that bounds the actuator; an expression where lower and upper are two.
        chain: key of ``[actuator]``, ``[sensor]`` or the clock -> name of its parameter, ``limit`` left out.
        leading: expression of b_m.
        disturbance_bound: D_max, or None.
        linear: (a_1, a_2, b_0), expressions of parameters in Python's notation, of a simulated plant that is
            ``x1' = x2 + a_1 x1, x2' = a_2 x1 + b_0 u + d`` with ``|d| <= D_max``; empty for other plants.
        kinks: arguments of abs and sign in the plant's rates, inner ones first; each has its zeros located.
        windows: whether one evaluation of the plant's guard serves many holds.
        guards: the rule for steps of each Taylor kernel, by its name.
        states: entries of X.
        start: the meaning of x0, and the plant's states there.
        blocks: index range of x, xi, Xi, lambda, r in X.
        parameters: entries of p.
        chosen: what keys of the design, such as a bandwidth, came to, one line each.
        rules: constraints on the parameters beyond those of every design.
        signals: entries of the ``signals`` kernel.
        partials: names of the ``partials`` kernel's entries.
        functions: all kernels.
        simulation: default run.
        files: SHA-256 of every other generated file.
    """

    name: str
    title: str
    source: str
    model_hash: str
    versions: Mapping[str, str]
    n: int
    m: int
    rho: int
    p: int
    nx: int
    nw: int
    order: int
    limit: str
    chain: Mapping[str, str]
    leading: str
    disturbance_bound: float | None
    linear: tuple[str, ...]
    kinks: tuple[str, ...]
    windows: bool
    guards: Mapping[str, GuardRule]
    states: tuple[Variable, ...]
    start: Start
    blocks: Mapping[str, tuple[int, int]]
    parameters: tuple[Parameter, ...]
    chosen: tuple[str, ...]
    rules: tuple[Rule, ...]
    signals: tuple[Variable, ...]
    partials: tuple[str, ...]
    functions: tuple[Function, ...]
    simulation: Simulation
    files: Mapping[str, str]

    def __repr__(self) -> str:
        """Name the model and its sizes."""
        return (
            f"<Manifest of {self.name}: order {self.n}, relative degree {self.rho}, {self.nX} states, "
            f"{len(self.parameters)} parameters, {len(self.signals)} signals, hash {self.model_hash[:12]}>"
        )

    @property
    def nX(self) -> int:  # noqa: N802 - X is the closed loop's state, as in the table of kernels
        """Number of states of the closed loop."""
        return len(self.states)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names in the order of p, without the reference's segment at its end."""
        return tuple(item.name for item in self.settable)

    @cached_property
    def settable(self) -> tuple[Parameter, ...]:
        """The parameters that have names for a user: all but the reference's segment."""
        return tuple(item for item in self.parameters if item.kind != SEGMENT)

    @property
    def segment(self) -> int:
        """Number of parameters of the reference's segment; 0 where the reference is an expression."""
        return len(self.parameters) - len(self.settable)

    def with_command(self, command: Command | None) -> Manifest:
        """The same model with a reference that is data."""
        return replace(self, simulation=replace(self.simulation, command=command))

    @cached_property
    def scales(self) -> Mapping[str, str]:
        """Scales of the parameters that the model file states in non-SI units, by name."""
        return {item.name: item.scale for item in self.parameters if item.scale != SI}

    @cached_property
    def least_scale(self) -> float:
        """The smaller of the units of y and u in SI units, where one is below 1."""
        return min(1.0, *(float(item.scale) for item in self.signals))

    def written(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of parameters, as the kernels take them, in the units of the model file."""
        return {name: from_si(value, self.scales.get(name, SI)) for name, value in values.items()}

    @property
    def limit_names(self) -> tuple[str, str]:
        """What bounds the actuator below and above, for a reader."""
        if LOWER in self.chain:
            return self.chain[LOWER], self.chain[UPPER]
        return f"-{self.limit}", self.limit

    @property
    def limit_parameters(self) -> tuple[str, ...]:
        """The parameters that bound the actuator: one for both sides, or lower and upper."""
        return (self.chain[LOWER], self.chain[UPPER]) if LOWER in self.chain else (self.limit,)

    def limits(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Lower and upper limit of what the actuator is told, from values of the parameters."""
        if LOWER in self.chain:
            return values[self.chain[LOWER]], values[self.chain[UPPER]]
        return -values[self.limit], values[self.limit]

    @property
    def own(self) -> Mapping[str, str]:
        """Name of the plant's own value -> the controller's parameter: ``J_plant`` -> ``J``."""
        twins = (item.name for item in self.parameters if item.kind == "own")
        return {name: name.removesuffix(OWN_SUFFIX) for name in twins}

    def stated(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values by name, without the plant's own where they equal the controller's."""
        own = self.own
        return {name: x for name, x in values.items() if name not in own or x != values[own[name]]}

    @property
    def hold_order(self) -> int:
        """Highest Taylor coefficient that ``sample`` gives, of the channels x and e."""
        return self._order("sample")

    @property
    def plant_order(self) -> int:
        """Highest Taylor coefficient that ``plant_taylor`` gives, of the same."""
        return self._order("plant_taylor")

    @property
    def can_hold(self) -> bool:
        """Whether a kink can hold a run, as Coulomb friction does: there is a kernel ``holds``."""
        return any(item.name == "holds" for item in self.functions)

    def _order(self, name: str) -> int:
        return dict(self.function(name).outputs)["c"] // (self.nx + 1 + len(self.kinks)) - 1

    def function(self, name: str) -> Function:
        """The kernel of that name.

        Raises:
            KeyError: when the model has no such kernel.
        """
        for item in self.functions:
            if item.name == name:
                return item
        raise KeyError(name)

    def to_json(self) -> str:
        """The file's text, with a hash over itself."""
        contents = {"schema": SCHEMA, **self.to_contents(), "contents_hash": ""}
        text = json.dumps(contents, indent=1, ensure_ascii=False) + "\n"
        return _with_hash(text, "", sha256(text.encode()))

    def to_contents(self) -> dict[str, Any]:
        """The fields as values of JSON, without a reference's data."""
        contents = asdict(self)
        del contents["simulation"]["command"]
        for item in _scaled_records(contents):
            for key, usual in (("scale", SI), ("truth", "")):  # written only if they say something
                if item.get(key) == usual:
                    del item[key]
        return contents

    def without_kernels(self) -> Manifest:
        """The same model without what only its kernels need, for the record of a run."""
        kept = tuple(item for item in self.functions if item.name == "holds")  # tells whether a kink can hold
        return replace(self, functions=kept, guards={}, partials=(), files={})

    @classmethod
    def from_json(cls, text: str, where: str) -> Manifest:
        """Read the file's text.

        Args:
            text: as :meth:`to_json` wrote it.
            where: the file's path, for messages.

        Raises:
            StaleError: for text that is not JSON, or was edited by hand.
            OtherVersionError: for the fields of another version.
        """
        try:
            contents = json.loads(text)
            recorded = str(contents.pop("contents_hash"))
        except (ValueError, KeyError, AttributeError, TypeError):
            raise StaleError("is not a generated model", where=where, remedy=_REMEDY) from None
        if sha256(_with_hash(text, recorded, "").encode()) != recorded:
            raise StaleError(
                "was edited by hand", where=where, remedy=f"{_REMEDY}; edit the model file instead"
            )
        if contents.pop("schema") == SCHEMA and contents.keys() == {field.name for field in fields(cls)}:
            with suppress(TypeError, KeyError):  # records inside with other fields
                return cls.from_contents(contents)
        raise OtherVersionError("was written by another version", where=where, remedy=_REMEDY)

    @classmethod
    def from_contents(cls, contents: dict[str, Any]) -> Manifest:
        """Rebuild a manifest from `to_contents`; raises `TypeError` or `KeyError` for other fields."""
        records = {"states": Variable, "signals": Variable, "parameters": Parameter}
        for key, record in records.items():
            contents[key] = tuple(record(**item) for item in contents[key])
        contents["rules"] = tuple(Rule(**_with_tuples(item, "terms")) for item in contents["rules"])
        variables = tuple(Variable(**item) for item in contents["start"].pop("variables"))
        contents["start"] = Start(variables, **_with_tuples(contents["start"], "terms", "guesses"))
        contents["functions"] = tuple(_function(item) for item in contents["functions"])
        contents["blocks"] = {key: tuple(value) for key, value in contents["blocks"].items()}
        contents = _with_tuples(contents, "partials", "kinks", "chosen", "linear")
        guards = contents["guards"].items()
        contents["guards"] = {key: GuardRule(**_with_tuples(item, "inside")) for key, item in guards}
        contents["simulation"] = Simulation(**_with_tuples(contents["simulation"], "x0", "disturbance"))
        return cls(**{field.name: contents[field.name] for field in fields(cls)})

    @classmethod
    def read(cls, folder: Path) -> Manifest:
        """Read ``model.json`` of a generated folder.

        Raises:
            StaleError: when it is missing, unreadable or edited by hand.
        """
        path = folder / FILE_NAME
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise StaleError("is missing or unreadable", where=str(path), remedy=_REMEDY) from None
        return cls.from_json(text, str(path))


def _scaled_records(contents: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The records that have a scale."""
    for key in ("parameters", "states", "signals"):
        yield from contents[key]
    yield from contents["start"]["variables"]


def _with_hash(text: str, old: str, new: str) -> str:
    """The file with another hash; quotes in strings are escaped, so only the key itself matches."""
    return text.replace(f'"contents_hash": "{old}"', f'"contents_hash": "{new}"')


def _with_tuples(item: dict[str, Any], *keys: str) -> dict[str, Any]:
    """An object of JSON with tuples for its lists."""
    return {**item, **{key: tuple(item[key]) for key in keys}}


def _function(item: dict[str, Any]) -> Function:
    blocks = {
        side: tuple((str(label), int(size)) for label, size in item[side]) for side in ("inputs", "outputs")
    }
    return Function(**{**item, **blocks})
