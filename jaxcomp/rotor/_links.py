r"""Links between two nodes or a node and the ground: bearings, suspensions, grommets, magnetic pull.

A link acts on the relative motion d = x_a - x_b of some axes of its two nodes with the force
K(W) d + C(W) d' on node b (and its opposite on node a). The law behind K and C is any object with

    coefficients(spin_speed) -> (K, C)

of shape (n_axes, n_axes), and if it likes the number of axes as `size`. They are K_B, C_B, K_S, C_S and
K_SP in Eq. (1) of Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`. The film of a
journal bearing is linearised at its static load, or by means over a revolution along the orbit that the
journal has in the crank's periodic state (Eqs. (6) and (7) there, whose number is Someya's with the
speed in rev/s). A link may also be `Pinned` or `Clamped`: then it has no law, d is zero, and the
freedoms that it holds are not in the equations.
"""

from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import clip
from .._core.fields import POSITIVE, Part, is_traced, quantity
from .._core.lookup import interval_of
from ..film import AbstractSolvedFilm, JournalBearing, NamedBearing
from ..film._running import stiffness_damping
from ._conventions import SPACE_AXES, check_axes
from ._shaft import Node

GROUND = "ground"  # the word for `None` in lists of nodes
_RADIAL = ("ux", "uy")


@runtime_checkable
class LinkLaw(Protocol):
    """Protocol of the law of a link: stiffness and damping at a spin speed."""

    def coefficients(
        self, spin_speed: Float[Array, ""]
    ) -> tuple[Float[Array, "a a"], Float[Array, "a a"]]:
        """Stiffness [N/m, N, N m] and damping matrices at the spin speed [rad/s]."""
        ...


class ConstantLaw(Part):
    """Stiffness and damping that do not depend on the speed.

    Args:
        stiffness: [N/m] (a, a); entries of rotations in [N] and [N m].
        damping: [N s/m] (a, a).

    Raises:
        BadInput: matrices that are not square, or of different size.
    """

    kind: ClassVar[str] = "constant"

    stiffness: Array = quantity("N/m", shape=(None, None))
    damping: Array = quantity("N s/m", shape=(None, None))

    def __check_init__(self):
        _check_square(self)

    @property
    def size(self):
        """Number of axes."""
        return self.stiffness.shape[-1]

    def coefficients(self, spin_speed):
        """The two matrices."""
        del spin_speed
        return self.stiffness, self.damping


class Mount(Part):
    """Uncoupled springs and dampers: a suspension or grommet.

    Args:
        stiffness: [N/m] (t,) along the displacements among the link's axes, which stand first.
        damping: [N s/m] (t,)
        angular_stiffness: [N m/rad] (r,) about the rotations that follow; absent for none.
        angular_damping: [N m s/rad] (r,)

    Raises:
        BadInput: dampings that do not go with the stiffnesses one by one.
    """

    kind: ClassVar[str] = "mount"

    stiffness: Array = quantity("N/m", shape=(None,))
    damping: Array = quantity("N s/m", shape=(None,))
    angular_stiffness: Array | None = quantity("N m/rad", shape=(None,), default=None)
    angular_damping: Array | None = quantity("N m s/rad", shape=(None,), default=None)

    def __check_init__(self):
        for stiffness, damping in (
            ("stiffness", "damping"),
            ("angular_stiffness", "angular_damping"),
        ):
            pair = getattr(self, stiffness), getattr(self, damping)
            sizes = set()
            for values in pair:
                # absent ones have a size that no other has
                sizes.add(-1 if values is None else jnp.size(values))
            if len(sizes) > 1:
                raise BadInput(
                    damping, getattr(self, damping), f"one value for each of `{stiffness}`"
                )

    @property
    def size(self):
        """Number of axes."""
        if self.angular_stiffness is None:
            return self.stiffness.size
        return self.stiffness.size + self.angular_stiffness.size

    def coefficients(self, spin_speed):
        """The two matrices."""
        del spin_speed
        if self.angular_stiffness is None or self.angular_damping is None:
            return jnp.diag(self.stiffness), jnp.diag(self.damping)
        stiffness = jnp.concatenate([self.stiffness, self.angular_stiffness])
        damping = jnp.concatenate([self.damping, self.angular_damping])
        return jnp.diag(stiffness), jnp.diag(damping)


class SpeedTable(Part):
    """Stiffness and damping tabulated over the spin speed.

    Every interpolant passes through the table's own points to the last bit. Outside the table the
    end values hold.

    Args:
        speed: [rad/s] (m,), increasing.
        stiffness: [N/m] (m, a, a)
        damping: [N s/m] (m, a, a)
        kind: "linear", or "monotone" for the piecewise cubic of F. N. Fritsch and J. Butland
            (1984), SIAM J. Sci. Stat. Comput. 5, which is smooth and makes no new extremum.

    Raises:
        BadInput: a table that is not increasing, columns of different length, or matrices that are
            not square or of different size.
    """

    speed: Array = quantity("rad/s", shape=(None,))
    stiffness: Array = quantity("N/m", shape=(None, None, None))
    damping: Array = quantity("N s/m", shape=(None, None, None))
    kind: Literal["linear", "monotone"] = eqx.field(static=True, default="monotone")

    def __check_init__(self):
        _check_square(self)
        m = self.speed.shape[0]
        for name in ("stiffness", "damping"):
            if getattr(self, name).shape[0] != m:
                raise BadInput(name, getattr(self, name), f"one matrix for each of {m} speeds")
        if m < 2:
            raise BadInput("speed", self.speed, "at least two speeds")
        if self.kind not in ("linear", "monotone"):
            raise BadInput("kind", self.kind, "one of ('linear', 'monotone')")

    @property
    def size(self):
        """Number of axes."""
        return self.stiffness.shape[-1]

    def conditions(self):
        # a condition and no exception where the table is built, since speeds may be traced
        return {"a table with increasing speeds": (self.speed[1:] > self.speed[:-1]).all()}

    def coefficients(self, spin_speed):
        """The two matrices at a speed."""
        stiffness = _through_points(self.speed, self.stiffness, spin_speed, self.kind)
        damping = _through_points(self.speed, self.damping, spin_speed, self.kind)
        return stiffness, damping


class Pinned(Part):
    """No relative motion along the axes of the link; a pin, with the default axes.

    The freedoms are removed from the equations, without the large numbers of a stiff spring.
    """

    kind: ClassVar[str] = "pinned"


class Clamped(Part):
    """No relative motion and no relative rotation, whatever `axes` the model has."""

    kind: ClassVar[str] = "clamped"


class Link(Part):
    """One bearing, suspension or grommet.

    Args:
        nodes: the two nodes; `None` or "ground" as the second is the ground.
        law: object with `coefficients(spin_speed)`, or a condition, `Pinned` or `Clamped`.
        axes: the axes that the law's matrices refer to or that a pin holds, by default ("ux", "uy"); a
            clamp holds all. Axes that a model of 4 degrees of freedom lacks (uz, thz) are left out there.

    Raises:
        BadInput: unknown axes, the same node twice, matrices of another size than `axes`, or fewer
            axes beside `Clamped`.
    """

    nodes: tuple[Node, Node | None] = eqx.field(static=True)
    law: LinkLaw | Pinned | Clamped
    axes: tuple[str, ...] = eqx.field(static=True, default=_RADIAL)

    def __post_init__(self):
        self.nodes = _grounded(self.nodes)
        if isinstance(self.law, Clamped):
            # the first is the default; the second is set below and comes back where a link is rebuilt
            if self.axes not in (_RADIAL, SPACE_AXES):
                bound = "left out beside a clamped link, which holds all (pin single ones)"
                raise BadInput("axes", str(self.axes), bound)
            self.axes = SPACE_AXES

    @property
    def held(self) -> bool:
        """Whether the link is a condition, which removes freedoms."""
        return isinstance(self.law, Pinned | Clamped)

    def __check_init__(self):
        check_axes(self.axes)
        if len(self.nodes) != 2 or self.nodes[0] is None or self.nodes[0] == self.nodes[1]:
            raise BadInput("nodes", str(self.nodes), "two different nodes, or a node and None")
        # a law that somebody else wrote need not tell its size
        size = getattr(self.law, "size", len(self.axes))
        if size != len(self.axes):
            raise BadInput("axes", str(self.axes), f"{size} axes, as the matrices of `law` have")


class MagneticPull(Part):
    """Unbalanced magnetic pull between stator and rotor: a negative isotropic radial stiffness.

    Args:
        nodes: pairs (rotor node, stator node); `None` or "ground" as the second for a fixed
            stator.
        stiffness: [N/m] magnitude over the whole length of the core, positive.
        share: [-] (n,) part of it on each pair; absent: equal parts.

    Raises:
        BadInput: shares that are not one a pair, or do not add up to one.
    """

    nodes: tuple[tuple[Node, Node | None], ...] = eqx.field(static=True)
    stiffness: Array = quantity("N/m", POSITIVE)
    share: Array | None = quantity("", POSITIVE, shape=(None,), default=None)

    def __post_init__(self):
        self.nodes = tuple(_grounded(pair) for pair in self.nodes)

    def __check_init__(self):
        n = len(self.nodes)
        share = self.share
        if share is None:
            return
        if share.shape != (n,):
            raise BadInput("share", share, f"one value for each of {n} pairs")
        if not is_traced(share) and abs(float(jnp.sum(share)) - 1) > 1e-9:
            raise BadInput("share", share, "parts that add up to 1")


def _check_square(law) -> None:
    columns = law.stiffness.shape[-1]
    for name, bound in (("stiffness", "square matrices"), ("damping", "as large as `stiffness`")):
        shape = getattr(law, name).shape
        if shape[-2:] != (columns, columns):
            raise BadInput(name, f"of shape {shape}", bound)


def _grounded(nodes: tuple) -> Any:
    """A pair of nodes with `None` for the word "ground"."""
    grounded = []
    for node in nodes:
        # a file has a word for the ground, since TOML has no empty value; a model has `None`
        if node == GROUND:
            node = None
        grounded.append(node)
    return tuple(grounded)


def isotropic(stiffness, damping=0.0, *, size: int = 2) -> ConstantLaw:
    """Law of equal stiffness [N/m] and damping [N s/m] along `size` axes.

    Args:
        stiffness: [N/m] one value.
        damping: [N s/m] one value.
        size: number of axes.
    """
    eye = jnp.eye(size)
    return ConstantLaw(stiffness * eye, damping * eye)


def diagonal(stiffness, damping) -> ConstantLaw:
    """Uncoupled axes.

    Args:
        stiffness: [N/m] (a,) along the axes of the link, [N m/rad] about them.
        damping: [N s/m] (a,) or [N m s/rad].
    """
    return ConstantLaw(jnp.diag(jnp.asarray(stiffness)), jnp.diag(jnp.asarray(damping)))


def magnetic_pull_stiffness(pull: MagneticPull) -> Float[Array, " n"]:
    """[N/m] Negative radial stiffness of each pair."""
    share = pull.share
    if share is None:
        share = jnp.full(len(pull.nodes), 1 / len(pull.nodes))
    # Negative: the pull is towards the narrower gap and grows as it closes.
    return -pull.stiffness * share


def _through_points(x, y, at, kind):
    """Interpolate `y` (m, ...) over `x` (m,); exact at every point of the table."""
    at = clip(at, x[0], x[-1])
    i = interval_of(x, at)
    h = x[i + 1] - x[i]
    t = (at - x[i]) / h
    if kind == "linear":
        # Not y + t (y' - y), which misses y' by a rounding at t = 1.
        return (1 - t) * y[i] + t * y[i + 1]
    slope = _monotone_slopes(x, y)
    # Hermite's cubic as a blend of the ends and a part that is zero at both to the last bit.
    a, b = t**2 * (3 - 2 * t), t * (1 - t)
    ends = (1 - a) * y[i] + a * y[i + 1]
    return ends + h * b * ((1 - t) * slope[i] - t * slope[i + 1])


def _monotone_slopes(x, y):
    h = jnp.diff(x).reshape((-1,) + (1,) * (y.ndim - 1))
    d = jnp.diff(y, axis=0) / h
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    same = d[1:] * d[:-1] > 0
    # Double where: the harmonic mean divides by the slopes, which may be zero.
    low = jnp.where(same, d[:-1], 1.0)
    high = jnp.where(same, d[1:], 1.0)
    # Flat where the slope changes sign, so that an extremum of the table stays one.
    inner = jnp.where(same, (w1 + w2) / (w1 / low + w2 / high), 0.0)
    # The secants at the ends: with them the cubic stays monotone in the outer intervals as well.
    return jnp.concatenate([d[:1], inner, d[-1:]])


class LoadedFilm(Part):
    """The film of a bearing, linearised; see `stiffness_damping`.

    Args:
        bearing: the bearing, or the name of one of the machine. One whose journal moves in its film is
            taken as the same bearing under a steady load.
        load: [N] (2,) static load on the journal along x and y, or (m, 2) at the speeds of `speed`;
            absent: from the crank's periodic state and the statics of the shaft, at every speed.
        speed: [rad/s] (m,) increasing spin speeds of a table of loads, which is interpolated linearly
            and held beyond its ends.
        linearised: where stiffness and damping are taken: at the "mean_load", or as their means over a
            revolution along the "orbit" of the journal, which the crank's periodic state gives.
        name: of the bearing in the results of the crank; by default its own.

    Raises:
        BadInput: a film model without stiffness and damping, loads that do not fit the speeds, or a
            load beside "orbit".
    """

    kind: ClassVar[str] = "film"
    size: ClassVar[int] = 2

    bearing: JournalBearing | NamedBearing
    load: Array | None = quantity(
        "N",
        shape=(...,),
        default=None,
        doc="static, on the journal, along x and y; absent: from the crank's periodic state",
    )
    speed: Array | None = quantity(
        "rad/s", shape=(None,), default=None, doc="of the rows of a table of loads"
    )
    linearised: Literal["mean_load", "orbit"] = eqx.field(static=True, default="mean_load")
    name: str | None = eqx.field(static=True, default=None)

    def __post_init__(self):
        # at the mean load the name stays out, so that films of one kind are traced once
        if self.linearised == "orbit" and isinstance(self.bearing, NamedBearing):
            self.name = self.name or self.bearing.name

    def __check_init__(self):
        if isinstance(self.bearing, JournalBearing) and not issubclass(
            self.bearing.model, AbstractSolvedFilm
        ):
            raise BadInput("bearing.film", self.bearing.film, "a film with stiffness and damping")
        shape = (2,) if self.speed is None else (*self.speed.shape, 2)
        if self.load is not None and self.load.shape != shape:
            raise BadInput("load", self.load, f"of shape {shape}")
        if self.linearised not in ("mean_load", "orbit"):
            raise BadInput("linearised", self.linearised, '"mean_load" or "orbit"')
        if self.linearised == "orbit" and self.load is not None:
            raise BadInput("load", self.load, 'absent beside linearised = "orbit"')

    def coefficients(self, spin_speed):
        """Stiffness and damping of the film at a spin speed.

        Raises:
            BadInput: a bearing or load that only the whole machine knows.
        """
        if self.load is None or isinstance(self.bearing, NamedBearing):
            missing = "bearing" if isinstance(self.bearing, NamedBearing) else "load"
            raise BadInput(missing, "open", "resolved by its machine, see `jaxcomp.Machine`")
        load = self.load
        if self.speed is not None:
            # The table counts speeds without a sense of rotation, which acts in the film.
            at = jnp.abs(spin_speed)
            load = jax.vmap(lambda column: jnp.interp(at, self.speed, column), -1)(load)
        return tuple(stiffness_damping(self.bearing, load, spin_speed))
