"""Newton-Euler program of k cylinders on one crank in NumPy, which shares nothing with the package.

Forces on every piston and rod in the axes of its cylinder, and on the shaft in those of the machine;
the speed over the revolution on a uniform grid, by the trapezoidal rule, with the level of a motor torque
that goes with the speed.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Cylinders:
    """Numbers of the machine; those of the cylinders as (k, 1)."""

    bore: np.ndarray
    crank_radius: np.ndarray
    conrod_length: np.ndarray
    conrod_centre: np.ndarray
    conrod_inertia: np.ndarray
    conrod_mass: np.ndarray
    piston_mass: np.ndarray
    offset: np.ndarray
    bank: np.ndarray
    throw: np.ndarray
    place: np.ndarray
    inertia: float
    # angle, place and unbalance of every throw
    unbalances: list[tuple[float, float, float]]
    bearings: tuple[float, float]
    mean_speed: float
    suction: float = 98e3
    discharge: float = 980e3
    exponent: float = 1.05
    clearance: float = 0.0076
    wall: float = 0.083
    # coefficient times radius
    piston_pin: float = 0.013 * 0.020
    crank_pin: float = 0.013 * 0.045
    journal: float = 0.013 * 0.046
    points: int = 40000
    losses: dict = field(default_factory=dict)
    # [N] on the pistons, of the evaluation before: the next one starts from them
    side: np.ndarray | float = 0.0

    def gas(self, position, rate):
        """Force on the pistons towards the crank, by the two polytropic curves and the two lines."""
        area = np.pi / 4 * self.bore**2
        reach = np.sqrt((self.conrod_length + self.crank_radius) ** 2 - self.offset**2)
        least = np.sqrt((self.conrod_length - self.crank_radius) ** 2 - self.offset**2)
        swept = reach - least
        height = reach - position + self.clearance * swept
        compressed = self.suction * ((1 + self.clearance) * swept / height) ** self.exponent
        expanded = self.discharge * (self.clearance * swept / height) ** self.exponent
        inward = np.minimum(compressed, self.discharge)
        outward = np.maximum(expanded, self.suction)
        return (np.where(rate > 0, inward, outward) - self.suction) * area

    def torque(self, theta, speed, rise, level):
        """What is left of the moments on the shaft [N m], with the losses over the speed by joint."""
        r, l, b, e = self.crank_radius, self.conrod_length, self.conrod_centre, self.offset
        psi = theta + self.throw - self.bank
        c, s = np.cos(psi), np.sin(psi)
        sin_tilt = (r * s - e) / l
        cos_tilt = np.sqrt(1 - sin_tilt**2)
        tilt = r * c * speed / (l * cos_tilt)
        tilt_rise = (r * (c * rise - s * speed**2) + l * sin_tilt * tilt**2) / (l * cos_tilt)
        position = r * c + l * cos_tilt
        rate = -r * s * speed - l * sin_tilt * tilt
        push = -r * s * rise - r * c * speed**2 - l * sin_tilt * tilt_rise - l * cos_tilt * tilt**2
        # the rod's mass centre lies b along (cos, -sin) of the tilt from the crank pin
        centre_x = (
            -r * s * rise - r * c * speed**2 - b * (sin_tilt * tilt_rise + cos_tilt * tilt**2)
        )
        centre_y = r * c * rise - r * s * speed**2 - b * (cos_tilt * tilt_rise - sin_tilt * tilt**2)
        force, slides = self.gas(position, rate), np.sign(rate)
        swings, turns = np.sign(tilt), np.sign(speed + tilt)
        side = np.broadcast_to(self.side, psi.shape)
        for _ in range(60):
            rub = -self.wall * np.abs(side) * slides
            top = np.stack([-force + rub - self.piston_mass * push, side])  # on the rod
            pin = np.stack([self.conrod_mass * centre_x, self.conrod_mass * centre_y]) - top
            at_piston = self.piston_pin * np.hypot(*top) * swings
            at_crank = self.crank_pin * np.hypot(*pin) * turns
            # moments about the mass centre: arms (l - b) and -b along (cos, -sin)
            rest = (
                (l - b) * (cos_tilt * top[1] + sin_tilt * top[0])
                - b * (cos_tilt * pin[1] + sin_tilt * pin[0])
                + at_piston + at_crank + self.conrod_inertia * tilt_rise
            )  # fmt: skip
            step = rest / (l * cos_tilt)
            side = side - step
            if np.max(np.abs(step)) < 1e-11 * np.max(np.abs(force)):
                break
        self.side = side
        on_crank = -pin
        moment = r * (c * on_crank[1] - s * on_crank[0]) - at_crank
        turned = (
            np.cos(self.bank) * on_crank[0] - np.sin(self.bank) * on_crank[1],
            np.sin(self.bank) * on_crank[0] + np.cos(self.bank) * on_crank[1],
        )
        pulls = [
            u * np.stack([
                -np.cos(theta + t) * speed**2 - np.sin(theta + t) * rise,
                -np.sin(theta + t) * speed**2 + np.cos(theta + t) * rise,
            ])
            for t, _, u in self.unbalances
        ]  # fmt: skip
        low, high = self.bearings
        journals = []
        for here, other in ((low, high), (high, low)):
            share = lambda z: (z - other) / (here - other)  # noqa: B023, E731
            load = np.stack([np.sum(share(self.place) * f, axis=0) for f in turned])
            load = load - sum(
                share(z) * pull for (_, z, _), pull in zip(self.unbalances, pulls, strict=True)
            )
            journals.append(self.journal * np.hypot(*load))
        self.losses = {
            "wall": np.sum(self.wall * np.abs(side) * np.abs(rate) / speed, axis=0),
            "piston_pin": np.sum(np.abs(at_piston * tilt) / speed, axis=0),
            "crank_pin": np.sum(np.abs(at_crank * (speed + tilt)) / speed, axis=0),
            "main": sum(journals),
            "gas": np.sum(force * rate / speed, axis=0),
        }
        motor = level * speed / self.mean_speed
        return motor + np.sum(moment, axis=0) - sum(journals) - self.inertia * rise

    def rise(self, theta, speed, level, start):
        """[rad/s^2] Acceleration by the secant rule: the moments are all but linear in it."""
        before, now = start, start + 1.0
        left = self.torque(theta, speed, before, level)
        for _ in range(12):
            here = self.torque(theta, speed, now, level)
            fall = np.where(here == left, 1.0, here - left)
            step = np.where(here == left, 0.0, -here * (now - before) / fall)
            before, left, now = now, here, now + step
            if np.max(np.abs(step)) < 1e-10 * np.max(np.abs(now)):
                break
        return now

    def solved(self):
        """Mechanical efficiency, fluctuation of the speed, and the losses [J] by joint."""
        theta = np.linspace(0.0, 2 * np.pi, self.points, endpoint=False)
        width = theta[1]
        speed, rise, level = np.full_like(theta, self.mean_speed), np.zeros_like(theta), 0.0
        for _ in range(40):
            rise = self.rise(theta, speed, level, rise)
            more = self.rise(theta, speed, level + 1.0, rise)
            change = -np.sum(rise) / np.sum(more - rise)
            level += change
            rise = rise + change * (more - rise)
            mean = 0.5 * (rise + np.roll(rise, -1))
            gained = np.concatenate([[0.0], np.cumsum(mean)[:-1]]) * width
            energy = 0.5 * speed[0] ** 2
            for _ in range(8):  # the level for which the revolution takes its time
                root = 1 / np.sqrt(2 * (energy + gained))
                time = np.sum(root) * width
                energy -= (time - 2 * np.pi / self.mean_speed) / (-np.sum(root**3) * width)
            new = np.sqrt(2 * (energy + gained))
            moved = np.max(np.abs(new - speed)) / self.mean_speed
            speed = new
            if moved < 1e-12:
                break
        self.torque(theta, speed, rise, level)
        losses = {name: float(np.sum(value) * width) for name, value in self.losses.items()}
        gas = losses.pop("gas")
        efficiency = gas / (gas + sum(losses.values()))
        return efficiency, float(np.ptp(speed) / self.mean_speed), losses
