"""Which kernels serve a model: the committed ones if current, else kernels derived into the cache.

The common case needs neither SymPy nor CasADi: two hashes are compared, and ``generated/<name>/`` is used
as it is. A model is rederived if its file differs from what ``generated/`` was made from, or if the command
line gives another reference or disturbance. This module never writes ``generated/``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from pmjoint_codegen import __version__
from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import (
    MissingToolError,
    ModelError,
    StaleError,
    UsageError,
    installing,
    quoted,
)
from pmjoint_codegen.identity import canonical_hash, model_hash
from pmjoint_codegen.manifest import LANES, Manifest
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.reference.reader import read_command
from pmjoint_codegen.reference.segments import make_segments
from pmjoint_codegen.storage import drop_link, replace_folder, sha256_file
from pmjoint_codegen.values import BRAKING, CLIP, COMPENSATOR, SATURATIONS, check_rules
from pmjoint_codegen.workspace import cache_dir, called, find_model, generated_root

SHAPING: Final = (
    "modelfile",
    "emit",
    "report",
    "kernels",
    "loops",
    "reference",
)  # folders of what `generate` imports

Notify = Callable[[str], None]
Stage = Callable[[str, float], None]  # name, part done
Reference = str | Mapping[str, Any] | None  # an expression, or data as in a model file


@dataclass(frozen=True)
class Provided:
    """Kernels for one model.

    Attributes:
        manifest: what the kernels are.
        folder: where ``kernels.c``, ``kernels.h`` and ``kernels.tape`` stand.
    """

    manifest: Manifest
    folder: Path

    __repr__ = brief


@dataclass(frozen=True)
class Source:
    """What a closed loop is loaded from; a copy in another process is made from it.

    Attributes:
        file: the model file, an absolute path.
        document: its contents, read once: the file may have changed since, or been a pipe.
        evaluator, reference, disturbance, saturation: as for `ClosedLoop.load`.
        environment: for compiler and cache folder; None: that of the loading process.
    """

    file: Path
    document: Mapping[str, Any]
    evaluator: str | None = None
    reference: Reference = None
    disturbance: tuple[str, ...] | None = None
    saturation: str | None = None
    environment: Mapping[str, str] | None = None

    __repr__ = brief

    @classmethod
    def of(cls, model: str | Path) -> Source:
        """Find and read a model file; raises `ModelError`."""
        path = find_model(model)
        return cls(path.absolute(), read_document(path))


def provide(
    model: str | Path,
    *,
    reference: Reference = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    environment: Mapping[str, str],
    notify: Notify,
    stage: Stage = lambda name, done: None,
    lanes: bool = False,
) -> Provided:
    """Find or make the kernels of a model.

    Args:
        model: name or path.
        reference: another y_r, a function of t and parameters; or data, as in a model file.
        disturbance: another disturbance, one expression per state.
        saturation: ``compensator``, ``clip`` or ``braking`` in place of the model's own.
        environment: for the cache folder.
        notify: called with one line about slow work or a fact that the user should know.
        stage: called with the stage of a derivation, if there is one.
        lanes: whether a sweep needs its own C, ``lanes.c``; a single run does without.

    Raises:
        ModelError: for a model that cannot be found, read or derived; an error in an override names the
            option.
        StaleError: when a committed file was edited by hand.
        MissingToolError: when something must be derived and the toolchain is not installed.
    """
    path = find_model(model)
    return provide_document(
        path,
        read_document(path),
        reference=reference,
        disturbance=disturbance,
        saturation=saturation,
        environment=environment,
        notify=notify,
        stage=stage,
        lanes=lanes,
    )


def provide_document(
    path: Path,
    document: Mapping[str, Any],
    *,
    reference: Reference = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    environment: Mapping[str, str],
    notify: Notify,
    stage: Stage = lambda name, done: None,
    lanes: bool = False,
) -> Provided:
    """`provide` for a model file that has been read: a pipe can be read only once.

    Args:
        path: of the file; the generated folder is searched for from there.
        document: its contents.
        reference: as for `provide`, as are the errors.
        disturbance: the same.
        saturation: the same.
        environment: the same.
        notify: the same.
        stage: the same.
        lanes: the same.
    """
    joint = document.get("joint")
    for name, line in joint.items() if isinstance(joint, dict) else ():
        if (
            isinstance(line, dict) and "value" in line and "unit" not in line and name != "eps0"
        ):  # no dimension
            notify(f"{path}: joint.{name} has no unit: {line['value']} is taken in SI units")
    redesigned = _redesigned(document, saturation)
    changed = _changed(redesigned, reference, disturbance)
    same = model_hash(changed) == model_hash(document)
    found = _committed(path, document, notify) if same else None
    if found is None:
        try:
            found = _derived(path, changed, environment, notify, stage, lanes=lanes)
        except ModelError as error:
            raise _of_option(error, reference, disturbance, saturation) from error
    manifest = with_data(found.manifest, changed, path, own=reference is None)
    return _switched(replace(found, manifest=manifest), saturation)


def _redesigned(document: Mapping[str, Any], saturation: str | None) -> Mapping[str, Any]:
    """The model with another compensator, if it takes another derivation: plain clipping is only a switch.

    Raises:
        UsageError: an unknown kind of saturation.
    """
    if saturation not in (None, *SATURATIONS):
        raise UsageError(
            f"is {saturation!r}", where="saturation", remedy=f"allowed: {', '.join(SATURATIONS)}"
        )
    design = document.get("design")
    if saturation in (None, CLIP) or not isinstance(design, dict):
        return document
    if (saturation == BRAKING) == (design.get("saturation") == BRAKING):
        return document
    kept = {key: value for key, value in design.items() if key not in (COMPENSATOR, BRAKING)}
    return {**document, "design": {**kept, "saturation": saturation}}


def _switched(provided: Provided, saturation: str | None) -> Provided:
    """The kernels with the compensator's switch on or off by default, as asked for."""
    if saturation is None:
        return provided
    manifest, on = provided.manifest, saturation != CLIP
    check_rules(
        {COMPENSATOR: float(on)},
        [rule for rule in manifest.rules if rule.names == {COMPENSATOR}],
        error=UsageError,
        key=lambda name: "saturation",
    )
    parameters = tuple(
        replace(item, value=float(on)) if item.name == COMPENSATOR else item for item in manifest.parameters
    )
    simulation = replace(manifest.simulation, compensator=on)
    return replace(provided, manifest=replace(manifest, parameters=parameters, simulation=simulation))


def with_data(manifest: Manifest, document: Mapping[str, Any], path: Path, *, own: bool = True) -> Manifest:
    """The manifest of a model with the data of its reference, if it is data.

    Args:
        manifest: as it was generated.
        document: of the model.
        path: of its file; names of other files are relative to its folder.
        own: whether the reference is the file's own, not an option's.

    Raises:
        ModelError: data of the file that cannot be read.
        UsageError: data of an option.
    """
    spec = document.get("simulation", {}).get("reference")
    if not isinstance(spec, Mapping):
        return manifest
    unit = next(item.unit for item in manifest.signals if item.name == "y_r")
    if not own:
        return manifest.with_command(read_command(spec, folder=Path(), unit=unit, where="--reference"))
    try:
        place = f"{path}: simulation.reference"
        command = read_command(spec, folder=path.parent, unit=unit, where=place)
        make_segments(command, manifest.rho)
    except UsageError as error:
        raise ModelError(error.what, where=error.where, remedy=error.remedy) from None
    return manifest.with_command(command)


def _committed(path: Path, document: Mapping[str, Any], notify: Notify) -> Provided | None:
    name = document.get("name")
    folder = generated_root(path) / str(name)
    if not isinstance(name, str) or not folder.is_dir():
        return None
    manifest = Manifest.read(folder)
    if manifest.model_hash != model_hash(document):
        notify(
            f"{path} differs from what {folder} was made from; deriving it again, into the cache "
            f"(`pmjoint regenerate {called(path)}` makes it permanent)"
        )
        return None
    for file, recorded in manifest.files.items():
        if _altered(folder / file, recorded):
            raise StaleError(
                "was edited by hand or is missing",
                where=str(folder / file),
                remedy=f"run pmjoint regenerate {called(path)}",
            )
    return Provided(manifest, folder)


def _altered(file: Path, recorded: str) -> bool:
    """Whether a generated file is missing or altered."""
    return not file.is_file() or sha256_file(file) != recorded


def _changed(
    document: Mapping[str, Any], reference: Reference, disturbance: Sequence[str] | None
) -> dict[str, Any]:
    changed = {key: dict(value) if isinstance(value, dict) else value for key, value in document.items()}
    _check_text("--reference", [reference] if isinstance(reference, str) else [])
    _check_text("--disturbance", disturbance or [])
    if reference is not None:
        changed["simulation"] = {**changed.get("simulation", {}), "reference": reference}
    if disturbance is not None:
        changed |= _disturbed(changed, disturbance)
    return changed


def _check_text(option: str, expressions: Sequence[str]) -> None:
    """Refuse bytes that are not UTF-8: Python turns them into surrogates, which cannot be written."""
    for text in expressions:
        if any("\ud800" <= character <= "\udfff" for character in text):
            raise ModelError(f"{quoted(text)} is not UTF-8", where=option, remedy="allowed: an expression")


def _of_option(
    error: ModelError, reference: Reference, disturbance: Sequence[str] | None, saturation: str | None
) -> ModelError:
    """The error in an expression that overrides the file's, with the option as its place."""
    options: Mapping[str, tuple[str, object]] = {
        "simulation.reference": ("--reference", reference),
        "plant.disturbance": ("--disturbance", disturbance),
        "joint.disturbance": ("--disturbance", disturbance),
        "system.disturbance": ("--disturbance", disturbance),
        "design.saturation": ("--saturation", saturation),
    }
    place = error.where.rpartition(": ")[2]
    key, comma, detail = place.partition(",")
    option, given = options.get(key, ("", None))
    if given is None:
        return error
    one = given == disturbance and len(disturbance or ()) == 1  # which a joint's plant has in several entries
    return ModelError(error.what, where=option if one else f"{option}{comma}{detail}", remedy=error.remedy)


def _disturbed(document: Mapping[str, Any], disturbance: Sequence[str]) -> dict[str, Any]:
    """The physics of a model under another disturbance: one expression per state, or a joint's torque."""
    if "system" in document:
        return {"system": {**document["system"], "disturbance": list(disturbance)}}
    if "joint" not in document:
        return {"plant": {**document.get("plant", {}), "disturbance": list(disturbance)}}
    if len(disturbance) != 1:
        raise UsageError(
            f"has {len(disturbance)} expressions",
            where="--disturbance",
            remedy="a joint has one disturbance: the torque in N m",
        )
    return {"joint": {**document["joint"], "disturbance": disturbance[0]}}


def _derived(
    path: Path,
    document: dict[str, Any],
    environment: Mapping[str, str],
    notify: Notify,
    stage: Stage,
    *,
    lanes: bool,
) -> Provided:
    key = canonical_hash([model_hash(document), _toolchain_key()])
    folder = cache_dir(environment, notify) / "models" / key[:32]
    drop_link(folder)
    with suppress(StaleError):  # not there yet
        manifest = Manifest.read(folder)
        whole = not any(_altered(folder / file, recorded) for file, recorded in manifest.files.items())
        if whole and (LANES in manifest.files or not lanes):
            return Provided(manifest, folder)
    stage("loading the toolchain", 0.0)
    try:
        from pmjoint_codegen.emit.pipeline import generate
        from pmjoint_codegen.modelfile import model_of
    except ModuleNotFoundError as error:
        raise MissingToolError(
            f"{error.name} is needed to derive a changed model",
            where=str(path),
            remedy=f"install it: {installing('pmjoint-codegen[derive]')}",
        ) from None
    stage("reading the model", 0.0)
    artifacts = generate(document, model_of(document, str(path)), stage=stage, lanes=lanes)
    replace_folder(folder, {name: text.encode() for name, text in artifacts.files.items()}, private=True)
    return Provided(artifacts.manifest, folder)


def _toolchain_key() -> str:
    """A text that changes whenever the tools or sources that shape generated text change."""
    from importlib import metadata  # slow to import, and needed for a derivation only

    package = Path(__file__).resolve().parent
    derivation = package.parent / "pmjoint_derive"
    folders = (derivation, package, *(package / name for name in SHAPING))
    sources = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    versions = [__version__, metadata.version("sympy"), metadata.version("casadi")]
    return canonical_hash([versions, [sha256_file(path) for path in sources]])
