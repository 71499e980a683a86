"""Polytropic cycles in stages, with the pressures between them."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.fields import NONNEGATIVE, POSITIVE, Bound, quantity
from .._core.roots import AbstractRoot, root
from ._gas_law import AbstractGas
from .double_acting import DoubleActing
from .polytropic import PolytropicCycle

# Newton steps for the logarithms of the pressures between stages; three reach rounding.
_STEPS = 12


class _Interstage(AbstractRoot):
    """Every stage draws what the one before it delivers; unknown are the pressures between them.

    Attributes:
        volume: [-] swept volume of each chamber, over the largest.
        clearance, exponent: of each chamber.
        outer: [-] logarithms of the suction and the discharge pressure.
        stages: of each chamber, from 1.
    """

    volume: Float[Array, " k"]
    clearance: Float[Array, " k"]
    exponent: Float[Array, " k"]
    outer: Float[Array, "2"]
    stages: tuple[int, ...] = eqx.field(static=True)

    def logarithms(self, inner):
        """Logarithms of all pressures, from suction to discharge."""
        return jnp.concatenate([self.outer[:1], inner, self.outer[1:]])

    def residual(self, unknowns):
        """Flow into a stage less that out of the one before, in units of the flow at suction."""
        logs = self.logarithms(unknowns)
        place = jnp.asarray(self.stages) - 1
        opening = jnp.exp((logs[place + 1] - logs[place]) / self.exponent)
        drawn = self.volume * (1 + self.clearance - self.clearance * opening)
        flow = jnp.zeros(max(self.stages)).at[place].add(drawn)
        return jnp.diff(flow * jnp.exp(logs[:-1] - self.outer[0]))

    def newton_correction(self, unknowns, residual):
        """By Newton's step, as the stages are coupled."""
        return -jnp.linalg.solve(jax.jacfwd(self.residual)(unknowns), residual)

    def solve(self):
        # equal pressure ratios in all stages
        share = jnp.linspace(0.0, 1.0, max(self.stages) + 1)[1:-1]
        start = share * (self.outer[1] - self.outer[0]) + self.outer[0]

        def improve(_, logarithms):
            return logarithms + self.newton_correction(logarithms, self.residual(logarithms))

        return lax.fori_loop(0, _STEPS, improve, start)


class StagedCycle(AbstractGas):
    r"""Several stages with ideal valves; the pressures between them follow from the cylinders.

    With perfect intercooling the gas enters every stage at one temperature, so that what one delivers
    the next one draws at the pressure between them: $\sum V (1 + c - c\,(p_{i+1}/p_i)^{1/n})\,p_i$ is
    the same for all stages, with the swept volume V and the clearance ratio c of each chamber.

    Args:
        stages: stage of every cylinder, from 1.
        suction_pressure: [Pa] absolute, of the first stage.
        discharge_pressure: [Pa] absolute, of the last stage.
        exponent: [-] of compression and re-expansion.
        clearance_ratio: [-] clearance volume over swept volume.
        back_pressure: [Pa] absolute, behind the pistons; the suction pressure if absent. With a rod,
            on its other end.
        rod_diameter: [m] of the piston rods of double-acting cylinders; absent for single-acting.
        inlet_temperature: [K] of the gas that comes; with it the mass delivered and its temperature are
            known.
        gas_constant: [J/(kg K)] specific; of air if absent.

    Raises:
        BadInput: stages that do not begin at 1 or leave one out.
    """

    kind: ClassVar[str] = "staged"
    of_whole_machine: ClassVar[bool] = True
    for_each_cylinder: ClassVar[bool] = True

    stages: tuple[int, ...] = eqx.field(static=True)
    suction_pressure: Float[Array, ""] = quantity("Pa", POSITIVE, doc="absolute", usual=(1e3, 2e7))
    discharge_pressure: Float[Array, ""] = quantity(
        "Pa", POSITIVE, doc="absolute", usual=(1e4, 1e8)
    )
    exponent: Float[Array, ""] = quantity(
        "", Bound(1.0, 3.0), doc="1 is isothermal", usual=(1.0, 1.7)
    )
    clearance_ratio: Float[Array, ""] = quantity("", NONNEGATIVE, default=0.0, usual=(1e-3, 0.3))
    back_pressure: Float[Array, ""] | None = quantity(
        "Pa", NONNEGATIVE, default=None, usual=(1e3, 2e7)
    )
    rod_diameter: Float[Array, ""] | None = quantity("m", POSITIVE, default=None, usual=(5e-3, 0.3))
    inlet_temperature: Float[Array, ""] | None = quantity(
        "K",
        POSITIVE,
        default=None,
        doc="of the gas that comes, for what is delivered",
        usual=(200.0, 400.0),
    )
    gas_constant: Float[Array, ""] = quantity(
        "J/(kg K)", POSITIVE, default=287.05, doc="specific, of air if absent", usual=(20.0, 4200.0)
    )

    def __check_init__(self):
        if not self.stages or set(self.stages) != set(range(1, len(set(self.stages)) + 1)):
            raise BadInput("stages", str(self.stages), "numbers from 1 without a gap")

    def conditions(self):
        compresses = self.discharge_pressure > self.suction_pressure
        return {"stages with discharge_pressure > suction_pressure": compresses}

    @property
    def behind_piston(self):
        return self.suction_pressure if self.back_pressure is None else self.back_pressure

    def pressure(self, stroke):
        """Known once the cylinders are: see `of_cylinders`."""
        raise BadInput("gas", "staged", "put together by `jaxcomp.compressor.compressor_of`")

    @kept_jit
    def between(self, area: Float[Array, "*k"], stroke: Float[Array, "*k"]) -> Float[Array, " m"]:
        """[Pa] Suction pressure of every stage and at last the discharge pressure.

        Args:
            area, stroke: [m^2], [m] of the pistons, of every cylinder or of all.
        """
        count = len(self.stages)
        stage_count = max(self.stages)
        ends = 1.0
        if self.rod_diameter is not None:
            # The head end, and the crank end less the rod.
            ends = 2 - jnp.pi / 4 * self.rod_diameter**2 / area
        volume = jnp.broadcast_to(ends * area * stroke, (count,))
        clearance = jnp.broadcast_to(self.clearance_ratio, (count,))
        exponent = jnp.broadcast_to(self.exponent, (count,))
        # The flows become of order one; only ratios of volumes count, also in derivatives.
        volume = volume / lax.stop_gradient(max_of(volume))
        outer = jnp.log(jnp.stack([self.suction_pressure, self.discharge_pressure]))
        if stage_count == 1:
            return jnp.exp(outer)
        stages = _Interstage(volume, clearance, exponent, outer, self.stages)
        return jnp.exp(stages.logarithms(root(stages)))

    def of_cylinders(self, area: Float[Array, "*k"], stroke: Float[Array, "*k"]) -> AbstractGas:
        """The cycle of every cylinder, between the pressures of its stage.

        Args:
            area, stroke: [m^2], [m] of the pistons, of every cylinder or of all.
        """
        pressure = self.between(area, stroke)
        place = jnp.asarray(self.stages) - 1
        # The numbers of the cylinders go in behind the checks, which are those of a single cycle.
        of_unit_numbers = PolytropicCycle(1.0, 2.0, 1.0, 0.0, self.behind_piston)
        cycle = eqx.tree_at(
            lambda g: (g.suction_pressure, g.discharge_pressure, g.exponent, g.clearance_ratio),
            of_unit_numbers,
            (pressure[place], pressure[place + 1], self.exponent, self.clearance_ratio),
        )
        if self.rod_diameter is None:
            return cycle
        double_acting = DoubleActing(cycle, cycle, 1.0, self.behind_piston)
        return eqx.tree_at(lambda g: g.rod_diameter, double_acting, self.rod_diameter)
