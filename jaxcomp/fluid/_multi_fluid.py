r"""The Helmholtz energy of mixtures: one table of the terms of all components and pairs.

$$\frac{a}{RT} = \sum_i x_i\frac{R_i}{R}\left(a^0_i(T_i/T, \rho/\rho_i) + \ln x_i\right)
+ \sum_i x_i a^r_i(\tau,\delta) + \sum_{i<j} x_i x_j F_{ij} a^r_{ij}(\tau,\delta)$$

with $\tau = T_r(x)/T$ and $\delta = \rho/\rho_r(x)$. Under the sums a mixture is a longer table of the
terms of `_helmholtz`, each with a weight: $x_i$, or $x_i x_j F_{ij}$ of a departure function. Nothing
loops over components in a traced program, and the composition is an array like any other.

Sources: Kunz and Wagner (2012), J. Chem. Eng. Data 57, 3032, Eqs. (2) to (12), whose $\beta$ and $\gamma$
are those of the tables in `data/mixtures`; Lemmon and Jacobsen (2004), JPCRD 33, 593. The ideal part has
the reducing values of each component's own equation of state, not its critical point.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from itertools import combinations
from operator import itemgetter
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._core.errors import BadInput
from ._helmholtz import Weighted, arrays, fluid_data, residual_terms
from ._term_sums import TermTable

GAS_CONSTANT = 8.31446261815324  # [J/(mol K)] exact since 2019
REFERENCE = "reference equations"
GERG = "GERG-2008"


class Weights(NamedTuple):
    """Factors of the rows of a family of terms: x_i, or F x_i x_j.

    Attributes:
        first: (rows,) index i.
        second: (rows,) index j, and that of a one behind the last component where there is no pair.
        factor: (rows,) F of the pair, else one.
    """

    first: np.ndarray
    second: np.ndarray
    factor: np.ndarray

    def at(self, x):
        """(rows,) weights at mole fractions (n,)."""
        tools = np if isinstance(x, np.ndarray) else jnp
        padded = tools.concatenate([x, tools.ones_like(x[:1])])
        return self.factor * padded[self.first] * padded[self.second]


class MultiFluid(NamedTuple):
    """Coefficients of n components, n (n - 1)/2 pairs and all their terms.

    Attributes:
        gas_constant: [J/(mol K)]
        molar_mass: [kg/mol] (n,)
        T_r: [K] (n,) reducing temperatures.
        v_r: [m^3/mol] (n,) reducing volumes.
        pairs: (2, m) indices of the components of each pair, in the order that its parameters have.
        shape_T, mean_T: (m,) beta_T^2, and beta_T gamma_T sqrt(T_i T_j) [K].
        shape_v, mean_v: (m,) beta_v^2, and beta_v gamma_v times the cubic mean [m^3/mol].
        residual: rows by family of terms.
        weights: of these rows, by family.
        term_table: of the same rows, as a compiled program sums them.
        ideal: rows by family, in 1/T [1/K] and ln(rho) [mol/m^3].
        ideal_of: (rows,) index of the component, by family.
        lead: (n, 2) constant and coefficient of 1/T.
        log: (n,) coefficient of ln(1/T).
        ratio: (n,) R_i/R, of which the ideal part of each component is a multiple.
        limits: [K], [K], [Pa] lowest and highest temperature and highest pressure of all components.
        limited_by: components that set these.
    """

    gas_constant: float
    molar_mass: np.ndarray
    T_r: np.ndarray
    v_r: np.ndarray
    pairs: np.ndarray
    shape_T: np.ndarray
    mean_T: np.ndarray
    shape_v: np.ndarray
    mean_v: np.ndarray
    residual: dict[str, np.ndarray]
    weights: dict[str, Weights]
    term_table: TermTable
    ideal: dict[str, np.ndarray]
    ideal_of: dict[str, np.ndarray]
    lead: np.ndarray
    log: np.ndarray
    ratio: np.ndarray
    limits: tuple[float, float, float]
    limited_by: tuple[str, str, str]

    @property
    def terms(self) -> int:
        """Number of residual terms."""
        return sum(len(table) for table in self.residual.values())

    def mole_fractions(self, mass_fractions):
        """(n,) from mass fractions (n,) of any sum."""
        amounts = mass_fractions / self.molar_mass
        return amounts / amounts.sum()

    def mass_fractions(self, mole_fractions):
        """(n,) from mole fractions (n,) of any sum."""
        masses = mole_fractions * self.molar_mass
        return masses / masses.sum()

    def reducing(self, x):
        """Reducing temperature [K] and volume [m^3/mol] at mole fractions (n,)."""
        tools = np if isinstance(x, np.ndarray) else jnp
        first = x[self.pairs[0]]
        second = x[self.pairs[1]]
        total = first + second
        # a pair of which neither is there: zero over zero, with a derivative that is none either
        absent = total == 0
        product = 2 * first * second * total

        def mixed(pure, shape, mean):
            denominator = tools.where(absent, 1.0, shape * first + second)
            return (x**2 * pure).sum() + (product * mean / denominator).sum()

        return mixed(self.T_r, self.shape_T, self.mean_T), mixed(
            self.v_r, self.shape_v, self.mean_v
        )

    def ideal_at(self, x) -> dict[str, Any]:
        """The ideal part at mole fractions (n,), for `ideal_terms` with 1/T and mol/m^3."""
        amounts = self.ratio * x
        lead = amounts @ self.lead
        # x ln x is zero without the component, and its derivative must stay finite
        logs = amounts * jnp.log(jnp.where(x > 0, x, 1.0))
        tables = {}
        for family, table in self.ideal.items():
            tables[family] = Weighted(table, amounts[self.ideal_of[family]])
        return {"lead": (lead[0] + jnp.sum(logs), lead[1]), "log": amounts @ self.log, **tables}

    def residual_terms(self, x, tau, delta) -> list:
        """Sums at mole fractions (n,), as those of a pure fluid."""
        table = self.term_table
        total = table.residual(tau, delta, table.coefficients(x))
        if table.inseparable:
            rows = {}
            for family in table.inseparable:
                rows[family] = Weighted(self.residual[family], self.weights[family].at(x))
            row_sums = residual_terms(rows, tau, delta)
            total = [part + row_sum for part, row_sum in zip(total, row_sums, strict=True)]
        return total


# ------------------------------------------------------------------- files
@cache
def mixture_file(name: str) -> dict:
    """A file of `data/mixtures`."""
    return json.loads(files(__package__).joinpath("data", "mixtures", f"{name}.json").read_text())


class Pair(NamedTuple):
    """Parameters by which two components mix, with the names in the order that the parameters have.

    Attributes:
        names: of the components.
        quality: "departure", "generalised departure", "fit", "estimated" or "none".
        source: BibTeX key of the paper.
        shape_T, mean_T, shape_v, mean_v: as in `MultiFluid`.
        factor: F of the departure function.
        function: its name, "" if there is none.
    """

    names: tuple[str, str]
    quality: str
    source: str
    shape_T: float
    mean_T: float
    shape_v: float
    mean_v: float
    factor: float
    function: str


@cache
def pair_of(first: str, second: str, model: str = REFERENCE) -> Pair:
    """Two components in a model; Lorentz and Berthelot's rules where it has nothing for them."""
    table = _pair_table(model)
    for names in ((first, second), (second, first)):
        row = table.get("+".join(names))
        if row is None:
            continue
        if model == GERG:
            numbers = row[:5]
            function = row[5]
            fitted = numbers[0] != 1 or numbers[2] != 1
            quality = "fit" if fitted else "estimated"
            if function:
                quality = "departure"
            return Pair(names, quality, "Kunz-JCED-2012", *numbers, function)
        # T_r has 2 beta gamma x_1 x_2 (x_1 + x_2)/(beta^2 x_1 + x_2) sqrt(T_1 T_2), and v_r likewise: the
        # names stand in the order of the file, since beta changes to 1/beta with it.
        means = _means(names)
        return Pair(
            names,
            quality=row["quality"],
            source=row["source"],
            shape_T=row["beta_T"] ** 2,
            mean_T=row["beta_T"] * row["gamma_T"] * means[0],
            shape_v=row["beta_v"] ** 2,
            mean_v=row["beta_v"] * row["gamma_v"] * means[1],
            factor=row["F"],
            function=row["function"],
        )
    mean_T, mean_v = _means((first, second))
    return Pair(
        names=(first, second),
        quality="none",
        source="",
        shape_T=1.0,
        mean_T=mean_T,
        shape_v=1.0,
        mean_v=mean_v,
        factor=0.0,
        function="",
    )


def _pair_table(model: str) -> Mapping[str, Any]:
    """The pairs of a model by their names, which a plus sign joins."""
    if model == GERG:
        return mixture_file("gerg2008")["pairs"]
    return mixture_file("pairs")


def _means(names: Sequence[str]) -> tuple[float, float]:
    """[K] Geometric mean of the reducing temperatures, [m^3/mol] cubic mean of the volumes."""
    first = fluid_data(names[0])
    second = fluid_data(names[1])
    mean_T = float(np.sqrt(first["T_r"] * second["T_r"]))
    return mean_T, (_edge(first) + _edge(second)) ** 3 / 8


def _edge(fluid: Mapping[str, Any]) -> float:
    """[m/mol^(1/3)] Edge of a cube of a fluid's reducing volume."""
    return (fluid["molar_mass"] / fluid["rho_r"]) ** (1 / 3)


def pairs_of(components: Sequence[str], model: str = REFERENCE) -> list[Pair]:
    """All pairs of components."""
    return [pair_of(first, second, model) for first, second in combinations(components, 2)]


def in_gerg(components: Sequence[str]) -> bool:
    """Whether GERG-2008 has all components."""
    return set(components) <= set(mixture_file("gerg2008")["components"])


# ------------------------------------------------------------------- tables
class Component(NamedTuple):
    """A component in either model, by amounts of substance."""

    molar_mass: float
    gas_constant: float
    T_r: float
    v_r: float
    ideal: Mapping[str, Any]
    residual: Mapping[str, np.ndarray]


def _component(name: str, model: str) -> Component:
    if model == GERG:
        tables = mixture_file("gerg2008")
        row = arrays(tables["components"][name])
        return Component(
            molar_mass=row["molar_mass"],
            gas_constant=tables["gas_constant"],
            T_r=row["T_r"],
            v_r=1 / row["rho_r"],
            ideal=row["ideal"],
            residual=row["residual"],
        )
    data = fluid_data(name)
    return Component(
        molar_mass=data["molar_mass"],
        gas_constant=data["gas_constant"] * data["molar_mass"],
        T_r=data["T_r"],
        v_r=data["molar_mass"] / data["rho_r"],
        ideal=data["ideal"],
        residual=data["residual"],
    )


@cache
def multi_fluid(components: tuple[str, ...], model: str = REFERENCE) -> MultiFluid:
    """Coefficients of components in a model.

    Args:
        components: names of `fluids()`.
        model: of the mixture; `GERG` for its own short equations.
    """
    parts = [_component(name, model) for name in components]
    pairs = pairs_of(components, model)
    place = {name: index for index, name in enumerate(components)}
    gas_constant = GAS_CONSTANT
    if model == GERG:
        gas_constant = mixture_file("gerg2008")["gas_constant"]
    T_r = _column(parts, "T_r")
    v_r = _column(parts, "v_r")
    residual, weights = _residual_table(parts, pairs, place, model)
    ideal, ideal_of = _ideal_table(parts)
    lead = np.array([part.ideal["lead"] for part in parts])
    log = np.array([part.ideal["log"] for part in parts])
    # of each component's own variables T_i/T and rho v_i on 1/T and rho
    constant = lead[:, 0] + np.log(v_r) + log * np.log(T_r)
    limits, limited_by = _limits(components, model)
    pair_places = []
    for pair in pairs:
        first, second = pair.names
        pair_places.append((place[first], place[second]))
    return MultiFluid(
        gas_constant=gas_constant,
        molar_mass=_column(parts, "molar_mass"),
        T_r=T_r,
        v_r=v_r,
        pairs=np.array(pair_places).T,
        shape_T=_column(pairs, "shape_T"),
        mean_T=_column(pairs, "mean_T"),
        shape_v=_column(pairs, "shape_v"),
        mean_v=_column(pairs, "mean_v"),
        residual=residual,
        weights=weights,
        term_table=TermTable(residual, weights),
        ideal=ideal,
        ideal_of=ideal_of,
        lead=np.stack([constant, lead[:, 1] * T_r], axis=1),
        log=log,
        ratio=_column(parts, "gas_constant") / gas_constant,
        limits=limits,
        limited_by=limited_by,
    )


def _column(rows: Sequence[Component] | Sequence[Pair], attribute: str) -> np.ndarray:
    """(rows,) one attribute of all components or of all pairs."""
    return np.array([getattr(row, attribute) for row in rows])


def _residual_table(parts, pairs: Sequence[Pair], place, model: str):
    """Rows of all components and departure functions by family, and the weights of the rows."""
    functions = mixture_file("departures")
    if model == GERG:
        functions = mixture_file("gerg2008")["functions"]
    tables: dict[str, list] = {}
    places: dict[str, list] = {}

    def take(rows: Mapping[str, Any], first: int, second: int, factor: float) -> None:
        for family, table in rows.items():
            if family == "source":
                continue
            for row in np.asarray(table, float):
                tables.setdefault(family, []).append(row)
                places.setdefault(family, []).append((first, second, factor))

    for index, part in enumerate(parts):
        take(part.residual, index, len(parts), 1.0)
    for pair in pairs:
        if pair.function:
            first, second = pair.names
            take(functions[pair.function], place[first], place[second], pair.factor)
    residual = {}
    weights = {}
    for family, rows in tables.items():
        residual[family] = np.array(rows)
        first, second, factor = np.array(places[family]).T
        weights[family] = Weights(first.astype(int), second.astype(int), factor)
    return residual, weights


def _ideal_table(parts: Sequence[Component]):
    """Rows of the ideal parts in 1/T by family, and the component of each."""
    power = []
    planck = []
    for index, part in enumerate(parts):
        for n, t in np.reshape(part.ideal["power"], (-1, 2)):
            power.append((n * part.T_r**t, t, index))
        for n, c, d, theta in np.reshape(part.ideal["planck"], (-1, 4)):
            planck.append((n, c, d, theta * part.T_r, index))
    indexed = {"power": np.reshape(power, (-1, 3)), "planck": np.reshape(planck, (-1, 5))}
    tables = {}
    ideal_of = {}
    for family, rows in indexed.items():
        # the index of the component stands in the last column
        tables[family] = rows[:, :-1]
        ideal_of[family] = rows[:, -1].astype(int)
    return tables, ideal_of


def _limits(components: Sequence[str], model: str):
    """The tightest limits of all components, and the components that set them."""
    if model == GERG:
        table = mixture_file("gerg2008")
        return (table["T_least"], table["T_most"], table["p_most"]), (GERG,) * 3
    data = [fluid_data(name) for name in components]
    of_cold = max(data, key=itemgetter("T_least"))
    of_heat = min(data, key=itemgetter("T_most"))
    of_pressure = min(data, key=itemgetter("p_most"))
    limits = float(of_cold["T_least"]), float(of_heat["T_most"]), float(of_pressure["p_most"])
    return limits, (of_cold["name"], of_heat["name"], of_pressure["name"])


def checked_pairs(
    components: Sequence[str], model: str, estimate_pairs: bool, name: str = "components"
) -> None:
    """Refuse pairs that the model has no parameters for.

    Raises:
        BadInput: such a pair, unless it is to be estimated.
    """
    unknown = [pair for pair in pairs_of(components, model) if pair.quality == "none"]
    if unknown and not estimate_pairs:
        pair_names = " and ".join("/".join(pair.names) for pair in unknown)
        bound = (
            f"a mixture of pairs with known parameters; there are none for {pair_names}. In a section "
            'of type "mixture", `estimate_pairs = true` takes Lorentz and Berthelot\'s rules for them, '
            "which may err by tens of per cent in pressure"
        )
        raise BadInput(name, ", ".join(components), bound)
