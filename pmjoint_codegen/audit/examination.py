"""The driver: every display and claim, in the paper's order.

context          model file "paper" -> derivation, beside the printed equations
experiments      generated kernels  -> the runs that claims are tested with
EXAMINATIONS     context, experiments -> one finding each
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pmjoint_codegen.audit import claims, designing, filtering, future, modelling, stability
from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.findings import Finding
from pmjoint_codegen.audit.paper import Printed, printed_equations
from pmjoint_codegen.audit.runs import ExperimentRunner, Notify, experiments
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.workspace import find_model
from pmjoint_derive import derive

Progress = Callable[[float], None]

COMPARISONS = (
    modelling.torque_balance,
    modelling.muscle_forces,
    modelling.contraction_rates,
    modelling.pressures,
    modelling.equation_of_motion_printed,
    modelling.damping_moved,
    modelling.states,
    modelling.system_model,
    modelling.constants,
    modelling.disturbance_bound,
    modelling.saturation,
    modelling.saturated_system,
    filtering.system_in_matrices,
    filtering.matrices,
    filtering.filters,
    filtering.lyapunov_equation,
    filtering.state_estimate,
    filtering.estimate_rate,
    filtering.estimation_error,
    filtering.error_dynamics,
    filtering.error_function,
    filtering.error_function_rate,
    filtering.output_rate,
    filtering.regressors,
    filtering.input_filter_entries,
    designing.auxiliary_system,
    designing.lost_input,
    designing.errors,
    designing.first_rate,
    designing.virtual_control,
    designing.first_function,
    designing.first_function_rate,
    designing.second_rate,
    designing.control_law,
    stability.lyapunov_function,
    stability.function_rate,
    stability.youngs_inequality,
    stability.function_bound,
    stability.residual,
    stability.comparison,
    stability.decay_constants,
    stability.decay,
    stability.value_bound,
    modelling.simulated_system,
    modelling.simulated_disturbance,
)

TRIALS = (
    claims.bounded_disturbance,
    claims.smooth_reference,
    claims.adaptive_title,
    claims.unknown_saturation,
    claims.error_boundedness,
    claims.all_signals_bounded,
    claims.example_numbers,
    claims.compensation,
    claims.one_name_two_meanings,
    future.future_work,
)


def paper_context(paper: Mapping[str, Printed] | None = None) -> Context:
    """The printed equations beside the derivation of the model ``paper``.

    Args:
        paper: other printed equations, for tests of the audit itself.

    Raises:
        ModelError: the model file is missing or wrong.
    """
    path = find_model("paper")
    model = model_of(read_document(path), str(path))
    return Context(printed_equations() if paper is None else paper, derive(model))


def audit(progress: Progress, notify: Notify) -> tuple[Finding, ...]:
    """Compare and try everything.

    Args:
        progress: called with the fraction completed, 0 to 1.
        notify: called with one line that the user should know.

    Raises:
        PmjointError: the model cannot be read, or its kernels cannot be built.
    """
    context = paper_context()
    made = experiments(ExperimentRunner(_once(notify)), context.derivation.model.disturbance_bound or 0.0)
    found: list[Finding] = []
    total = len(COMPARISONS) + len(TRIALS)
    for compare in COMPARISONS:
        found.append(compare(context))
        progress(len(found) / total)
    for attempt in TRIALS:
        found.append(attempt(context, made))
        progress(len(found) / total)
    places = {number: place for place, number in enumerate(context.paper)}
    return tuple(sorted(found, key=lambda finding: places.get(finding.number, len(places))))


def _once(notify: Notify) -> Notify:
    """The same listener, called once with each line: three loops are loaded, on one machine."""
    said: set[str] = set()

    def tell(line: str) -> None:
        if line not in said:
            said.add(line)
            notify(line)

    return tell
