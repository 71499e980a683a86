"""Tolerances as they are written on drawings, and files of them.

    +-0.02 mm                 between -0.02 and 0.02 mm, normal, a limit at three standard deviations
    -0.01 +0.03 mm            one limit by one
    +-5 %                     a share of the nominal value
    +-0.02 mm uniform         every value between the limits is as likely
    +-0.02 mm truncated       normal, sorted out beyond the limits
    +-0.02 mm 2 sigma         a limit at two standard deviations
    sigma 5 um                one standard deviation

A file of them is TOML, with names as in `Variable`; `*` stands for any part of a name:

    [tolerances]
    "loads.unbalances.*.magnitude.*" = "+-5 %"
    "mechanism.bore" = "+-0.02 mm"

    [[correlations]]
    between = ["mechanism.bore", "mechanism.conrod_length"]
    value = 0.3
"""

import os
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from .._core.files import regular
from ..machine import Machine
from ..study import Identification, variable
from ..study._variables import by_name
from ..study.tolerance import within
from ..study.tolerance._scatter import Within
from ._text import SceneError, reading, toml_tables
from ._units import to_si

_NUMBER = r"\d*\.?\d+(?:[eE][+-]?\d+)?"
_BOTH = re.compile(rf"\s*(?:\+/-|\+-|±)\s*({_NUMBER})\s*(.*)")
_TWO = re.compile(rf"\s*([+-]?\s*{_NUMBER})\s*(?:/|,|\s)\s*([+-]?\s*{_NUMBER})\s*(.*)")
_SIGMA = re.compile(rf"\s*sigma\s*({_NUMBER})\s*(.*)")
_WORDS = re.compile(
    rf"(.*?)[\s,]*(?:\b(normal|uniform|truncated))?[\s,]*(?:({_NUMBER})\s*sigma)?\s*"
)
_FORMS = 'must be written like "+-0.02 mm", "-0.01 +0.03 mm", "+-5 % uniform" or "sigma 5 um"'


class ToleranceFile(NamedTuple):
    """Content of a file of tolerances.

    Attributes:
        tolerances: as written, by name or pattern.
        correlations: by pairs of names.
    """

    tolerances: dict[str, str]
    correlations: dict[tuple[str, str], float]


def read_tolerance(text: Any, unit: str, key: str) -> Within:
    """A tolerance as written.

    Args:
        text: see the notation above.
        unit: SI unit of the number that it belongs to.
        key: what it belongs to, for the message.

    Raises:
        SceneError: what cannot be read, a unit of another dimension, or limits that do not rise.
    """
    text = str(text)
    single = _SIGMA.fullmatch(text)
    symmetric = _BOTH.fullmatch(text)
    limit_pair = _TWO.fullmatch(text)
    match = single or symmetric or limit_pair
    if match is None:
        raise SceneError(key, _FORMS, text)
    *numbers, unit_and_words = match.groups()
    words = _WORDS.fullmatch(unit_and_words)
    assert words is not None  # it matches any text
    given_unit = words[1].strip()
    distribution = words[2] or "normal"
    sigmas = words[3] or "3"
    if single and (words[2] or words[3]):
        raise SceneError(key, "is a standard deviation, which takes no other word", text)
    relative = given_unit == "%"
    values = []
    for number in numbers:
        if relative:
            values.append(float(number.replace(" ", "")) / 100)
        else:
            values.append(float(to_si(f"{number} {given_unit}", unit, key, difference=True)))
    if limit_pair:
        limits: Any = (min(values), max(values))  # drawings have either one on top
    else:
        limits = 3 * values[0] if single else values[0]
    try:
        return within(limits, distribution, sigmas=float(sigmas), relative=relative)  # pyright: ignore
    except ValueError as error:
        raise SceneError(key, f"is no tolerance: {error}", text) from None


def tolerances_of(design: Machine, texts: Mapping[str, str]) -> dict[str, Within]:
    """Tolerances of the numbers of a design.

    Args:
        design: whose numbers they are.
        texts: as written, by name or pattern; where several fit the last one counts.

    Raises:
        BadInput: a name or pattern that fits nothing.
        SceneError: a text that cannot be read.
    """
    tolerances = {}
    for name, text in by_name(design, texts).items():
        tolerances[name] = read_tolerance(text, variable(design, name).unit, name)
    return tolerances


def read_tolerance_file(path: str | os.PathLike) -> ToleranceFile:
    """A file of tolerances, as written.

    Raises:
        SceneError: a file that cannot be read, or an entry that does not belong there.
    """
    with reading(os.fspath(path)):
        return _file(toml_tables(regular(path).read_bytes()))


def _file(tables: Mapping[str, Any]) -> ToleranceFile:
    for key in tables:
        if key not in ("tolerances", "correlations"):
            raise SceneError(key, "must be `tolerances` or `correlations`")
    texts = tables.get("tolerances")
    if not isinstance(texts, dict) or not texts:
        raise SceneError("tolerances", "must be a table of at least one tolerance")
    for key, text in texts.items():
        if not isinstance(text, str):
            raise SceneError(
                f"tolerances.{key}", f'{_FORMS}; a name with dots needs quotes: "{key}"'
            )
    pairs = {}
    for number, row in enumerate(tables.get("correlations", ())):
        key = f"correlations.{number}"
        if not isinstance(row, dict) or set(row) != {"between", "value"}:
            raise SceneError(key, "must have the entries `between` and `value`")
        between = row["between"]
        value = row["value"]
        if not isinstance(between, list) or len(between) != 2:
            raise SceneError(f"{key}.between", "must be two names", between)
        pairs[(str(between[0]), str(between[1]))] = float(to_si(value, "", f"{key}.value"))
    return ToleranceFile(dict(texts), pairs)


def identified_tolerances(found: Identification) -> str:
    """The uncertainty of identified constants as such a file, for `tolerance`.

    Where the model is rejected, deviations grow with the scatter of the fit. A common factor by pattern
    is no single number and is left out.

    Args:
        found: the result.
    """
    # residuals that are smaller than the readings are sure of make no constant surer
    grown = 1.0
    if found.fit is not None:
        grown = max(1.0, found.fit.scatter)
    indices = [n for n in range(found.constants) if "*" not in found.parameters[n]]
    error = [float(e) * grown for e in found.standard_error.tolist()]
    lines = [f"# identified from {found.source}", "[tolerances]"]
    for n in indices:
        unit = found.units[n]
        lines.append(f'"{found.parameters[n]}" = "sigma {error[n]:.6g}{unit and f" {unit}"}"')
    for place, n in enumerate(indices):
        for m in indices[:place]:
            covariance = float(found.covariance[n, m])
            value = covariance * grown**2 / (error[n] * error[m])
            pair = f'between = ["{found.parameters[m]}", "{found.parameters[n]}"]'
            lines += ["", "[[correlations]]", pair, f"value = {value:.6f}"]
    return "\n".join([*lines, ""])
