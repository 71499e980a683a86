r"""The main bearings of a shaft: how they share its load, and what each of them loses.

The shaft is rigid, its bearings stand at $z_i$ along it from the plane of the rod, and each takes part
in proportion to its weight $w_i$. A force $F$ with the moment $M$ about the plane of the rod
($M = \sum F_j z_j$) is then shared as

$$F_i = w_i\Big(\frac{F}{\sum w} + \frac{(M - \bar z F)(z_i - \bar z)}{\sum w\,(z - \bar z)^2}\Big),
  \qquad \bar z = \frac{\sum w z}{\sum w} .$$

For two bearings this is the law of the lever whatever the weights, Eqs. (27) and (28) of Dagilis et
al., *Slider-link driven compressor (I)*. For more it assumes films whose stiffness goes with their
projected area; the bending of the shaft is left out.

With `shaft="beam"` the bearings are rigid, and a uniform shaft bends between them. Its line
$w(z) = a + bz + \tfrac{1}{12EI}(\sum R_i |z - z_i|^3 - \sum F_j |z - z_j|^3)$ vanishes at the bearings,
which with the balances of force and moment gives the reactions: those of the three-moment equation.
"""

from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, BadInput, Part, quantity, replaced
from ..film import AbstractJournal, JournalBearing, NamedBearing, OrbitBearing, PlacedJournal
from ..mechanism import Vector
from ._drag import STANDARD_GRAVITY, OilPump, ThrustBearing
from ._loads import magnitude, shaft_loss


class MainBearings(Part):
    """The radial bearings of the shaft along its axis, with thrust bearing and oil pump.

    Args:
        bearings: the bearings or their names.
        position: [m] (n,) of each along the shaft from the plane of the rod, any direction positive;
            absent where a rotor says on which nodes they stand, or for a single bearing in the plane.
        shaft_mass: [kg] shaft with rotor, on the thrust bearing.
        thrust_bearing: its law; `None` for none.
        pump: drag of the oil pump; `None` for none.
        names: of the bearings in results; by default their own, or "main_1" and so on.
        shaft: "rigid" on films, or a "beam" of constant section on rigid bearings; see the head of the
            module. For two bearings both are the law of the lever.

    Raises:
        BadInput: no bearing, names that are not one a bearing, or positions that are not.
    """

    kind: ClassVar[str] = "main_bearings"

    bearings: tuple[AbstractJournal, ...]
    position: Float[Array, " n"] | None = quantity(
        "m", shape=(None,), default=None, doc="along the shaft from the plane of the rod"
    )
    shaft_mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, default=0.0, doc="shaft with rotor, on the thrust bearing"
    )
    thrust_bearing: ThrustBearing | None = None
    pump: OilPump | None = None
    names: tuple[str, ...] | None = eqx.field(static=True, default=None)
    shaft: Literal["rigid", "beam"] = eqx.field(static=True, default="rigid")

    def __post_init__(self):
        if self.names is None and isinstance(self.bearings, tuple):
            self.names = tuple(
                one.name if isinstance(one, NamedBearing) else f"main_{number}"
                for number, one in enumerate(self.bearings, 1)
            )

    def __check_init__(self):
        count = len(self.bearings)
        if not count:
            raise BadInput("bearings", "()", "at least one bearing")
        if self.names is None or len(set(self.names)) != count:
            raise BadInput("names", str(self.names), f"{count} different names, one a bearing")
        if self.position is not None and self.position.shape != (count,):
            raise BadInput("position", self.position, f"one for each of {count} bearings")
        if self.shaft not in ("rigid", "beam"):
            raise BadInput("shaft", self.shaft, '"rigid" or "beam"')

    def conditions(self):
        if self.position is None or len(self.bearings) < 2:
            return {}
        apart = self.position.max() > self.position.min()
        return {"a shaft with bearings in different places": apart}

    def reactions(self, force: Vector, moment: Vector | None) -> dict[str, Vector]:
        """[N] Force of each bearing on the shaft, by name.

        Args:
            force: [N] sum of all of them in x and y.
            moment: [N m] sum of force times position; `None` for none.

        Raises:
            BadInput: several bearings whose positions nobody gave.
        """
        found = {}
        for name, (share, lever) in zip(self.names or (), self.line(), strict=True):
            own = Vector(share * force.x, share * force.y)
            if moment is not None:
                own = Vector(own.x + lever * moment.x, own.y + lever * moment.y)
            found[name] = own
        return found

    def influence(self, places: Float[Array, " k"]) -> Float[Array, "m k"]:
        """[-] What each of m bearings takes of a force at places [m] along the shaft."""
        if self.shaft == "beam" and len(self.bearings) > 2:
            return _beam(self._positions(), places)
        return jnp.stack([share + lever * places for share, lever in self.line()])

    def line(self):
        """What each bearing takes of a force at the origin [-] and of a moment there [1/m]."""
        position = self._positions()
        if self.shaft == "beam" and len(self.bearings) > 2:
            zero, one = jnp.zeros(1), jnp.ones(1)
            share, lever = jax.jvp(lambda z: _beam(position, z), (zero,), (one,))
            return list(zip(share[:, 0], lever[:, 0], strict=True))
        return shares(self.bearings, position)

    def _positions(self):
        if len(self.bearings) > 1 and self.position is None:
            raise BadInput("position", "absent", "given, or a rotor with these bearings in it")
        return self.position

    def moments(
        self, reactions: dict[str, Vector], rate: Float[Array, "*n"]
    ) -> dict[str, Float[Array, "*n"]]:
        """[N m] Friction of every part by name, for reactions [N] and a rate of rotation [rad/s]."""
        found = dict(
            zip(reactions, _moments(self.bearings, [*reactions.values()], rate), strict=True)
        )
        weight = self.shaft_mass * STANDARD_GRAVITY
        for name in ("thrust_bearing", "pump"):
            law = getattr(self, name)
            if law is not None:
                found[name] = law.moment(rate, weight)
        return found


def shares(
    bearings: tuple[AbstractJournal, ...], position: Float[Array, " n"] | None
) -> list[tuple[Float[Array, ""], Float[Array, ""]]]:
    """What each bearing of a rigid shaft takes of force [-] and moment [1/m]; see the head of the module.

    Args:
        bearings: of the shaft; their projected areas are the weights.
        position: [m] of each along the shaft; not needed for a single one.
    """
    if len(bearings) == 1:
        return [(jnp.ones(()), jnp.zeros(()))]
    weight = jnp.stack([_weight(one) for one in bearings])
    total = jnp.sum(weight)
    centre = jnp.sum(weight * position) / total
    arm = position - centre
    lever = weight * arm / jnp.sum(weight * arm**2)
    return list(zip(weight / total - centre * lever, lever, strict=True))


def _beam(supports: Float[Array, " m"], places: Float[Array, " k"]) -> Float[Array, "m k"]:
    """[-] Reactions of rigid supports of a uniform beam to unit forces at places [m]."""
    count, span = supports.size, jnp.max(supports) - jnp.min(supports)
    at, z = supports / span, places / span
    lines = jnp.stack([jnp.ones(count), at])
    matrix = jnp.block([[jnp.abs(at[:, None] - at) ** 3, lines.T], [lines, jnp.zeros((2, 2))]])
    right = jnp.concatenate([jnp.abs(at[:, None] - z) ** 3, jnp.stack([jnp.ones_like(z), z])])
    return jnp.linalg.solve(matrix, right)[:count]


def film_journals(friction: Any) -> dict[str, JournalBearing | OrbitBearing]:
    """The oil-lubricated journals of a machine by joint; those of the shaft by their own names.

    Args:
        friction: the laws of a mechanism, or `None`.
    """
    laws = {} if friction is None else dict(vars(friction))
    support = laws.get("main_journal")
    if isinstance(support, MainBearings):
        laws |= dict(zip(support.names or (), support.bearings, strict=True))
    kinds = (JournalBearing, OrbitBearing)
    return {name: law for name, law in laws.items() if isinstance(law, kinds)}


def moving_journals(friction: Any) -> dict[str, OrbitBearing]:
    """The journals whose orbits are solved, by joint; those of the shaft by their own names."""
    journals = film_journals(friction)
    return {name: law for name, law in journals.items() if isinstance(law, OrbitBearing)}


def placed(
    friction: Any, positions: dict[str, Float[Array, "2 *n"]], lossless: bool = False
) -> Any:
    """The laws with their moving journals at positions over the clearance, by joint.

    Args:
        friction: the laws of a mechanism.
        positions: (2, *n) of each journal.
        lossless: leave the losses of these out, for who adds them.
    """
    laws = {
        name: PlacedJournal(law, positions[name], lossless)
        for name, law in moving_journals(friction).items()
        if name in positions
    }
    support = getattr(friction, "main_journal", None)
    if isinstance(support, MainBearings):
        names = zip(support.names or (), support.bearings, strict=True)
        bearings = tuple(laws.pop(name, law) for name, law in names)
        laws["main_journal"] = replaced(support, bearings=bearings)
    return replaced(friction, **laws)


def _weight(bearing: AbstractJournal) -> Float[Array, ""]:
    """[m^2] Projected area; one of a law that has no length."""
    length, diameter = (getattr(bearing, name, None) for name in ("length", "diameter"))
    if length is None or diameter is None:
        return jnp.ones(())
    return length * diameter


def _moments(bearings, forces, rate) -> list[Float[Array, "*n"]]:
    """Bearings of one law are mapped over, so that the law is traced once."""
    kinds = {jax.tree.structure(one) for one in bearings}
    if len(bearings) < 2 or len(kinds) > 1 or isinstance(bearings[0], PlacedJournal):
        return [shaft_loss(one, load, rate) for one, load in zip(bearings, forces, strict=True)]
    loads = [magnitude(*force) for force in forces]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *bearings)
    return list(jax.vmap(lambda one, load: one.moment(load, rate))(stacked, jnp.stack(loads)))
