"""All that a report says of one model, gathered before anything is written.

What cannot be had, because an extra or a compiler is not there, is an `Absent` with the reason.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmjoint_codegen import __version__
from pmjoint_codegen.check.gates.proof import design_values, no_certificate, unfit_gains
from pmjoint_codegen.check.oracles.certificate import Certificate, certify
from pmjoint_codegen.check.oracles.truth import decay
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.dossier.gates import Checked, checked
from pmjoint_codegen.dossier.region import Map, draw_region
from pmjoint_codegen.errors import PmjointError
from pmjoint_codegen.export.package import TRACE, export_c
from pmjoint_codegen.export.source import Identity as Exported
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.margins import Margins
from pmjoint_codegen.provision import Provided, provide
from pmjoint_codegen.simulate.estimates import FrozenError, frozen_error, frozen_parameters, is_frozen
from pmjoint_codegen.simulate.pace import LIMIT, paces
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.sheets import transient_window
from pmjoint_codegen.workspace import find_model, is_stream
from pmjoint_derive import Derivation
from pmjoint_derive.closed_loop import disturbance_bound, output_disturbance
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.equation import Equation, Identity
from pmjoint_derive.progress import Stage, unwatched

CERTIFICATE = "Certificate"  # section of the equations that the proof shows
_DETAIL_ROWS = 400  # of the saturated transient's figure
Notify = Callable[[str], None]


@dataclass(frozen=True)
class Absent:
    """Something that is not there.

    Attributes:
        reason: why, and what brings it, in one line.
    """

    reason: str


@dataclass(frozen=True)
class Decay:
    """What ``V' <= -f V + Y`` says of a design with estimates.

    Attributes:
        f: rate, 1/s.
        Y: what disturbance and wrong priors add at most; None without a bound of the disturbance.
    """

    f: float
    Y: float | None


@dataclass(frozen=True)
class Traced:
    """The exported controller and where its terms are.

    Attributes:
        file: name of the C file.
        lines: its text, by line.
        entries: of ``trace.json``.
    """

    file: str
    lines: tuple[str, ...]
    entries: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class Pace:
    """The law over the sample time of the model.

    Attributes:
        sample_time: s.
        turn: the fastest rate times the sample time.
        limit: where a warning begins.
    """

    sample_time: float
    turn: float
    limit: float = LIMIT


@dataclass(frozen=True)
class Facts:
    """One model.

    Attributes:
        called: the model on a command line.
        text: of the model file, or nothing if it came from a pipe.
        subject: model and derivation.
        provided: its kernels.
        equations: of the derivation and the certificate, in order.
        identities: that the proof rests on, recomputed.
        certificate: at the gains of the model.
        checks: results of the gates.
        run: the default run.
        transient: its saturated beginning on a finer grid of instants, if there is one.
        frozen: the error of the same run without adaptation, of an adaptive controller that adapts.
        sampled: the same with a sampled controller at the model's sample time.
        pace: of the law at that sample time.
        margins: at the model's reference at t = 0.
        region: from where the loop recovers.
        trace: of the exported controller.
        origin: revision and commit in words, if the model is not as in the working tree.
    """

    called: str
    text: str
    subject: Subject
    provided: Provided
    equations: tuple[Equation, ...]
    identities: tuple[Identity, ...]
    certificate: Certificate | Decay | Absent
    checks: Checked
    run: Run | Absent
    transient: Run | None
    frozen: FrozenError | Absent | None
    sampled: Run | Absent
    pace: Pace
    margins: Margins | Absent
    region: Map | Absent
    trace: Traced | Absent
    origin: str = ""

    @property
    def derivation(self) -> Derivation:
        """The derivation."""
        return self.subject.derivation

    @property
    def manifest(self) -> Manifest:
        """The manifest of the kernels."""
        return self.provided.manifest


def gather(
    model: str | Path,
    *,
    environment: Mapping[str, str],
    notify: Notify,
    stage: Stage = unwatched,
    recorded: Path | None = None,
    full: bool = False,
    called: str = "",
    origin: str = "",
    compared: bool = False,
) -> Facts:
    """Derive a model, check it, run it.

    Args:
        model: name or path.
        environment: for compiler and cache folder.
        notify: called with one line for the user.
        stage: called with the name of a slow stage.
        recorded: a JUnit file of ``pmjoint check`` for the gates that are not run here.
        full: run every gate here.
        called: the model in words, if it is not as asked.
        origin: revision and commit in words, if the model is not as in the working tree.
        compared: whether the page is about the differences from another model, which has no chapters on gates
            and region: neither is made.

    Raises:
        ModelError: the model cannot be found, read or derived.
        MissingToolError: the toolchain is not installed.
        UsageError: the file of recorded results cannot be read.
    """
    path = find_model(model)
    text = "" if is_stream(path) else path.read_text(encoding="utf-8")
    subject = load_subject(path, environment, notify, stage)
    derivation = subject.derivation
    stage("certificate", 0.0)
    equations = (*derivation.equations.values(), *derivation.design.certificate(derivation))
    identities = (*derivation.design.prove(derivation), *consistency_identities(derivation))
    checks = Checked((), "", "")
    if not compared:
        checks = checked(subject, recorded=recorded, full=full, stage=stage)
    stage("simulating", 0.0)
    provided = provide(path, environment=environment, notify=notify, stage=stage)
    loop = ClosedLoop.load(path, environment=environment, notify=notify, stage=stage)
    run = _run(loop)
    region: Map | Absent = Absent("is no part of a comparison")
    if not compared:
        stage("mapping the region", 0.0)
        region = _region(subject, environment, notify, run)
    return Facts(
        called=called or str(model),
        text=text,
        subject=subject,
        provided=provided,
        equations=equations,
        identities=identities,
        certificate=_certificate(derivation, equations),
        checks=checks,
        run=run,
        transient=_transient(loop, run),
        frozen=_frozen(loop, run),
        sampled=_run(loop, controller="sampled"),
        pace=_pace(loop.manifest),
        margins=_margins(loop),
        region=region,
        trace=_trace(derivation, loop.manifest),
        origin=origin,
    )


def _certificate(derivation: Derivation, equations: tuple[Equation, ...]) -> Certificate | Decay | Absent:
    if not derivation.design.certifies:
        return Absent("the law comes without a certificate")
    values = design_values(derivation)
    faults = unfit_gains(derivation, values)
    if faults:
        return Absent(f"no certificate at these gains: {'; '.join(faults)}")
    if not derivation.design.decays:
        return _decay(derivation, values, {item.name for item in equations if item.section == CERTIFICATE})
    return certify(derivation, values, derivation.model.disturbance_bound)


def _decay(derivation: Derivation, values: Mapping[str, float], stated: set[str]) -> Decay | Absent:
    """Rate and residual of a design with estimates, where the derivation states them."""
    reason = no_certificate(derivation)
    if reason:
        return Absent(reason)
    if "f" not in stated:
        return Absent(
            "V does not rise where disturbance and leakage are 0; it has a rate f only with leakage and "
            "without ranges"
        )
    bound = disturbance_bound(derivation.model, derivation.design)
    disturbs_y = output_disturbance(derivation.design) != 0
    f, Y = decay(derivation.model, values, bound or 0.0, disturbs_y=disturbs_y)
    return Decay(f, None if bound is None else Y)


def _run(loop: ClosedLoop, **asked: Any) -> Run | Absent:
    try:
        return loop.simulate(**asked)
    except PmjointError as error:
        return Absent(str(error))


def _transient(loop: ClosedLoop, run: Run | Absent) -> Run | None:
    window = None if isinstance(run, Absent) else transient_window(run)
    if window is None or isinstance(run, Absent):
        return None
    step = min(window / _DETAIL_ROWS, run.settings.output_step)
    return loop.simulate(horizon=window, output_step=step)


def _frozen(loop: ClosedLoop, run: Run | Absent) -> FrozenError | Absent | None:
    if isinstance(run, Absent) or is_frozen(run):
        return None
    frozen = _run(loop, parameters=frozen_parameters(run.manifest))
    return frozen if isinstance(frozen, Absent) else frozen_error(frozen)


def _pace(manifest: Manifest) -> Pace:
    import numpy as np

    values = {item.name: np.array([item.value]) for item in manifest.parameters}
    period = manifest.simulation.sample_time
    return Pace(period, float(paces(manifest, values, np.array([period]))[0]))


def _margins(loop: ClosedLoop) -> Margins | Absent:
    try:
        return loop.margins()
    except PmjointError as error:
        return Absent(str(error))


def _region(
    subject: Subject, environment: Mapping[str, str], notify: Notify, run: Run | Absent
) -> Map | Absent:
    missing = [name for name in ("xarray", "zarr") if importlib.util.find_spec(name) is None]
    if missing:
        from pmjoint_codegen.errors import installing

        return Absent(f"needs {missing[0]}; install it: {installing('pmjoint-codegen[sweep]')}")
    if isinstance(run, Absent):
        return Absent("the default run failed")
    try:
        return draw_region(subject.file, run, environment, notify)
    except PmjointError as error:
        return Absent(str(error))


def _trace(derivation: Derivation, manifest: Manifest) -> Traced | Absent:
    import json

    try:
        made = export_c(derivation, Exported(manifest.name, manifest.model_hash, __version__))
    except PmjointError as error:
        return Absent(str(error))
    file = f"{made.identity.prefix}.c"
    return Traced(file, tuple(made.source.splitlines()), tuple(json.loads(made.files[TRACE])))
