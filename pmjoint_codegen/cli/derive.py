"""``pmjoint derive``: the derivation of a model, equation by equation."""

from __future__ import annotations

import click

from pmjoint_codegen.cli.options import ModelName
from pmjoint_codegen.cli.terminal import activity, document, result

FORMATS = ("text", "latex", "markdown", "json")


_ABOUT = """Print the derivation of MODEL, equation by equation.

The derivation leads from the plant to the filters, the compensator, each error, virtual control and partial
derivative, the law v, and the Lyapunov function V with its rate. Each named step has its number in the
paper, its meaning and its unit.
"""

_EXAMPLES = """\b
Examples
  pmjoint derive paper
  pmjoint derive paper --format latex > derivation.tex && pdflatex derivation
  pmjoint derive paper --format json | jq '.equations[] | select(.name == "v")'
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="text can be pasted into code; latex is a whole document (article, amsmath); markdown renders on "
    "GitHub and GitLab; json is one document.",
)
def command(model: str, form: str) -> None:
    """Run ``pmjoint derive``: click passes the parsed arguments."""
    with activity(f"deriving {model}") as shown:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen.modelfile import model_of
        from pmjoint_codegen.modelfile.reader import read_document
        from pmjoint_codegen.report.latex import latex_report
        from pmjoint_codegen.report.markdown import markdown_report
        from pmjoint_codegen.report.record import derivation_record
        from pmjoint_codegen.report.text import text_report
        from pmjoint_codegen.workspace import find_model
        from pmjoint_derive import derive

        path = find_model(model)
        shown.stage("reading the model", 0.0)
        source = model_of(read_document(path), str(path))
        derivation = derive(source, shown.stage)
        shown.stage("certificate", 0.0)
        equations = (*derivation.equations.values(), *derivation.design.certificate(derivation))
    if form == "json":
        document(derivation_record(source, equations))
    else:
        write = {"text": text_report, "latex": latex_report, "markdown": markdown_report}[form]
        result(write(source, equations))
