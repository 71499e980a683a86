r"""The crankshaft of a machine: its inertia, throws and banks, counterweights and main bearings.

Machine axes: origin on the shaft, z along it, the crank turns from +x to +y. Cylinder $k$ points along
the bank angle $b_k$, its rod runs on a pin at the throw angle $t_k$ and stands at $z_k$ along the shaft.
It sees the crank angle

$$\psi_k = \theta + t_k - b_k ,$$

so that all laws of one cylinder hold with $\psi_k$ in place of $\theta$. The rods stand side by side,
each with a bearing of its own on the pin; fork-and-blade and articulated rods are not described. A
machine with one cylinder has one throw with one bank, both at angle 0 unless it says otherwise.
"""

from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.each import along_cylinders
from .._core.errors import BadInput
from .._core.fields import ANY, NONNEGATIVE, POSITIVE, Part, is_traced, quantity, rebuilt, replaced
from ..film import AbstractJournal
from ..mechanism import AbstractKinematics, AbstractMechanism, CrankState, Vector
from ..mechanism._mechanism import turned_with
from ._bearings import MainBearings, along_lines
from ._throws import Throw, rod_places, throws_of

# [rad] Between the crank angles of cylinders that would see the same one: fifty times the
# rounding of an angle, it changes sums over the cylinders that vanish by less than 1e-12 of one of them.
_APART = 5e-14
# What follows from the rotor of a machine in which `loads.crank` joins the two.
OF_ROTOR = (
    "inertia",
    "mass",
    "unbalance",
    "balanced",
    "shaft_unbalance",
    "shaft_couple",
    "throw_pitch",
    "rod_pitch",
    "places",
)


class Crankshaft(Part):
    """The crankshaft, with what sits on it.

    Cylinders are numbered throw by throw. A number of mechanism, gas or friction that differs from
    cylinder to cylinder is a list there.

    Args:
        inertia: [kg m^2] crankshaft with rotor about the shaft axis; absent where it follows from the
            rotor of the same machine.
        mass: [kg] crankshaft with rotor; its weight is on the bearings.
        throws: of the crankshaft; none with a layout, or for a single throw with one cylinder.
        layout: its name in the place of throws: "single", "in-line-4", "boxer-2", "opposed", "radial-5",
            "V90" for two banks on one throw, "W60" for three, "VV45" for four, "V90x2" for two such
            throws. Pins of several throws are spread evenly, an even number of four or more as its own
            mirror image.
        throw_pitch: [m] between neighbouring throws of a layout.
        rod_pitch: [m] between neighbouring rods of a throw of a layout.
        unbalance: [kg m] of the crank at each throw of a layout without rods, positive at the pin's
            side; that of a counterweight is negative.
        balanced: whether every throw has, beside its own unbalance, the counterweight that takes what
            turns forward of the first order, see `counterweights`.
        shaft_unbalance: [kg m] (2,) of the whole crank beside that of the throws, along the first throw
            at angle 0 and 90 degrees ahead of it; of a rotor its own.
        shaft_couple: [kg m^2] (2,) sum of that unbalance times its place.
        places: [m] of every rod along the shaft in the place of that by throws; of a rotor its pins'.
        mass_centre: [m] place of the mass along the shaft, for its weight.
        origin: [m] place along the shaft about which moments on the block count.
        main_journal: law of the shaft in its bearing, or `MainBearings`; `None` without friction there.

    Raises:
        BadInput: throws beside a layout or beside an unbalance of a layout's throws, an unknown layout,
            or places that are not one a rod.
    """

    kind: ClassVar[str] = "crankshaft"

    inertia: Float[Array, ""] | None = quantity(
        "kg m^2",
        POSITIVE,
        default=None,
        doc="with rotor about the shaft axis; absent where it follows from [rotor]",
    )
    mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, default=0.0, doc="crankshaft with rotor; its weight is on the bearings"
    )
    throws: tuple[Throw, ...] = ()
    layout: str | None = eqx.field(static=True, default=None)
    throw_pitch: Float[Array, ""] = quantity("m", ANY, default=0.0)
    rod_pitch: Float[Array, ""] = quantity("m", ANY, default=0.0)
    unbalance: Float[Array, ""] = quantity(
        "kg m", ANY, default=0.0, doc="of the crank at each throw, positive at the pin's side"
    )
    balanced: bool = eqx.field(static=True, default=False)
    shaft_unbalance: Float[Array, "2"] | None = quantity(
        "kg m", ANY, shape=(2,), default=None, doc="beside the throws, at the pin and ahead of it"
    )
    shaft_couple: Float[Array, "2"] | None = quantity(
        "kg m^2", ANY, shape=(2,), default=None, doc="sum of shaft unbalance times place"
    )
    places: Float[Array, " k"] | None = quantity("m", ANY, shape=(None,), default=None)
    mass_centre: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="of the mass along the shaft, for its weight"
    )
    origin: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="place about which moments on the block count"
    )
    main_journal: AbstractJournal | MainBearings | None = None

    def __check_init__(self):
        if self.layout is not None:
            throws_of(self.layout)
        if self.throws:
            if self.layout is not None:
                raise BadInput("throws", f"{len(self.throws)} throws", "absent beside a layout")
            if not is_traced(self.unbalance) and float(self.unbalance) != 0:
                raise BadInput(
                    "unbalance", self.unbalance, "absent beside throws, which have theirs"
                )
        if self.places is not None and self.places.shape != (self.count,):
            raise BadInput("places", self.places, f"one for each of {self.count} rods")

    @property
    def rows(self) -> tuple[Throw, ...]:
        """The throws, given or of the layout."""
        if self.throws:
            return self.throws
        angles_and_banks = throws_of(self.layout or "single")
        # the origin along the shaft is the middle of its throws
        middle = 0.5 * (len(angles_and_banks) - 1)
        throws = []
        for number, (angle, banks) in enumerate(angles_and_banks):
            throw = Throw(np.deg2rad(banks), np.deg2rad(angle))
            place = (number - middle) * self.throw_pitch
            throws.append(
                replaced(throw, position=place, rod_pitch=self.rod_pitch, unbalance=self.unbalance)
            )
        return tuple(throws)

    @property
    def count(self) -> int:
        """Number of cylinders; also where the numbers are only shapes."""
        if self.throws:
            return sum(throw.banks.size for throw in self.throws)
        return sum(len(banks) for _, banks in throws_of(self.layout or "single"))

    def each(self, part, like):
        """A part whose lists over the cylinders go with instants like these."""
        return along_cylinders(part, like)

    def unbalances(self, mechanism: AbstractMechanism) -> list[Float[Array, ""]]:
        """[kg m] of the crank at every throw, with its counterweight where `balanced` says so."""
        cranks = [throw.unbalance for throw in self.rows]
        if not self.balanced:
            return cranks
        unbalances = []
        for crank, weight in zip(cranks, _counterweights(mechanism, self), strict=True):
            unbalances.append(crank + weight)
        return unbalances

    @property
    def bank_angle(self) -> Float[Array, " k"]:
        """[rad] b of every cylinder."""
        return jnp.concatenate([throw.banks for throw in self.rows])

    @property
    def throw_angle(self) -> Float[Array, " k"]:
        """[rad] t of every cylinder's pin."""
        angles = []
        for throw in self.rows:
            angles.append(jnp.full(throw.banks.shape, throw.angle))
        return jnp.concatenate(angles)

    @property
    def position(self) -> Float[Array, " k"]:
        """[m] z of every rod."""
        if self.places is not None:
            return self.places
        places = []
        for throw in self.rows:
            places.append(throw.position + throw.rod_pitch * rod_places(throw))
        return jnp.concatenate(places)

    @property
    def phase(self) -> Float[Array, " k"]:
        """[rad] psi - theta of every cylinder."""
        return self.throw_angle - self.bank_angle

    @property
    def distinct_phase(self) -> Float[Array, " k"]:
        """[rad] The same, apart by far less than counts.

        Where kinks of two cylinders coincide, derivatives need to know what either does on both of its
        sides: a panel between the two has to lie between them.
        """
        apart = _APART * np.arange(self.count)
        if not apart.any():
            return self.phase
        return self.phase + apart

    @property
    def firing_intervals(self) -> Float[Array, " k"]:
        """[rad] between the top dead centres of a machine without offset, in the order of firing."""
        # half a degree of lead keeps what is 0 but for rounding from lying at the end
        at = jnp.sort(jnp.mod(jnp.deg2rad(0.5) - self.phase, 2 * jnp.pi))
        return jnp.diff(jnp.append(at, at[0] + 2 * jnp.pi))

    def order_sums(self, order: int) -> "OrderSums":
        r"""Sums of the cylinders' shaking forces of an order at constant speed.

        The force of all pistons on the frame, with $x + iy$ for its direction and the amplitude
        $A_n$ of one of them, is $A_n (f_+ e^{in\theta} + f_- e^{-in\theta})$: an ellipse with the
        semi-axes $|f_+| + |f_-|$ and $||f_+| - |f_-||$; with $z_k$ in the sums, $c_\pm$, its couples,
        moment $M_x + i M_y = i c$.

        $$f_\pm = \tfrac12 \sum_k e^{i (b_k \pm n (t_k - b_k))}$$

        Args:
            order: n, of the revolution.
        """
        turning = order * self.phase
        phasors = 0.5 * jnp.exp(1j * (self.bank_angle + jnp.stack([turning, -turning])))
        forward, backward = phasors.sum(-1)
        return OrderSums(forward, backward, *(phasors * self.position).sum(-1))

    def own_angle(self, angle: Float[Array, "*n"]) -> Float[Array, "k *n"]:
        """[rad] psi of every cylinder at crank angles [rad]."""
        return self.along(self.distinct_phase, angle) + angle

    def joint(self, name: str, number: int) -> str:
        """Name in results of a joint of cylinder `number` >= 1; only several cylinders are numbered."""
        if self.count == 1:
            return name
        return f"{name}_{number}"

    def second_rate(self, kinematics: AbstractKinematics, state: CrankState) -> Vector:
        """[1/s^2] Second time derivative of the unit vector along the crank at angle 0.

        Args:
            kinematics: of the linkages, whose first has the angle with its sine and cosine already.
            state: of the crank.
        """
        first = jax.tree.map(lambda leaf: leaf[0], kinematics)
        x, y = first.crank_acceleration(state)
        # Turned back by the first cylinder's phase, in whose crank angle the kinematics stand.
        c, s = jnp.cos(self.phase[0]), jnp.sin(self.phase[0])
        return Vector(c * x + s * y, c * y - s * x)

    def of_throws(self, values: Float[Array, "k *n"]) -> Float[Array, "t *n"]:
        """Sums of values of the cylinders over those of each throw."""
        ends = np.cumsum([throw.banks.size for throw in self.rows])[:-1]
        sums = []
        for values_of_throw in jnp.split(values, ends):
            sums.append(jnp.sum(values_of_throw, axis=0))
        return jnp.stack(sums)

    def along(
        self, values: Float[Array, " k"], like: Float[Array, "*n"]
    ) -> Float[Array, "k *ones"]:
        """A value of each cylinder, in a shape that goes with instants."""
        return values.reshape(values.shape + (1,) * jnp.ndim(like))

    def turned(self, force: Vector, back: bool = False) -> Vector:
        """Vectors from the axes of each cylinder, x along it, to those of the machine, or back."""
        bank_angle = self.bank_angle
        if back:
            bank_angle = -bank_angle
        angle = self.along(bank_angle, force.x[0])
        c, s = jnp.cos(angle), jnp.sin(angle)
        return Vector(c * force.x - s * force.y, s * force.x + c * force.y)

    def own_gravity(self, gravity: Float[Array, "2"], like: Float[Array, "*n"]):
        """A gravity [m/s^2] of the machine's axes in those of each cylinder: (2, k, 1)."""
        ones = jnp.ones((self.count,) + (1,) * jnp.ndim(like))
        return jnp.stack(self.turned(Vector(gravity[0] * ones, gravity[1] * ones), back=True))

    def crank_pulls(
        self, second: Vector, mechanism: AbstractMechanism, line, influence=None
    ) -> list[Vector]:
        """Shares of m receivers of the inertia [N] of the crank's unbalances, in machine axes.

        Args:
            second: [1/s^2] second time derivative of the unit vector along the crank at angle 0.
            mechanism: one of the cylinders.
            line: for each receiver what it takes of a force at z = 0 and of a moment, sum of F z:
                (1, 0) for all of the force, (0, 1) for the moment.
            influence: (m, t) what they take of forces at t places [m], where that is no straight line.
        """
        pulls = []
        for vector in self._crank_vectors(mechanism, line, influence):
            pulls.append(turned_with(*vector, second))
        return pulls

    def _crank_vectors(self, mechanism: AbstractMechanism, line, influence=None):
        """(2,) What each takes of the unbalances, along the crank at angle 0 and ahead of it."""
        angles = []
        places = []
        for throw in self.rows:
            angles.append(throw.angle)
            places.append(throw.position)
        angle = jnp.stack(angles)
        place = jnp.stack(places)
        vectors = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        # An unbalance turns with its throw, ahead of the crank at angle 0 by the throw's angle.
        vectors *= jnp.stack(self.unbalances(mechanism))
        if influence is None:
            influence = partial(along_lines, line)
        for (share, lever), reaction in zip(line, influence(place), strict=True):
            vector = vectors @ reaction
            if self.shaft_unbalance is not None:
                vector = vector + share * self.shaft_unbalance
            if self.shaft_couple is not None:
                vector = vector + lever * self.shaft_couple
            yield vector

    def weight_torque(
        self,
        angle: Float[Array, "*n"],
        gravity: Float[Array, "2"],
        mechanism: AbstractMechanism,
    ):
        """[N m] on the crank, of the weights of its unbalances."""
        (vector,) = self._crank_vectors(mechanism, [(1.0, 0.0)])
        x, y = turned_with(*vector, Vector(jnp.cos(angle), jnp.sin(angle)))
        return x * gravity[1] - y * gravity[0]


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


def counterweights(mechanism: AbstractMechanism, crankshaft: Crankshaft) -> Crankshaft:
    r"""The crankshaft with the counterweights that take what turns forward of the first order.

    On a throw of n rods $u = -(n m_{rot} + \tfrac n2 m_{rec})\,r$: banks that are equally spaced over
    180 degrees have then no first order left, neither force nor couple, if the rods are at one place.

    Args:
        mechanism: one of the cylinders.
        crankshaft: its unbalances at the throws do not matter.
    """
    weights = _counterweights(mechanism, crankshaft)
    throws = []
    for throw, weight in zip(crankshaft.rows, weights, strict=True):
        throws.append(replaced(throw, unbalance=weight))
    none = jnp.zeros_like(crankshaft.unbalance)
    return rebuilt(crankshaft, throws=tuple(throws), layout=None, balanced=False, unbalance=none)


def _counterweights(mechanism: AbstractMechanism, crankshaft: Crankshaft) -> list[Float[Array, ""]]:
    each = jnp.broadcast_to(-mechanism.half_balance, (crankshaft.count,))
    return list(crankshaft.of_throws(each))
