"""A notebook of docs/notebooks/ as a page: executed, with what its cells print and draw."""

from __future__ import annotations

from pathlib import Path


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
    NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": script.parent}}
    ).execute()
    text, resources = MarkdownExporter().from_notebook_node(
        notebook, resources={"unique_key": script.stem, "output_files_dir": f"{script.stem}-figures"}
    )
    return text, dict(resources["outputs"])
