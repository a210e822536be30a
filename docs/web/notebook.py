"""A notebook of docs/notebooks/ as a page: executed, with what its cells print and draw."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

FIGURES: Final = "module://matplotlib_inline.backend_inline"  # whatever backend the shell asks for
CELL_S: Final = 120  # longest time of a cell


def executed(script: Path) -> tuple[str, dict[str, bytes]]:
    """Run a notebook.

    Args:
        script: the notebook as jupytext keeps it, a Python file in cells.

    Returns:
        the page in Markdown, and its figures by name.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    import jupytext
    from nbclient import NotebookClient
    from nbconvert import MarkdownExporter

    notebook = jupytext.read(script)
    where = {"metadata": {"path": str(script.parent)}}
    quiet = ["--log-level=ERROR"]  # it warns of its port, which is this machine's own
    client = NotebookClient(
        notebook, kernel_name="python3", timeout=CELL_S, resources=where, extra_arguments=quiet
    )
    client.execute(env={**os.environ, "MPLBACKEND": FIGURES})
    names = {"unique_key": script.stem, "output_files_dir": f"{script.stem}-figures"}
    text, resources = MarkdownExporter().from_notebook_node(notebook, resources=names)
    return text, dict(resources["outputs"])
