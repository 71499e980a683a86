"""Whether a result can be trusted, read off the evidence that it carries."""

from collections.abc import Mapping
from typing import Any, NamedTuple

# What is left of an energy balance, of a periodicity or of a linear system: solvers reach 1e-9 and
# better, and a millionth of an efficiency is far below what the laws of friction are known to.
_SMALL = 1e-6


class Check(NamedTuple):
    """One question that a result answers about itself.

    Attributes:
        name: what is asked.
        answer: in words or as a number.
        good: whether it is as it should be.
        bound: what it should be.
    """

    name: str
    answer: str
    good: bool
    bound: str


def checks(result: Mapping[str, Any]) -> tuple[Check, ...]:
    """The checks that the keys of a result of the command line allow, in a fixed order."""
    allowed = []
    for keys, make in _CHECKS:
        if result.keys() >= set(keys):
            check = make(result)
            if check is not None:
                allowed.append(check)
    return tuple(allowed)


def _solution(result) -> Check:
    return Check("Solution", str(result["status"]), bool(result["converged"]), "converged")


def _size(name: str, key: str):
    def make(result) -> Check | None:
        if not isinstance(result[key], int | float):
            return None  # a list or nothing: the command says more about it itself
        limit = max(_SMALL, 10 * _number(result.get("tolerance")))
        value = abs(result[key])
        return Check(name, f"{value:.1e}", value <= limit, f"at most {limit:.0e}")

    return make


def _resolution(result) -> Check:
    value = result["resolution"]
    return Check("Resolution of the speed", f"{value:.1e}", value <= 0.01, "at most 1e-02")


def _verified(result) -> Check:
    march = result["verification"]
    if march["status"] != "converged":
        return Check("Independent march", march["status"], False, "ends")
    size = max(result["motor_work"], sum(result["losses"].values()), key=abs)
    # what is zero, as the work of an ideal machine, has absolute errors
    losses = sum(map(abs, march["losses"].values())) / abs(size or 1.0)
    largest = 0.0
    for name, error in march["peak_forces"].items():
        largest = max(largest, abs(error) / (result["peak_forces"][name] or 1.0))
    answer = f"speed {march['speed']:.1e}, losses {losses:.1e}, peaks {largest:.1e}"
    good = march["speed"] <= 1e-4 and losses <= 1e-4 and largest <= 1e-2
    return Check("Errors by an independent march", answer, good, "at most 1e-04, 1e-04, 1e-02")


def _margin(result) -> Check:
    value = result["joint_margin"]
    return Check("Margin against self-locking", f"{value:.4f}", value > 0, "above 0")


def _stable(result) -> Check:
    good = all(result["stable"])
    answer = "stable" if good else "unstable"
    return Check("Stability", answer, good, "no mode grows")


def _failed(name: str, all_of_them: str):
    def make(result) -> Check:
        failed = result["failed"]
        number = result[all_of_them]
        return Check(f"{name} without a result", f"{failed:,} of {number:,}", failed == 0, "none")

    return make


def _recommended(result) -> Check:
    good = result["recommended"] is not None
    answer = "none of those tried"
    if good:
        answer = "found"
    return Check(f"Options with an error of at most {result['error']:g}", answer, good, "found")


def _optimum(result) -> Check:
    good = str(result["status"]) == "converged"
    return Check("Search", str(result["status"]), good, "converged")


def _feasible(result) -> Check:
    good = bool(result["feasible"])
    answer = "kept" if good else "violated"
    return Check("Constraints", answer, good, "kept")


def _condition(result) -> Check:
    value = result["condition"]
    # errors of the influence coefficients come out that much larger in the masses
    return Check("Condition of the balancing planes", f"{value:.3g}", value < 100, "below 100")


def _gap(result) -> Check:
    size = abs(result["gap"])
    return Check("Gap to the proven optimum", f"{size:.1e}", size <= 1e-3, "at most 1e-03")


def _number(value: Any) -> float:
    if not isinstance(value, int | float):
        return 0.0
    return float(value)


_CHECKS = (
    (("converged", "status"), _solution),
    (("feasible", "status", "stationarity"), _optimum),
    (("feasible", "stationarity"), _feasible),
    (("energy_residual",), _size("Energy closure", "energy_residual")),
    (("residual",), _size("Residual", "residual")),
    (("resolution",), _resolution),
    (("correction",), _size("Last correction of the linear solution", "correction")),
    (("verification",), _verified),
    (("joint_margin",), _margin),
    (("stable",), _stable),
    (("failed", "designs"), _failed("Designs", "designs")),
    (("failed", "samples"), _failed("Machines of the sample", "samples")),
    (("recommended", "error"), _recommended),
    (("planes", "condition"), _condition),
    (("planes", "gap"), _gap),
)
