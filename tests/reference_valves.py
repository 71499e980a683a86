"""A compressor with valves in time, written from the equations, with SciPy and a perfect gas.

Shares nothing with the package: closed forms of a perfect gas, a rod without mass, signs of pressure and
velocity taken as they are, and `solve_ivp` from contact to contact of the valves. Temperatures of plenums
are states, or given.
"""

import numpy as np
from scipy.integrate import solve_ivp

AIR = {"R": 287.0, "k": 1.4}


class Reference:
    """The golden air machine; chains are lists of (volume, temperature or None, length, area, loss).

    Args:
        suction_chain: from the line to the valve; the neck of a plenum stands before it.
        discharge_chain: from the valve to the line; the neck of a plenum stands behind it.
        inertia: [kg m^2] of the crank.
        motor: torque [N m] over speed [rad/s].
        changes: of the numbers below.

    Lifts are followed to where they turn, so that no touch of seat or stop is passed over.
    """

    def __init__(self, suction_chain=(), discharge_chain=(), inertia=8e-4, motor=None, **changes):
        self.r, self.l, self.bore, self.c = 9.5e-3, 44e-3, 22e-3, 0.025
        self.piston_mass = 0.05
        self.lines = (1e5, 300.0), (5e5, 430.0)
        self.wall, self.mu, self.conductivity = 350.0, 1.9e-5, 0.027
        self.gap, self.gap_length = 5e-6, 12e-3
        # mass, damping, stiffness, preload, stop, port diameter, C_d, C_f, port length
        self.valves = (
            (1.5e-4, 0.02, 250.0, 0.0, 1.5e-3, 7e-3, 0.65, 1.1, 5e-3),
            (1.2e-4, 0.03, 700.0, 1e-4, 9e-4, 5e-3, 0.65, 1.1, 5e-3),
        )
        self.stiction = (0.0, 1.0), (0.0, 1.0)  # coefficient of v/(x + x_oil)^3 and x_oil
        self.restitution, self.rest_speed = 0.0, 1e-4  # of both valves; [m/s] rebound that rests
        self.chains = suction_chain, discharge_chain
        self.inertia, self.motor = inertia, motor
        vars(self).update(changes)
        self.area = np.pi / 4 * self.bore**2
        self.swept = 2 * self.r * self.area

    def piston(self, th):
        """Position below the top dead centre and its derivative."""
        root = np.sqrt(self.l**2 - (self.r * np.sin(th)) ** 2)
        x = self.r + self.l - self.r * np.cos(th) - root
        return x, self.r * np.sin(th) + self.r**2 * np.sin(th) * np.cos(th) / root

    def piston_2(self, th, h=1e-4):
        return (self.piston(th + h)[1] - self.piston(th - h)[1]) / (2 * h)

    def nozzle(self, p1, rho1, p2):
        """Enthalpy drop from the side of the higher pressure."""
        k = AIR["k"]
        r = max(p2 / p1, (2 / (k + 1)) ** (k / (k - 1)))
        return k / (k - 1) * p1 / rho1 * (1 - r ** ((k - 1) / k))

    def port(self, a, b, x, u, valve, is_open):
        """Flow from a to b, its enthalpy, and the acceleration of the column."""
        k = AIR["k"]
        (p_a, rho_a, _), (p_b, rho_b, _) = a, b
        diameter, c_d, length = valve[5], valve[6], valve[8]
        drop = self.nozzle(p_a, rho_a, p_b) if p_a > p_b else -self.nozzle(p_b, rho_b, p_a)
        rate = (drop - 0.5 * u * abs(u)) / length if is_open else 0.0
        up, down = (a, b) if u > 0 else (b, a)
        r_c = (2 / (k + 1)) ** (k / (k - 1))
        density = up[1] * min(max(down[0] / up[0], r_c), 1.0) ** (1 / k)
        curtain, hole = np.pi * diameter * max(x, 0.0), np.pi / 4 * diameter**2
        flow = c_d * curtain / np.sqrt(1 + (curtain / hole) ** 2) * density * u if is_open else 0.0
        return flow, self.h(up[2]), rate

    def h(self, T):
        return AIR["R"] * AIR["k"] / (AIR["k"] - 1) * T

    def gas(self, m, T, V):
        rho = m / V
        return rho * AIR["R"] * T, rho, T

    def line(self, which):
        p, T = self.lines[which]
        return p, p / (AIR["R"] * T), T

    def sides(self, y):
        """Gas before the suction valve and behind the discharge valve, and slopes of the chains."""
        return self.walk(y, None, None)[:2]

    def walk(self, y, suction, discharge):
        """Both chains; `suction` and `discharge` are flow and stream of enthalpy through the valves."""
        rates, ends, place = [], [], 10
        for which, chain in enumerate(self.chains):
            line = self.line(which)
            states = []
            for i, (_, given, *_) in enumerate(chain):
                flow, m, T = y[place + 3 * i : place + 3 * i + 3]
                states.append((flow, m, T if given is None else given))
            gases = [self.gas(m, T, c[0]) for (_, m, T), c in zip(states, chain, strict=True)]
            # along the chain from the line to the valve for suction, the other way for discharge
            towards = [line, *gases] if which == 0 else [*gases, line]
            ends.append((towards[-1] if which == 0 else towards[0]) if chain else line)
            if suction is None:
                place += 3 * len(chain)
                continue
            flows = [s[0] for s in states]
            # a fifth of the flow of a full cylinder, below which both sides of a neck mix
            least = 0.2 * self.line(0)[1] * self.swept * self.scale / (2 * np.pi)
            sizes = [np.hypot(f, least) for f in flows]
            density, carried = [], []
            for i, (f, size) in enumerate(zip(flows, sizes, strict=True)):
                share = 0.5 + 0.5 * f / size
                (_, rho_a, T_a), (_, rho_b, T_b) = towards[i], towards[i + 1]
                density.append(share * rho_a + (1 - share) * rho_b)
                carried.append(f * (share * self.h(T_a) + (1 - share) * self.h(T_b)))
            for i, (_, given, length, area, loss) in enumerate(chain):
                f, m, T = states[i]
                dp = towards[i][0] - towards[i + 1][0]
                lost = loss / (2 * density[i] * area**2) * f * sizes[i]
                f_1 = (dp - lost) * area / length
                if which == 0:
                    last = i == len(chain) - 1
                    come, go = (f, carried[i]), suction if last else (flows[i + 1], carried[i + 1])
                else:
                    come, go = (
                        discharge if i == 0 else (flows[i - 1], carried[i - 1]),
                        (f, carried[i]),
                    )
                m_1 = come[0] - go[0]
                c_v = AIR["R"] / (AIR["k"] - 1)
                T_1 = (come[1] - go[1] - c_v * T * m_1) / (m * c_v)
                rates += [f_1, m_1, T_1 if given is None else 0.0]
            place += 3 * len(chain)
        return *ends, rates

    def rhs(self, t, y, modes):
        th, w, m, T = y[:4]
        x, x_1 = self.piston(th)
        V = self.area * x + self.c * self.swept
        here = self.gas(m, T, V)
        s, d, _ = self.walk(y, None, None)
        flows = []
        slopes = []
        for i, (a, b) in enumerate(((s, here), (here, d))):
            lift, v, u = y[4 + 3 * i : 7 + 3 * i]
            mass, damping, _, _, stop, *_ = self.valves[i]
            place = lift if modes[i] == 1 else stop * (modes[i] == 2)
            flow, h, u_1 = self.port(a, b, place, u, self.valves[i], modes[i] > 0)
            flows.append((flow, h))
            push = self.push(i, place, a, b) - damping * v
            coefficient, film = self.stiction[i]
            push -= coefficient * v / (lift + film) ** 3
            free = modes[i] == 1
            slopes += [v if free else 0.0, push / mass if free else 0.0, u_1]
        p_c, rho_c, T_c = self.line(0)
        leak = np.pi * self.bore * self.gap**3 / (12 * self.mu * self.gap_length)
        leak *= (here[0] - p_c) * (here[1] + rho_c) / 2
        h_leak = self.h(T if leak > 0 else T_c)
        speed = 2 * self.r * max(abs(w), 1e-3 * self.scale) / np.pi
        number = 0.7 * (here[1] * speed * self.bore / self.mu) ** 0.7
        wall = 2 * self.area + 4 * V / self.bore
        heat = number * self.conductivity / self.bore * wall * (self.wall - T)
        heat = heat if self.conductivity else 0.0
        (f_s, h_s), (f_d, h_d) = flows
        m_1 = f_s - f_d - leak
        c_v = AIR["R"] / (AIR["k"] - 1)
        energy = f_s * h_s - f_d * h_d - leak * h_leak + heat - here[0] * self.area * x_1 * w
        T_1 = (energy - c_v * T * m_1) / (m * c_v)
        chain = self.walk(y, *((f, f * h) for f, h in flows))[2]
        J, J_1 = self.inertia + self.piston_mass * x_1**2, 0.0
        J_1 = 2 * self.piston_mass * x_1 * self.piston_2(th)
        gas = (here[0] - p_c) * self.area * x_1
        torque = self.motor(w) + gas - 0.5 * J_1 * w**2
        return np.array([w, torque / J, m_1, T_1, *slopes, *chain, f_d, h_d * f_d])

    def push(self, i, place, a, b):
        _, _, stiffness, preload, _, diameter, _, c_f, _ = self.valves[i]
        return c_f * np.pi / 4 * diameter**2 * (a[0] - b[0]) - stiffness * (place + preload)

    def forces(self, y):
        x, _ = self.piston(y[0])
        here = self.gas(y[2], y[3], self.area * x + self.c * self.swept)
        s, d, _ = self.walk(y, None, None)
        return [(s, here), (here, d)]

    def run(self, duration, angle, speed, scale, rtol=1e-10, start=None):
        """State at the end: angle, speed, m, T, valves, chains, delivered mass and enthalpy."""
        self.scale = scale
        x, _ = self.piston(angle)
        p, rho, T = self.line(0)
        y = [angle, speed, rho * (self.area * x + self.c * self.swept), T, *[0.0] * 6]
        for chain in self.chains:
            for volume, given, *_ in chain:
                at = T if given is None else given
                y += [0.0, p / (AIR["R"] * at) * volume, at]
        y = y if start is None else [angle, speed, *start]
        y, t, modes = np.array([*y, 0.0, 0.0]), 0.0, [0, 0]

        def contact(i, kind):
            stop = self.valves[i][4]

            def event(t, y):
                if kind == "turn":
                    return y[5 + 3 * i]
                force = self.push(i, stop * (modes[i] == 2), *self.forces(y)[i])
                if kind == "force":
                    return -force if modes[i] == 0 else force
                return y[4 + 3 * i] if kind == "seat" else stop - y[4 + 3 * i]

            event.terminal, event.direction = kind != "turn", 0 if kind == "turn" else -1
            return event

        self.touches = [[0, 0], [0, 0]]  # of every valve, on its seat and on its stop
        last = duration  # where the next march ends; before a turn beyond the stop, that turn
        while t < duration - 1e-13:
            events = []
            for i in (0, 1):
                kinds = ("seat", "stop", "turn") if modes[i] == 1 else ("force",)
                events += [(i, kind) for kind in kinds]
            longest = 2e-4
            found = solve_ivp(
                lambda t, y: self.rhs(t, y, modes), (t, last), y, "DOP853", rtol=rtol,
                atol=rtol * np.maximum(np.abs(y), [1, 1, 1e-6, 100, *[1e-4, 1, 10] * 2,
                                                   *[1e-4, 1e-6, 100] * sum(map(len, self.chains)),
                                                   1e-6, 1.0]),
                events=[contact(*one) for one in events], max_step=longest,
            )  # fmt: skip
            assert found.status >= 0, found.message
            # a lift that turns beyond the stop or the seat was there and back within one step
            beyond = [
                time
                for (i, kind), *turns in zip(events, found.t_events, found.y_events, strict=True)
                for time, state in zip(*turns, strict=True)
                if kind == "turn" and abs(state[4 + 3 * i] / self.valves[i][4] - 0.5) > 0.5 + 1e-13
            ]
            if beyond:
                last = min(beyond)
                continue
            t, y, last = found.t[-1], found.y[:, -1].copy(), duration
            if found.status == 0:
                continue
            i, kind = next(
                one for one, times in zip(events, found.t_events, strict=True)
                if times.size and one[1] != "turn"
            )  # fmt: skip
            place = 4 + 3 * i
            force = self.push(i, self.valves[i][4] * (kind == "stop"), *self.forces(y)[i])
            if kind == "force":
                y[place] = 0.0 if modes[i] == 0 else self.valves[i][4]
                if modes[i] == 0:
                    y[place + 2] = 0.0
                y[place + 1] = 0.0
                modes[i] = 1
                y[place] += 1e-15 if y[place] == 0 else 0.0
            else:
                rebound = -self.restitution * y[place + 1]
                y[place] = 0.0 if kind == "seat" else self.valves[i][4]
                self.touches[i][kind == "stop"] += 1
                if abs(rebound) >= self.rest_speed:
                    y[place + 1] = rebound
                    continue
                y[place + 1] = 0.0
                rests = force <= 0 if kind == "seat" else force > 0
                modes[i] = (0 if kind == "seat" else 2) if rests else 1
        return y
