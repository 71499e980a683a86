r"""Several cylinders on one crankshaft: banks, throws and counterweights.

Machine axes: origin on the shaft, z along it, the crank turns from +x to +y. Cylinder $k$ points along
the bank angle $b_k$, its rod runs on a pin at the throw angle $t_k$ and stands at $z_k$ along the shaft.
It sees the crank angle

$$\psi_k = \theta + t_k - b_k ,$$

so that all laws of one cylinder hold with $\psi_k$ in place of $\theta$. The rods stand side by side,
each with a bearing of its own on the pin; fork-and-blade and articulated rods are not described.
"""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._fields import ANY, BadInput, Part, quantity, replaced
from ._base import CrankState, Vector, rotating
from ._slider_crank import SliderCrank


class Throw(Part):
    """One throw of the crankshaft with the rods on its pin.

    Args:
        angle: [rad] of the pin, ahead of the first throw in the sense of rotation.
        position: [m] middle of the pin along the shaft.
        banks: [rad] (n,) direction of each cylinder's axis, in the order of the rods along the shaft.
        rod_pitch: [m] between neighbouring rods along the shaft.
        unbalance: [kg m] of the crank at this throw without rods, positive at the pin's side; that
            of a counterweight is negative.
    """

    kind: ClassVar[str] = "throw"

    banks: Float[Array, " n"] = quantity("rad", ANY, shape=(None,))
    angle: Float[Array, ""] = quantity("rad", ANY, default=0.0)
    position: Float[Array, ""] = quantity("m", ANY, default=0.0)
    rod_pitch: Float[Array, ""] = quantity("m", ANY, default=0.0)
    unbalance: Float[Array, ""] = quantity("kg m", ANY, default=0.0)

    def __check_init__(self):
        if not self.banks.size:
            raise BadInput("banks", "[]", "at least one bank angle")


class Cylinders(Part):
    """How the cylinders of a machine stand about its crankshaft.

    The mechanism describes one cylinder, with the crank's inertia for the whole machine; it must be
    without an unbalance of its own, which the throws have. Cylinders are numbered throw by throw.

    Args:
        throws: of the crankshaft.

    Raises:
        BadInput: no throw.
    """

    kind: ClassVar[str] = "cylinders"

    throws: tuple[Throw, ...]

    def __check_init__(self):
        if not self.throws:
            raise BadInput("throws", "()", "at least one throw")

    @property
    def count(self) -> int:
        """Number of cylinders."""
        return sum(throw.banks.size for throw in self.throws)

    @property
    def bank_angle(self) -> Float[Array, " k"]:
        """[rad] b of every cylinder."""
        return jnp.concatenate([throw.banks for throw in self.throws])

    @property
    def throw_angle(self) -> Float[Array, " k"]:
        """[rad] t of every cylinder's pin."""
        return jnp.concatenate([jnp.full(t.banks.shape, t.angle) for t in self.throws])

    @property
    def position(self) -> Float[Array, " k"]:
        """[m] z of every rod."""
        return jnp.concatenate([t.position + t.rod_pitch * _places(t) for t in self.throws])

    @property
    def phase(self) -> Float[Array, " k"]:
        """[rad] psi - theta of every cylinder."""
        return self.throw_angle - self.bank_angle

    @property
    def firing_intervals(self) -> Float[Array, " k"]:
        """[rad] between the top dead centres of a machine without offset, in the order of firing."""
        # half a degree of lead keeps what is 0 but for rounding from lying at the end
        at = jnp.sort(jnp.mod(jnp.deg2rad(0.5) - self.phase, 2 * jnp.pi))
        return jnp.diff(jnp.append(at, at[0] + 2 * jnp.pi))

    def order_sums(self, order: int) -> "OrderSums":
        r"""How the cylinders' shaking forces of an order add up at constant speed.

        The force of all pistons on the frame, with $x + iy$ for its direction and the amplitude
        $A_n$ of one of them, is $A_n (f_+ e^{in\theta} + f_- e^{-in\theta})$: an ellipse with the
        semi-axes $|f_+| + |f_-|$ and $||f_+| - |f_-||$; with $z_k$ in the sums, $c_\pm$, its couples,
        moment $M_x + i M_y = i c$.

        $$f_\pm = \tfrac12 \sum_k e^{i (b_k \pm n (t_k - b_k))}$$

        Args:
            order: n, of the revolution.
        """
        turning = order * self.phase
        both = 0.5 * jnp.exp(1j * (self.bank_angle + jnp.stack([turning, -turning])))
        forward, backward = both.sum(-1)
        return OrderSums(forward, backward, *(both * self.position).sum(-1))

    def own_angle(self, angle: Float[Array, "*n"]) -> Float[Array, "k *n"]:
        """[rad] psi of every cylinder at crank angles [rad]."""
        return self.along(self.phase, angle) + angle

    def along(
        self, values: Float[Array, " k"], like: Float[Array, "*n"]
    ) -> Float[Array, "k *ones"]:
        """A value of each cylinder, in a shape that goes with instants."""
        return values.reshape(values.shape + (1,) * jnp.ndim(like))

    def turned(self, force: Vector, back: bool = False) -> Vector:
        """Vectors from the axes of each cylinder, x along it, to those of the machine, or back."""
        angle = self.along(-self.bank_angle if back else self.bank_angle, force.x[0])
        c, s = jnp.cos(angle), jnp.sin(angle)
        return Vector(c * force.x - s * force.y, s * force.x + c * force.y)

    def own_gravity(self, gravity: Float[Array, "2"], like: Float[Array, "*n"]):
        """A gravity [m/s^2] of the machine's axes in those of each cylinder: (2, k, 1)."""
        ones = jnp.ones((self.count,) + (1,) * jnp.ndim(like))
        return jnp.stack(self.turned(Vector(gravity[0] * ones, gravity[1] * ones), back=True))

    def crank_pull(self, state: CrankState) -> tuple[Vector, Vector]:
        """Inertia [N] of the throws' unbalances in machine axes, and its moment [N m], sum of F z."""
        pull, moment = [], []
        for throw in self.throws:
            _, second = rotating(state.angle + throw.angle, state.speed, state.acceleration)
            pull.append(throw.unbalance * second)
            moment.append(throw.position * pull[-1])
        pull, moment = (jnp.sum(jnp.stack(each), axis=0) for each in (pull, moment))
        return Vector(*pull), Vector(*moment)

    def weight_torque(self, angle: Float[Array, "*n"], gravity: Float[Array, "2"]):
        """[N m] on the crank, of the weights of the throws' unbalances."""
        torque = jnp.zeros_like(angle)
        for throw in self.throws:
            at = angle + throw.angle
            torque += throw.unbalance * (gravity[1] * jnp.cos(at) - gravity[0] * jnp.sin(at))
        return torque


class OrderSums(NamedTuple):
    """Sums of an order over the cylinders, in forces of one piston.

    Attributes:
        forward, backward: [-] f+ and f-, which turn with the crank and against it.
        forward_couple, backward_couple: [m] c+ and c-, force times place.
    """

    forward: Complex[Array, ""]
    backward: Complex[Array, ""]
    forward_couple: Complex[Array, ""]
    backward_couple: Complex[Array, ""]


def counterweights(mechanism: SliderCrank, cylinders: Cylinders) -> Cylinders:
    r"""The cylinders with the counterweights that take what turns forward of the first order.

    On a throw of n rods $u = -(n m_{rot} + \tfrac n2 m_{rec})\,r$: banks that are equally spaced over
    180 degrees have then no first order left, neither force nor couple, if the rods are at one place.

    Args:
        mechanism: one of the cylinders.
        cylinders: how they stand; their unbalances do not matter.
    """
    share = mechanism.conrod_centre / mechanism.conrod_length
    rotating = mechanism.conrod_mass * (1 - share)
    reciprocating = mechanism.piston_mass + mechanism.conrod_mass * share
    each = -(rotating + reciprocating / 2) * mechanism.crank_radius
    throws = tuple(replaced(throw, unbalance=throw.banks.size * each) for throw in cylinders.throws)
    return replaced(cylinders, throws=throws)


def _places(throw: Throw) -> np.ndarray:
    """Places of the rods about the middle of the pin, in pitches."""
    count = throw.banks.size
    return np.arange(count) - 0.5 * (count - 1)
