"""The reference of `reference.py` for many machines at once, and the slider-link beside it.

Newton-Euler equations of every body with all pin and contact forces as unknowns, friction as a right
side that a fixed point makes consistent, DOP853 with a step of its own for every machine. NumPy alone;
the tableau is SciPy's. Nothing here is shared with the package.
"""

import copy
from itertools import pairwise

import numpy as np
from reference import Machine, cross, from_compressor
from scipy.integrate import DOP853


class Many(Machine):
    """Machines as one, with an array over them in every field."""

    names = ("wall", "piston_pin", "crank_pin", "main_journal")

    @classmethod
    def of(cls, machines):
        """Stack prepared machines of one kind."""
        self = cls.__new__(cls)
        for name, value in vars(machines[0]).items():
            if name == "pins":
                self.pins = {
                    pin: tuple(np.array([m.pins[pin][k] for m in machines]) for k in (0, 1))
                    for pin in value
                }
            elif name not in ("has_gas", "pressure_over_angle"):
                setattr(self, name, np.array([getattr(m, name) for m in machines]))
        return self

    def some(self, which):
        part = copy.copy(self)
        for name, value in vars(self).items():
            if name == "pins":
                part.pins = {pin: tuple(v[which] for v in pair) for pin, pair in value.items()}
            else:
                setattr(part, name, value[which])
        return part

    def pressure(self, theta, inward):
        biggest = self.clearance + self.swept
        volume = np.maximum(self.volume(theta), 1e-9 * self.swept)
        compressed = self.suction_pressure * (biggest / volume) ** self.exponent
        closed = self.suction_pressure * (biggest / self.clearance) ** self.exponent
        reached = np.minimum(self.discharge_pressure, closed)
        expanded = reached * (self.clearance / volume) ** self.exponent
        return np.where(
            inward,
            np.minimum(compressed, self.discharge_pressure),
            np.maximum(expanded, self.suction_pressure),
        )

    def gas_force(self, theta, inward):
        return (self.pressure(theta, inward) - self.behind) * self.area

    def signs(self, theta):
        """What a friction force opposes in the middle of a piece without reversals of motion."""
        return self.piston_rate(theta) > 0, -np.sign(self.rod_rate(theta))

    def pin_moment(self, name, load):
        if name not in self.pins:
            return 0.0 * load
        coefficient, diameter = self.pins[name]
        return coefficient * diameter / 2 * load

    def equations(self, theta, speed):
        """Those of `Machine.system`."""
        r, l, b = self.crank_radius, self.conrod_length, self.conrod_centre
        beta, rate = self.rod_angle(theta), self.rod_rate(theta)
        turn = rate * speed
        pin = r * np.array([np.cos(theta), np.sin(theta)])
        along = np.array([np.cos(beta), np.sin(beta)])
        across, pin_across = np.array([-along[1], along[0]]), np.array([-pin[1], pin[0]])
        g = self.gravity.T
        matrix, right = np.zeros((len(theta), 12, 12)), np.zeros((len(theta), 12))
        al, gx, gy, be, x, tx, ty, sx, sy, qx, qy, n = range(12)

        def put(row, constant, **entries):
            right[:, row] = constant
            for column, value in entries.items():
                matrix[:, row, places[column]] = value

        places = dict(
            al=al, gx=gx, gy=gy, be=be, x=x, tx=tx, ty=ty, sx=sx, sy=sy, qx=qx, qy=qy, n=n
        )
        put(0, self.conrod_mass * g[0], gx=self.conrod_mass, tx=-1, sx=-1)
        put(1, self.conrod_mass * g[1], gy=self.conrod_mass, ty=-1, sy=-1)
        small, big = (l - b) * along, -b * along
        put(2, 0, be=self.conrod_inertia, tx=small[1], ty=-small[0], sx=big[1], sy=-big[0])
        put(3, self.piston_mass * g[0], x=self.piston_mass, tx=1)
        put(4, -self.piston_mass * g[1], n=1, ty=-1)
        centre, swing = self.crank_unbalance * pin / r, self.crank_unbalance * pin_across / r
        side = -centre * speed**2 - self.crank_mass * g
        put(5, side[0], qx=1, sx=-1, al=-swing[0])
        put(6, side[1], qy=1, sy=-1, al=-swing[1])
        put(7, cross(centre, g), al=self.crank_inertia, sx=-pin[1], sy=pin[0])
        side = -pin * speed**2 - b * along * turn**2
        put(8, side[0], gx=1, al=-pin_across[0], be=-b * across[0])
        put(9, side[1], gy=1, al=-pin_across[1], be=-b * across[1])
        side = -pin * speed**2 - l * along * turn**2
        put(10, side[0], x=1, al=-pin_across[0], be=-l * across[0])
        put(11, side[1], al=-pin_across[1], be=-l * across[1])
        return matrix, right

    def solve(self, theta, speed, motor_torque, signs):
        """Acceleration, loss torques and gas torque on the crank, (m,) each."""
        inward, swing = signs
        matrix, constant = self.equations(theta, speed)
        inverse = np.linalg.inv(matrix)
        gas, rate, rod = (
            self.gas_force(theta, inward),
            self.piston_rate(theta),
            self.rod_rate(theta),
        )
        constant[:, 3] -= gas
        constant[:, 7] += motor_torque
        sliding = np.where(inward, 1.0, -1.0)

        def friction(answer):
            tx, ty, sx, sy, qx, qy, n = answer.T[5:]
            return (
                sliding * self.wall * np.abs(n),
                swing * self.pin_moment("piston_pin", np.hypot(tx, ty)),
                np.sign(1 - rod) * self.pin_moment("crank_pin", np.hypot(sx, sy)),
                self.pin_moment("main_journal", np.hypot(qx, qy)),
            )

        def right_side(wall, small, big, main):
            right = constant.copy()
            right[:, 3] -= wall
            right[:, 2] += small + big
            right[:, 7] -= big + main
            return right

        answer, (wall, small, big, main) = consistent(inverse, constant, friction, right_side)
        losses = wall * rate, -small * rod, big * (1 - rod), main
        return answer[:, 0], losses, gas * rate


def consistent(inverse, constant, friction, right_side):
    """The fixed point of forces and what friction makes of them."""
    times = lambda right: np.einsum("mij,mj->mi", inverse, right)  # noqa: E731
    answer = times(constant)
    for _ in range(300):
        drag = friction(answer)
        new = times(right_side(*drag))
        left = np.max(np.abs(new - answer) / np.max(np.abs(new), 1, keepdims=True))
        answer = new
        if left <= 1e-14:
            break
    assert left < 1e-10, left
    return answer, drag


class LinkMachine(Machine):
    """A slider-link machine; `Machine` lends gas and kinks. Symbols as in `SliderLink`."""

    def piston(self, theta):
        return self.crown_to_link + self.crank_radius * np.cos(theta)

    def piston_rate(self, theta):
        return -self.crank_radius * np.sin(theta)

    def dead_centres(self):
        return 0.0, np.pi


class ManyLinks(Many):
    """Slider-link machines: forces on the piston and link, on the slider, on the shaft."""

    names = ("wall", "link_slider", "crank_pin", "upper_bearing", "lower_bearing")
    piston, piston_rate = LinkMachine.piston, LinkMachine.piston_rate

    def signs(self, theta):
        return self.piston_rate(theta) > 0, np.sign(np.cos(theta))

    def solve(self, theta, speed, motor_torque, signs):
        inward, across = signs
        r, cosine, sine = self.crank_radius, np.cos(theta), np.sin(theta)
        crown, height = self.crown_to_link, r * sine - self.offset
        edge = crown - (self.cylinder_length - r * (1 - cosine))
        wall = np.where(inward, -self.wall, self.wall)  # with the sign of the force along x
        link = across * self.link_slider
        gas, rate = self.gas_force(theta, inward), self.piston_rate(theta)
        # accelerations of the crank pin: by the speed, and per angular acceleration
        still, per = -r * speed**2 * np.array([cosine, sine]), r * np.array([-sine, cosine])
        # unknown: acceleration, force of the slider on the link along x, contacts of crown and edge
        matrix, constant = np.zeros((len(theta), 4, 4)), np.zeros((len(theta), 4))
        matrix[:, 0, 0], matrix[:, 0, 1] = self.piston_mass * per[0], -1.0
        constant[:, 0] = -gas - self.piston_mass * still[0]
        matrix[:, 1, 2:] = 1.0
        # about the crossing of cylinder axis and link; friction of the contacts at half the bore
        matrix[:, 2, 0] = self.piston_centre_offset * self.piston_mass * per[0]
        matrix[:, 2, 1] = -height + link * self.slider_diameter / 2
        matrix[:, 2, 2] = crown + wall * self.bore / 2
        matrix[:, 2, 3] = edge + wall * self.bore / 2
        constant[:, 2] = -self.piston_centre_offset * self.piston_mass * still[0]
        turning = r * (cosine * per[1] - sine * per[0])
        matrix[:, 3, 0] = self.crank_inertia + self.slider_mass * turning
        matrix[:, 3, 1] = -r * sine
        stirred = self.slider_mass * r * (cosine * still[1] - sine * still[0])
        constant[:, 3] = motor_torque - stirred
        inverse = np.linalg.inv(matrix)

        def friction(answer):
            speeding, push, one, two = answer.T
            pressed, rubbed = np.abs(one) + np.abs(two), link * np.abs(push)
            pin = np.array([push, rubbed]) + self.slider_mass * (still + per * speeding)
            swing = still / r + per / r * speeding  # of the crank's unit vector
            pull = pin + self.crank_unbalance * swing
            span = self.lower_place - self.upper_place
            upper = (self.lower_place * pull - self.crank_couple * swing) / span
            forces = zip(self.names[2:], (pin, upper, pull - upper), strict=True)
            return pressed, rubbed, *(self.pin_moment(name, np.hypot(*f)) for name, f in forces)

        def right_side(pressed, rubbed, *moments):
            right = constant.copy()
            right[:, 0] += wall * pressed
            right[:, 1] -= rubbed
            right[:, 3] -= r * cosine * rubbed + sum(moments)
            return right

        answer, (pressed, rubbed, *moments) = consistent(inverse, constant, friction, right_side)
        losses = -wall * pressed * rate, rubbed * r * cosine, *moments
        return answer[:, 0], losses, gas * rate


def many_of(compressors) -> tuple[Many, list]:
    """The numbers of machines of the package, and the angles of their kinks."""
    from jaxcomp.mechanism import SliderLink

    if not isinstance(compressors[0].mechanism, SliderLink):
        twins = [from_compressor(compressor) for compressor in compressors]
        return Many.of(twins), [twin.kinks() for twin in twins]
    machines = []
    for compressor in compressors:
        machine, friction = LinkMachine(**dict.fromkeys(_NEEDED, 1.0)), compressor.friction
        shaft = compressor.crankshaft
        support = shaft.main_journal
        for part in (compressor.mechanism, compressor.gas):
            for name, value in vars(part).items():
                setattr(machine, name, None if value is None else float(value))
        machine.crank_inertia, machine.crank_unbalance = (
            float(shaft.inertia),
            float(shaft.unbalance),
        )
        machine.crank_couple = float(shaft.shaft_couple[0])
        machine.upper_place, machine.lower_place = map(float, support.position)
        machine.wall = float(friction.wall.coefficient)
        machine.link_slider = float(friction.link_slider.coefficient)
        laws = {"crank_pin": friction.crank_pin}
        laws |= dict(zip(support.names, support.bearings, strict=True))
        machine.pins = {k: (float(v.coefficient), float(v.diameter)) for k, v in laws.items()}
        machines.append(machine.prepare())
    return ManyLinks.of(machines), [machine.kinks() for machine in machines]


_NEEDED = ("bore", "crank_radius", "conrod_length", "piston_mass", "conrod_mass", "crank_inertia")


def one_turn(many: Many, kinks, torque, angle, speed, rtol, steps=1):
    """Integrate one revolution from states (m,); gap of the speed, mean speed and work, (m,) each.

    Args:
        many, kinks: of `many_of`.
        torque: (which, speed) -> [N m] of the motors of some machines.
        angle, speed: [rad], [rad/s] where each revolution begins.
        rtol: of a step.
        steps: between two kinks at least: a step that crosses a load reversal is not always noticed.
    """
    rows = []
    for begin, own in zip(angle, kinks, strict=True):
        places = np.concatenate([own - 2 * np.pi, own, own + 2 * np.pi])
        inside = np.unique(places[(places > begin) & (places < begin + 2 * np.pi)])
        rows.append([begin, *inside, begin + 2 * np.pi])
    width = max(map(len, rows))
    edges = np.array([[*row, *[row[-1]] * (width - len(row))] for row in rows]).T
    y = np.zeros((len(angle), 4 + len(many.names)))
    y[:, 0] = speed
    scale = np.full(y.shape, 1.0)
    scale[:, 0], scale[:, 1], scale[:, 2:4] = speed, 1 / speed, 100.0
    for left, right in pairwise(edges):
        signs = many.signs(0.5 * (left + right))

        def rate(which, theta, y, signs=signs):
            part, now = many.some(which), y[:, 0]
            drive = torque(which, now)
            grown, losses, gas = part.solve(theta, now, drive, tuple(s[which] for s in signs))
            return np.stack([grown / now, 1 / now, drive, gas, *losses], 1)

        y = march(rate, y, left, right, rtol, rtol * scale, steps)
    work = dict(zip(("motor", "gas", *many.names), y.T[2:], strict=True))
    return y[:, 0] / speed - 1, 2 * np.pi / y[:, 1], work


def march(rate, y, left, right, rtol, atol, steps):
    """DOP853 with a step of its own for every row of `y`."""
    longest = (right - left) / steps
    t, y, step = left.copy(), y.copy(), np.minimum((right - left) / 4, longest)
    going = right - left > 1e-12
    while going.any():
        which = np.flatnonzero(going)
        h = np.minimum(step[which], right[which] - t[which])
        stages = [rate(which, t[which], y[which])]
        for row, c in zip(DOP853.A[1:], DOP853.C[1:], strict=True):
            ahead = sum(a * k for a, k in zip(row, stages, strict=False) if a)
            stages.append(rate(which, t[which] + c * h, y[which] + h[:, None] * ahead))
        new = y[which] + h[:, None] * sum(b * k for b, k in zip(DOP853.B, stages, strict=True))
        stages.append(rate(which, t[which] + h, new))
        size = atol[which] + rtol * np.maximum(np.abs(y[which]), np.abs(new))
        fifth, third = (
            np.sum((sum(e * k for e, k in zip(table, stages, strict=True)) / size) ** 2, 1)
            for table in (DOP853.E5, DOP853.E3)
        )
        error = h * fifth / np.sqrt((fifth + 0.01 * third + 1e-300) * y.shape[1])
        good = error < 1
        done = which[good]
        t[done] += h[good]
        y[done] = new[good]
        h *= np.clip(0.9 * (error + 1e-30) ** -0.125, 0.2, np.where(good, 10.0, 1.0))
        step[which] = np.minimum(h, longest[which])
        going[which] = right[which] - t[which] > 1e-12
    return y
