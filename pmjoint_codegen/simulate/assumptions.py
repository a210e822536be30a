"""What a run was made with that its source does not say, for captions and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pmjoint_codegen.values import COMPENSATOR

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

_SILENT_SOURCES = (
    "paper",
)  # models whose source states neither the reference nor the horizon of its figures


def source_is_silent(run: Record) -> bool:
    """Say whether reference and horizon are assumptions, since the model's source states neither."""
    return run.manifest.name in _SILENT_SOURCES


def settings_text(run: Record) -> str:
    """Give the reference, the horizon and, for a sampled controller, the sample time."""
    settings = run.settings
    text = f"y_r = {run.manifest.simulation.reference}, horizon {settings.horizon:g} s"
    return f"{text}, sample time {settings.sample_time:g} s" if settings.controller == "sampled" else text


def changes(run: Record) -> tuple[str, ...]:
    """List parameters, gains and initial states that differ from the model file's, such as ``c1 = 20``."""
    manifest, settings = run.manifest, run.settings
    defaults = {item.name: item.value for item in manifest.parameters}
    stated = manifest.stated(settings.parameters)
    found = [
        _said(name, value)
        for name, value in stated.items()
        if value != defaults[name] or name in manifest.own
    ]
    if tuple(settings.x0.tolist()) != manifest.simulation.x0:
        found.append(f"x(0) = ({', '.join(f'{value:g}' for value in settings.x0)})")
    return tuple(found)


def _said(name: str, value: float) -> str:
    if name == COMPENSATOR:
        return f"compensator {'on' if value else 'off'}"
    return f"{name} = {value:g}"


def sentence(run: Record, notes: Sequence[str] = ()) -> str:
    """Say all of it in a sentence or two, for a caption.

    Args:
        run: what is captioned.
        notes: further changes that the run itself does not know to be changes.
    """
    opening = "Assumed, not stated in the paper" if source_is_silent(run) else "Settings"
    changed = [*changes(run), *notes]
    return f"{opening}: {settings_text(run)}." + (f" Changed: {', '.join(changed)}." if changed else "")
