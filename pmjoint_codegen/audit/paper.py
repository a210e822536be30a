"""The paper's equations as printed; nothing here is corrected or judged.

Cai, Qian, Yu, Shen, "Output Feedback Control for Pneumatic Muscle Joint System With Saturation Input", IEEE
Access 8 (2020), DOI 10.1109/ACCESS.2020.2991729. Notation is that of `pmjoint_codegen.audit.notation`; the
argument (t) of signals is left out; displays without a number stand where the paper has them, under a name.
What a symbol means depends on the place: ``scope`` names the table of `pmjoint_codegen.audit.context` that
says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

JOINT = "joint"  # Section II up to (8): physics
DESIGN = "design"  # from (9) on
YOUNG = "young"  # the display of Young's inequality, with letters of its own


@dataclass(frozen=True)
class Printed:
    """One display of the paper.

    Attributes:
        number: as printed, such as ``(29)``, or a name for a display without one.
        title: what it is about.
        lines: the display, one chain of relations a line.
        scope: which table says what its symbols mean.
    """

    number: str
    title: str
    lines: tuple[str, ...]
    scope: str = DESIGN


def printed_equations() -> Mapping[str, Printed]:
    """All displays by number, in the paper's order."""
    sections = (
        _joint(),
        _plant(),
        _filters(),
        _error(),
        _auxiliary_system(),
        _first_step(),
        _second_step(),
        _analysis(),
        _example(),
    )
    return by_number(display for section in sections for display in section)


def by_number(displays: Iterable[Printed]) -> Mapping[str, Printed]:
    """Displays as a read-only table."""
    return MappingProxyType({display.number: display for display in displays})


def _joint() -> tuple[Printed, ...]:
    """Section II up to (8): the physics of the joint."""
    stiffness = "(2*k_0*u_0*r**2*(2*C_1*varepsilon_0 + C_2)*l_0**-1)/J"
    gain = "(2*k_0*k_u*r*(C_1*varepsilon_0**2 + C_2*varepsilon_0 + C_3))/J"
    return (
        Printed(
            "(1)",
            "torque balance",
            ("T = J*ddot(theta) + b_v*dot(theta) = F_1*b_1 - F_2*b_2 + vartheta",),
            JOINT,
        ),
        Printed(
            "(2)",
            "muscle forces",
            (
                "F_1 = P_1*(C_1*varepsilon_1**2 + C_2*varepsilon_1 + C_3) + C_4",
                "F_2 = P_2*(C_1*varepsilon_2**2 + C_2*varepsilon_2 + C_3) + C_4",
            ),
            JOINT,
        ),
        Printed(
            "(3)",
            "contraction rates",
            (
                "varepsilon_1 = varepsilon_0 + r*l_0**-1*theta",
                "varepsilon_2 = varepsilon_0 - r*l_0**-1*theta",
            ),
            JOINT,
        ),
        Printed(
            "(4)",
            "muscle pressures",
            ("P_1 = P_0 + Delta_P = k_0*u_0 + k_u*u", "P_2 = P_0 - Delta_P = k_0*u_0 - k_u*u"),
            JOINT,
        ),
        Printed("radii", "one gear radius", ("b_1 = b_2 = r",), JOINT),
        Printed(
            "(5)",
            "equation of motion",
            (f"ddot(theta) = -b_v/J*dot(theta) + {stiffness}*theta + {gain}*u + vartheta",),
            JOINT,
        ),
        Printed("d(t)", "lumped disturbance", ("d = vartheta - b_v/J*dot(theta)",), JOINT),
        Printed(
            "below (5)",
            "equation of motion without damping",
            (f"ddot(theta) = {stiffness}*theta + {gain}*u + d",),
            JOINT,
        ),
        Printed("(6)", "states", ("x_1 = theta", "x_2 = dot(theta)"), JOINT),
        Printed(
            "(7)", "system model", ("dot(x_1) = x_2", "dot(x_2) = d_1*x_1 + d + b_0*u", "y = x_1"), JOINT
        ),
        Printed("(8)", "its two constants", (f"b_0 = {gain}", f"d_1 = {stiffness}"), JOINT),
    )


def _plant() -> tuple[Printed, ...]:
    """From (9) to (13): the plant of the design."""
    return (
        Printed("(9)", "bound of the disturbance", ("abs(d) <= D_max",)),
        Printed(
            "(10)",
            "saturation",
            ("u = sat(v) = cases(u_M, v > u_M, v, -u_M <= v <= u_M, -u_M, v < -u_M)",),
        ),
        Printed(
            "(11)", "system with saturation", ("dot(x_1) = x_2", "dot(x_2) = d_1*x_1 + b_0*u + d", "y = x_1")
        ),
        Printed("(12)", "system in matrices", ("dot(x) = A*x + Phi_1*theta_1 + D + [[0], [b_0]]*u",)),
        Printed(
            "(13)",
            "its matrices",
            ("A = [[0, 1], [0, 0]]", "Phi_1 = [[0], [x_1]]", "D = [[0], [d]]", "theta_1 = d_1"),
        ),
    )


def _filters() -> tuple[Printed, ...]:
    """From (14) to (16)."""
    return (
        Printed(
            "(14)",
            "filters",
            (
                "dot(xi) = A_0*xi + k*y",
                "dot(T(Xi_A)) = A_0*T(Xi_A) + Phi_1",
                "dot(lamda) = A_0*lamda + E_2*u",
                "v_0 = A_0**0*lamda = lamda",
            ),
        ),
        Printed("A_0, P", "Lyapunov equation", ("A_0 = A - k*T(E_1)", "P*A_0 + T(A_0)*P = -2*I")),
        Printed("(15)", "state estimate", ("hat(x) = xi + T(Xi_A)*theta_1 + b_0*v_0",)),
        Printed(
            "(16)",
            "its derivative",
            (
                "dot(hat(x)) = dot(xi) + dot(T(Xi_A))*theta_1 + b_0*dot(v_0)"
                " = A_0*xi + k*y + (A_0*T(Xi_A) + Phi_1)*theta_1 + b_0*(A_0*lamda + E_2*u)"
                " = A_0*(xi + T(Xi_A)*theta_1 + b_0*v_0) + k*y + Phi_1*theta_1 + b_0*E_2*u"
                " = A_0*hat(x) + k*y + Phi_1*theta_1 + b_0*E_2*u",
            ),
        ),
    )


def _error() -> tuple[Printed, ...]:
    """From (17) to (22): what the filters say of the state and of the output's rate."""
    return (
        Printed("(17)", "estimation error", ("epsilon = x - hat(x)",)),
        Printed(
            "(18)",
            "error dynamics",
            (
                "dot(epsilon) = dot(x) - hat(x)"
                " = A*x + Phi_1*theta_1 + D + [[0], [b_0]]*u - (A_0*hat(x) + k*y + Phi_1*theta_1 + b_0*E_2*u)"
                " = A*x - k*T(E_1)*x - A_0*hat(x) + D"
                " = A_0*epsilon + D",
            ),
        ),
        Printed("(19)", "Lyapunov function of the error", ("V_epsilon = T(epsilon)*P*epsilon",)),
        Printed(
            "(20)",
            "its derivative",
            (
                "dot(V_epsilon) = T(dot(epsilon))*P*epsilon + T(epsilon)*P*dot(epsilon)"
                " = T(epsilon)*(T(P)*A_0 + P*A_0)*epsilon + 2*T(epsilon)*P*D"
                " = -2*T(epsilon)*epsilon + 2*T(epsilon)*P*D"
                " <= -2*T(epsilon)*epsilon + T(epsilon)*epsilon + norm(P*D)**2"
                " = -T(epsilon)*epsilon + norm(P*D)**2",
            ),
        ),
        Printed(
            "(21)",
            "rate of the output",
            (
                "dot(y) = dot(hat(x_1)) + dot(epsilon) = b_0*v_0_2 + xi_2 + T(bar(omega))*Theta + epsilon_2",
                "dot(v_0_2) = -k_2*v_0_1 + u",
            ),
        ),
        Printed(
            "(22)",
            "regressors",
            ("Theta = T([[b_0, T(theta_1)]])", "omega = T([[v_0_2, Xi_A2]])", "bar(omega) = T([[0, Xi_A2]])"),
        ),
        # In words: "v_0,2 ... denote the second entries of v_0 ... v_0,1 is the first entries of v_0, v_0,2
        # is the second entries of Av_0."
        Printed("below (22)", "entries of the input filter", ("v_0_2 = T(E_2)*v_0", "v_0_2 = T(E_2)*A*v_0")),
    )


def _auxiliary_system() -> tuple[Printed, ...]:
    """(23) and (24)."""
    return (
        Printed(
            "(23)", "auxiliary system", ("dot(r_1) = r_2 - C_k1*r_1", "dot(r_2) = -C_k2*r_2 + b_0*Delta_u")
        ),
        Printed("Delta u", "input of the auxiliary system", ("Delta_u = u - v",)),
        Printed(
            "(24)",
            "errors",
            ("z_1 = y - y_r - r_1", "z_2 = v_0_2 - alpha_1 - 1/b_0*dot(y_r) - 1/b_0*r_2"),
        ),
    )


def _first_step() -> tuple[Printed, ...]:
    """From there to (27)."""
    return (
        Printed(
            "step 1",
            "rate of the first error",
            (
                "dot(z_1) = dot(y) - dot(y_r) - dot(r_1)"
                " = b_0*(z_2 + alpha_1 + 1/b_0*dot(y_r) + 1/b_0*r_2) + xi_2 + T(bar(omega))*Theta"
                " + epsilon_2 - dot(y_r) - r_2 + C_k1*r_1"
                " = b_0*z_2 + b_0*alpha_1 + xi_2 + T(bar(omega))*Theta + epsilon_2 + C_k1*r_1",
            ),
        ),
        Printed(
            "(25)",
            "virtual control",
            ("alpha_1 = 1/b_0*(-C_1*z_1 - e_1*z_1 - xi_2 - T(bar(omega))*Theta - C_k1*r_1)",),
        ),
        Printed("(26)", "Lyapunov function of step 1", ("V_1 = 1/2*z_1**2 + 1/(2*e_1)*V_epsilon",)),
        Printed(
            "(27)",
            "its derivative",
            (
                "dot(V_1) = z_1*dot(z_1) - 1/(2*e_1)*T(epsilon)*epsilon + 1/(2*e_1)*norm(P*D)**2"
                " = z_1*(b_0*z_2 + b_0*alpha_1 + xi_2 + T(bar(omega))*Theta + epsilon_2 + C_k1*r_1)"
                " - 1/(2*e_1)*T(epsilon)*epsilon + 1/(2*e_1)*norm(P*D)**2"
                " = b_0*z_1*z_2 - C_1*z_1**2 - e_1*z_1**2 + z_1*epsilon_2"
                " - 1/(2*e_1)*T(epsilon)*epsilon + 1/(2*e_1)*norm(P*D)**2"
                " <= -C_1*z_1**2 + b_0*z_1*z_2 - 1/(4*e_1)*T(epsilon)*epsilon + 1/(2*e_1)*norm(P*D)**2",
            ),
        ),
    )


def _second_step() -> tuple[Printed, ...]:
    """(28) and (29)."""
    last = "v_0_3 - k_2*v_0_1"
    return (
        Printed(
            "(28)",
            "rate of the second error",
            (
                "dot(z_2) = dot(v_0_2) - dot(alpha_1) - 1/b_0*ddot(y_r) - 1/b_0*dot(r_2)"
                f" = {last} + u - dot(alpha_1) - 1/b_0*ddot(y_r) + C_k2/b_0*r_2 - Delta_u"
                f" = v + {last} - dot(alpha_1) - 1/b_0*ddot(y_r) + C_k2/b_0*r_2",
            ),
        ),
        Printed(
            "(29)",
            "control law",
            (
                "v = -b_0*z_1 - C_2*z_2 - e_2*partial(alpha_1, y)**2*z_2 - v_0_3"
                " - C_k2/b_0*r_2 + partial(alpha_1, y)*(b_0*v_0_2 + xi_2 + T(bar(omega))*Theta)"
                " + partial(alpha_1, xi)*(A_0*xi + k*y) + partial(alpha_1, r_1)*(r_2 - C_k1*r_1)"
                " + partial(alpha_1, T(Xi_A))*(A_0*T(Xi_A) + Phi_1)"
                " + k_2*v_0_1 + 1/b_0*ddot(y_r) + partial(alpha_1, y_r)*dot(y_r)",
            ),
        ),
    )


def _analysis() -> tuple[Printed, ...]:
    """Section IV."""
    first = "-C_1*z_1**2 + b_0*z_1*z_2 - 1/(4*e_1)*T(epsilon)*epsilon + 1/(2*e_1)*norm(P*D)**2"
    second = "- 1/(2*e_2)*T(epsilon)*epsilon + 1/(2*e_2)*norm(P*D)**2"
    quarters = "- 1/(4*e_1)*T(epsilon)*epsilon", "- 1/(4*e_2)*T(epsilon)*epsilon"
    return (
        Printed("(30)", "Lyapunov function", ("V_2 = V_1 + 1/2*z_2**2 + 1/(2*e_2)*V_epsilon",)),
        Printed(
            "(31)",
            "its derivative",
            (
                f"dot(V_2) = {first} + z_2*dot(z_2) {second}"
                f" = {first}"
                f" + z_2*(v + v_0_3 - k_2*v_0_1 - dot(alpha_1) - 1/b_0*ddot(y_r) + C_k2/b_0*r_2) {second}"
                f" = -C_1*z_1**2 - C_2*z_2**2 {quarters[0]} + 1/(2*e_1)*norm(P*D)**2"
                f" - z_2*partial(alpha_1, y)*epsilon_2 {second} - e_2*partial(alpha_1, y)**2*z_2**2",
            ),
        ),
        Printed("Young", "Young's inequality", ("a*b <= d_1*a**2 + 1/(4*d_1)*b**2",), YOUNG),
        Printed(
            "(32)",
            "its bound",
            (
                f"dot(V_2) <= -C_1*z_1**2 - C_2*z_2**2 {quarters[0]} + 1/(2*e_1)*norm(P*D)**2"
                f" {quarters[1]} + 1/(2*e_2)*norm(P*D)**2"
                f" <= -C_1*z_1**2 - C_2*z_2**2 {quarters[0]} + 1/(2*e_1)*norm(P)**2*D_max**2"
                f" {quarters[1]} + 1/(2*e_2)*norm(P)**2*D_max**2",
            ),
        ),
        Printed("(33)", "residual", ("Y = 1/(2*e_1)*norm(P)**2*D_max**2 + 1/(2*e_2)*norm(P)**2*D_max**2",)),
        Printed(
            "above (34)",
            "comparison with one quadratic form",
            (
                f"-C_1*z_1**2 - C_2*z_2**2 {quarters[0]} {quarters[1]} <= -f_minus*bar(V_2)",
                "1/2*z_2**2 + 1/(2*e_2)*V_epsilon + 1/2*z_1**2 + 1/(2*e_1)*V_epsilon <= f_plus*bar(V_2)",
            ),
        ),
        Printed(
            "(34)",
            "its constants",
            (
                "bar(V_2) = z_1**2 + z_2**2 + 2*T(epsilon)*epsilon",
                "f_minus = min(C_1, C_2, 1/(4*e_1), 1/(4*e_1))",
                "f_plus = max(1/2, 1/(2*e_1)*lamda_max(P), 1/(2*e_2)*lamda_max(P))",
            ),
        ),
        Printed("(35)", "decay", ("dot(V_2) <= -f*V_2 + Y",)),
        Printed("below (35)", "bound of V", ("f = f_minus/f_plus", "V_2 <= V_2(0) + Y/f")),
    )


def _example() -> tuple[Printed, ...]:
    """Section V."""
    return (
        Printed("(36)", "simulated system", ("dot(x_1) = x_2", "dot(x_2) = d_1*x_1 + b_0*u + d", "y = x_1")),
        Printed("(37)", "simulated disturbance", ("d = 0.1*sin(x_2)*cos(t)",)),
        Printed(
            "Section V",
            "numbers of the example",
            (
                "d_1 = 0.2",
                "b_0 = 2",
                "u_M = 10",
                "c_1 = c_2 = 15",
                "c_k1 = c_k2 = 1",
                "e_1 = e_2 = 0.1",
                "k = T([[6, 8]])",
                "x_1(0) = 1.5",
                "x_2(0) = 0",
                "r_1(0) = r_2(0) = 0",
                "xi(0) = 0",
                "Xi(0) = 0",
                "lamda(0) = 0",
            ),
        ),
    )
