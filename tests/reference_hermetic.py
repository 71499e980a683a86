"""The machine hermetic-68cc once more in NumPy and SciPy: crank with film journals, rotor and housing.

The crank is that of `reference`, its main journal three films under the statics of a rigid shaft; the
film is solved by finite volumes, tabulated over eps and interpolated by splines. The rotor is assembled
from the printed matrices of Nelson's element (1980), rigid bodies and links, and solved densely. Numbers
come from the scene; of the package only the finite volumes of the film are used.
"""

from dataclasses import dataclass, field

import numpy as np
import reference as bodies
from scipy.interpolate import CubicSpline

from jaxcomp.film import reference_solution
from jaxcomp.machine import machine_of

# cells of the finite volumes; forces to 2e-6, stiffness to 2e-5
GRIDS = ((120, 8), (240, 16), (480, 32))
HIGHEST = 0.8  # eps of the tables


class Film:
    """A grooved film of one L/D by tables over eps."""

    def __init__(self, ratio):
        self.ratio = ratio
        eps = HIGHEST * (1 - np.cos(np.linspace(0, np.pi / 2, 33)))
        rows = [
            reference_solution(e, ratio, grooved=True, coefficients=False, grids=GRIDS) for e in eps
        ]
        number = np.array([row.load_number for row in rows])
        self.eps = CubicSpline(number, eps)
        self.friction = CubicSpline(number, [row.friction_number for row in rows])
        self.highest = number[-1]

    def coefficients(self, number):
        found = reference_solution(float(self.eps(number)), self.ratio, grooved=True, grids=GRIDS)
        assert abs(found.load_number / number - 1) < 1e-5
        return np.asarray(found.stiffness), np.asarray(found.damping)


@dataclass
class Bearing:
    """A journal bearing at a place along the shaft."""

    diameter: float
    length: float
    clearance: float
    viscosity: float
    place: float  # from the plane of the rod
    nodes: tuple
    film: Film

    @property
    def unit(self):
        """Of film force over speed."""
        area, ratio = self.length * self.diameter, 2 * self.clearance / self.diameter
        return self.viscosity * area / ratio**2

    def moment(self, load, speed):
        number = load / (self.unit * speed)
        assert number < self.film.highest
        return self.unit * self.clearance * speed * float(self.film.friction(number))

    def matrices(self, load, speed):
        """Stiffness and damping over (x, y) under a static load vector."""
        size = np.hypot(*load)
        x, y = load / size
        axes = np.array([[x, -y], [y, x]])
        k, c = self.film.coefficients(size / (self.unit * speed))
        scale = self.unit / self.clearance
        return scale * speed * axes @ k @ axes.T, scale * axes @ c @ axes.T


@dataclass
class Hermetic(bodies.Machine):
    """The crank with its main journal in several films."""

    bearings: list = field(default_factory=list)
    couple: float = 0.0  # sum of unbalance times place along the shaft, towards the pin

    def reactions(self, force, moment):
        """Force of each bearing: a rigid shaft on springs that go with the projected areas."""
        weight = np.array([b.length * b.diameter for b in self.bearings])
        place = np.array([b.place for b in self.bearings])
        # shift and tilt of the shaft from force and moment
        system = np.array([[weight.sum(), weight @ place], [weight @ place, weight @ place**2]])
        shift, tilt = np.linalg.solve(system, np.stack([force, moment]))
        return weight[:, None] * (shift + place[:, None] * tilt)

    def main_moment(self, theta, speed, answer):
        along = np.array([np.cos(theta), np.sin(theta)])
        across = np.array([-along[1], along[0]])
        moment = self.couple * (answer[0] * across - speed**2 * along)
        loads = np.linalg.norm(self.reactions(answer[9:11], moment), axis=1)
        each = zip(self.bearings, loads, strict=True)
        return sum(bearing.moment(load, abs(speed)) for bearing, load in each)


def places(shafts):
    """z of every node of the shaft, from the first."""
    found, left = (
        {},
        [(pair, float(l)) for s in shafts for pair, l in zip(s.pairs, s.length, strict=True)],
    )
    found[left[0][0][0]] = 0.0
    while left:
        rest = []
        for (a, b), length in left:
            if a in found:
                found[b] = found[a] + length
            elif b in found:
                found[a] = found[b] - length
            else:
                rest.append(((a, b), length))
        left = rest
    return found


def machine(scene) -> Hermetic:
    """The crank of the scene; inertia and unbalance of its shaft from the tables of the rotor."""
    rotor, loads = scene.parts["rotor"], scene.parts["loads"]
    z = places(rotor.shafts)
    at_pin = z[loads.crank.pin]
    made = bodies.from_compressor(scene.as_compressor())
    inertia = sum(float(np.sum(d.polar_inertia)) for d in rotor.disks)
    for s in rotor.shafts:
        inner = 0.0 if s.inner_diameter is None else np.asarray(s.inner_diameter)
        fourth = np.asarray(s.outer_diameter) ** 4 - inner**4
        inertia += float(np.sum(np.asarray(s.density) * np.pi / 32 * fourth * np.asarray(s.length)))
    towards = [(node, float(m) * np.cos(float(p))) for table in loads.unbalances for node, m, p in
               zip(table.nodes, table.magnitude, np.broadcast_to(table.phase, table.magnitude.shape),
                   strict=True)]  # fmt: skip
    films, bearings = {}, []
    for link in rotor.links:
        if getattr(link.law, "kind", "") != "film":
            continue
        part = machine_of(scene).bearings[link.law.bearing.name]
        ratio = float(part.length / part.diameter)
        if round(ratio, 9) not in films:
            films[round(ratio, 9)] = Film(ratio)
        film = films[round(ratio, 9)]
        oil = machine_of(scene).oils[part.oil]
        bearings.append(Bearing(float(part.diameter), float(part.length), float(part.radial_clearance),
                                float(oil.dynamic_viscosity), z[link.nodes[0]] - at_pin, link.nodes,
                                film))  # fmt: skip
    numbers = {name: getattr(made, name) for name in bodies.Machine.__dataclass_fields__}
    numbers |= {"crank_inertia": inertia, "crank_unbalance": sum(u for _, u in towards)}
    couple = sum(u * (z[node] - at_pin) for node, u in towards)
    return Hermetic(**numbers, bearings=bearings, couple=couple).prepare()


def running(made: Hermetic, speed: float):
    """The periodic state at a mean speed, and of the forces on the structure order 1 and the mean.

    Returns:
        The turn; (3, 2) complex amplitudes of the force on pin, head and wall; (2,) mean on the pin.
    """
    turn = bodies.orbit(made, lambda w, level: level, mean_speed=speed, rtol=1e-10)
    x, weight = np.polynomial.legendre.leggauss(24)
    first, mean, total = np.zeros((3, 2), complex), np.zeros(2), 0.0
    for low, high, solution in turn.pieces:
        inward = made.piston_rate((low + high) / 2) > 0
        for theta, w in zip(
            low + (high - low) * (x + 1) / 2, weight * (high - low) / 2, strict=True
        ):
            now, time = solution(theta)[:2]
            torque = turn.level
            answer, losses, gas = made.solve(theta, now, torque, inward)
            rate = made.piston_rate(theta)
            rubbed = losses["wall"] / rate  # of the wall on the piston, against its motion
            forces = np.array([-answer[7:9], [gas / rate, 0.0], [rubbed, -answer[11]]])
            dt = w / now
            first += 2 * dt * forces * np.exp(-1j * speed * time)
            mean, total = mean + dt * forces[0], total + dt
    return turn, first / total, mean / total


def element(length, outer, inner, young, density, poisson):
    """Stiffness, translational and rotary inertia over (u_1, phi_1, u_2, phi_2), as printed by Nelson."""
    area, second = np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4)
    m2 = (inner / outer) ** 2
    s = (1 + m2) ** 2  # Cowper's coefficient of a hollow circle
    kappa = 6 * (1 + poisson) * s / ((7 + 6 * poisson) * s + (20 + 12 * poisson) * m2)
    shear, l = young / (2 * (1 + poisson)), length
    f = 12 * young * second / (kappa * shear * area * l**2)

    def four(a, b, c, d, e, g):
        return np.array([[a, b, c, d], [b, e, -d, g], [c, -d, a, -b], [d, g, -b, e]])

    k = four(12, 6 * l, -12, 6 * l, (4 + f) * l**2, (2 - f) * l**2)
    shift = four(
        13 / 35 + 7 * f / 10 + f**2 / 3,
        (11 / 210 + 11 * f / 120 + f**2 / 24) * l,
        9 / 70 + 3 * f / 10 + f**2 / 6,
        -(13 / 420 + 3 * f / 40 + f**2 / 24) * l,
        (1 / 105 + f / 60 + f**2 / 120) * l**2,
        -(1 / 140 + f / 60 + f**2 / 120) * l**2,
    )
    turn = four(6 / 5, (1 / 10 - f / 2) * l, -6 / 5, (1 / 10 - f / 2) * l,
                (2 / 15 + f / 6 + f**2 / 3) * l**2, (-1 / 30 - f / 6 + f**2 / 6) * l**2)  # fmt: skip
    k = k * young * second / (l**3 * (1 + f))
    return (
        k,
        shift * density * area * l / (1 + f) ** 2,
        turn * density * second / (l * (1 + f) ** 2),
    )


AXES = ("ux", "uy", "thx", "thy")


def displacement(scene, made: Hermetic, speed: float, forces, mean):
    """Complex amplitude (4,) of every node by name at order 1 of a speed."""
    rotor, loads = scene.parts["rotor"], scene.parts["loads"]
    nodes = list(places(rotor.shafts)) + [body.centre for body in rotor.bodies]
    size = 4 * len(nodes)
    m, c, k = (np.zeros((size, size)) for _ in range(3))
    motion = {}  # of every node, from the unknowns
    for number, node in enumerate(nodes):
        motion[node] = np.eye(size)[4 * number : 4 * number + 4]
    for body in rotor.bodies:
        for node, (_, _, z) in zip(body.nodes, np.asarray(body.arm), strict=True):
            follow = np.eye(4)  # u = u_c + th x r
            follow[0, 3], follow[1, 2] = z, -z
            motion[node] = follow @ motion[body.centre]
        at = motion[body.centre]
        inertia = np.diag(
            [float(body.mass)] * 2 + [float(body.inertia[0, 0]), float(body.inertia[1, 1])]
        )
        m += at.T @ inertia @ at
    beta = float(rotor.damping.stiffness_factor)

    def planes(*at):
        """(u, phi) of these nodes in the x plane and in the y plane."""
        return (np.concatenate([motion[n][[0, 3]] for n in at]),
                np.concatenate([motion[n][[1, 2]] * [[1], [-1]] for n in at]))  # fmt: skip

    def spin(polar, x, y):
        return speed * (x.T @ polar @ y - y.T @ polar @ x)

    for s in rotor.shafts:
        inner = np.zeros(len(s.pairs)) if s.inner_diameter is None else s.inner_diameter
        columns = (s.length, s.outer_diameter, inner, s.young_modulus, s.density, s.poisson)
        for pair, *row in zip(
            s.pairs, *(np.broadcast_to(q, len(s.pairs)) for q in columns), strict=True
        ):
            stiff, shift, turn = element(*row)
            x, y = planes(*pair)
            for p in (x, y):
                k += p.T @ stiff @ p
                c += beta * p.T @ stiff @ p
                m += p.T @ (shift + turn) @ p
            c += spin(2 * turn, x, y)
    for disks in rotor.disks:
        columns = (disks.nodes, disks.mass, disks.transverse_inertia, disks.polar_inertia)
        for node, mass, across, polar in zip(*columns, strict=True):
            x, y = planes(node)
            for p in (x, y):
                m += p.T @ np.diag([mass, across]) @ p
            c += spin(np.diag([0.0, polar]), x, y)

    def join(pair, axes, stiff, damp):
        nonlocal k, c
        first, second = pair
        d = motion[first] - (0.0 if second is None else motion[second])
        d = d[[AXES.index(a) for a in axes]]
        k, c = k + d.T @ stiff @ d, c + d.T @ damp @ d

    carried = made.reactions(-mean, np.zeros(2))
    for bearing, force in zip(made.bearings, carried, strict=True):
        # the static load on the journal is what its bearing pushes back
        join(bearing.nodes, AXES[:2], *bearing.matrices(-force, speed))
    for link in rotor.links:
        if link.law.kind == "film":
            continue
        k_all = [
            *link.law.stiffness,
            *(() if link.law.angular_stiffness is None else link.law.angular_stiffness),
        ]
        c_all = [
            *link.law.damping,
            *(() if link.law.angular_damping is None else link.law.angular_damping),
        ]
        kept = [i for i, axis in enumerate(link.axes) if axis in AXES]
        axes = [link.axes[i] for i in kept]
        join(link.nodes, axes, *(np.diag([float(v[i]) for i in kept]) for v in (k_all, c_all)))
    for pull in rotor.magnetic_pulls:
        each = -float(pull.stiffness) / len(pull.nodes) * np.eye(2)
        for pair in pull.nodes:
            join(pair, AXES[:2], each, 0 * each)

    load = np.zeros(size, complex)
    crank = loads.crank
    for node, force in zip((crank.pin, crank.head, crank.wall), forces, strict=True):
        load += motion[node][:2].T @ force
    for table in loads.unbalances:
        phases = np.broadcast_to(table.phase, len(table.nodes))
        for node, amount, phase in zip(table.nodes, table.magnitude, phases, strict=True):
            turning = float(amount) * speed**2 * np.exp(1j * float(phase))
            load += motion[node][:2].T @ (turning * np.array([1.0, -1j]))
    x = np.linalg.solve(k - speed**2 * m + 1j * speed * c, load)
    return {node: at @ x for node, at in motion.items()}


def vibration(scene, made: Hermetic):
    """Root mean square amplitude of all targets at the balancing speeds, and the turns there."""
    planes = scene.parts["balancing"]
    rows, turns = [], {}
    for speed in map(float, planes.speeds):
        turns[speed], forces, mean = running(made, speed)
        x = displacement(scene, made, speed, forces, mean)
        for target in planes.targets:
            moved = x[target.node] - (0.0 if target.relative_to is None else x[target.relative_to])
            rows += [moved[AXES.index(axis)] for axis in target.axes]
    return float(np.sqrt(np.mean(np.abs(rows) ** 2))), turns
