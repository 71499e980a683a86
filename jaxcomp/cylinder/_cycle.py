"""Periodic cycles, of one cylinder and of several: what they pump, what that costs, what valves do."""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._core.declared import computed, held, reading, word
from .._core.extremes import max_of
from .._core.results import Data, Result
from .._core.status import Status
from ..fluid import GasState
from ._cylinder import Case
from ._event_panels import SolvedPressure, over_panels, resolution, turning_margins
from ._gas_balance import STATES, Accounts, valve_scales
from ._pulsation import Pulsation
from ._stability import largest_multiplier

VALVES = ("suction", "discharge")
# [-] of the stop: a valve that reverses as near to it as production tolerances
GRAZING = 0.01


class Events(eqx.Module):
    """Events of the valves: p places, of which some hold none.

    Attributes:
        which: (p,) 0 to 3 suction, 4 to 7 discharge valve: leaves or meets its seat or leaves its
            stop, meets its stop, reversal of the flow, reversal of the pressure; -1 for none.
        angle: [rad] (p,)
        speed: [m/s] (p,) of the valve before it, positive away from the seat.
        meets: (p,) whether the valve meets seat or stop there.
        shuts: (p,) whether it stays on its seat.
        opens: (p,) whether it leaves its seat.
    """

    which: Int[Array, " p"]
    angle: Float[Array, " p"]
    speed: Float[Array, " p"]
    meets: Bool[Array, " p"]
    shuts: Bool[Array, " p"]
    opens: Bool[Array, " p"]

    def impact_speed(self, valve: int, stop: bool) -> Float[Array, ""]:
        """Highest speed [m/s] at which a valve (0 suction, 1 discharge) meets its stop or its seat."""
        strikes = self.meets & (self.which == 4 * valve + stop)
        return max_of(jnp.where(strikes, jnp.abs(self.speed), 0.0))

    def closing_angle(self, valve: int) -> Float[Array, ""]:
        """Crank angle [rad] at which a valve shuts for the last time; 0 if it never does."""
        closings = self.shuts & (self.which == 4 * valve)
        # a valve that bounces or flutters shuts more than once
        latest = jnp.argmax(jnp.where(closings, self.angle, -jnp.inf))
        return jnp.where(jnp.any(closings), self.angle[latest], 0.0)


def whole_cycle(cycle) -> Iterator[Data]:
    """Quantities of one cycle, or several together, over a revolution."""
    yield from cycle.data_of("mass_flow", "volumetric_efficiency", "isentropic_efficiency")
    yield from cycle.data_of("indicated_power", "discharge_temperature", "peak_pressure")
    yield from cycle.data_of("wall_temperature")
    yield from cycle.members_of(indicated_work="work_losses")
    yield from cycle.data_of("mass_closure", "energy_closure")


class Cycle(Result, eqx.Module):
    """One revolution of the periodic state, at n quadrature nodes from 90 degrees before the top.

    Attributes:
        angle: [rad] (n,) crank angle.
        weight: [rad] (n,) of the quadrature.
        volume: [m^3] (n,)
        pressure: [Pa] (n,)
        temperature: [K] (n,)
        mass: [kg] (n,)
        lift: [m] (2, n) of suction and discharge valve.
        flow: [kg/s] (2, n) through them, forward.
        port_velocity: [m/s] (2, n); 0 with quasi-steady flow.
        totals: [kg] and [J] over the revolution.
        events: what the valves do.
        leakage_work: [J] isentropic work on the gas that leaks, up to the pressure at which it does.
        peak_pressure: [Pa]
        status: how the solver ended, a member of `Status`.
        residual: [-] last change of the unknowns.
        iterations: Newton steps.
        revolutions: marched before that.
        passes: tries of steps in them.
        case: cylinder, lines and speed.
        solver: its name.
        raw: panels of the collocation, from which a similar machine may start.
        plenum_pressure: [Pa] (p, n) in the plenums before the suction valve, then behind the discharge
            valve; `None` without any.
        valve_events: of all suction valves and of all discharge valves that were solved together, in the
            last revolution that was marched.
        repeats: whether the march repeated within its tolerance before Newton's method; where it did not,
            the cycle may be unstable, see `multiplier`.
        flange_pressure: [Pa] (p, s + 1, 2) at the flanges, at the points of all panels; `None` without
            pipes.
        piping_work: [J] (2,) that the pipes of suction and discharge cost.
        pulsation: in the pipes of a single cylinder; of several it is that of all together.
    """

    angle: Float[Array, " n"] = reading("rad", "crank_angle")
    weight: Float[Array, " n"] = held()
    volume: Float[Array, " n"] = reading("m^3", "crank_angle")
    pressure: Float[Array, " n"] = reading("Pa", "crank_angle")
    temperature: Float[Array, " n"] = reading("K", "crank_angle")
    mass: Float[Array, " n"] = reading("kg", "crank_angle")
    lift: Float[Array, "2 n"] = reading("m", "valve", "crank_angle")
    flow: Float[Array, "2 n"] = reading("kg/s", "valve", "crank_angle")
    port_velocity: Float[Array, "2 n"] = held()
    totals: Accounts = held()
    events: Events = held()
    leakage_work: Float[Array, ""] = held()
    peak_pressure: Float[Array, ""] = reading("Pa")
    status: Status = held()
    residual: Float[Array, ""] = held()
    iterations: Int[Array, ""] = held()
    revolutions: Int[Array, ""] = held()
    passes: Int[Array, ""] = held()
    case: Case = held()
    solver: str = word(static=True)
    raw: Any = held(default=None)
    plenum_pressure: Float[Array, "p n"] | None = reading(
        "Pa", "plenum", "crank_angle", default=None
    )
    valve_events: Int[Array, "2"] | None = held(default=None)
    repeats: Bool[Array, ""] | None = held(default=None)
    flange_pressure: Float[Array, "p m 2"] | None = held(default=None)
    piping_work: Float[Array, "2"] | None = held(default=None)
    pulsation: Pulsation | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("crank_angle",)
    flat: ClassVar[bool] = True

    @property
    def event_count(self) -> Int[Array, "*batch"]:
        """Events of all valves in the last revolution that was marched."""
        assert self.valve_events is not None
        return jnp.sum(self.valve_events, axis=-1)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield from whole_cycle(self)
        yield from self.data_of(crank_angle="angle")
        yield from self.data_of("volume", "pressure", "temperature", "mass")
        for number, valve in enumerate(VALVES):
            for data in self.data_of("lift", "flow", dims=at):
                of_valve = data.values[..., number, :]
                yield data._replace(name=f"{data.name}.{valve}_valve", values=of_valve)
        for data in self.data_of("plenum_pressure", dims=at):
            for number, pressure in enumerate(jnp.moveaxis(data.values, -2, 0), 1):
                yield data._replace(name=f"{data.name}.{number}", values=pressure)

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the solution can be relied on."""
        return self.status == Status.converged

    @computed("K")
    def wall_temperature(self) -> Float[Array, ""] | None:
        """[K] of the cylinder's wall, given or by its network; `None` without heat transfer."""
        cylinder = self.case.cylinder
        if cylinder.walls is None:
            return cylinder.wall_temperature
        # the first panel stands for all: it is constant within the revolution
        return self.raw[1].left[..., 0, STATES] * self.case.suction.T

    @property
    def frequency(self) -> Float[Array, ""]:
        """[1/s] revolutions."""
        return self.case.speed / (2 * jnp.pi)

    @property
    def delivered(self) -> Float[Array, ""]:
        """[kg] a revolution."""
        return self.totals.discharge

    @computed("kg/s")
    def mass_flow(self) -> Float[Array, ""]:
        """[kg/s] delivered."""
        return self.delivered * self.frequency

    @property
    def indicated_work(self) -> Float[Array, ""]:
        """[J] put into the gas in a revolution."""
        return -self.totals.work

    @computed("W")
    def indicated_power(self) -> Float[Array, ""]:
        """[W]"""
        return self.indicated_work * self.frequency

    @computed("")
    def volumetric_efficiency(self) -> Float[Array, ""]:
        """[-] mass delivered over density in the suction line times swept volume."""
        return self.delivered / self.case.mass_scale

    @property
    def isentropic_rise(self) -> Float[Array, ""]:
        """[J/kg] of the enthalpy between the lines."""
        return self.case.isentropic.h - self.case.suction.h

    @computed("")
    def isentropic_efficiency(self) -> Float[Array, ""]:
        """[-] isentropic work of the mass delivered over the indicated work."""
        return self.delivered * self.isentropic_rise / nonzero(self.indicated_work)

    @property
    def discharge_enthalpy(self) -> Float[Array, ""]:
        """[J/kg] mean of the gas that is delivered."""
        return self.totals.discharge_heat / nonzero(self.delivered)

    @property
    def discharged_gas(self) -> GasState:
        """That gas at the pressure of the line."""
        line = self.case.discharge
        # without delivery there is no mean enthalpy: the gas of the line stands for it
        enthalpy = jnp.where(self.delivered > 0, self.discharge_enthalpy, line.h)
        return self.case.cylinder.fluid.at_enthalpy(line.p, enthalpy, line)

    @computed("K")
    def discharge_temperature(self) -> Float[Array, ""]:
        """[K] of that gas at the pressure of the line."""
        return self.discharged_gas.T

    @property
    def polytropic_rise(self) -> Float[Array, ""]:
        r"""[J/kg] Polytropic head between the lines, $\int dp/\rho$ with $p\rho^{-n}$ constant.

        The exponent is that of the densities of the gas at the suction valve and of the gas delivered.
        """
        suction = self.case.suction
        behind = self.discharged_gas
        ratio = behind.p / suction.p
        inverse = jnp.log(behind.rho / suction.rho) / jnp.log(ratio)  # 1/n
        return suction.p / suction.rho * (ratio ** (1 - inverse) - 1) / (1 - inverse)

    @computed("")
    def mass_closure(self) -> Float[Array, ""]:
        """[-] mass that came and did not leave, over that which came."""
        t = self.totals
        return (t.suction - t.discharge - t.leakage) / nonzero(t.suction)

    @computed("")
    def energy_closure(self) -> Float[Array, ""]:
        """[-] energy that came and did not leave, over the indicated work."""
        t = self.totals
        # p dV is work of the gas: what it gives away counts as energy that left
        imbalance = t.suction_heat - t.discharge_heat - t.leakage_heat + t.heat - t.work
        return imbalance / nonzero(self.indicated_work)

    @computed("J")
    def work_losses(self) -> dict[str, Float[Array, ""]]:
        """[J] Where the indicated work goes, by name; the values add up to it.

        Plenums and their necks count with their valve. Heating, throttling of back flow and the loss of
        the gas that expands again act upon each other; what they cost together is the last entry,
        negative where cooling saves work.
        """
        named = {
            "isentropic": self.delivered * self.isentropic_rise,
            "suction valve": self.totals.suction_loss,
            "discharge valve": self.totals.discharge_loss,
            "leakage": self.leakage_work,
        }
        if self.piping_work is not None:
            named["suction piping"] = self.piping_work[0]
            named["discharge piping"] = self.piping_work[1]
        remainder = self.indicated_work - sum(named.values(), start=jnp.zeros(()))
        return {**named, "heating": remainder}

    @property
    def volume_losses(self) -> dict[str, Float[Array, ""]]:
        """[-] Where the swept volume goes, by name; the values add up to 1.

        The suction valve's share is what the pressure at the bottom dead centre is below the line's.
        """
        case = self.case
        t = self.totals
        c = case.cylinder.clearance_ratio
        # what the clearance holds at discharge expands over this part of the stroke before the
        # suction valve can open
        expanded = case.cylinder.fluid.at_entropy(case.suction.p, case.discharge.s, case.discharge)
        clearance = c * (case.discharge.rho / expanded.rho - 1)
        _, bottom = case.mechanism.dead_centres()
        # shares of the full cylinder, clearance included: (1 + c) swept volumes are filled at this
        # pressure
        full = self.pressure_at(bottom)
        named = {
            "delivered": self.volumetric_efficiency,
            "clearance": clearance,
            "leakage": t.leakage / case.mass_scale,
            "back flow": (t.suction_back + t.discharge_back) / case.mass_scale,
            "suction valve": (1 + c) * (1 - full / case.suction.p),
        }
        if self.flange_pressure is not None:
            _, z, _ = self.raw
            flange = over_panels(z.edges, self.flange_pressure[..., 0], bottom)
            named["suction valve"] = (1 + c) * (flange - full) / case.suction.p
            named["piping"] = (1 + c) * (1 - flange / case.suction.p)
        remainder = 1 - sum(named.values(), start=jnp.zeros(()))
        return {**named, "heating": remainder}

    def gas(self) -> "SolvedPressure":
        """The pressure as a gas that is prescribed over the crank angle."""
        _, z, pressure = self.raw
        # all edges, since the valves' events are among them and the pressure swings between
        return SolvedPressure(z.edges, pressure, z.edges[1:-1], self.case.suction.p)

    def pressure_at(self, angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[Pa] at crank angles [rad]."""
        _, z, pressure = self.raw
        return over_panels(z.edges, pressure, angle)

    def lift_at(self, angle: Float[Array, "*n"], discharge: bool) -> Float[Array, "*n"]:
        """[m] of the suction valve, or of the discharge valve, at crank angles [rad]."""
        _, z, _ = self.raw
        which = int(discharge)
        length, *_ = valve_scales(self.case, which)
        return over_panels(z.edges, z.points[..., 2 + 3 * which], angle) * length

    @property
    def capacity(self) -> Float[Array, ""]:
        """Cooling capacity [W]: mass flow times the enthalpy from the liquid to the gas that comes.

        Raises:
            TypeError: a perfect gas, which has no liquid.
        """
        cylinder = self.case.cylinder
        liquid = cylinder.discharge.liquid_enthalpy(cylinder.fluid)
        # before shell and muffler heat the gas, which cools nothing outside; so do the standards
        # count
        return self.mass_flow * (self.case.comes.h - liquid)

    @property
    def impact_speeds(self) -> dict[str, Float[Array, ""]]:
        """[m/s] Highest speed at which each valve meets its seat and its stop."""
        speeds = {}
        for number, valve in enumerate(VALVES):
            for place in ("seat", "stop"):
                speeds[f"{valve}_{place}"] = self.events.impact_speed(number, place == "stop")
        return speeds

    @property
    def resolution(self) -> Float[Array, ""]:
        """[-] Size of the highest two terms of the polynomials, above the relative error of the flow.

        Over the scales of mass, temperature and lift; of a march that of the panels laid after it.
        """
        return resolution(self.raw[1])

    @property
    def multiplier(self) -> float:
        """[-] Largest Floquet multiplier: the factor of a disturbance in a revolution, by collocation.

        Beyond one in magnitude the cycle is unstable; below minus one the machine repeats only after
        two revolutions. With its sign where it is real, else the magnitude. Behind pipes that of the
        valves and the gas in the cylinder, with the waves as they are.
        """
        mesh, z, _ = self.raw
        waves = None if self.pulsation is None else self.pulsation.waves
        return largest_multiplier(self.case, mesh, z, waves)

    @property
    def turning_margins(self) -> dict[str, Float[Array, ""]]:
        """[-] How far each valve turns beyond its seat and its stop, in parts of the stop.

        Positive: it touches, and would have turned so far beyond. Negative: it turns so far before.
        Of all touches and turns the one nearest to nothing; infinite where there is none.
        """
        mesh, z, _ = self.raw
        margins = turning_margins(self.case, mesh, z)
        by_name = {}
        for number, valve in enumerate(VALVES):
            for side, place in enumerate(("seat", "stop")):
                by_name[f"{valve}_{place}"] = margins[number, side]
        return by_name

    @property
    def grazes(self) -> dict[str, Bool[Array, ""]]:
        """Whether 1 % of its stop in a valve's motion adds a touch of seat or stop, or ends one.

        Derivatives hold on this side of that only (see `turning_margins`), and grow with one over the
        root of the margin on the side where it touches.
        """
        return {name: jnp.abs(margin) < GRAZING for name, margin in self.turning_margins.items()}

    @property
    def closing_angles(self) -> dict[str, Float[Array, ""]]:
        """[rad] Crank angle at which each valve shuts for the last time."""
        return {valve: self.events.closing_angle(n) for n, valve in enumerate(VALVES)}


def nonzero(value):
    # one in the place of zero alone: the quotient is finite there and the same elsewhere,
    # derivatives included
    return value + (value == 0)


def values_only(tree):
    """A copy that refuses to be differentiated: derivatives of the quasi-steady law err by per cent."""
    numbers, static_part = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(_refuse, numbers), static_part)


@jax.custom_jvp
def _refuse(x):
    return x


@_refuse.defjvp
def _refuse_jvp(primals, tangents):
    raise NotImplementedError(
        "Cycles that are marched have no derivatives. Give both ports a length, so that the gas in "
        "them has inertia, and solve by collocation. Where they have one, collocation did not hold at "
        "this machine: a valve grazes its seat or stop, or leaves it for a moment; a slightly other "
        "speed or spring has derivatives."
    )
