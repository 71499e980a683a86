"""What a periodic cycle is solved of: one cylinder with its plenums, or several that share theirs.

There is one vector of states, one of branches and one row of events, so that march and collocation need
not know how many cylinders there are.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import max_of, min_of
from ..valve._flow import Side
from ._cylinder import Case
from ._events import after_event, jump, longest_step, passed, towards
from ._gas_balance import (
    EVENTS,
    FLAGS,
    STATES,
    STREAMS,
    Accounts,
    Rates,
    account_scales,
    choking_margins,
    gas_in,
    in_angle_and_state,
    initial,
    rates,
)
from ._piston_end import PistonEnd
from ._plenum import (
    PER_PLENUM,
    PassedGas,
    chain_rates,
    chains,
    first_states,
    line_streams,
    settled_states,
)
from ._quadrature import harmonics, machine_time, series_at
from ._rings import with_ring_flow
from ._waves import (
    Observed,
    Samples,
    SideWaves,
    Waves,
    flange_numbers,
    has_own_temperature,
    orders_of,
    pipings,
    sampled,
    side_at,
    sides_of,
    slope_of,
)
from .wall_network import OF_WALL, next_revolution

_LEAKAGE = np.array([Accounts._fields.index(name) for name in ("leakage", "leakage_heat")])


class FlangeJacobian(NamedTuple):
    """Rates over the crank angle with all derivatives, behind flanges whose pressures swing.

    Attributes:
        panels: as `Cylinders.jacobian` gives it, with what the pressures do over the angle.
        state_by_pressure: (n, k) of the rates in the k pressures over those of the lines.
        events_by_pressure: (e, k)
        observed: (o,) flows through the flanges.
        observed_by_state, observed_by_angle, observed_by_pressure: (o, n), (o,), (o, k)
        basis: (k, c) pressures for each harmonic of each flange.
    """

    panels: tuple
    state_by_pressure: Float[Array, "n k"]
    events_by_pressure: Float[Array, "e k"]
    observed: Float[Array, " o"]
    observed_by_state: Float[Array, "o n"]
    observed_by_angle: Float[Array, " o"]
    observed_by_pressure: Float[Array, "o k"]
    basis: Float[Array, "k c"]


class Cylinders(eqx.Module):
    """The balances of k cylinders over the crank angle.

    The n states are those of the first cylinder, of the next, and so on, and then those of the plenums.

    Attributes:
        cases: the cylinders; of several, with an axis of them. Their lines are the same.
        phase: [rad] (k,) own angle of each less that of the crank.
        in_time: whether the rates are those in time; the temperature of the walls is held then.
        waves: of the pressures at the flanges of pipes; `None` where lines are constant.
        samples: of these pressures in each network, for a march.
    """

    cases: Case
    phase: Float[Array, " k"]
    in_time: bool = eqx.field(static=True, default=False)
    waves: Waves | None = None
    samples: tuple[Samples, ...] | None = None

    @property
    def count(self) -> int:
        """Number of cylinders, k."""
        return self.phase.shape[0]

    @property
    def stride(self) -> int:
        """States of one cylinder."""
        # a wall moves from one revolution to the next, which a run in time does not have
        moving = self.cases.cylinder.walls is not None and not self.in_time
        return STATES + (OF_WALL if moving else 0)

    @property
    def size(self) -> int:
        """Number of states, n."""
        return self.count * self.stride + PER_PLENUM * len(self.cases.cylinder.plenums)

    @property
    def leaks_between(self) -> bool:
        """Whether every two neighbours are the ends of a cylinder with gas that passes the rings."""
        piston = self.cases.mechanism
        return self.count > 1 and isinstance(piston, PistonEnd) and piston.rings is not None

    @property
    def shared(self) -> Case:
        """A cylinder as large as all together, for the scales of lines and plenums."""
        if self.count == 1:
            return self.cases
        # lines and plenums are the same for all, so the first has them
        first = jax.tree.map(lambda leaf: leaf[0], self.cases)
        return eqx.tree_at(lambda case: case.swept, first, jnp.sum(self.cases.swept))

    def each(self, function, *arrays) -> Any:
        """Values of a function of a case and of arrays that have an axis of k, with that axis."""
        if self.count > 1:
            return jax.vmap(function)(self.cases, *arrays)
        # mapped, both sides of every choice would be computed
        values = function(self.cases, *(array[0] for array in arrays))
        return jax.tree.map(lambda leaf: leaf[None], values)

    def columns(self, *places: int) -> np.ndarray:
        """Where states of a cylinder stand among those of all."""
        return (self.stride * np.arange(self.count)[:, None] + np.array(places)).ravel()

    def parted(self, state: Float[Array, " n"]) -> tuple[Float[Array, "k m"], Float[Array, " 3p"]]:
        """The states of each cylinder, and of the plenums."""
        of_cylinders = self.count * self.stride
        return state[:of_cylinders].reshape(self.count, self.stride), state[of_cylinders:]

    def own_angle(self, angle: Float[Array, ""]) -> Float[Array, " k"]:
        """[rad] of each cylinder."""
        return self.phase + angle

    def rates(self, angle, state, flags, speed: Float[Array, ""] | None = None) -> Rates:
        """Rates as of one cylinder, with accounts (k, 12), events (8 k,), force (2 k,), pressure (k,).

        Args:
            angle: [rad] of the crank.
            state: (n,) over its scales.
            flags: (6 k,)
            speed: [rad/s] of the crank, for rates in time.
        """
        states, plenums = self.parted(state)
        pressures, pair = self._around_cylinders(angle, plenums)

        def cylinder_rates(case, angle, state, flags, *pressures):
            # a row of pressures for each cylinder, or no argument at all between constant lines:
            # `each` maps over whatever there is
            lines = None
            if pressures:
                lines = self.sides(case, pressures[0])
            return rates(case, angle, state, flags, speed=speed, pair=pair, lines=lines)

        flags = flags.reshape(-1, FLAGS)
        of_each = self.each(cylinder_rates, self.own_angle(angle), states, flags, *pressures)
        if self.leaks_between:
            past_rings, leaks = self._between_ends(angle, states, speed)
            of_gas = of_each.state.at[:, :2].add(past_rings)
            accounts = of_each.accounts.at[:, _LEAKAGE].add(leaks)
            of_each = of_each._replace(state=of_gas, accounts=accounts)
        slopes = of_each.state.ravel()
        if pair is not None:
            shared = self.shared
            # plenums are shared: they see the sum of what all cylinders draw and deliver, at the
            # pace of the first one, by whose own angle the shared case counts
            streams = jnp.sum(of_each.streams, axis=0)
            pace = shared.speed
            if speed is None:
                pace = shared.speed_at(self.own_angle(angle)[0])
            of_chains = chain_rates(shared, pair, plenums, streams, pace)
            slopes = jnp.concatenate([slopes, of_chains])
        return of_each._replace(
            state=slopes, events=of_each.events.ravel(), force=of_each.force.ravel()
        )

    def _around_cylinders(self, angle, plenums: Float[Array, " 3p"]):
        """Pressures at the flanges (k, l) in a list, empty where lines are constant, and the plenums."""
        pressures = []
        if self.waves is not None:
            pressures.append(self.flange_pressures(angle))
        if not plenums.size:
            return pressures, None
        lines = None
        if pressures:
            # all share the flange that plenums stand at
            lines = self.sides(self.shared, pressures[0][0])
        return pressures, chains(self.shared, plenums, lines)

    def choking_margins(self, angle, state, flags) -> Float[Array, " 2k"]:
        """[-] Of the ports of all cylinders; positive where none chokes or its valve is shut."""
        states, plenums = self.parted(state)
        pressures, pair = self._around_cylinders(angle, plenums)

        def of_cylinder(case, angle, state, flags, *pressures):
            lines = None
            if pressures:
                lines = self.sides(case, pressures[0])
            return choking_margins(case, angle, state, flags, pair, lines)

        flags = flags.reshape(-1, FLAGS)
        return self.each(of_cylinder, self.own_angle(angle), states, flags, *pressures).ravel()

    def _between_ends(
        self, angle, states: Float[Array, "k m"], speed=None
    ) -> tuple[Float[Array, "k 2"], Float[Array, "k 2"]]:
        """Rates of mass and temperature, and of the accounts of leakage, by gas past the rings."""
        own_angle = self.own_angle(angle)
        gases = self.each(gas_in, own_angle, states)
        # either end computes the flow by itself, with its neighbour behind: both are alike but for
        # the sign
        behind = jax.tree.map(_of_other_end, gases)

        def ring_flow(case, angle, state, inside, behind):
            return with_ring_flow(case, angle, state, (inside, behind), speed)

        return self.each(ring_flow, own_angle, states, gases, behind)

    def _slopes_between_ends(
        self, angle, states: Float[Array, "k m"]
    ) -> tuple[Float[Array, " 2k"], Float[Array, " 2k"], Float[Array, "2k km"]]:
        """Rates of masses and temperatures by gas past the rings, with slopes in the angle and states."""

        def between(angle, states):
            ring_rates = self._between_ends(angle, states)[0]
            return ring_rates, ring_rates

        slopes = jax.jacfwd(between, (0, 1), has_aux=True)(angle, states)
        (with_angle, with_states), ring_rates = slopes
        return (
            ring_rates.ravel(),
            with_angle.ravel(),
            with_states.reshape(2 * self.count, states.size),
        )

    def jacobian(self, angle, state, flags):
        """Rates over the crank angle and event functions, with their derivatives in state and angle.

        Returns:
            (state', events), then (n, n) and (n,) of state', then (8 k, n) and (8 k,) of the events.
        """
        states, plenums = self.parted(state)
        m, q, k = self.stride, plenums.size, self.count
        shared = self.shared
        own_angle = self.own_angle(angle)

        def cylinder_slopes(case, angle, state, flags):
            def law(packed, gas):
                pair = None
                if q:
                    pair = chains(shared, packed[1 + m :])
                cylinder_rates = rates(case, packed[0], packed[1 : 1 + m], flags, gas, pair=pair)
                parts = [cylinder_rates.state, cylinder_rates.events]
                if q:
                    parts.append(cylinder_rates.streams)
                return jnp.concatenate(parts)

            # the directions on which a cylinder depends at all; by states of other cylinders its
            # rates have no slope
            directions = [angle[None], state]
            if q:
                directions.append(plenums)
            return in_angle_and_state(case, law, jnp.concatenate(directions))

        values, slopes = self.each(cylinder_slopes, own_angle, states, flags.reshape(-1, FLAGS))
        parts = (slice(0, m), slice(m, m + EVENTS), slice(m + EVENTS, None))
        state_1, events, streams = (values[:, part] for part in parts)
        of_state, of_events, of_streams = (slopes[:, part] for part in parts)

        by_state, by_angle = self._among_all(of_state)
        if self.leaks_between:
            rows = self.columns(0, 1)
            ring_rates, with_angle, with_states = self._slopes_between_ends(angle, states)
            state_1 = state_1.at[:, :2].add(ring_rates.reshape(k, 2))
            by_angle = by_angle.at[rows].add(with_angle)
            by_state = by_state.at[rows[:, None], np.arange(k * m)].add(with_states)
        if q:

            def of_plenums(angle, plenums, streams):
                pair = chains(shared, plenums)
                pace = shared.speed_at(angle)
                return chain_rates(shared, pair, plenums, streams, pace)

            of_chains = own_angle[0], plenums, jnp.sum(streams, axis=0)
            with_angle, with_plenums, with_streams = jax.jacfwd(of_plenums, (0, 1, 2))(*of_chains)
            # chain rule: plenums feel the cylinders through their streams alone
            through = jnp.einsum("qa,kac->kqc", with_streams, of_streams)
            rows, turned = self._among_all(through)
            rows = rows.reshape(k, q, -1).sum(0)
            turned = turned.reshape(k, q).sum(0)
            by_state = jnp.concatenate([by_state, rows.at[:, k * m :].add(with_plenums)])
            by_angle = jnp.concatenate([by_angle, turned + with_angle])
            state_1 = jnp.concatenate([state_1.ravel(), of_plenums(*of_chains)])
        return (state_1.ravel(), events.ravel()), (by_state, by_angle), self._among_all(of_events)

    def _among_all(self, rows: Float[Array, "k r c"]):
        """From own columns, of angle, state and plenums, to those of all."""
        k = self.count
        m = self.stride
        if k == 1:
            return rows[0, :, 1:], rows[0, :, 0]
        diagonal = np.arange(k)
        # blocks of each cylinder along the diagonal; the columns of the shared plenums stand
        # behind them
        wide = (
            jnp.zeros((k, rows.shape[1], k, m)).at[diagonal, :, diagonal].set(rows[:, :, 1 : 1 + m])
        )
        wide = wide.reshape(*rows.shape[:2], k * m)
        of_all = jnp.concatenate([wide, rows[:, :, 1 + m :]], axis=2)
        return of_all.reshape(-1, of_all.shape[2]), rows[:, :, 0].ravel()

    def with_waves(self, waves: Waves) -> "Cylinders":
        """These cylinders behind flanges with given waves."""
        return Cylinders(self.cases, self.phase, self.in_time, waves)

    def with_samples(self) -> "Cylinders":
        """These cylinders with their waves at instants: values alone, but quick."""
        samples = tuple(sampled(side.pressure) for side in self._piped_waves)
        return Cylinders(self.cases, self.phase, self.in_time, self.waves, samples)

    @property
    def first(self) -> Case:
        """The first cylinder."""
        if self.count == 1:
            return self.cases
        return jax.tree.map(lambda leaf: leaf[0], self.cases)

    @property
    def piped_sides(self) -> tuple[int, ...]:
        """Numbers of the lines that are networks of pipes."""
        return sides_of(self.cases.cylinder)

    @property
    def orders(self) -> int:
        """Harmonics of the waves."""
        return orders_of(self.cases.cylinder)

    @property
    def _flanges(self) -> list[np.ndarray]:
        """Flange of every cylinder in each network."""
        networks = pipings(self.cases.cylinder)
        return [flange_numbers(networks[side], self.count) for side in self.piped_sides]  # pyright: ignore[reportArgumentType]

    def flange_pressures(self, angle: Float[Array, ""]) -> Float[Array, "k l"]:
        """[-] Of every cylinder at each piped line, over that of the line, less one."""
        tau, _ = self._time(angle)
        if self.samples is not None:
            return self._of_cylinders([samples.at(tau) for samples in self.samples])
        return self._of_cylinders([series_at(side.pressure, tau) for side in self._piped_waves])

    def _time(self, angle: Float[Array, ""]):
        """tau [rad] of the machine, and its rate over the angle."""
        return machine_time(self.first, self.phase[0], self.own_angle(angle)[0])

    @property
    def _piped_waves(self) -> list[SideWaves]:
        """Waves of each network."""
        assert self.waves is not None
        return [side for side in self.waves if side is not None]

    def _of_cylinders(self, at_flanges: list[Float[Array, " f"]]) -> Float[Array, "k l"]:
        """Values of every cylinder, from those at the flanges of each network."""
        pairs = zip(at_flanges, self._flanges, strict=True)
        return jnp.stack([values[flanges] for values, flanges in pairs], axis=1)

    def sides(self, case: Case, pressures: Float[Array, " l"]) -> tuple[Side, Side]:
        """The gas at the flanges of a cylinder."""
        lines = list(case.lines)
        for place, side in enumerate(self.piped_sides):
            lines[side] = side_at(lines[side], 1 + pressures[place])
        return lines[0], lines[1]

    def line_pressures(self, angle: Float[Array, ""]) -> Float[Array, "k 2"]:
        """[Pa] At the flanges of every cylinder, before its suction and behind its discharge valve."""
        pressures = self.flange_pressures(angle)

        def at_flanges(case, pressures):
            sides = self.sides(case, pressures)
            return jnp.stack([side.p for side in sides])

        return self.each(at_flanges, pressures)

    def observation(self) -> tuple[np.ndarray, np.ndarray]:
        """To the flows of all flanges, and heats where they count.

        Returns:
            (o, 6 k) from the streams of all cylinders, and (o, 4) from those between plenums and lines.
        """
        rows = []
        rows_of_plenums = []
        cylinder = self.cases.cylinder
        for side, flanges in zip(self.piped_sides, self._flanges, strict=True):
            has_plenums = bool((cylinder.suction, cylinder.discharge)[side].plenums)
            # flows of all flanges, then the heat
            columns = [(flanges == flange, 2 * side) for flange in range(flanges.max() + 1)]
            if has_own_temperature(cylinder, side):
                columns.append((flanges >= 0, 2 * side + 1))
            for cylinders, column in columns:
                row = np.zeros((self.count, STREAMS))
                row_of_plenums = np.zeros(4)
                # at such a flange flows what passes the neck next to the line; what passes the
                # valves does not reach it at once
                if has_plenums:
                    row_of_plenums[column] = 1
                else:
                    row[cylinders, column] = 1
                rows.append(row.ravel())
                rows_of_plenums.append(row_of_plenums)
        return np.stack(rows), np.stack(rows_of_plenums)

    def observe(self, angle, state, flags) -> tuple[Rates, Float[Array, " o"]]:
        """Rates, and flows [kg/s] through all flanges with the heat [W] of each network that it warms."""
        at = self.rates(angle, state, flags)
        of_valves, of_plenums = map(jnp.asarray, self.observation())
        observed = of_valves @ at.streams.ravel()
        _, plenums = self.parted(state)
        if plenums.size:
            lines = self.sides(self.shared, self.flange_pressures(angle)[0])
            pair = chains(self.shared, plenums, lines)
            observed = observed + of_plenums @ line_streams(self.shared, pair)
        return at, observed

    def of_sides(self, harmonics: Float[Array, "o h"]) -> tuple[Observed, ...]:
        """Harmonics of what `observe` gives, for each network."""
        parts = []
        place = 0
        cylinder = self.cases.cylinder
        for side, flanges in zip(self.piped_sides, self._flanges, strict=True):
            end = place + flanges.max() + 1
            flow = harmonics[place:end]
            heat = jnp.zeros(harmonics.shape[1])
            if has_own_temperature(cylinder, side):
                heat = harmonics[end]
                end += 1
            parts.append(Observed(flow, heat))
            place = end
        return tuple(parts)

    def _columns_of(self, basis: Float[Array, " h"]) -> Float[Array, "q c"]:
        """Pressures of all cylinders at each piped line for each harmonic of each flange.

        Args:
            basis: values of the harmonics.
        """
        flanges = self._flanges
        counts = [numbers.max() + 1 for numbers in flanges]
        starts = np.cumsum([0, *counts])
        lines = len(flanges)
        # 1 where a cylinder stands at a flange: cylinders at one flange share its columns
        selection = np.zeros((self.count, lines, starts[-1]))
        for line, numbers in enumerate(flanges):
            selection[np.arange(self.count), line, starts[line] + numbers] = 1
        wide = selection.reshape(-1, starts[-1], 1) * basis
        return jnp.asarray(wide).reshape(self.count * lines, -1)

    def jacobian_at_flanges(self, angle, state, flags) -> FlangeJacobian:
        """Rates over the crank angle with their derivatives, also in the pressures at the flanges."""
        states, plenums = self.parted(state)
        m = self.stride
        q = plenums.size
        shared = self.shared
        tau, pace = self._time(angle)
        waves = [side.pressure for side in self._piped_waves]
        pressures = self._of_cylinders([series_at(series, tau) for series in waves])
        slopes_in_time = [series_at(slope_of(series), tau) for series in waves]
        pressures_1 = pace * self._of_cylinders(slopes_in_time)

        def cylinder_slopes(case, angle, state, flags, pressures):
            def law(packed, gas):
                sides = self.sides(case, packed[1 + m + q :])
                pair = None
                if q:
                    pair = chains(shared, packed[1 + m : 1 + m + q], sides)
                cylinder_rates = rates(
                    case, packed[0], packed[1 : 1 + m], flags, gas, pair=pair, lines=sides
                )
                return jnp.concatenate(
                    [cylinder_rates.state, cylinder_rates.events, cylinder_rates.streams]
                )

            packed = jnp.concatenate([angle[None], state, plenums, pressures])
            return in_angle_and_state(case, law, packed)

        flags = flags.reshape(-1, FLAGS)
        values, slopes = self.each(cylinder_slopes, self.own_angle(angle), states, flags, pressures)
        of_pressures = slopes[:, :, 1 + m + q :]
        # total slopes over the angle: flange pressures move with it as well, by their series in
        # time
        by_angle = slopes[:, :, 0] + jnp.einsum("krl,kl->kr", of_pressures, pressures_1)

        def among_states(rows: Float[Array, "k r c"]):
            """Rows of own states among those of all, with columns of the plenums behind them."""
            of_cylinders = _along_diagonal(rows[:, :, 1 : 1 + m])
            if not q:
                return of_cylinders
            of_plenums = rows[:, :, 1 + m : 1 + m + q].reshape(-1, q)
            return jnp.concatenate([of_cylinders, of_plenums], axis=1)

        parts = (slice(0, m), slice(m, m + EVENTS), slice(m + EVENTS, None))
        state_1, events, streams = (values[:, part].ravel() for part in parts)
        by_state, events_by_state, streams_by_state = (
            among_states(slopes[:, part]) for part in parts
        )
        by_pressure, events_by_pressure, streams_by_pressure = (
            _along_diagonal(of_pressures[:, part]) for part in parts
        )
        turned, events_turned, streams_turned = (by_angle[:, part].ravel() for part in parts)
        of_states = [state_1, turned, by_state, by_pressure]
        of_streams = [streams, streams_turned, streams_by_state, streams_by_pressure]
        if self.leaks_between:
            of_states = self._with_ring_flows(angle, states, of_states)
        of_valves, of_necks = map(jnp.asarray, self.observation())
        # flows with all their slopes at once, in columns: value, angle, states, pressures
        observed = of_valves @ jnp.column_stack(of_streams)
        if q:
            of_flange = pressures[0], pressures_1[0]
            of_chains, necks = self._plenum_slopes(angle, plenums, of_flange, of_streams)
            observed = observed + of_necks @ necks
            of_states = list(map(jnp.concatenate, zip(of_states, of_chains, strict=True)))
        state_1, turned, by_state, by_pressure = of_states
        n = state_1.size
        return FlangeJacobian(
            panels=((state_1, events), (by_state, turned), (events_by_state, events_turned)),
            state_by_pressure=by_pressure,
            events_by_pressure=events_by_pressure,
            observed=observed[:, 0],
            observed_by_state=observed[:, 2 : 2 + n],
            observed_by_angle=observed[:, 1],
            observed_by_pressure=observed[:, 2 + n :],
            basis=self._columns_of(harmonics(tau, self.orders)),
        )

    def _with_ring_flows(self, angle, states, of_states: list) -> list:
        """Rates of all states with their slopes, and what gas past the rings adds to them."""
        state_1, turned, by_state, by_pressure = of_states
        rows = self.columns(0, 1)
        ring_rates, with_angle, with_states = self._slopes_between_ends(angle, states)
        by_state = by_state.at[rows[:, None], np.arange(states.size)].add(with_states)
        return [
            state_1.at[rows].add(ring_rates),
            turned.at[rows].add(with_angle),
            by_state,
            by_pressure,
        ]

    def _plenum_slopes(self, angle, plenums, pressures, valve_slopes):
        """Rates of the plenums, and what flows between them and the lines, with all derivatives.

        Args:
            angle: [rad] of the crank.
            plenums: (q,) their states.
            pressures: (l,) at their flange over those of the lines, and what they change by over the
                angle.
            valve_slopes: streams of all valves (6 k,), their slopes in the angle (6 k,), in all n states
                (6 k, n) and in all pressures (6 k, c).

        Returns:
            Rates of the plenums (q,) with slopes in the angle (q,), states (q, n) and pressures (q, c),
            and the same of what flows as columns (4, 2 + n + c).
        """
        k = self.count
        shared = self.shared
        streams, *slopes = valve_slopes
        total = jnp.sum(streams.reshape(k, STREAMS), axis=0)
        own_angle = self.own_angle(angle)[0]

        def of_plenums(angle, plenums, streams, pressures):
            pair = chains(shared, plenums, self.sides(shared, pressures))
            of_chains = chain_rates(shared, pair, plenums, streams, shared.speed_at(angle))
            rows = jnp.concatenate([of_chains, line_streams(shared, pair)])
            return rows, rows

        at = own_angle, plenums, total, pressures[0]
        of_own, values = jax.jacfwd(of_plenums, (0, 1, 2, 3), has_aux=True)(*at)
        with_angle, with_plenums, with_streams, with_pressures = of_own
        turned, by_state, by_pressure = (
            with_streams @ jnp.sum(part.reshape(k, STREAMS, -1), axis=0) for part in slopes
        )
        turned = turned[:, 0] + with_angle + with_pressures @ pressures[1]
        by_state = by_state.at[:, -plenums.size :].add(with_plenums)
        # pressures of the first cylinder are those of the flange
        by_pressure = by_pressure.at[:, : with_pressures.shape[1]].add(with_pressures)
        parts = (values, turned, by_state, by_pressure)
        of_chains = [part[: plenums.size] for part in parts]
        return of_chains, jnp.column_stack(parts)[plenums.size :]

    def initial(self, angle) -> tuple[Float[Array, " n"], Int[Array, " f"]]:
        """A guess of states and branches."""
        states, flags = self.each(initial, self.own_angle(jnp.asarray(angle)))
        return self._joined(states, first_states(self.shared, at_rest=False)), flags.ravel()

    def jump(self, event, code, state) -> Float[Array, " n"]:
        """The states after an event; see `_events.jump`."""

        # less its own numbers an event of another cylinder is outside 0 to 7, where nothing jumps
        def jump_of_cylinder(case, place, state):
            return jump(case, event - EVENTS * place, code, state)

        states, plenums = self.parted(state)
        return self._joined(self.each(jump_of_cylinder, jnp.arange(self.count), states), plenums)

    def after(self, event, state, flags, force) -> tuple[Int[Array, ""], Int[Array, " f"]]:
        """Code of the jump and branches after an event; see `_events.after_event`."""

        def after_of_cylinder(case, place, state, flags, force):
            return after_event(case, event - EVENTS * place, state, flags, force)

        states = self.parted(state)[0]
        shape = (self.count, -1)
        arguments = jnp.arange(self.count), states, flags.reshape(shape), force.reshape(shape)
        code, new = self.each(after_of_cylinder, *arguments)
        # one cylinder at most has the event; the code of all others is 0
        return max_of(code), new.ravel()

    def towards(self, state, events) -> Bool[Array, " e"]:
        """Whether each event may happen there."""
        arguments = self.parted(state)[0], events.reshape(self.count, -1)
        return self.each(lambda _, *arguments: towards(*arguments), *arguments).ravel()

    def longest(self, flags) -> Float[Array, ""]:
        """[rad] The longest step."""
        return min_of(self.each(longest_step, flags.reshape(self.count, -1)))

    def passed(self, ends, slopes, width, flags, least) -> Float[Array, ""]:
        """Share of a step at which a valve turns beyond seat or stop; see `AbstractLaw.passed`."""

        def passed_by_cylinder(_, ends, slopes, flags):
            return passed(ends, slopes, width, flags, least)

        def of_each(pair):
            return jnp.stack([self.parted(values)[0] for values in pair], axis=1)

        # the first of all cylinders decides: behind its contact the step means nothing for the
        # others
        own_flags = flags.reshape(self.count, -1)
        return min_of(self.each(passed_by_cylinder, of_each(ends), of_each(slopes), own_flags))

    def next_revolution(self, state) -> Float[Array, " n"]:
        """The states after the end of a revolution: the walls are warmer by the heat they have gained."""
        states, plenums = self.parted(state)
        return self._joined(self.each(next_revolution, states), plenums)

    def settled(self, state, totals: Float[Array, "k 12"]) -> Float[Array, " n"]:
        """The states with plenums as after many revolutions like the last; see `settled_states`.

        Args:
            state: (n,) at the end of a revolution.
            totals: of the accounts over it.
        """
        states, plenums = self.parted(state)
        # in kilograms and joules, as the scales of the cylinders may differ
        sums = Accounts(*jnp.sum(totals * self.each(account_scales), axis=0))
        through_suction = PassedGas(sums.suction, sums.suction_back, sums.suction_heat)
        through_discharge = PassedGas(sums.discharge, sums.discharge_back, sums.discharge_heat)
        passed = (through_suction, through_discharge)
        return self._joined(states, settled_states(self.shared, plenums, passed))

    def of_cylinder(self, values: Float[Array, "*p n"]) -> Float[Array, "k *p m"]:
        """States of each cylinder, as if it had the plenums alone."""
        of_cylinders = self.count * self.stride
        states = values[..., :of_cylinders].reshape(*values.shape[:-1], self.count, self.stride)
        states = jnp.moveaxis(states, -2, 0)
        # behind the states of each, where a cylinder alone has its plenums
        plenums = jnp.broadcast_to(
            values[..., of_cylinders:], (*states.shape[:-1], values.shape[-1] - of_cylinders)
        )
        return jnp.concatenate([states, plenums], axis=-1)

    @staticmethod
    def _joined(states, plenums):
        if not plenums.size:
            return states.ravel()
        return jnp.concatenate([states.ravel(), plenums])


def _along_diagonal(rows: Float[Array, "k r c"]) -> Float[Array, "kr kc"]:
    """Rows of each cylinder, from own columns to those of all cylinders."""
    k, height, width = rows.shape
    diagonal = np.arange(k)
    wide = jnp.zeros((k, height, k, width)).at[diagonal, :, diagonal].set(rows)
    return wide.reshape(k * height, k * width)


def _of_other_end(values: Float[Array, " k"]) -> Float[Array, " k"]:
    """Values of ends in pairs, each that of its neighbour."""
    return values.reshape(-1, 2, *values.shape[1:])[:, ::-1].reshape(values.shape)
