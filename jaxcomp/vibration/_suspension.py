r"""The block on its springs: the rotor model of $M\ddot X + C\dot X + SX = F$.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eq. (42), with S and C built from springs at points. Degrees of freedom: displacement of the mass
centre in x, y, z [m], then small rotations about x, y, z [rad]. As in the source the products of
inertia of the block are neglected.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import ANY, NONNEGATIVE, POSITIVE, Part, quantity, replaced
from ..rotor import ConstantLaw, Link, RigidBody, RotorModel


class Spring(Part):
    """A spring, with its damper, between a point of the block and the ground.

    Positions count in the mechanism's axes from the mechanism's origin.

    Args:
        position: [m] where it holds the block.
        axial_stiffness: [N/m] along its axis.
        lateral_stiffness: [N/m] across its axis.
        axial_damping: [N s/m] along its axis.
        lateral_damping: [N s/m] across its axis.
        axis: [-] direction, of any length.
    """

    kind: ClassVar[str] = "spring"

    position: Float[Array, "3"] = quantity("m", ANY, shape=(3,), doc="where it holds the block")
    axial_stiffness: Float[Array, ""] = quantity(
        "N/m", NONNEGATIVE, doc="along its axis", usual=(10.0, 1e9)
    )
    lateral_stiffness: Float[Array, ""] = quantity(
        "N/m", NONNEGATIVE, default=0.0, doc="across its axis"
    )
    axial_damping: Float[Array, ""] = quantity(
        "N s/m", NONNEGATIVE, default=0.0, doc="along its axis"
    )
    lateral_damping: Float[Array, ""] = quantity(
        "N s/m", NONNEGATIVE, default=0.0, doc="across its axis"
    )
    axis: Float[Array, "3"] = quantity(
        "", ANY, shape=(3,), default=(0.0, 0.0, 1.0), doc="direction, of any length"
    )

    def conditions(self):
        return {"a spring whose axis has a direction": (self.axis != 0).any()}

    @property
    def law(self) -> ConstantLaw:
        """Stiffness and damping in the axes of the mechanism."""
        axis = self.axis / jnp.linalg.norm(self.axis)
        # projectors onto the axis and onto the plane across it
        on_axis = jnp.outer(axis, axis)
        on_plane = jnp.eye(3) - on_axis
        stiffness = self.axial_stiffness * on_axis + self.lateral_stiffness * on_plane
        damping = self.axial_damping * on_axis + self.lateral_damping * on_plane
        return ConstantLaw(stiffness, damping)


class PipePoint(Part):
    """Point of the block on which the waves of pipes push by a run or a vessel.

    Args:
        run: name of the run or vessel, as `shaking` has it: its ends with a hyphen, such as "tee-line",
            with "suction." or "discharge." before them where both lines have pipes.
        position: [m] of a point on its axis, in the mechanism's axes from the mechanism's origin.
    """

    run: str = eqx.field(static=True)
    position: Float[Array, "3"] = quantity("m", ANY, shape=(3,), doc="of a point on its axis")


class Suspension(Part):
    """The suspended block: casing, stator and, at rest, everything that moves.

    Args:
        mass: [kg] of all that hangs in the springs.
        inertia_x, inertia_y, inertia_z: [kg m^2] about the mass centre.
        springs: any number.
        mass_centre: [m] in the mechanism's axes from the mechanism's origin.
        pipes: that are fixed to the block and push it, beside the moving parts.
    """

    kind: ClassVar[str] = "suspension"

    mass: Float[Array, ""] = quantity(
        "kg", POSITIVE, doc="of all that hangs in the springs", usual=(0.1, 1e5)
    )
    inertia_x: Float[Array, ""] = quantity("kg m^2", POSITIVE, doc="about the mass centre")
    inertia_y: Float[Array, ""] = quantity("kg m^2", POSITIVE, doc="about the mass centre")
    inertia_z: Float[Array, ""] = quantity("kg m^2", POSITIVE, doc="about the mass centre")
    springs: tuple[Spring, ...] = eqx.field(converter=tuple)  # pyright: ignore[reportGeneralTypeIssues]
    mass_centre: Float[Array, "3"] = quantity(
        "m", ANY, shape=(3,), default=(0.0, 0.0, 0.0), doc="from the mechanism's origin"
    )
    pipes: tuple[PipePoint, ...] = ()

    @property
    def rotor(self) -> RotorModel:
        """The block as a rigid body that springs tie to the ground, a model of 6 degrees of freedom."""
        names = tuple(f"spring_{number}" for number in range(len(self.springs)))
        tensor = jnp.diag(jnp.stack([self.inertia_x, self.inertia_y, self.inertia_z]))
        # a block without springs, which floats: `jnp.stack` takes no empty list
        arm = jnp.zeros((0, 3))
        if self.springs:
            arm = jnp.stack([spring.position - self.mass_centre for spring in self.springs])
        body = RigidBody("mass_centre", names, arm, self.mass, tensor)
        links = []
        for name, spring in zip(names, self.springs, strict=True):
            # A spring's end takes no moment; those about the mass centre come by the rigid arms.
            links.append(Link((name, None), spring.law, ("ux", "uy", "uz")))
        nodes = ("mass_centre", *names)
        return RotorModel(bodies=(body,), links=tuple(links), dof=6, nodes=nodes)


def viscous_damping(
    stiffness: Float[Array, ""], damping_ratio: Float[Array, ""], carried_mass: Float[Array, ""]
) -> Float[Array, ""]:
    r"""Damper [N s/m] beside a spring for a damping ratio of its own mass, $2\zeta\sqrt{km}$.

    Args:
        stiffness: [N/m] k.
        damping_ratio: [-] zeta.
        carried_mass: [kg] m, the block's mass over the number of springs.
    """
    return 2 * damping_ratio * jnp.sqrt(stiffness * carried_mass)


def with_scaled_frequencies(suspension: Suspension, factor: Float[Array, ""]) -> Suspension:
    """The suspension with all natural frequencies times a factor, at the same damping ratios.

    Args:
        suspension: the suspension.
        factor: [-] on all natural frequencies.
    """

    # w^2 = k/m and c = 2 zeta m w: at one damping ratio k goes with the square of the frequency.
    def scaled(spring):
        return replaced(
            spring,
            axial_stiffness=factor**2 * spring.axial_stiffness,
            lateral_stiffness=factor**2 * spring.lateral_stiffness,
            axial_damping=factor * spring.axial_damping,
            lateral_damping=factor * spring.lateral_damping,
        )

    return replaced(suspension, springs=tuple(map(scaled, suspension.springs)))


def block_points(suspension: Suspension) -> dict[str, Float[Array, "3"]]:
    """Points [m] of the block where its vibration is of interest: mass centre and springs."""
    springs = {f"spring_{i}": spring.position for i, spring in enumerate(suspension.springs)}
    return {"mass_centre": suspension.mass_centre, **springs}


def motion_at(suspension: Suspension, point: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """Matrix from the six degrees of freedom to the displacement of a point [m] of the block."""
    # rotations are small, so that they act one by one and in any order
    x, y, z = point - suspension.mass_centre
    zero = jnp.zeros_like(x)
    turning = jnp.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])  # rotation x arm
    return jnp.concatenate([jnp.eye(3), turning], axis=1)
