"""Mixtures by the Helmholtz energies of their components: blends, natural gas, process gas."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import clip
from .._core.fields import Bound, Part, is_traced, quantity, rebuilt
from .._core.roots import root
from ._blends import SYNONYMS, Blend, blend, blends, component_name, stored_lines
from ._dew_curve import SAMPLES, DewCurve, solve_dew_curve
from ._expanded import evaporator
from ._fluid import SmallSystem, compiled
from ._helmholtz import Saturation, fluid_data, fluids, ideal_terms
from ._multi_fluid import (
    GERG,
    REFERENCE,
    MultiFluid,
    Pair,
    checked_pairs,
    in_gerg,
    multi_fluid,
    pairs_of,
)
from ._real import NEAR_SATURATION, AbstractRealGas, state_of_terms, tools_for
from ._saturation_lines import (
    BUBBLE_DENSITY,
    BUBBLE_PRESSURE,
    DEW_DENSITY,
    DEW_PRESSURE,
    NODES,
    SaturationLines,
    curve,
    solve_lines,
    temperature_of,
)
from ._transport import mixed_transport

_ROUNDING = 1e-3  # of a sum of fractions: analyses and lists of blends print a tenth of a per cent
_NAMED = 0.03  # by which a fraction of a blend may differ: tolerances of ASHRAE 34 are up to 2 %
_MARGIN = 1.02  # of the dew density, beyond which gas counts as wet, as of pure fluids

Model = Literal["GERG-2008", "reference equations"]


class Mixture(AbstractRealGas):
    """A mixture of fluids by the Helmholtz energies of its components and of their pairs.

    Its composition is that of what circulates, by mass or by amount, and an array like any other number:
    derivatives to a fraction are those of the normalised composition, in which the others give way in
    proportion. Dew and bubble line are solved when the mixture is made.

    Args:
        mass_fractions: [-] (n,) by mass, in the order of `components`; in Python also a table of them by
            component. Their sum may be off by 1e-3.
        mole_fractions: [-] (n,) by amount, instead of those by mass.
        components: names of `fluids()`.
        name: of a blend of ASHRAE 34, which needs no composition; else what the mixture is called.
        model: "GERG-2008" for its own short equations, "reference equations" for those of the fluids;
            absent: GERG-2008 where it has all components.
        estimate_pairs: whether pairs without parameters are taken by Lorentz and Berthelot's rules.
        lines: dew and bubble line of this composition, where they are known; else they are solved.
        dew_curve: of a gas without such lines, where it is known; else it is solved.

    Raises:
        BadInput: an unknown component or blend, a composition that is none, or a pair without parameters.
    """

    kind: ClassVar[str] = "mixture"

    mass_fractions: Float[Array, " n"] = quantity(
        "",
        Bound(0.0, 1.0),
        shape=(None,),
        default=None,
        doc="by mass, { R32 = 0.689, R1234yf = 0.311 } or in the order of the components",
    )
    mole_fractions: Float[Array, " n"] | None = quantity(
        "", Bound(0.0, 1.0), shape=(None,), default=None, doc="by amount, instead of those by mass"
    )
    components: tuple[str, ...] | None = eqx.field(static=True, default=None)
    name: str = eqx.field(static=True, default="")
    model: Model | None = eqx.field(static=True, default=None)
    estimate_pairs: bool = eqx.field(static=True, default=False)
    tables_by_name: ClassVar[tuple[str, ...]] = ("mass_fractions", "mole_fractions")
    # no entry of a file: it follows from the composition
    lines: SaturationLines | None = eqx.field(default=None, repr=False, metadata={"derived": True})
    dew_curve: DewCurve | None = eqx.field(default=None, repr=False, metadata={"derived": True})

    def __init__(
        self,
        mass_fractions: Any = None,
        mole_fractions: Any = None,
        components: Sequence[str] | None = None,
        name: str = "",
        model: Model | None = None,
        estimate_pairs: bool = False,
        lines: SaturationLines | None = None,
        dew_curve: DewCurve | None = None,
    ):
        if mass_fractions is None and mole_fractions is None:
            predefined = _blend_of(name)
            mass_fractions = predefined.mass_fractions
            model = model or REFERENCE
        components, fractions, by_amount = _composition(mass_fractions, mole_fractions, components)
        if not model:
            model = GERG if in_gerg(components) else REFERENCE
        if model == GERG and not in_gerg(components):
            outside = next(component for component in components if not in_gerg([component]))
            bound = f'"{REFERENCE}": GERG-2008 is without {outside}'
            raise BadInput("model", f'"{model}"', bound)
        checked_pairs(components, model, estimate_pairs, "name" if name else "components")
        table = multi_fluid(components, model)
        _check_name(name, table, components, fractions, by_amount)
        self.components = components
        self.model = model
        self.estimate_pairs = estimate_pairs
        self.name = name or "/".join(components)
        fractions = _by_mass(table, fractions, by_amount)
        self.mass_fractions = jnp.asarray(fractions)
        self.mole_fractions = None
        if is_traced(fractions):
            raise BadInput(
                "mass_fractions", "traced", "known where a mixture is made: its lines are solved"
            )
        composition = np.asarray(fractions)
        if lines is None and model == REFERENCE:
            lines = stored_lines(components, composition)
        lines = lines or solve_lines(components, composition, model)
        self.lines = jax.tree.map(jnp.asarray, lines)
        if lines is None and dew_curve is None:
            dew_curve = solve_dew_curve(components, tuple(composition.tolist()), model)
        self.dew_curve = jax.tree.map(jnp.asarray, dew_curve)

    @classmethod
    def written(cls, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """Entries of a section of a file, whose table of fractions by component is two lists."""
        rows: dict[str, Any] = {}
        for key in ("mass_fractions", "mole_fractions"):
            fractions = table.get(key)
            if isinstance(fractions, Mapping) and "value" not in fractions:
                rows |= {"components": list(fractions), key: list(fractions.values())}
        if not rows:
            return table
        return {**table, **rows}

    def rewritten(self, old: Part | None, source: str) -> dict[str, Any] | None:
        """Section of a file for this mixture, where its composition differs from that of an old one."""
        if isinstance(old, Mixture) and np.array_equal(old.mass_fractions, self.mass_fractions):
            return None
        fractions = np.asarray(self.mass_fractions).tolist()
        section = {
            "type": self.kind,
            "mass_fractions": dict(zip(self.components or (), fractions, strict=True)),
            "model": self.model,
            "source": source,
        }
        if self.name != "/".join(self.components or ()):
            section["name"] = self.name
        if self.estimate_pairs:
            section["estimate_pairs"] = True
        return section

    # ------------------------------------------------------------------- composition
    @property
    def table(self) -> MultiFluid:
        """Coefficients of the components and pairs."""
        return multi_fluid(self.components or (), self.model or REFERENCE)

    @property
    def pairs(self) -> list[Pair]:
        """Parameters by which the components mix, pair by pair, with their quality and source."""
        return pairs_of(self.components or (), self.model or REFERENCE)

    @property
    def _normalised(self):
        return self.mass_fractions / self.mass_fractions.sum()

    @property
    def _amounts(self):
        """(n,) mole fractions of the normalised composition."""
        return self.table.mole_fractions(self.mass_fractions)

    def _fractions(self, kind: str):
        """(n,) mass or mole fractions of the normalised composition, by the name of their entry."""
        if kind == "mass_fractions":
            return self._normalised
        return self._amounts

    def fraction(self, kind: str, component: str) -> Float[Array, ""]:
        """[-] Fraction of a component of the normalised composition.

        Args:
            kind: "mass_fractions" or "mole_fractions".
            component: name or synonym.

        Raises:
            LookupError: no component of that name.
        """
        return self._fractions(kind)[self.place_of(component)]

    def place_of(self, component: str) -> int:
        """Index of a component by its name or a synonym.

        Raises:
            LookupError: no component of that name.
        """
        components = self.components or ()
        name = component
        if component not in components:
            name = SYNONYMS.get(component, component)
        if name not in components:
            raise LookupError(component)
        return components.index(name)

    def with_fractions(self, kind: str, fractions: Mapping[str, Any]) -> "Mixture":
        """The mixture with other fractions of some components; those of all others go in proportion.

        Dew and bubble line are solved again for the new composition, beside a program where that is
        traced: they are as right as those of a mixture that is made with it. Derivatives to the
        composition are exact to first order.

        Args:
            kind: "mass_fractions" or "mole_fractions".
            fractions: [-] by component, of fewer than all. Within `jit` lines are not numbers where they
                leave nothing for the others.

        Raises:
            LookupError: no component of that name.
            BadInput: fractions of all components, of which one must be left to follow.
        """
        table = self.table
        if len(fractions) >= len(self.components or ()):
            bound = f"fractions of at most {len(fractions) - 1} components: the last one follows"
            raise BadInput(kind, ", ".join(fractions), bound)
        places = np.array([self.place_of(component) for component in fractions])
        followers = np.setdiff1d(np.arange(len(self.components or ())), places)
        old = self._fractions(kind)
        moved = jnp.stack([jnp.asarray(value, float) for value in fractions.values()])
        share = (1 - moved.sum()) / old[followers].sum()
        new = (old * share).at[places].set(moved)
        w = new
        if kind != "mass_fractions":
            w = table.mass_fractions(new)
        lines = None
        if self.lines is not None:
            lines = self._lines_at(w)
        dew_curve = None
        if self.dew_curve is not None:
            dew_curve = self._dew_curve_at(w)
        name = self.name
        if name in blends():
            # a blend of ASHRAE 34 is one of its own composition
            name = "/".join(self.components or ())
        return rebuilt(self, mass_fractions=w, lines=lines, dew_curve=dew_curve, name=name)

    def _lines_at(self, mass_fractions) -> SaturationLines:
        """Lines of another composition (n,), which move with it to first order."""
        lines = self._lines
        like = jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape, float), lines)
        solve = partial(_solved_beside, self.components or (), self.model or REFERENCE)
        # `SaturationLines.at` has the derivatives: those of its coefficients are beside them
        moved = jax.lax.stop_gradient(mass_fractions)
        if not is_traced(moved):
            return jax.tree.map(jnp.asarray, solve(moved))
        return jax.pure_callback(solve, like, moved, vmap_method="sequential")

    def _dew_curve_at(self, mass_fractions) -> DewCurve:
        """Dew curve of another composition (n,); it has no derivatives, as it decides what is wet."""
        like = jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape, float), self.dew_curve)
        solve = partial(_dew_curve_beside, self.components or (), self.model or REFERENCE)
        moved = jax.lax.stop_gradient(mass_fractions)
        if not is_traced(moved):
            return jax.tree.map(jnp.asarray, solve(moved))
        return jax.pure_callback(solve, like, moved, vmap_method="sequential")

    @property
    def molar_mass(self) -> Float[Array, ""]:
        """[kg/mol]"""
        return self._amounts @ self.table.molar_mass

    @property
    def specific_gas_constant(self):
        return self.table.gas_constant / self.molar_mass

    @property
    def temperature_range(self):
        low, high, _ = self.table.limits
        return low, high

    @property
    def highest_pressure(self):
        _, _, highest = self.table.limits
        return highest

    # ------------------------------------------------------------------- states
    def _state(self, T, rho):
        table = self.table
        x = self._amounts
        mass = x @ table.molar_mass
        R = table.gas_constant / mass
        density = rho / mass
        T_r, v_r = table.reducing(x)
        a0, a0_t, a0_tt = ideal_terms(table.ideal_at(x), 1 / T, density)
        # A paper's own gas constant multiplies all of the component's ideal part, and so ln(rho) too.
        a0 = a0 + (x @ table.ratio - 1) * jnp.log(density)
        residual = table.residual_terms(x, T_r / T, density * v_r)
        return state_of_terms(T, rho, R, (a0, a0_t, a0_tt), residual)

    def transport(self, T, rho):
        """Viscosity [Pa s] and thermal conductivity [W/(m K)] of the gas, by mixing rules: an estimate.

        Against fits for blends and for air it errs by 4 and 16 %; laws of heat and leakage are no better.

        Args:
            T: [K] temperature.
            rho: [kg/m^3] density.
        """
        x = self._amounts
        _, v_r = self.table.reducing(x)
        reduced = rho / (x @ self.table.molar_mass) * v_r
        return mixed_transport(self.components or (), x, T, reduced)

    def density(self, T, p):
        """Density [kg/m^3] of the gas at a temperature `T` [K] and a pressure `p` [Pa].

        Raises:
            BadInput: a temperature out of the range of a component, or a pressure at which the mixture
                condenses. Within `jit` the result is then near the limit of the metastable gas.
        """
        if not any(map(is_traced, (T, p, self.mass_fractions))):
            low, high, highest = self.table.limits
            self._require("T", T, Bound(low, high), f"K, the range of {self._limited_by(T)} in")
            why = f"Pa at {T:g} K, for gas of"
            if self.dew_curve is not None:
                dew = float(self.condensation_temperature(p))
                if np.any(np.less(T, dew - NEAR_SATURATION)):
                    bound = (
                        f"above {dew:.5g} K, at which {self.name} begins to condense at {p:g} Pa"
                    )
                    raise BadInput("T", T, bound)
            if self.condenses and np.all(np.less(T, self.critical_temperature)):
                highest = float(self.dew_pressure(np.asarray(T) + NEAR_SATURATION))
                if np.all(np.less(p, self.critical_pressure)):
                    dew = float(self.dew_temperature(p))
                    dew_point = f"the dew temperature at that pressure is {dew:.5g} K"
                    why = f"Pa at {T:g} K, as {dew_point}, for gas of"
            self._require("p", p, Bound(0.0, highest, low_open=True), why)
        return super().density(T, p)

    def _limited_by(self, T) -> str:
        """The component, or the model, whose range ends before a temperature [K] that is beyond it."""
        low, _, _ = self.table.limits
        of_lowest, of_highest, _ = self.table.limited_by
        if np.any(np.less(T, low)):
            return of_lowest
        return of_highest

    @property
    def range_ends_with(self) -> str:
        return self.table.limited_by[1]

    @property
    def pressure_ends_with(self) -> str:
        return self.table.limited_by[2]

    # ------------------------------------------------------------------- saturation
    @property
    def condenses(self) -> bool:
        return self.lines is not None

    @property
    def has_glide(self) -> bool:
        return True

    @property
    def knows_dew_points(self) -> bool:
        return self.condenses or self.dew_curve is not None

    def condensation_temperature(self, p):
        if self.dew_curve is None:
            return super().condensation_temperature(p)
        tools = tools_for(self.dew_curve.temperature, p)
        return self.dew_curve.temperature_at_pressure(p, tools)

    @property
    def _lines(self) -> SaturationLines:
        if self.lines is None:
            bound = "of a mixture with a known dew line; give pressures and temperatures of the gas"
            raise BadInput("fluid", self.name, bound)
        return self.lines

    @property
    def lowest_temperature(self):
        return self._lines.ends[0]

    @property
    def critical_temperature(self):
        """[K] Where the lines end, at 0.985 of the temperature of the critical point."""
        return self._lines.ends[2]

    @property
    def critical_pressure(self):
        return self.dew_pressure(self.critical_temperature)

    def dew_temperature(self, p):
        return self._temperature(p, DEW_PRESSURE)

    def dew_pressure(self, T):
        return self._pressure(T, DEW_PRESSURE)

    def bubble_temperature(self, p):
        return self._temperature(p, BUBBLE_PRESSURE)

    def bubble_pressure(self, T):
        return self._pressure(T, BUBBLE_PRESSURE)

    def _curve(self, which: int, *inputs):
        """Coefficients of a curve, its ends, and the tools for them: NumPy where all is known."""
        lines = self._lines
        tools = tools_for(lines.ends, self.mass_fractions, *inputs)
        ends = lines.ends
        if tools is np:
            ends = np.asarray(ends)
        return lines.at(self._normalised, tools)[:, which], ends, tools

    def _pressure(self, T, which: int):
        coefficients, ends, tools = self._curve(which, T)
        return tools.exp(curve(coefficients, ends, T, tools)[0])

    def _temperature(self, p, which: int):
        coefficients, ends, tools = self._curve(which, p)
        if tools is np:
            return temperature_of(coefficients, ends, np.log(p), np)
        return _traced_temperature(coefficients, ends, p)

    def bubble_of_dew(self, T):
        return self.bubble_temperature(self.dew_pressure(T))

    def dew_of_evaporator(self, T, h):
        on_host = partial(_evaporator_on_host, self.components or (), self.model or REFERENCE)

        def dew(mean, h):
            w = self._normalised
            coefficients, ends, _ = self._curve(DEW_PRESSURE, jnp.asarray(mean))
            inputs = jax.lax.stop_gradient((w, coefficients, ends, mean, h))
            like = jax.ShapeDtypeStruct((4 + w.size,), float)
            point = jax.pure_callback(on_host, like, *inputs, vmap_method="sequential")
            T_dew, inlet, by_pressure, by_enthalpy, *by_fractions = point
            # One step of Newton's method from the root, of which only the derivatives are left.
            logarithm, slope = curve(coefficients, ends, T_dew)
            p = jnp.exp(logarithm)
            at_root = jax.lax.stop_gradient(p)
            inlet = inlet + by_pressure * (p - at_root) + by_enthalpy * (h - inputs[-1])
            inlet = inlet + jnp.stack(by_fractions) @ (w - inputs[0])
            slope_of_mean = 1 + jax.lax.stop_gradient(by_pressure * p * slope)
            return T_dew - (inlet + T_dew - 2 * mean) / slope_of_mean

        if not any(map(is_traced, jax.tree.leaves((self, T, h)))) and np.ndim(T) == np.ndim(h) == 0:
            coefficients, ends, _ = self._curve(DEW_PRESSURE, T)
            return jnp.asarray(on_host(self._normalised, coefficients, ends, T, h)[0])
        return jnp.vectorize(dew)(jnp.asarray(T, float), jnp.asarray(h, float))

    def boiling_density(self, T):
        coefficients, ends, _ = self._curve(BUBBLE_DENSITY, jnp.asarray(T))
        return jnp.exp(curve(jnp.asarray(coefficients), ends, T)[0])

    def saturation(
        self, T: Float[Array, ""] | None = None, p: Float[Array, ""] | None = None
    ) -> Saturation:
        """Saturation at a dew temperature `T` [K] or at a pressure `p` [Pa], by the lines.

        `liquid` is the density on the bubble line at the same temperature.

        Raises:
            BadInput: one that is not on the lines; within `jit` it is not seen.
        """
        ends = self._lines.ends
        if not is_traced(ends):
            ends = np.asarray(ends)
            if T is None and not is_traced(p):
                low = float(self.dew_pressure(ends[0]))
                high = float(self.dew_pressure(ends[2]))
                self._require("p", p, Bound(low, high), "Pa, on the dew line of")
            elif T is not None and not is_traced(T):
                self._require("T", T, Bound(ends[0], ends[2]), "K, on the dew line of")
        return _saturation(self._lines, self.mass_fractions, T, p)

    def is_wet(self, T, rho):
        if self.dew_curve is not None:
            # at its density gas is wet below one temperature, also where it condenses by expanding
            return self.dew_curve.temperature_at_density(rho / _MARGIN) > T
        if self.lines is None:
            return super().is_wet(T, rho)
        # the line of the composition that was solved: the margin covers what a tolerance moves it by
        dew = self._pressure(T, DEW_DENSITY)
        ends = self._lines.ends
        return (ends[2] > T) & (rho > _MARGIN * dew)


@compiled
def _saturation(lines: SaturationLines, mass_fractions, T, p) -> Saturation:
    """Saturation at a temperature or a pressure; one program for all mixtures of n components."""
    coefficients = lines.at(mass_fractions / mass_fractions.sum(), jnp)
    ends = lines.ends

    def on(which: int, T):
        return jnp.exp(curve(coefficients[:, which], ends, T)[0])

    if T is None:
        T = _traced_temperature(coefficients[:, DEW_PRESSURE], ends, p)
    T = jnp.asarray(T)
    if p is None:
        p = on(DEW_PRESSURE, T)
    pressure = jnp.asarray(p)
    return Saturation(
        T=T,
        p=pressure,
        liquid=on(BUBBLE_DENSITY, T),
        vapour=on(DEW_DENSITY, T),
        T_bubble=_traced_temperature(coefficients[:, BUBBLE_PRESSURE], ends, pressure),
    )


def _traced_temperature(coefficients, ends, p) -> Array:
    """[K] Where a curve has pressures [Pa], with derivatives of any order."""

    def misfit(T, inputs):
        coefficients, ends, logarithm = inputs
        # linear beyond the ends, where the curve itself stays level and has no inverse
        value, slope = curve(coefficients, jax.lax.stop_gradient(ends), T)
        inside = clip(T, ends[0], ends[2])
        return value + slope * (T - inside) - logarithm

    def solve(inputs):
        return temperature_of(*inputs)

    def inverse(logarithm):
        return root(SmallSystem(misfit, solve, (coefficients, ends, logarithm)))

    return jnp.vectorize(inverse)(jnp.log(p))


def _evaporator_on_host(components, model, *inputs) -> np.ndarray:
    numbers = [np.asarray(number, float) for number in inputs]
    return evaporator(components, model, *numbers)


def _solved_beside(components, model, mass_fractions) -> SaturationLines:
    """Lines of one of many compositions; not a number where there are none."""
    w = np.asarray(mass_fractions, float)
    lines = None
    if np.isfinite(w).all() and (w >= 0).all():
        lines = solve_lines(components, w, model, one_of_many=True)
    if lines is not None:
        return lines
    shape = 2, 4, NODES
    return SaturationLines(
        ends=np.full(3, np.nan),
        coefficients=np.full(shape, np.nan),
        slopes=np.full((w.size, *shape), np.nan),
        reference=w,
        critical=np.asarray(np.nan),
    )


def _dew_curve_beside(components, model, mass_fractions) -> DewCurve:
    """Dew curve of one of many compositions; that of no wet gas where there is none."""
    w = np.asarray(mass_fractions, float)
    curve = None
    if np.isfinite(w).all() and (w >= 0).all():
        curve = solve_dew_curve(components, tuple(w.tolist()), model)
    if curve is not None:
        return curve
    rising = np.linspace(0.0, 1.0, SAMPLES)
    return DewCurve(rising, np.zeros(SAMPLES), rising)


def _blend_of(name: str) -> Blend:
    if not name:
        bound = "a mixture with mass_fractions, mole_fractions, or the name of a blend of ASHRAE 34"
        raise BadInput("mass_fractions", "absent", bound)
    return blend(name)


def _check_name(name: str, table: MultiFluid, components, fractions, by_amount: bool) -> None:
    """Refuse the name of a pure fluid, and that of a blend of ASHRAE 34 for another composition.

    Raises:
        BadInput: such a name, in any case.
    """
    pure = _spelled(name, fluids())
    if pure and not fluid_data(pure)["pseudo_pure"]:
        bound = f'a name of your own: {pure} is a pure fluid, type = "real_gas"'
        raise BadInput("name", f'"{name}"', bound)
    blend_name = _spelled(name, blends())
    if not blend_name:
        return
    w = _by_mass(table, fractions, by_amount)
    listed = blends()[blend_name].mass_fractions
    fractions_of = dict(zip(components, w, strict=True))
    names = fractions_of.keys() | listed.keys()
    differences = []
    for component in names:
        differences.append(fractions_of.get(component, 0.0) - listed.get(component, 0.0))
    if max(map(abs, differences)) > _NAMED:
        bound = (
            f"a name of your own: {blend_name} has another composition; leave the fractions out "
            "for it"
        )
        raise BadInput("name", f'"{name}"', bound)


def _spelled(name: str, names: Iterable[str]) -> str:
    """The spelling in a list of a name that differs by capital letters at most; "" for none."""
    for spelling in names:
        if spelling.lower() == name.lower():
            return spelling
    return ""


def _by_mass(table: MultiFluid, fractions, by_amount: bool):
    """Mass fractions of sum one, of fractions that may be by amount or off by a rounding."""
    if by_amount:
        return table.mass_fractions(fractions)
    return fractions / fractions.sum()


def _composition(by_mass, by_amount, components) -> tuple[tuple[str, ...], np.ndarray, bool]:
    """Names of the components, fractions (n,) in their order, and whether these are by amount.

    Raises:
        BadInput: a composition that is none.
    """
    if by_mass is not None and by_amount is not None:
        raise BadInput("mole_fractions", "beside mass_fractions", "absent, or mass_fractions")
    key = "mass_fractions" if by_amount is None else "mole_fractions"
    fractions = by_mass if by_amount is None else by_amount
    if isinstance(fractions, Mapping):
        components = list(fractions)
        fractions = list(fractions.values())
    if not components:
        bound = f"a table of fractions by component, or `components` given beside {key}"
        raise BadInput(key, "a list without names", bound)
    names = tuple(map(component_name, components))
    fractions = np.asarray(fractions, float)
    if fractions.shape != (len(names),):
        raise BadInput(key, fractions, f"one for each of the {len(names)} components")
    if len(set(names)) < len(names):
        raise BadInput("components", ", ".join(names), "each named once")
    if len(names) == 1:
        bound = f'of two components at least: that is pure {names[0]}, type = "real_gas"'
        raise BadInput("components", names[0], bound)
    if {"R717", "water"} <= set(names):
        raise BadInput("components", ", ".join(names), "no ammonia-water, which is not covered")
    if not (np.isfinite(fractions) & (fractions >= 0)).all():
        raise BadInput(key, fractions, "at least 0 each")
    total = float(fractions.sum())
    if abs(total - 1) > _ROUNDING:
        bound = f"fractions of sum 1, or percentages with %; these sum to {total:.6g}"
        raise BadInput(key, fractions, bound)
    return names, fractions, by_amount is not None
