"""The slider-crank compressor once more, in plain NumPy and SciPy, by another road.

Bodies with all their coordinates: three accelerations of the rod, one of piston and crank each,
six pin forces and the wall force are the unknowns of one 12 x 12 linear system; friction is a right
side that a fixed point makes consistent. One turn is integrated over crank angle with `solve_ivp`,
cut at the kinks, and closed with `scipy.optimize`. Nothing here is shared with the package.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar, root


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


@dataclass
class Machine:
    """Numbers only; `motor` maps (speed, level) to a torque."""

    bore: float
    crank_radius: float
    conrod_length: float
    piston_mass: float
    conrod_mass: float
    crank_inertia: float
    conrod_centre: float = 0.0
    conrod_inertia: float = 0.0
    crank_unbalance: float = 0.0
    crank_mass: float = 0.0
    offset: float = 0.0
    suction_pressure: float = 1e5
    discharge_pressure: float = 1e5
    exponent: float = 1.0
    clearance_ratio: float = 0.0
    back_pressure: float | None = None
    gravity: tuple = (0.0, 0.0)
    wall: float = 0.0
    pins: dict = field(default_factory=dict)  # name -> (coefficient, diameter)
    has_gas: bool = True
    pressure_over_angle: object = None  # a given diagram

    # ---------------------------------------------------------------- geometry and gas
    def rod_angle(self, theta):
        """Angle of the line from crank pin to piston pin, counterclockwise from x."""
        rise = self.offset - self.crank_radius * np.sin(theta)
        return np.arcsin(rise / self.conrod_length)

    def piston(self, theta):
        return self.crank_radius * np.cos(theta) + self.conrod_length * np.cos(
            self.rod_angle(theta)
        )

    def piston_rate(self, theta):
        """dx/dtheta from the velocity of a rod whose end stays on the line y = offset."""
        turn = self.rod_rate(theta)
        return -self.crank_radius * np.sin(theta) - self.conrod_length * turn * np.sin(
            self.rod_angle(theta)
        )

    def rod_rate(self, theta):
        return (
            -self.crank_radius
            * np.cos(theta)
            / (self.conrod_length * np.cos(self.rod_angle(theta)))
        )

    def dead_centres(self):
        top = brentq(self.piston_rate, -0.5 * np.pi, 0.5 * np.pi, xtol=1e-15)
        bottom = brentq(self.piston_rate, 0.5 * np.pi, 1.5 * np.pi, xtol=1e-15)
        return top, bottom

    @property
    def area(self):
        return np.pi * self.bore**2 / 4

    def prepare(self):
        self.top, self.bottom = self.dead_centres()
        self.highest = self.piston(self.top)
        self.swept = self.area * (self.highest - self.piston(self.bottom))
        self.clearance = self.clearance_ratio * self.swept
        behind = self.back_pressure
        self.behind = self.suction_pressure if behind is None else behind
        return self

    def volume(self, theta):
        return self.clearance + self.area * (self.highest - self.piston(theta))

    def pressure(self, theta, inward):
        if self.pressure_over_angle is not None:
            return self.pressure_over_angle(theta)
        biggest = self.clearance + self.swept
        volume = max(self.volume(theta), 1e-9 * self.swept)  # no power of it overflows
        if inward:
            compressed = self.suction_pressure * (biggest / volume) ** self.exponent
            return min(compressed, self.discharge_pressure)
        reached = self.discharge_pressure
        if self.clearance > 0:
            closed = self.suction_pressure * (biggest / self.clearance) ** self.exponent
            reached = min(reached, closed)
        expanded = reached * (self.clearance / volume) ** self.exponent
        return max(expanded, self.suction_pressure)

    def gas_force(self, theta, inward):
        if not self.has_gas:
            return 0.0
        return (self.pressure(theta, inward) - self.behind) * self.area

    def kinks(self):
        """Angles in the turn after the top dead centre, ends included."""
        places = [self.top, self.bottom, self.top + 2 * np.pi]
        places += [a + 2 * np.pi * (a < self.top) for a in (np.pi / 2, 3 * np.pi / 2)]
        if self.has_gas and self.pressure_over_angle is None:
            ratio = (self.discharge_pressure / self.suction_pressure) ** (1 / self.exponent)
            biggest = self.clearance + self.swept
            opens = lambda a: self.volume(a) - biggest / ratio  # noqa: E731
            if opens(self.top + 2 * np.pi) < 0:
                places.append(brentq(opens, self.bottom, self.top + 2 * np.pi, xtol=1e-15))
                closes = lambda a: self.volume(a) - self.clearance * ratio  # noqa: E731
                if self.clearance > 0:
                    places.append(brentq(closes, self.top, self.bottom, xtol=1e-15))
        return np.unique(places)

    # ---------------------------------------------------------------- balances
    def main_moment(self, theta, speed, answer):
        """Friction moment of the main journal, opposite to the speed."""
        del theta, speed
        coefficient, diameter = self.pins.get("main_journal", (0.0, 0.0))
        return coefficient * diameter / 2 * math.hypot(answer[9], answer[10])

    def system(self, theta, speed):
        """Matrix over (alpha, Gx, Gy, beta, x; Tx, Ty, Sx, Sy, Qx, Qy, N) and the constant side."""
        r, l, b = self.crank_radius, self.conrod_length, self.conrod_centre
        beta = self.rod_angle(theta)
        turn = self.rod_rate(theta) * speed
        pin = r * np.array([np.cos(theta), np.sin(theta)])
        along = np.array([np.cos(beta), np.sin(beta)])
        across = np.array([-np.sin(beta), np.cos(beta)])
        pin_across = np.array([-pin[1], pin[0]])
        g = np.asarray(self.gravity)
        matrix, right = np.zeros((12, 12)), np.zeros(12)
        al, gx, gy, be, x, tx, ty, sx, sy, qx, qy, n = range(12)
        for i, (acc, t, s) in enumerate(((gx, tx, sx), (gy, ty, sy))):  # forces on the rod
            matrix[i, [acc, t, s]] = self.conrod_mass, -1, -1
            right[i] = self.conrod_mass * g[i]
        to_small, to_big = (l - b) * along, -b * along  # moments on the rod about its mass centre
        matrix[2, be] = self.conrod_inertia
        matrix[2, [tx, ty]] = to_small[1], -to_small[0]
        matrix[2, [sx, sy]] = to_big[1], -to_big[0]
        matrix[3, [x, tx]] = self.piston_mass, 1  # forces on the piston
        right[3] = self.piston_mass * g[0]
        matrix[4, [n, ty]] = 1, -1
        right[4] = -self.piston_mass * g[1]
        centre = self.crank_unbalance * pin / r  # mass times place of the crank's mass centre
        swing = self.crank_unbalance * pin_across / r
        for i, (q, s) in enumerate(((qx, sx), (qy, sy))):  # forces on the crank
            matrix[5 + i, [q, s, al]] = 1, -1, -swing[i]
            right[5 + i] = -centre[i] * speed**2 - self.crank_mass * g[i]
        matrix[7, al] = self.crank_inertia  # moments on the crank about its axis
        matrix[7, [sx, sy]] = -pin[1], pin[0]
        right[7] = cross(centre, g)
        for i, acc in enumerate((gx, gy)):  # the rod's mass centre belongs to the crank pin
            matrix[8 + i, [acc, al, be]] = 1, -pin_across[i], -b * across[i]
            right[8 + i] = -pin[i] * speed**2 - b * along[i] * turn**2
        for i, (acc, share) in enumerate(((x, 1), (x, 0))):  # the piston pin stays on its line
            matrix[10 + i, acc] += share
            matrix[10 + i, [al, be]] = -pin_across[i], -l * across[i]
            right[10 + i] = -pin[i] * speed**2 - l * along[i] * turn**2
        return matrix, right

    def solve(self, theta, speed, motor_torque, inward=None, swing=None):
        """Accelerations, forces and friction torques on the crank at one instant.

        `inward` and `swing` give the signs of piston velocity and rod rate, where the angle itself
        is too close to a kink to tell.
        """
        inward = self.piston_rate(theta) > 0 if inward is None else inward
        swing = -np.sign(self.rod_rate(theta)) if swing is None else swing
        matrix, constant = self.system(theta, speed)
        inverse = np.linalg.inv(matrix)
        gas = self.gas_force(theta, inward)
        constant[3] -= gas
        constant[7] += motor_torque
        # by plain numbers: NumPy's functions of scalars would take most of the time of a turn
        forward = float(np.sign(speed))
        sliding = forward if inward else -forward
        rod_rate = float(self.rod_rate(theta))
        turning = float(np.sign(speed * (1 - rod_rate)))
        small, big = (
            self.pins[name][0] * self.pins[name][1] / 2 if name in self.pins else 0.0
            for name in ("piston_pin", "crank_pin")
        )
        answer = inverse @ constant
        for _ in range(200):
            _, _, _, _, _, tx, ty, sx, sy, _, _, n = answer.tolist()
            wall = self.wall * abs(n)
            on_small = swing * forward * small * math.hypot(tx, ty)
            on_big = turning * big * math.hypot(sx, sy)
            on_main = forward * self.main_moment(theta, speed, answer)
            right = constant.copy()
            right[3] -= sliding * wall
            right[2] += on_small + on_big
            right[7] -= on_big + on_main
            new = inverse @ right
            done = abs(new - answer).max() <= 1e-14 * abs(new).max()
            answer = new
            if done:
                break
        losses = {
            "wall": sliding * wall * self.piston_rate(theta),
            "piston_pin": -on_small * rod_rate,
            "crank_pin": on_big * (1 - rod_rate),
            "main_journal": on_main,
        }
        return answer, losses, gas * self.piston_rate(theta)

    def side_force(self, theta, speed, acceleration, gas):
        """The wall force for a given motion, from one scalar equation by bracketing."""
        r, l, b = self.crank_radius, self.conrod_length, self.conrod_centre
        beta, rate = self.rod_angle(theta), self.rod_rate(theta)
        turn = rate * speed
        pin = r * np.array([np.cos(theta), np.sin(theta)])
        pin_acc = -pin * speed**2 + np.array([-pin[1], pin[0]]) * acceleration
        along = np.array([np.cos(beta), np.sin(beta)])
        across = np.array([-np.sin(beta), np.cos(beta)])
        # the piston pin has no acceleration across its line
        turn_acc = (l * along[1] * turn**2 - pin_acc[1]) / (l * across[1])
        piston_acc = (pin_acc + l * (turn_acc * across - turn**2 * along))[0]
        centre_acc = pin_acc + b * (turn_acc * across - turn**2 * along)
        g = np.asarray(self.gravity)
        sliding = np.sign(self.piston_rate(theta) * speed)

        def moment(name, load, rotation):
            if name not in self.pins:
                return 0.0
            coefficient, diameter = self.pins[name]
            return -np.sign(rotation) * coefficient * diameter / 2 * np.hypot(*load)

        def excess(n):
            friction = -sliding * self.wall * abs(n)
            t = np.array(
                [
                    -gas + friction - self.piston_mass * (piston_acc - g[0]),
                    n + self.piston_mass * g[1],
                ]
            )
            s = self.conrod_mass * (centre_acc - g) - t
            total = cross((l - b) * along, t) + cross(-b * along, s)
            total += moment("piston_pin", t, turn) + moment("crank_pin", s, turn - speed)
            return total - self.conrod_inertia * turn_acc

        reach = 1e3
        while excess(reach) * excess(-reach) > 0:
            reach *= 10
            assert reach < 1e15, "no bracket"
        return brentq(excess, -reach, reach, xtol=1e-13 * reach, rtol=1e-15, maxiter=500), excess


@dataclass
class Turn:
    efficiency: float
    fluctuation: float
    mean_speed: float
    level: float
    work: dict
    changes: list  # angles where the wall force changes its side
    pieces: list = field(default_factory=list)  # (left, right, dense solution) between the kinks


def orbit(machine: Machine, motor, mean_speed=None, guess=None, rtol=1e-11) -> Turn:
    """The periodic state. `motor(speed, level)`; with a mean speed the level is an unknown."""
    machine.prepare()
    names = ("wall", "piston_pin", "crank_pin", "main_journal")
    edges = machine.kinks()
    scale = mean_speed or guess

    def integrate(first, level, edges, dense=False, rtol=rtol):
        y = np.array([first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        pieces, changes = [], []
        for left, right in pairwise(edges):
            middle = 0.5 * (left + right)
            inward = machine.piston_rate(middle) > 0
            swing = -np.sign(machine.rod_rate(middle))

            def rate(theta, y, inward=inward, swing=swing):
                speed = y[0]
                torque = motor(speed, level)
                answer, losses, gas = machine.solve(theta, speed, torque, inward, swing)
                return [answer[0] / speed, 1 / speed, torque, gas] + [losses[k] for k in names]

            def side(theta, y, inward=inward, swing=swing):
                return machine.solve(theta, y[0], motor(y[0], level), inward, swing)[0][-1]

            answer = solve_ivp(
                rate,
                (left, right),
                y,
                method="DOP853",
                rtol=rtol,
                atol=rtol * np.array([scale, 1 / scale, 100, 100, 1, 1, 1, 1]),
                dense_output=dense,
                events=side if dense else None,
            )
            assert answer.success, answer.message
            y = answer.y[:, -1]
            if dense:
                inside = answer.t_events[0]
                changes += [a for a in inside if left + 1e-6 < a < right - 1e-6]
                pieces.append((left, right, answer.sol))
        return y, pieces, changes

    def close(edges, start, rtol, xtol):
        def gaps(unknown):
            first = unknown[0] * scale
            end, _, _ = integrate(first, unknown[1] if mean_speed else 1.0, edges, rtol=rtol)
            gap = [(end[0] - first) / scale]
            return gap + ([end[1] * mean_speed / (2 * np.pi) - 1] if mean_speed else [])

        # The gaps carry the error of the integration: hybr stops where it no longer falls.
        found = root(gaps, start, method="hybr", options={"xtol": xtol, "eps": 1e-6})
        assert np.max(np.abs(found.fun)) < 1e3 * xtol, found
        return found.x

    # The first time only to find where loads reverse: a millionth of the speed moves them by as little.
    coarse = max(rtol, 1e-8)
    level = 1.0
    if mean_speed:  # a first level from constant speed
        end, _, _ = integrate(scale, 1.0, edges[[0, -1]], rtol=coarse)
        level = 0.9 * (end[3] + end[4:].sum()) / (2 * np.pi) / motor(mean_speed, 1.0)
        level = max(level, 1.0)
    unknown = close(edges, [1.0, level] if mean_speed else [1.0], coarse, 1e-7)
    # once more with the load reversals as edges
    _, _, changes = integrate(
        unknown[0] * scale, unknown[1] if mean_speed else 1.0, edges, dense=True
    )
    edges = np.unique(np.concatenate([edges, changes]))
    unknown = close(edges, unknown, rtol, 1e-12)
    level = unknown[1] if mean_speed else 1.0
    end, pieces, _ = integrate(unknown[0] * scale, level, edges, dense=True)
    lowest, highest = np.inf, -np.inf
    for left, right, sol in pieces:
        x = np.linspace(left, right, 60)
        speed = sol(x)[0]
        lowest, highest = min(lowest, speed.min()), max(highest, speed.max())
        for sign, i in ((1, np.argmin(speed)), (-1, np.argmax(speed))):
            bounds = x[max(i - 1, 0)], x[min(i + 1, 59)]
            best = minimize_scalar(
                lambda a, sol=sol, sign=sign: sign * sol(a)[0],
                bounds=bounds,
                method="bounded",
                options={"xatol": 1e-10},
            )
            value = sign * best.fun
            lowest, highest = min(lowest, value), max(highest, value)
    mean = 2 * np.pi / end[1]
    work = dict(zip(("motor", "gas", *names), end[2:], strict=True))
    fluctuation = (highest - lowest) / mean
    return Turn(work["gas"] / work["motor"], fluctuation, mean, level, work, changes, pieces)


def one_turn(machine: Machine, motor, angle, speed, rtol=1e-10):
    """Integrate one turn from any state; returns the gap of speed, the mean speed and the work.

    A state on the periodic orbit comes back to itself, so this checks an orbit without searching.
    """
    names = ("wall", "piston_pin", "crank_pin", "main_journal")
    kinks = machine.kinks()
    kinks = np.concatenate([kinks - 2 * np.pi, kinks, kinks + 2 * np.pi])
    inside = kinks[(kinks > angle) & (kinks < angle + 2 * np.pi)]
    y = np.array([speed, 0, 0, 0, 0, 0, 0, 0], float)
    for left, right in pairwise(np.concatenate([[angle], np.unique(inside), [angle + 2 * np.pi]])):
        middle = 0.5 * (left + right)
        inward = machine.piston_rate(middle) > 0
        swing = -np.sign(machine.rod_rate(middle))

        def rate(theta, y, inward=inward, swing=swing):
            torque = motor(y[0])
            answer, losses, gas = machine.solve(theta, y[0], torque, inward, swing)
            return [answer[0] / y[0], 1 / y[0], torque, gas] + [losses[k] for k in names]

        scale = np.array([speed, 1 / speed, 100, 100, 1, 1, 1, 1])
        answer = solve_ivp(rate, (left, right), y, method="DOP853", rtol=rtol, atol=rtol * scale)
        assert answer.success, answer.message
        y = answer.y[:, -1]
    work = dict(zip(("motor", "gas", *names), y[2:], strict=True))
    return y[0] / speed - 1, 2 * np.pi / y[1], work


def from_compressor(compressor) -> Machine:
    """Read the numbers of a machine of the package."""
    numbers = lambda part: {  # noqa: E731
        name: float(value)
        for name, value in vars(part).items()
        if value is not None and name in Machine.__dataclass_fields__
    }
    values, shaft = numbers(compressor.mechanism), compressor.crankshaft
    for name in ("inertia", "mass", "unbalance"):
        values[f"crank_{name}"] = float(getattr(shaft, name))
    if compressor.gas is not None:
        values |= numbers(compressor.gas)
    friction, pins, wall = compressor.friction, {}, 0.0
    if friction is not None:
        wall = 0.0 if friction.wall is None else float(friction.wall.coefficient)
    for name in ("piston_pin", "crank_pin", "main_journal"):
        law = getattr(shaft if name == "main_journal" else friction, name, None)
        if hasattr(law, "coefficient"):
            pins[name] = (float(law.coefficient), float(law.diameter))
    gravity = (0.0, 0.0) if compressor.gravity is None else tuple(map(float, compressor.gravity))
    has_gas = compressor.gas is not None
    machine = Machine(**values, gravity=gravity, wall=wall, pins=pins, has_gas=has_gas)
    return machine.prepare()
