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
which with the balances of force and moment gives the reactions: those of the three-moment equation. On
films of the stiffness $k_i$, quasi-static, it gives way at every bearing by $R_i/k_i$ instead. The shaft
of a rotor is no uniform beam: `shaft="rotor"` takes the deflections of its finite elements on these
springs.
"""

from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.each import mapped
from .._core.errors import BadInput
from .._core.extremes import max_of, min_of
from .._core.fields import POSITIVE, Part, quantity, replaced
from .._core.lookup import interval_of
from .._core.polynomials import cubic_step
from ..film import AbstractJournal, JournalBearing, NamedBearing
from ..film._placed import PlacedJournal
from ..friction import MixedThrust, OilPump, ThrustBearing
from ..friction._joint_laws import STANDARD_GRAVITY
from ..friction._joint_loads import shaft_loss
from ..mechanism import Vector


class MainBearings(Part):
    """The radial bearings of the shaft along its axis, with thrust bearing and oil pump.

    Args:
        bearings: the bearings or their names.
        position: [m] (n,) of each along the shaft; absent where a rotor says on which nodes they stand,
            or for a single bearing.
        thrust_bearing: its law, under the weight of the shaft; `None` for none.
        pump: drag of the oil pump; `None` for none.
        names: of the bearings in results; by default their own, or "main_1" and so on.
        shaft: "rigid" on films, a "beam" of constant section, or the shaft of the "rotor" of the same
            machine; see the head of the module. For two bearings all are the law of the lever.
        stiffness: [N/m] (n,) of the films, for a beam or rotor; absent for rigid bearings under a beam.
        bending_stiffness: [N m^2] of a beam on films.

    Raises:
        BadInput: no bearing, names that are not one a bearing, positions or stiffnesses that are not, or
            stiffnesses that the shaft has no use for.
    """

    kind: ClassVar[str] = "main_bearings"

    bearings: tuple[AbstractJournal, ...]
    position: Float[Array, " n"] | None = quantity(
        "m", shape=(None,), default=None, doc="along the shaft"
    )
    thrust_bearing: ThrustBearing | MixedThrust | None = None
    pump: OilPump | None = None
    names: tuple[str, ...] | None = eqx.field(static=True, default=None)
    shaft: Literal["rigid", "beam", "rotor"] = eqx.field(static=True, default="rigid")
    stiffness: Float[Array, " n"] | None = quantity(
        "N/m", POSITIVE, shape=(None,), default=None, doc="of the films, for a beam or rotor"
    )
    bending_stiffness: Float[Array, ""] | None = quantity(
        "N m^2", POSITIVE, default=None, doc="of a beam on films"
    )

    def __post_init__(self):
        if self.names is None and isinstance(self.bearings, tuple):
            names = []
            for number, bearing in enumerate(self.bearings, 1):
                name = f"main_{number}"
                if isinstance(bearing, NamedBearing):
                    name = bearing.name
                names.append(name)
            self.names = tuple(names)

    def __check_init__(self):
        count = len(self.bearings)
        if not count:
            raise BadInput("bearings", "()", "at least one bearing")
        if self.names is None or len(set(self.names)) != count:
            raise BadInput("names", str(self.names), f"{count} different names, one a bearing")
        if self.position is not None and self.position.shape != (count,):
            raise BadInput("position", self.position, f"one for each of {count} bearings")
        if self.shaft not in ("rigid", "beam", "rotor"):
            raise BadInput("shaft", self.shaft, '"rigid", "beam" or "rotor"')
        stiffness = self.stiffness
        if stiffness is None and self.shaft == "rotor":
            raise BadInput("stiffness", None, 'given beside shaft = "rotor"')
        if stiffness is not None and (self.shaft == "rigid" or stiffness.shape != (count,)):
            bound = f"one for each of {count} bearings, of a beam or rotor"
            raise BadInput("stiffness", stiffness, bound)
        on_films = self.shaft == "beam" and stiffness is not None
        if on_films != (self.bending_stiffness is not None):
            bound = "given for a beam on films, and only there"
            raise BadInput("bending_stiffness", self.bending_stiffness, bound)

    def conditions(self):
        if self.position is None or len(self.bearings) < 2:
            return {}
        apart = self.position.max() > self.position.min()
        return {"a shaft with bearings in different places": apart}

    def influence(self, places: Float[Array, " k"]) -> Float[Array, "m k"]:
        """[-] What each of m bearings takes of a force at places [m] along the shaft.

        Raises:
            BadInput: the shaft of a rotor that is not there.
        """
        if self.shaft == "beam" and len(self.bearings) > 2:
            return _beam(self._positions(), places, self.stiffness, self.bending_stiffness)
        if self.shaft == "rotor" and len(self.bearings) > 2:
            raise BadInput("shaft", "rotor", "of a machine with a rotor that `loads.crank` joins")
        return jnp.stack(along_lines(self.line(), places))

    def line(self):
        """Shares of each bearing of a force at the origin [-] and of a moment there [1/m]."""
        if self.shaft != "rigid" and len(self.bearings) > 2:
            zero = jnp.zeros(1)
            unit = jnp.ones(1)
            # A moment is a couple of forces close together, of which each bearing takes the slope.
            share, lever = jax.jvp(self.influence, (zero,), (unit,))
            return list(zip(share[:, 0], lever[:, 0], strict=True))
        return shares(self.bearings, self._positions())

    def _positions(self):
        if len(self.bearings) > 1 and self.position is None:
            raise BadInput("position", "absent", "given, or a rotor with these bearings in it")
        return self.position

    def moments(
        self, reactions: dict[str, Vector], rate: Float[Array, "*n"], mass: Float[Array, ""]
    ) -> dict[str, Float[Array, "*n"]]:
        """[N m] Friction of every part by name.

        Args:
            reactions: [N] by name.
            rate: [rad/s] of rotation.
            mass: [kg] of the shaft, whose weight is on the thrust bearing.
        """
        x_forces, y_forces = zip(*reactions.values(), strict=True)
        forces = Vector(jnp.stack(x_forces), jnp.stack(y_forces))

        def loss(bearing, x, y):
            return shaft_loss(bearing, Vector(x, y), rate)

        if len(self.bearings) < 3:  # one after the other they share the program of a pin's film
            losses = []
            for bearing, x, y in zip(self.bearings, *forces, strict=True):
                losses.append(loss(bearing, x[None], y[None])[0])
        else:
            losses = mapped(loss, self.bearings, *forces)
        friction = dict(zip(reactions, losses, strict=True))
        drags = {"thrust_bearing": self.thrust_bearing, "pump": self.pump}
        weight = mass * STANDARD_GRAVITY
        for name, law in drags.items():
            if law is not None:
                friction[name] = law.moment(rate, weight)
        return friction


def shaft_losses(
    support: Any,
    reactions: dict[str, Vector],
    speed: Float[Array, "*n"],
    mass: Float[Array, ""],
) -> dict[str, Float[Array, "*n"]]:
    """[N m] Loss torque of each bearing of the shaft by name, under its force on the shaft [N].

    Args:
        support: `MainBearings`, the law of a single journal, or `None`.
        reactions: by name.
        speed: [rad/s] of the crank.
        mass: [kg] of the shaft.
    """
    if isinstance(support, MainBearings):
        return support.moments(reactions, speed, mass)
    if support is None:
        return {}
    return {name: shaft_loss(support, force, speed) for name, force in reactions.items()}


def shares(
    bearings: tuple[AbstractJournal, ...], position: Float[Array, " n"] | None
) -> list[tuple[Float[Array, ""], Float[Array, ""]]]:
    """Shares of each bearing of a rigid shaft of force [-] and moment [1/m]; see the head of the module.

    Args:
        bearings: of the shaft; their projected areas are the weights.
        position: [m] of each along the shaft; not needed for a single one.
    """
    if len(bearings) == 1:
        return [(jnp.ones(()), jnp.zeros(()))]
    weight = jnp.stack([_weight(bearing) for bearing in bearings])
    total = jnp.sum(weight)
    centre = jnp.sum(weight * position) / total
    arm = position - centre
    lever = weight * arm / jnp.sum(weight * arm**2)
    return list(zip(weight / total - centre * lever, lever, strict=True))


def along_lines(lines, place) -> list:
    """Shares that several receivers take of a force at a place [m] along the shaft.

    Args:
        lines: for each what it takes of a force at the origin, and of a moment [1/m].
        place: of any shape.
    """
    return [share + lever * place for share, lever in lines]


class ShaftBearings(MainBearings):
    """Main bearings under the shaft of a rotor, by the deflections of its finite elements.

    Between the nodes the elements are cubics, so that reactions are exact everywhere for a shaft
    without shear, and at the nodes for any.

    Args:
        places: [m] (k,) of the nodes, rising.
        values: [-] (n, k) what each bearing takes of a force at a node.
        slopes: [1/m] (n, k) its derivative along the shaft.
    """

    kind: ClassVar[str] = "shaft_bearings"
    in_files: ClassVar[bool] = False

    places: Float[Array, " k"] | None = None
    values: Float[Array, "n k"] | None = None
    slopes: Float[Array, "n k"] | None = None

    def influence(self, places):
        assert self.places is not None
        assert self.values is not None
        assert self.slopes is not None
        interval = interval_of(self.places, places)
        width = self.places[interval + 1] - self.places[interval]
        t = (places - self.places[interval]) / width
        ends = self.values[:, interval], self.values[:, interval + 1]
        slopes = self.slopes[:, interval], self.slopes[:, interval + 1]
        return cubic_step(t, width, ends, slopes)


def _beam(
    supports: Float[Array, " m"], places: Float[Array, " k"], stiffness=None, bending=None
) -> Float[Array, "m k"]:
    """[-] Reactions of the supports of a uniform beam to unit forces at places [m].

    The supports are rigid, or springs of a stiffness [N/m] under a bending stiffness [N m^2].
    """
    count = supports.size
    span = max_of(supports) - min_of(supports)
    # Over the span, so that cubes and straight lines in the system are of one size.
    at = supports / span
    z = places / span
    lines = jnp.stack([jnp.ones(count), at])
    bent = jnp.abs(at[:, None] - at) ** 3
    if stiffness is not None:
        # R_i/k_i, by which the spring gives way, times the 12 EI of the line.
        bent = bent + jnp.diag(12 * bending / (stiffness * span**3))
    # The last two rows are the balances of force and moment, the last two unknowns a and b.
    matrix = jnp.block([[bent, lines.T], [lines, jnp.zeros((2, 2))]])
    right = jnp.concatenate([jnp.abs(at[:, None] - z) ** 3, jnp.stack([jnp.ones_like(z), z])])
    return jnp.linalg.solve(matrix, right)[:count]


def bearing_names(crankshaft: Any) -> tuple[str, ...]:
    """Names in results of the bearings of a crankshaft."""
    support = crankshaft.main_journal
    if isinstance(support, MainBearings):
        return support.names or ()
    return ("main_journal",)


def film_journals(friction: Any, support: Any) -> dict[str, JournalBearing]:
    """The oil-lubricated journals of a machine by joint; those of the shaft by their own names.

    Args:
        friction: the laws of a mechanism, or `None`.
        support: law of the shaft's journal, `MainBearings` or `None`.
    """
    laws = {}
    if friction is not None:
        laws |= vars(friction)
    if isinstance(support, MainBearings):
        laws |= dict(zip(support.names or (), support.bearings, strict=True))
    else:
        laws["main_journal"] = support
    return {name: law for name, law in laws.items() if isinstance(law, JournalBearing)}


def moving_journals(friction: Any, support: Any) -> dict[str, JournalBearing]:
    """Those whose orbits are solved; see `film_journals`."""
    moving = {}
    for name, journal in film_journals(friction, support).items():
        if journal.moves:
            moving[name] = journal
    return moving


def with_journal_positions(
    friction: Any,
    support: Any,
    positions: dict[str, Float[Array, "2 *n"]],
    lossless: bool = False,
) -> tuple[Any, Any]:
    """The laws of joints and shaft with their moving journals at positions over the clearance.

    Args:
        friction, support: as of `film_journals`.
        positions: (2, *n) of each journal, by joint.
        lossless: leave the losses of these out, for who adds them.
    """
    laws = {}
    for name, law in moving_journals(friction, support).items():
        if name in positions:
            laws[name] = PlacedJournal(law, positions[name], lossless)
    if isinstance(support, MainBearings):
        bearings = []
        for name, law in zip(support.names or (), support.bearings, strict=True):
            bearings.append(laws.pop(name, law))
        support = replaced(support, bearings=tuple(bearings))
    support = laws.pop("main_journal", support)
    if laws:
        friction = replaced(friction, **laws)
    return friction, support


def _weight(bearing: AbstractJournal) -> Float[Array, ""]:
    """[m^2] Projected area; one of a law that has no length."""
    length = getattr(bearing, "length", None)
    diameter = getattr(bearing, "diameter", None)
    if length is None or diameter is None:
        return jnp.ones(())
    return length * diameter
