"""The certificate of the adaptive design, as identities whose remainder is exactly zero.

As in `lyapunov`, everything is differentiated along the *true* dynamics: true values of what is estimated,
any input u. With ``eta`` now also by what the estimates are wrong, ``eta = Theta~' omega + epsilon_2 + D_1``,
weights w of `pmjoint_derive.signals.Signals.weights`, and s_i as there:

    d/dt (V_z + V_Theta)  =  -sum c w z^2 - sum e (w s z)^2 - (sum w s z)(epsilon_2 + D_1) + L,        (I)
    V'  =  -sum c w z^2 - sum |epsilon|^2/(4 e) + sum |P D|^2/(2 e) + L - {squares}.

Every entry of Theta that is estimated has its own place in V_Theta: ``Theta~^2/(2 gamma)``, or the distance
that belongs to a gain that vanishes at the ends of a range; its rate is ``-Theta~ pull`` in both, so that the
range costs nothing. Leakage gives

    L  =  leakage/2 sum ((Theta - prior)^2 - Theta~^2 - (Theta_hat - prior)^2)

and the same of ``rho_hat`` with ``|b_m| rho_leakage``; without leakage L = 0. All of this presumes gains that
are greater than 0 or estimates that are right. Least squares moves its estimates by the regression ``y -
xi_1``, whatever the errors do: there V_z' contains ``(sum w s z) Theta~' omega``, which nothing cancels, and
the identifier has a V of its own, ``Theta~' Gamma^-1 Theta~/2``.

Partial derivatives, gains and tuning functions stay names, as free symbols of a sparse polynomial ring
(`sparse`); their definitions are proved or unfolded one by one. What is differentiated is the estimate; that
its logit, which a loop integrates, moves it at that rate is an identity of its own.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.adaptation import (
    LEAKAGE,
    LS_FORGETTING,
    LS_K_MAX,
    LS_KAPPA,
    RHO_HAT,
    RHO_LEAKAGE,
    RHO_PRIOR,
    Adaptation,
    Entry,
)
from pmjoint_derive.adaptive_energy import error_energy, estimate_energy
from pmjoint_derive.closed_loop import disturbance_symbols, unknown_output_rate
from pmjoint_derive.design import Derivation
from pmjoint_derive.equation import Identity, real_symbol
from pmjoint_derive.estimation import omega, omega_1, turn, turn_at
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.least_squares import ERROR, NORM
from pmjoint_derive.lyapunov import (
    certified_rate,
    claimed_rates,
    error_function,
    error_identities,
    error_weight,
    estimation_identities,
    lyapunov_identities,
    partial_identities,
    rate_along,
    sensitivities,
    squares,
)
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix, lyapunov_residual, symmetric_matrix
from pmjoint_derive.signals import derivative_name, partial_name
from pmjoint_derive.sparse import remainder


def prove(derivation: Derivation) -> tuple[Identity, ...]:
    """Every identity that the certificate rests on, recomputed; all hold, or there is no certificate."""
    kept = _kept(derivation)
    identities = [
        *estimation_identities(derivation),
        *partial_identities(derivation, kept, remainder),
        *error_identities(derivation, kept, remainder),
        *logit_identities(derivation),
    ]
    if _adaptation(derivation).least_squares is None:
        identities += [
            *estimate_identities(derivation),
            energy_identity(derivation),
            certificate_identity(derivation),
        ]
    else:
        identities += [energy_identity(derivation), *identifier_identities(derivation)]
    return (*identities, *lyapunov_identities(derivation.signals, named_matrix(derivation)))


def _adaptation(derivation: Derivation) -> Adaptation:
    found = derivation.design.adaptation
    assert found is not None  # of a derivation of this design
    return found


def _kept(derivation: Derivation) -> frozenset[sp.Symbol]:
    """Names that identities of single errors treat as free: gains that move, factors of the regressor."""
    s, equations = derivation.signals, derivation.equations
    adaptation = _adaptation(derivation)
    names = [hat.name for hat in s.estimates]
    names += [f"Gamma_{entry.name}" for entry in adaptation.unknown]
    names += [f"zeta{i}" for i in range(2, len(s.z) + 1)]
    if adaptation.least_squares is not None:  # the law counts on the rates as they are
        names += [derivative_name(hat) for hat in s.estimates]
    return frozenset(real_symbol(name) for name in names if name in equations)


def true_value(derivation: Derivation, entry: Entry) -> sp.Expr:
    """The plant's own value of an entry of Theta."""
    truth = derivation.design.truth
    return (*truth.b, *truth.theta)[entry.place]


def missed(derivation: Derivation, entry: Entry) -> sp.Expr:
    """``Theta~``: what an estimate is wrong by."""
    return true_value(derivation, entry) - entry.estimate


def named_matrix(derivation: Derivation) -> sp.ImmutableMatrix:
    """P as the reported V has it, or as it is solved for where no V is reported."""
    n, equations = derivation.plant.order, derivation.equations
    P = symmetric_matrix(n)
    if P[0, 0].name not in equations:
        return lyapunov_matrix(derivation.signals)
    return sp.ImmutableMatrix(P.applyfunc(lambda entry: equations[entry.name].expression))


def energies(derivation: Derivation) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """``V_z``, ``V_Theta`` and ``V_epsilon`` with P as symbols: the reported ones where there are any."""
    s, equations = derivation.signals, derivation.equations
    if "V" not in equations:
        of_error = error_weight(s) * error_function(s, symmetric_matrix(derivation.plant.order))
        return error_energy(s), estimate_energy(derivation.design, _adaptation(derivation)), of_error
    first, second, third = (equations[name].expression for name in ("V_z", "V_Theta", "V_epsilon"))
    return first, second, third


def state_rates(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """Rates of the states of the estimates, in names."""
    s = derivation.signals
    states = (*s.learnt, *s.inverse)
    return {state: derivation.equations[derivative_name(state)].expression for state in states}


def in_estimate(entry: Entry, slope: sp.Expr) -> sp.Expr:
    """The derivative of V_Theta by the state of an estimate with a range, in the estimate.

    Hyperbolic functions in it are of half the logit itself: the estimate's place between the ends.
    """
    low, high = entry.ends
    for half in {item.args[0] for item in slope.atoms(sp.cosh)}:
        tangent = slope.xreplace({sp.sinh(half): sp.tanh(half) * sp.cosh(half)})
        slope = tangent.xreplace({sp.tanh(half): (2 * entry.estimate - low - high) / (high - low)})
    return slope


def moving_gains(value: sp.Expr) -> sp.Expr:
    """An expression where every gain of an estimate is greater than 0."""
    return value.xreplace({sign: sp.Integer(1) for sign in value.atoms(sp.sign)})


def pulled(derivation: Derivation) -> sp.Expr:
    """``-sum Theta~ pull - |b_m| (1/b_m - rho_hat) pull_rho``: what V_Theta' has to be."""
    adaptation = _adaptation(derivation)
    total = sp.Integer(0)
    for entry in adaptation.unknown:
        total -= missed(derivation, entry) * real_symbol(f"pull_{entry.name}")
    if adaptation.inverse is not None:
        b_m = derivation.design.truth.b[0]
        total -= adaptation.sign * (1 - b_m * RHO_HAT) * real_symbol("pull_rho")
    return total


def estimate_identities(derivation: Derivation) -> list[Identity]:
    """``V_Theta' = -sum Theta~ pull``, estimate by estimate: gains, ranges and their distance agree."""
    _, V_Theta, _ = energies(derivation)
    rates, wanted = state_rates(derivation), pulled(derivation)
    pulls = {symbol for symbol in wanted.free_symbols if symbol.name.startswith("pull_")}
    unknown = _adaptation(derivation).unknown
    found = {entry.state: in_estimate(entry, sp.diff(V_Theta, entry.state)) for entry in unknown}
    found |= {hat: sp.diff(V_Theta, hat) for hat in derivation.signals.inverse}
    estimates = dict(zip(found, (*derivation.signals.estimates, *derivation.signals.inverse), strict=True))
    identities = []
    for state, slope in found.items():
        hat = estimates[state]
        own = real_symbol(f"pull_{hat.name.removesuffix('_hat')}")
        claim = wanted.xreplace(dict.fromkeys(pulls - {own}, sp.Integer(0)))
        kept = _constants(derivation) | {own, hat}
        rest = derivation.equations.expand(moving_gains(slope) * rates[state] - claim, kept)
        claimed = f"{hat} adds -(its error) {own} to V_Theta'"
        identities.append(Identity(f"V_Theta {hat}", claimed, remainder(rest, derivation.plant.sigma)))
    return identities


def logit_identities(derivation: Derivation) -> list[Identity]:
    """Each estimate whose state is its logit is where that says, and moves as the law counts on."""
    equations, found = derivation.equations, []
    for entry in _adaptation(derivation).ranged:
        hat, state, T, (low, high) = entry.estimate, entry.state, turn(entry), entry.ends
        definition = equations[hat.name].expression
        at_guess = (2 * entry.guess_symbol - low - high) / (high - low)
        summed = (T + at_guess) / (1 + T * at_guess)  # tanh of half the logit, that of the guess added
        rest = definition - (low + high + (high - low) * summed) / 2
        claimed = f"{state} is the logit of {hat} in its range, less that of its guess"
        found.append(Identity(str(state), claimed, remainder(rest, sp.Integer(1))))
        turned = equations[T.name].expression
        moved = sp.diff(turned, state).xreplace({turned: T})
        slope = (sp.diff(definition, T) * moved).xreplace({T: turn_at(entry)})
        names = (derivative_name(hat), derivative_name(state))
        claimed_rate, rate = (equations[name].expression for name in names)
        kept = _constants(derivation) | _kept(derivation) - {real_symbol(f"Gamma_{entry.name}")}
        pulls = {symbol for symbol in rate.free_symbols if symbol.name.startswith("pull_")}
        rest = equations.expand(slope * rate - claimed_rate, kept | pulls)
        claimed = f"{hat}' follows from {state}'"
        found.append(Identity(f"{hat}'", claimed, remainder(rest, derivation.plant.sigma)))
    return found


def _constants(derivation: Derivation) -> frozenset[sp.Symbol]:
    """The plant's constants by name."""
    design = derivation.design
    entries = (*design.truth.b, *design.truth.theta, *design.plant.b, *design.plant.theta)
    return frozenset().union(*(entry.free_symbols for entry in entries))


def _summed(derivation: Derivation) -> frozenset[sp.Symbol]:
    """Names that stay where all errors are summed: partial derivatives, regressors, gains, alpha_1."""
    s, adaptation = derivation.signals, _adaptation(derivation)
    names = {real_symbol(partial_name(alpha, by)) for alpha in s.alpha for by in (s.y, *s.estimates)}
    for entry in adaptation.unknown:
        names |= {omega(entry), real_symbol(f"Gamma_{entry.name}")}
    return frozenset({*names, *s.z, *s.epsilon, *s.estimates, s.y, real_symbol("alpha_bar")}) | _constants(
        derivation
    )


def energy_rate(derivation: Derivation) -> sp.Expr:
    """``V_z'`` with the z_i' that are claimed, and V_Theta' by `estimate_identities`."""
    s, (V_z, _, _) = derivation.signals, energies(derivation)
    rates = dict(zip(s.z, claimed_rates(derivation, sensitivities(derivation)), strict=True))
    total = rate_along(V_z, rates)
    return total if _adaptation(derivation).least_squares is not None else total + pulled(derivation)


def leaked(derivation: Derivation) -> sp.Expr:
    """What leakage adds to V' at most: ``leakage/2 sum ((Theta - prior)^2 - Theta~^2)``, and of rho_hat."""
    adaptation = _adaptation(derivation)
    total = sp.Integer(0)
    for entry in adaptation.unknown:
        away = true_value(derivation, entry) - entry.prior_symbol
        total += LEAKAGE / 2 * (away**2 - missed(derivation, entry) ** 2)
    if adaptation.inverse is not None:
        b_m = derivation.design.truth.b[0]
        away, error = 1 / b_m - RHO_PRIOR, 1 / b_m - RHO_HAT
        total += adaptation.sign * b_m * RHO_LEAKAGE / 2 * (away**2 - error**2)
    return total


def leakage_squares(derivation: Derivation) -> tuple[sp.Expr, ...]:
    """What `leaked` gives away: ``leakage/2 (Theta_hat - prior)^2``, and of rho_hat with |b_m|."""
    adaptation = _adaptation(derivation)
    found = [LEAKAGE / 2 * (entry.estimate - entry.prior_symbol) ** 2 for entry in adaptation.unknown]
    if adaptation.inverse is not None:
        b_m = adaptation.sign * derivation.design.truth.b[0]
        found.append(b_m * RHO_LEAKAGE / 2 * (RHO_HAT - RHO_PRIOR) ** 2)
    return tuple(found)


def energy_claim(derivation: Derivation) -> sp.Expr:
    """The right side of (I); of least squares ``V_z'``, with ``Theta~' omega`` beside epsilon_2 and D_1."""
    s, adaptation = derivation.signals, _adaptation(derivation)
    eta, claim = unknown_output_rate(derivation.design), sp.Integer(0)
    if adaptation.least_squares is None:
        claim += leaked(derivation) - sum(leakage_squares(derivation), sp.Integer(0))
    else:
        eta += sum((omega(item) * missed(derivation, item) for item in adaptation.unknown), sp.Integer(0))
    for w, c, e, z, s_i in zip(s.weights, s.c, s.e, s.z, sensitivities(derivation), strict=True):
        claim += -w * (c + w * e * s_i**2) * z**2 - w * s_i * z * eta
    return claim


def energy_identity(derivation: Derivation) -> Identity:
    """(I), or its counterpart for least squares."""
    if _adaptation(derivation).least_squares is None:
        statement = (
            "d/dt (V_z + V_Theta) = -sum c w z^2 - sum e (w s z)^2 - (sum w s z) (epsilon_2 + D_1) + L"
        )
    else:
        statement = "V_z' = -sum c w z^2 - sum e (w s z)^2 - (sum w s z) (Theta~' omega + epsilon_2 + D_1)"
    difference = energy_rate(derivation) - energy_claim(derivation)
    rest = derivation.equations.expand(difference, _summed(derivation))
    return Identity("energy", statement, remainder(rest, derivation.plant.sigma))


def certificate_identity(derivation: Derivation) -> Identity:
    """V' with every square that is given away, modulo the Lyapunov equation."""
    s, n = derivation.signals, derivation.plant.order
    P, epsilon, D = (
        symmetric_matrix(n),
        sp.Matrix(s.epsilon),
        sp.Matrix(disturbance_symbols(derivation.plant)),
    )
    s_ = sensitivities(derivation)
    _, _, V_epsilon = energies(derivation)
    moving = dict(zip(s.epsilon, filter_matrix(s) * epsilon + D, strict=True))
    V_dot = energy_rate(derivation) + rate_along(V_epsilon, moving)
    given = (*squares(derivation, P * D, s_), *leakage_squares(derivation))
    claim = certified_rate(derivation, P * D) + leaked(derivation) - sum(given, sp.Integer(0))
    left = error_weight(s) * (epsilon.T * lyapunov_residual(P, s) * epsilon)[0]
    kept = _summed(derivation) | P.free_symbols | {*D}
    rest = derivation.equations.expand(V_dot - claim - left, kept)
    statement = "V' = -sum c w z^2 - sum |epsilon|^2/(4e) + what D and the priors add - squares"
    return Identity("certificate", statement, remainder(rest, derivation.plant.sigma))


def identifier_identities(derivation: Derivation) -> list[Identity]:
    """The prediction error is ``Omega_1' Theta~ + epsilon_1``; V of the identifier where no range acts.

    ``d/dt Theta~' Gamma^-1 Theta~/2 = (kappa epsilon_1^2 - kappa (Omega_1' Theta~ + epsilon_1)^2)/(2 N) -
    beta/2 Theta~' Gamma^-1 Theta~`` with N the norm and beta the forgetting that acts. With ``Theta~ = Gamma
    q`` it is a polynomial in q.
    """
    s, equations, adaptation = derivation.signals, derivation.equations, _adaptation(derivation)
    unknown = adaptation.unknown
    epsilon_1 = equations[s.epsilon[0].name].expression.xreplace({s.x[0]: s.y})
    wanted = sum((omega_1(item) * missed(derivation, item) for item in unknown), epsilon_1)
    rest = equations.expand(ERROR - wanted, _constants(derivation) | {s.y})
    claimed = "the prediction error is Omega_1' Theta~ + epsilon_1"
    found = [Identity("prediction_error", claimed, remainder(rest, derivation.plant.sigma))]
    if any(entry.range is not None for entry in unknown):
        return found
    G = sp.Matrix(adaptation.covariance)
    rate = G.applyfunc(lambda entry: equations[derivative_name(entry)].expression)
    q = sp.Matrix([real_symbol(f"q({i})") for i in range(G.rows)])  # with brackets: no name of a model
    regressor = sp.Matrix([omega_1(item) for item in unknown])
    error = (regressor.T * G * q)[0] + s.epsilon[0]
    hats = sp.Matrix([equations[derivative_name(item.estimate)].expression for item in unknown])
    V_dot = -(q.T * hats)[0] - (q.T * rate * q)[0] / 2
    beta = LS_FORGETTING * (1 - G.trace() / LS_K_MAX)
    claim = LS_KAPPA * (s.epsilon[0] ** 2 - error**2) / (2 * NORM) - beta / 2 * (q.T * G * q)[0]
    rest = (V_dot - claim).xreplace({ERROR: error})
    claimed = "V' of the identifier, Theta~' Gamma^-1 Theta~/2, is kappa epsilon_1^2/(2 N) less squares"
    return [*found, Identity("identifier", claimed, remainder(rest, derivation.plant.sigma))]
