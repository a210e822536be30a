"""Names of the adaptive design as a reader writes them, in LaTeX and in MathML."""

from __future__ import annotations

import re

import pytest
import sympy as sp

from pmjoint_codegen.report.mathml_names import symbol
from pmjoint_codegen.report.notation import latex_expression, latex_name, latex_prose
from pmjoint_derive import real_symbol

a, x, BAND = map(real_symbol, ("a", "x", "band"))
NAMES = {
    "alpha_bar": (r"\bar{\alpha}", "α¯"),
    "omega_b0": (r"\omega_{b_0}", "ωb0"),
    "omega1_d1": (r"\omega_{1,d_1}", "ω1,d1"),
    "Gamma_b0": (r"\Gamma_{b_0}", "Γb0"),
    "Gamma_b0_start": (r"\Gamma_{b_0}(0)", "Γb0(0)"),
    "gamma_w": (r"\gamma_{w}", "γw"),
    "gamma_rho": (r"\gamma_\varrho", "γϱ"),
    "tau_d1": (r"\tau_{d_1}", "τd1"),
    "tau_plant": (r"\tau_{\mathrm{plant}}", "τplant"),
    "pull_b0": (r"\mathrm{pull}_{b_0}", "pullb0"),
    "zeta2": (r"\zeta_2", "ζ2"),
    "chi1_dot": (r"\dot{\chi}_1", "χ˙1"),
    "b0_hat": (r"\hat{b}_0", "b^0"),
    "b0_hat_dot": (r"\dot{\hat{b}}_0", "b^˙0"),
    "b0_hat_next": (r"\hat{b}_{0,\mathrm{next}}", "b^0,next"),
    "w_hat_next": (r"\hat{w}_{\mathrm{next}}", "w^next"),
    "b0_logit": (r"\ell_{b_0}", "ℓb0"),
    "b0_logit_dot": (r"\dot{\ell}_{b_0}", "ℓ˙b0"),
    "b0_logit_next": (r"\ell_{b_0,\mathrm{next}}", "ℓb0,next"),
    "b0_turn": (r"T_{b_0}", "Tb0"),
    "b0_logit_start": (r"\ell_{b_0}(0)", "ℓb0(0)"),
    "b0_low": (r"\underline{b}_0", "b_0"),
    "d1_high": (r"\overline{d}_1", "d¯1"),
    "rho_hat": (r"\hat{\varrho}", "ϱ^"),
    "rho_hat_dot": (r"\dot{\hat{\varrho}}", "ϱ^˙"),
    "V_Theta": (r"V_{\Theta}", "VΘ"),
    "leakage": (r"\sigma_\Theta", "σΘ"),
    "dGamma_w_dw_hat": (r"\frac{\partial \Gamma_{w}}{\partial \hat{w}}", "∂Γw∂w^"),
    "dGamma_d1_dd1_hat": (r"\frac{\partial \Gamma_{d_1}}{\partial \hat{d}_1}", "∂Γd1∂d^1"),
    "pull_rho": (r"\mathrm{pull}_\varrho", "pullϱ"),
    "prediction_error": (r"\epsilon_y", "ϵy"),
    "prediction_norm": (r"\nu_\omega", "νω"),
    "observer": (r"\omega_o", "ωo"),
    "eso1": (r"\hat{\eta}_1", "η^1"),
    "eso2_dot": (r"\dot{\hat{\eta}}_2", "η^˙2"),
    "eso3_next": (r"\hat{\eta}_{3,\mathrm{next}}", "η^3,next"),
    "dalpha1_db0_hat": (r"\frac{\partial \alpha_1}{\partial \hat{b}_0}", "∂α1∂b^0"),
}


@pytest.mark.parametrize("name", list(NAMES))
def test_names_are_written_alike_in_both(name: str) -> None:
    latex, printed = NAMES[name]
    assert latex_name(name) == latex
    assert re.sub(r"<[^>]*>", "", symbol(name)) == printed


def test_remarks_keep_their_words() -> None:
    assert latex_prose("what moves b0_hat: tau and leakage") == r"what moves $\hat{b}_0$: $\tau$ and leakage"
    assert latex_prose("with the reference's rate") == "with the reference's rate"


@pytest.mark.parametrize(
    ("expression", "latex"),
    [
        (a * BAND, r"a\, \mathrm{band}"),
        (real_symbol("Gr_11") * real_symbol("chi1"), r"\mathrm{Gr}_{11}\, \chi_1"),
        (a * real_symbol("b0_plant") * x, r"a b_{0,\mathrm{plant}} x"),
        (BAND - a, r"\mathrm{band} - a"),
    ],
)
def test_words_stand_apart_from_their_factors(expression: sp.Expr, latex: str) -> None:
    assert latex_expression(expression) == latex
