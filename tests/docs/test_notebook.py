"""docs/notebooks/first-steps.py runs as a notebook: no cell fails or warns, and results show themselves."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

import pmjoint_codegen
from pmjoint_codegen.compile.compiler import find_compiler

jupytext = pytest.importorskip("jupytext")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("casadi")
pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps need a compiler")

SCRIPT = Path(__file__).resolve().parents[2] / "docs" / "notebooks" / "first-steps.py"


def usable(cell: Any) -> bool:
    """Whether this version has what a cell uses."""
    return "compare" in pmjoint_codegen.__all__ or "compar" not in cell.source or cell.cell_type != "code"


def shown(cell: Any) -> dict[str, str]:
    """Give what a cell displays, by type."""
    found: dict[str, str] = {}
    for output in cell.get("outputs", []):
        found |= output.get("data", {})
    return found


def test_the_notebook_runs_and_shows_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR", "MPLCONFIGDIR")
    for name in folders:
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setenv("PYTHONWARNINGS", "default")
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    folder = tmp_path / "jupyter_data_dir" / "kernels" / "python3"
    folder.mkdir(parents=True)
    argv = f'["{sys.executable}", "-m", "ipykernel_launcher", "-f", "{{connection_file}}"]'
    (folder / "kernel.json").write_text(
        f'{{"argv": {argv}, "display_name": "Python 3", "language": "python"}}', encoding="utf-8"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of the notebook's machinery; a cell's own are seen below
        book = jupytext.read(SCRIPT)
        book.cells = [cell for cell in book.cells if usable(cell)]
        client = nbclient.NotebookClient(
            book, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
        )
        client.execute()
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    errors = [out for cell in code for out in cell.outputs if out.output_type in ("error", "stream")]
    assert errors == []
    assert len(code) >= 10
    by_end = {cell.source.splitlines()[-1]: shown(cell) for cell in code}
    assert by_end["loop"]["text/plain"].startswith("<ClosedLoop of paper")
    assert "data:image/png;base64," in by_end["run"]["text/html"]
    assert "reached the horizon, 20 s" in by_end["run"]["text/plain"]
    assert by_end["better"]["text/plain"].startswith("<Tuned paper: ise 9.4")
    assert "xarray" in by_end['data["ise"]']["text/html"]
    pictures = [cell for cell in code if "image/png" in shown(cell)]
    assert len(pictures) >= 2
