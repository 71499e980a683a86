"""A small compressor with everything the rotor model has, shared by the tests of the rotor.

Rotor (nodes 1-9) in a rigid crankcase that hangs in a housing line (nodes h1-h4) on a foot. All
tests use the same construction and change only numbers, so that they share the compiled programs.
"""

import jax.numpy as jnp
import numpy as np

from jaxcomp.rotor import (
    ConstantLaw,
    Disks,
    Link,
    MagneticPull,
    PeriodicForce,
    PointMasses,
    ProportionalDamping,
    RigidBody,
    RotorModel,
    SpeedTable,
    Unbalances,
    diagonal,
    isotropic,
    shaft_line,
)

LATERAL = ("ux", "uy", "thx", "thy")
SPACE = ("ux", "uy", "uz", "thx", "thy", "thz")
SPEED, FREQUENCY = 310.0, 505.0


def machine(dof=4, *, symmetric=False, mount=2e4, tilt=True):
    """The machine; `symmetric` for bearings without cross coupling, `tilt` for bodies off the axis."""
    rotor = shaft_line(
        tuple(range(1, 10)),
        length=jnp.array([0.03, 0.03, 0.025, 0.03, 0.02, 0.03, 0.02, 0.025]),
        outer_diameter=jnp.array([22.0, 22, 24, 24, 20, 30, 26, 18]) * 1e-3,
        inner_diameter=4e-3,
        young_modulus=2.06e11,
        density=jnp.array([7800.0] * 5 + [0.0, 7800.0, 7800.0]),
        poisson=0.3,
    )
    housing = shaft_line(
        ("h1", "h2", "h3", "h4"),
        length=0.06,
        outer_diameter=0.2,
        inner_diameter=0.19,
        young_modulus=2e11,
        density=7800.0,
        poisson=0.3,
        spins=False,
    )
    disks = Disks((3, 7), [1.2, 0.3], [1.5e-3, 2e-4], [2.5e-3, 3e-4], offset=[0.004, -0.006])
    cross = 0.0 if symmetric else 4e6
    k = jnp.array([[3e7, cross], [-cross, 5e7]])
    c = jnp.array([[4e3, 100.0], [100.0, 6e3]])
    table = SpeedTable(
        [100.0, 250.0, 400.0, 900.0],
        jnp.array([0.8, 1.0, 1.15, 1.2])[:, None, None] * k,
        jnp.array([1.2, 1.0, 0.9, 0.85])[:, None, None] * c,
    )
    off = 0.02 if tilt else 0.0
    case = RigidBody(
        "case",
        ("c6", "c8", "s2", "s4", "head", "m1", "m2"),
        jnp.array(
            [
                [off, 0, 0.04],
                [off, 0, 0.10],
                [off, 0, -0.08],
                [off, 0, -0.03],
                [0.06, 0, 0.07],
                [off, off, -0.10],
                [-off, off, 0.12],
            ]
        ),
        15.0,
        jnp.diag(jnp.array([0.12, 0.11, 0.06])) if not tilt
        else jnp.array([[0.12, 0.01, 0.0], [0.01, 0.11, 0.004], [0.0, 0.004, 0.06]]),
    )  # fmt: skip
    grommet = diagonal([3e5, 2e5, 4e5, 200.0, 150.0, 100.0], [30.0, 20.0, 40.0, 0.1, 0.1, 0.1])
    foot = diagonal([mount] * 3 + [300.0] * 3, [15.0] * 3 + [0.3] * 3)
    links = (
        Link((6, "c6"), table),
        Link((8, "c8"), ConstantLaw(k, c)),
        Link(("m1", "h1"), grommet, SPACE),
        Link(("m2", "h4"), grommet, SPACE),
        Link(("h2", None), foot, SPACE),
        Link(("h4", None), isotropic(mount, 10.0, size=3), ("ux", "uy", "uz")),
        Link((9, "c8"), isotropic(2e5, 20.0, size=3), ("uz", "thz", "ux")),
    )
    pull = MagneticPull(((2, "s2"), (4, "s4")), 4e5, [0.4, 0.6])
    return RotorModel(
        (rotor, housing),
        (disks,),
        (PointMasses((9, "h3"), [0.05, 0.8]),),
        links,
        (pull,),
        (case,),
        ProportionalDamping(0.5, 2e-6),
        dof,
    )


def loads():
    """Unbalances, and a gas force between crank pin and cylinder head with two orders."""
    gas = PeriodicForce(
        7,
        "head",
        (1, 2),
        [[-1087.0, 0, 0], [-2172.0, 30.0, 0]],
        [[748.0, 100.0, 20.0], [374.0, 0, 0]],
        [[0, 5.0, 0], [0, 0, 2.0]],
        [[1.0, 0, 3.0], [0, 0, 0]],
        arm=[-0.04, 0.0, 0.0],
    )
    return Unbalances((2, 4, 7), [4e-4, 3e-4, 5e-4], [0.0, 2.0, 3.1]), gas


def random_force(shape, seed=0):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=shape) + 1j * rng.normal(size=shape))
