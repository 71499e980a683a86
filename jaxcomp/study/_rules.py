r"""Design variables: rules that turn one number into a whole consistent machine.

A rule is a pure function of a machine and a value, differentiable in both, and returns the whole
machine: crank and rotor stay one. It rebuilds the machine unchecked, as everything that may run inside
`jit` does; a solver reports a design that left its bounds. A bare compressor is taken as well.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.arguments import single_number
from .._core.each import listed, of_cylinder
from .._core.errors import BadInput, no_machine
from .._core.fields import (
    ANY,
    POSITIVE,
    Bound,
    Part,
    is_traced,
    plausible,
    quantities,
    rebuilt,
    replaced,
)
from .._core.registry import DESIGN_RULES
from ..compressor import Compressor
from ..machine import Machine
from ..mechanism import SliderCrank, SliderLink
from ..rotor import LoadCase

_Machine = TypeVar("_Machine", Machine, Compressor)


class DesignRule(NamedTuple):
    """A design variable.

    Attributes:
        apply: (machine, value) -> the machine with that value.
        current: machine -> the value it has now.
        unit: SI unit of the value.
        bound: admissible values.
        doc: one line for tables and help.
        entry: of the machine file, whose usual values are those of the rule; "" for none.
    """

    apply: Callable[[Any, Float[Array, ""]], Any]
    current: Callable[[Machine | Compressor], Float[Array, ""]]
    unit: str
    bound: Bound
    doc: str
    entry: str = ""


def with_bore(machine: _Machine, bore: Float[Array, ""]) -> _Machine:
    r"""The machine with another bore at the same displacement and crank ratio.

    Tsuji et al. (2012) Eq. (6), relative to the machine that is given. With
    $\sigma = (d_0/d)^2$ the crank radius and the rod length become $\sigma$ times as long, so that
    $V_s = \tfrac{\pi}{2} d^2 r$ and $r/l$ stay, and

    $$m_p = (d/d_0)^2\, m_{p0}, \quad m_c = (l/l_0)\, m_{c0}, \quad I_c = (l/l_0)^2\, I_{c0} .$$

    The paper leaves open what follows here: the mass centre keeps its share b/l of the rod, the
    offset of the cylinder its share e/r (which keeps the displacement exact), and the crank its share
    of what it balances, as counterweights that are designed along: with one slider-crank of the
    rotating moment $m_c r a/l$ of the rod, with several cylinders or a slider-link of the half balance
    $(m_{rot} + m_{rec}/2)\,r$ of its throws. With a rotor its unbalances, which are those of the crank,
    keep that share. Shaft and rotor and the diameters of pins and journals do not change, nor do gas,
    motor and coefficients of friction.

    A slider-link machine follows the same rule for R and $m_p$. The engaged length of its piston at
    the bottom dead centre grows with the bore, and slider, link, offset and the planes of the shaft
    stay.

    Args:
        machine: the machine to start from, or its compressor alone.
        bore: [m] piston diameter.

    Raises:
        BadInput: a mechanism without such a rule, or a concrete bore that is not positive.

    >>> from jaxcomp import load, with_bore
    >>> machine = load("mayekawa-wbhe").machine
    >>> narrow = with_bore(machine, 0.120)
    >>> for mechanism in (machine.compressor.mechanism, narrow.compressor.mechanism):
    ...     print(f"{mechanism.stroke:.4f} m, {1e6 * mechanism.swept_volume:.0f} cm3")
    0.1000 m, 1327 cm3
    0.1173 m, 1327 cm3
    """
    mechanism = _ruled(machine)
    bore = _checked("bore_at_displacement", bore, _of_field(mechanism, "bore"), "m")
    scale = (mechanism.bore / bore) ** 2
    if isinstance(mechanism, SliderLink):
        scaled = _link_with_bore(mechanism, bore, scale)
    else:
        scaled = replaced(
            mechanism,
            bore=bore,
            crank_radius=mechanism.crank_radius * scale,
            conrod_length=mechanism.conrod_length * scale,
            conrod_centre=mechanism.conrod_centre * scale,
            offset=mechanism.offset * scale,
            piston_mass=mechanism.piston_mass / scale,
            conrod_mass=mechanism.conrod_mass * scale,
            conrod_inertia=mechanism.conrod_inertia * scale**2,
        )
    # One slider-crank balances the rod's rotating moment, which goes with the square of the scale.
    share = scale**2
    if _compressor(machine).crankshaft.count > 1 or isinstance(mechanism, SliderLink):
        share = scaled.half_balance / mechanism.half_balance
    return _with_unbalances(_with_compressor(machine, mechanism=scaled), share)


def _with_unbalances(machine: _Machine, share: Float[Array, ""]) -> _Machine:
    """The machine with all unbalances of its crankshaft, or of the rotor that it is, times a factor."""
    shaft = _compressor(machine).crankshaft
    throws = tuple(_scaled(throw, ("unbalance",), share) for throw in shaft.throws)
    shaft = rebuilt(
        _scaled(shaft, ("unbalance", "shaft_unbalance", "shaft_couple"), share), throws=throws
    )
    scaled = _with_compressor(machine, crankshaft=shaft)
    case = None
    if isinstance(scaled, Machine):
        case = scaled.parts.get("loads")
    if not isinstance(case, LoadCase) or case.crank is None or not case.unbalances:
        return scaled

    def magnitudes(machine):
        return [table.magnitude for table in machine.parts["loads"].unbalances]

    scaled_magnitudes = [size * share for size in magnitudes(scaled)]
    return eqx.tree_at(magnitudes, scaled, scaled_magnitudes)


def _scaled(part, names: tuple[str, ...], factor: Float[Array, ""]):
    """A part with those of its numbers that it has times a factor."""
    changes = {}
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if field.name in names and value is not None:
            changes[field.name] = value * factor
    return replaced(part, **changes)


def with_stroke_bore_ratio(machine: _Machine, ratio: Float[Array, ""]) -> _Machine:
    r"""The machine with another ratio of crank circle to bore, $2R/D$, by `with_bore`.

    Args:
        machine: the machine to start from, or its compressor alone.
        ratio: [-] $2R/D$, the stroke over the bore.

    Raises:
        BadInput: as `with_bore`.
    """
    ratio = _checked("stroke_bore_ratio", ratio, POSITIVE)
    return with_bore(machine, _ruled(machine).bore * jnp.cbrt(_ratio(machine) / ratio))


def with_offset(machine: _Machine, value: Float[Array, ""]) -> _Machine:
    """The machine with its cylinder axis at y = offset [m] from the crank.

    Args:
        machine: the machine to start from, or its compressor alone.
        value: [m] the offset.
    """
    mechanism = _ruled(machine)
    value = _checked("offset", value, ANY)
    return _with_compressor(machine, mechanism=replaced(mechanism, offset=value))


def with_piston_clearance(machine: _Machine, clearance: Float[Array, ""]) -> _Machine:
    """The machine with another radial clearance [m] of the piston.

    It acts on the drag of the oil film alone: leakage past the piston is not modelled, so the gain
    of a wider clearance has no price here.

    Args:
        machine: a machine or a compressor with a `PistonFilm`.
        clearance: [m] radial.

    Raises:
        BadInput: there is no film between piston and cylinder, or a clearance that is not positive.
    """
    clearance = _checked("piston_clearance", clearance, POSITIVE)
    film = replaced(_film(machine), radial_clearance=clearance)
    friction = replaced(_compressor(machine).friction, piston_film=film)
    return _with_compressor(machine, friction=friction)


# Power of the length with which a number of a similar machine grows, by its unit: of the same materials,
# pressures, temperatures and speed. Springs keep their stresses.
_LENGTHS = {
    "m": 1, "m^2": 2, "m^3": 3, "kg": 3, "kg m": 4, "kg m^2": 5, "N": 2, "N m": 3, "N/m": 1,
    "N s/m": 2, "N m s": 3, "W": 3, "W/K": 2,
}  # fmt: skip


def with_swept_volume(machine: _Machine, volume: Float[Array, ""]) -> _Machine:
    r"""A similar machine with another swept volume, at the same speed and between the same lines.

    With $\sigma = (V/V_0)^{1/3}$ lengths grow with $\sigma$, areas and conductances with $\sigma^2$,
    masses with $\sigma^3$ and so on; materials, pressures, temperatures, speeds and pure numbers stay.
    So valves keep their share of the piston area. The gap of the leakage is a matter of manufacture
    and stays.

    Args:
        machine: the machine to start from, or its compressor alone.
        volume: [m^3] that the piston of one cylinder displaces; of different ones the first.

    Raises:
        BadInput: a machine with a rotor, which does not follow.
    """
    volume = _checked("similar_swept_volume", volume, POSITIVE)
    scale = jnp.cbrt(volume / _similar_volume(machine))

    def similar(part, path=""):
        changes: dict[str, Any] = {}
        for name, field in quantities(part):
            value = getattr(part, name)
            # The gap of the leakage does not follow the size, see above.
            if value is not None and f"{path}{name}" != "gas.leakage.gap":
                changes[name] = value * scale ** _LENGTHS.get(field.metadata["unit"], 0)
        for field in dataclasses.fields(part):
            child = getattr(part, field.name)
            if isinstance(child, Part):
                changes[field.name] = similar(child, f"{path}{field.name}.")
            elif isinstance(child, tuple) and child and all(isinstance(c, Part) for c in child):
                changes[field.name] = tuple(similar(c) for c in child)
        return rebuilt(part, **changes)

    compressor = _compressor(machine)
    parts = {}
    for field in dataclasses.fields(compressor):
        part = getattr(compressor, field.name)
        if isinstance(part, Part):
            parts[field.name] = similar(part, f"{field.name}.")
    machine = _with_compressor(machine, **parts)
    if isinstance(machine, Machine) and machine.bearings:
        bearings = {name: similar(bearing) for name, bearing in machine.bearings.items()}
        machine = eqx.tree_at(lambda m: m.bearings, machine, bearings)
    return machine


design_rules: dict[str, DesignRule] = {
    "bore_at_displacement": DesignRule(
        apply=with_bore,
        current=lambda machine: _ruled(machine).bore,
        unit="m",
        bound=POSITIVE,
        doc=DESIGN_RULES["bore_at_displacement"],
        entry="mechanism.bore",
    ),
    "stroke_bore_ratio": DesignRule(
        apply=with_stroke_bore_ratio,
        current=lambda machine: _ratio(machine),
        unit="",
        bound=POSITIVE,
        doc=DESIGN_RULES["stroke_bore_ratio"],
    ),
    "offset": DesignRule(
        apply=with_offset,
        current=lambda machine: _ruled(machine).offset,
        unit="m",
        bound=ANY,
        doc=DESIGN_RULES["offset"],
        entry="mechanism.offset",
    ),
    "piston_clearance": DesignRule(
        apply=with_piston_clearance,
        current=lambda machine: _film(machine).radial_clearance,
        unit="m",
        bound=POSITIVE,
        doc=DESIGN_RULES["piston_clearance"],
    ),
    "similar_swept_volume": DesignRule(
        apply=with_swept_volume,
        current=lambda machine: _similar_volume(machine),
        unit="m^3",
        bound=POSITIVE,
        doc=DESIGN_RULES["similar_swept_volume"],
    ),
}


def _similar_volume(machine) -> Float[Array, ""]:
    """[m^3] Swept volume of a cylinder of a machine that may become a similar one of another size."""
    if isinstance(machine, Machine) and "rotor" in machine.parts:
        bound = "left alone with a rotor, which would not follow"
        raise BadInput("similar_swept_volume", "given", bound)
    # of the first cylinder, also where the others differ: all lengths grow by one factor
    return of_cylinder(_compressor(machine).mechanism).swept_volume


def _link_with_bore(mechanism: SliderLink, bore, scale) -> SliderLink:
    radius = mechanism.crank_radius * scale
    piston_mass = mechanism.piston_mass / scale
    engaged = (mechanism.cylinder_length - 2 * mechanism.crank_radius) * bore / mechanism.bore
    length = engaged + 2 * radius
    return replaced(
        mechanism,
        bore=bore,
        crank_radius=radius,
        cylinder_length=length,
        crown_to_link=mechanism.crown_to_link - mechanism.cylinder_length + length,
        piston_mass=piston_mass,
    )


def _compressor(machine: Machine | Compressor) -> Compressor:
    if isinstance(machine, Compressor):
        return machine
    if not isinstance(machine, Machine):
        raise no_machine(machine, ".machine")
    if machine.compressor is None:
        raise BadInput("compressor", "absent", "given, for this design rule")
    return machine.compressor


def _with_compressor(machine: _Machine, **changes) -> _Machine:
    if isinstance(machine, Machine):
        compressor = replaced(_compressor(machine), **changes)
        return eqx.tree_at(lambda m: m.compressor, machine, compressor)
    return replaced(machine, **changes)


def _ratio(machine: Machine | Compressor):
    mechanism = _ruled(machine)
    return 2 * mechanism.crank_radius / mechanism.bore


def _ruled(machine: Machine | Compressor) -> SliderCrank | SliderLink:
    """The mechanism, if it is one that the rules know."""
    mechanism = _compressor(machine).mechanism
    if not isinstance(mechanism, SliderCrank | SliderLink):
        kind = getattr(mechanism, "kind", type(mechanism).__name__)
        bound = "a slider_crank or a slider_link, for which this rule is made"
        raise BadInput("mechanism", kind, bound)
    for name in listed(mechanism):
        bound = "one number for all cylinders, for which this rule is made"
        raise BadInput(f"mechanism.{name}", getattr(mechanism, name), bound)
    return mechanism


def _film(machine: Machine | Compressor):
    """The film between piston and cylinder."""
    film = getattr(_compressor(machine).friction, "piston_film", None)
    if film is None:
        raise BadInput("friction", "without", "one with a film between piston and cylinder")
    return film


def _of_field(mechanism: SliderCrank | SliderLink, name: str) -> Bound:
    """The bound of a length of the mechanism."""
    declared = dict(quantities(mechanism))[name].metadata
    return plausible(declared["bound"], declared["unit"], declared["usual"])


def _checked(name: str, value, bound: Bound, unit: str = "") -> Float[Array, ""]:
    value = single_number(name, value)
    if not is_traced(value) and not bool(bound.holds(value)):
        raise BadInput(name, value, f"{bound} {unit}".rstrip())
    return value
