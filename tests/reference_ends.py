"""Double-acting cylinder with valves, rod, rings and packing in time, in NumPy and SciPy.

Shares nothing with the package: closed forms of a perfect gas, signs of pressure and velocity as they
come, and `solve_ivp` from contact to contact of the valves, at a speed that nothing changes.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

R, KAPPA = 287.0, 1.4
C_P = R * KAPPA / (KAPPA - 1)
C_V = R / (KAPPA - 1)
CRITICAL = (2 / (KAPPA + 1)) ** (KAPPA / (KAPPA - 1))


@dataclass
class Valve:
    """Plate with the column of gas in its port."""

    mass: float
    damping: float
    stiffness: float
    preload: float
    stop: float
    diameter: float
    length: float
    flow: float = 0.65
    push: float = 1.1
    held: float = 0.0  # [N] of an unloader
    release: float | None = None  # [rad] own angle at which its force falls, within 10 degrees

    def area(self, lift):
        curtain = np.pi * self.diameter * max(lift, 0.0)
        hole = np.pi / 4 * self.diameter**2
        return self.flow * curtain / np.sqrt(1 + (curtain / hole) ** 2)

    def force(self, lift, before, behind, angle):
        face = self.push * np.pi / 4 * self.diameter**2
        held = self.held
        if self.release is not None:
            # It rises from a quarter turn behind the dead centre on.
            since = (angle - np.pi / 2) % (2 * np.pi)
            until = self.release - np.pi / 2
            steps = np.clip(np.array([since, since - until]) / (np.pi / 18), 0.0, 1.0)
            rise, fall = 6 * steps**5 - 15 * steps**4 + 10 * steps**3
            held *= rise - fall
        return face * (before - behind) - self.stiffness * (lift + self.preload) + held


@dataclass
class DoubleActing:
    """One throw; every list has the head end first."""

    bore: float
    radius: float
    rod_length: float
    rod: float
    clearance: tuple
    valves: tuple  # suction and discharge valve of each end
    suction: tuple  # pressure and temperature
    discharge: tuple
    speed: float
    rings: float  # pi D g^3/(12 mu L)
    packing: float

    def __post_init__(self):
        face = np.pi / 4 * self.bore**2
        self.area = face, face - np.pi / 4 * self.rod**2
        self.stroke = 2 * self.radius

    def volumes(self, angle):
        """Of both ends, with their rates over the angle."""
        root = np.sqrt(self.rod_length**2 - (self.radius * np.sin(angle)) ** 2)
        down = self.radius * (1 - np.cos(angle)) + self.rod_length - root
        rate = self.radius * np.sin(angle) + self.radius**2 * np.sin(angle) * np.cos(angle) / root
        head, crank = self.area
        return (
            (head * (down + self.clearance[0] * self.stroke), head * rate),
            (crank * (self.stroke - down + self.clearance[1] * self.stroke), -crank * rate),
        )

    def gases(self, angle, y):
        """Pressure, density and temperature in both ends."""
        out = []
        for end, (volume, _) in enumerate(self.volumes(angle)):
            m, T = y[8 * end : 8 * end + 2]
            out.append((m / volume * R * T, m / volume, T))
        return out

    def port(self, a, b, lift, u, valve):
        """Flow from a to b, its enthalpy, and the acceleration of the column."""
        high, low = (a, b) if a[0] > b[0] else (b, a)
        ratio = max(low[0] / high[0], CRITICAL)
        drop = C_P * high[2] * (1 - ratio ** ((KAPPA - 1) / KAPPA))
        drop = drop if a[0] > b[0] else -drop
        up, down = (a, b) if u > 0 else (b, a)
        density = up[1] * min(max(down[0] / up[0], CRITICAL), 1.0) ** (1 / KAPPA)
        return (
            valve.area(lift) * density * u,
            C_P * up[2],
            (drop - 0.5 * u * abs(u)) / valve.length,
        )

    def rhs(self, angle, y, modes):
        gases, volumes = self.gases(angle, y), self.volumes(angle)
        lines = [(p, p / (R * T), T) for p, T in (self.suction, self.discharge)]
        (p_h, rho_h, T_h), (p_c, rho_c, T_c) = gases
        past = self.rings * (p_h - p_c) * 0.5 * (rho_h + rho_c)
        share = (p_h - p_c) / np.hypot(p_h - p_c, 0.02 * self.suction[0])
        carried = past * C_P * 0.5 * ((1 + share) * T_h + (1 - share) * T_c)
        out = (p_c - lines[0][0]) * 0.5 * (rho_c + lines[0][1]) * self.packing
        vented = out * C_P * (T_c if out > 0 else lines[0][2])
        leaks = (past, carried), (out - past, vented - carried)
        slopes, sums = [], []
        for end, here in enumerate(gases):
            m, T = y[8 * end : 8 * end + 2]
            flows, motion = [], []
            sides = ((lines[0], here), (here, lines[1]))
            for i, (valve, (a, b)) in enumerate(zip(self.valves[end], sides, strict=True)):
                x, v, u = y[8 * end + 2 + 3 * i : 8 * end + 5 + 3 * i]
                mode = modes[2 * end + i]
                lift = x if mode == 1 else valve.stop * (mode == 2)
                flow, h, rise = self.port(a, b, lift, u, valve)
                flows.append((flow, flow * h) if mode else (0.0, 0.0))
                push = valve.force(lift, a[0], b[0], angle + end * np.pi) - valve.damping * v
                free = mode == 1
                motion += [v if free else 0.0, push / valve.mass if free else 0.0]
                motion.append(rise if mode else 0.0)
            (come, with_it), (go, away) = flows
            leak, lost = leaks[end]
            m_1 = come - go - leak
            work = here[0] * volumes[end][1] * self.speed
            T_1 = (with_it - away - lost - work - C_V * T * m_1) / (m * C_V)
            slopes += [m_1, T_1, *motion]
            sums += [come, go, away, work]
        return np.array([*slopes, *sums]) / self.speed

    def revolution(self, y, modes, start, rtol=1e-11):
        """States after a revolution, the sums of each end, the modes, and the pressures by the way.

        The sums are those of the gas that comes, goes, of the enthalpy of this, and of the work.
        """
        course = []
        y = np.array([*y, *[0.0] * 8])
        modes = list(modes)
        scale = np.array([*[1e-3, 300.0, *[1e-3, 1.0, 50.0] * 2] * 2, *[1e-3, 1e-3, 1e3, 1e3] * 2])
        angle, last = start, start + 2 * np.pi
        end_of_turn = last

        def contact(number, kind):
            valve = self.valves[number // 2][number % 2]
            place = 8 * (number // 2) + 2 + 3 * (number % 2)

            def event(angle, y):
                if kind == "turn":
                    return y[place + 1]
                if kind != "force":
                    return y[place] if kind == "seat" else valve.stop - y[place]
                here = self.gases(angle, y)[number // 2][0]
                sides = (self.suction[0], here), (here, self.discharge[0])
                lift = valve.stop * (modes[number] == 2)
                force = valve.force(lift, *sides[number % 2], angle + number // 2 * np.pi)
                return -force if modes[number] == 0 else force

            event.terminal, event.direction = kind != "turn", 0 if kind == "turn" else -1
            return event

        while angle < end_of_turn - 1e-13:
            names = [
                (number, kind)
                for number in range(4)
                for kind in (("seat", "stop", "turn") if modes[number] == 1 else ("force",))
            ]
            events = [contact(*name) for name in names]
            found = solve_ivp(
                lambda t, y: self.rhs(t, y, modes), (angle, last), y, "DOP853", rtol=rtol,
                atol=rtol * scale, events=events, max_step=0.05,
            )  # fmt: skip
            assert found.status >= 0, found.message
            beyond = []
            for (number, kind), times, states in zip(
                names, found.t_events, found.y_events, strict=True
            ):
                stop = self.valves[number // 2][number % 2].stop
                place = 8 * (number // 2) + 2 + 3 * (number % 2)
                for time, state in zip(times, states, strict=True):
                    if kind == "turn" and abs(state[place] / stop - 0.5) > 0.5 + 1e-12:
                        beyond.append(time)
            if beyond:
                last = min(beyond)
                continue
            for at, state in zip(found.t, found.y.T, strict=True):
                course.append([at, *[gas[0] for gas in self.gases(at, state)]])
            angle, y, last = found.t[-1], found.y[:, -1].copy(), end_of_turn
            if found.status == 0:
                continue
            number, kind = next(
                name for name, times in zip(names, found.t_events, strict=True)
                if times.size and name[1] != "turn"
            )  # fmt: skip
            valve = self.valves[number // 2][number % 2]
            place = 8 * (number // 2) + 2 + 3 * (number % 2)
            here = self.gases(angle, y)[number // 2][0]
            sides = (self.suction[0], here), (here, self.discharge[0])
            at = 0.0 if kind == "seat" or modes[number] == 0 else valve.stop
            force = valve.force(at, *sides[number % 2], angle + number // 2 * np.pi)
            y[place], y[place + 1] = at, 0.0
            if kind == "force":
                if modes[number] == 0:
                    y[place + 2] = 0.0
                modes[number] = 1
            elif kind == "seat":
                modes[number] = 0 if force <= 0 else 1
            else:
                modes[number] = 2 if force > 0 else 1
        return y[:16], y[16:].reshape(2, 4), modes, np.array(course).T
