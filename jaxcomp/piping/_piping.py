"""A network of pipes between the valves and a line of constant pressure, as machine files describe it."""

from collections.abc import Iterator
from itertools import chain
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import POSITIVE, Part, quantity
from .end import AbstractEnd
from .orifice import Orifice
from .pipe import Pipes
from .run import Run
from .vessel import Vessel
from .volume import Volume

LINE = "line"
FLANGE = "flange"
# Harmonics that the collocation's panels can carry; see `CylinderLines`.
FEWEST_ORDERS = 4
MOST_ORDERS = 128


class Piping(Part):
    """A network of pipes between the valves and a line of constant pressure.

    Node "line" has the given pressure, node "flange" is where the valves of all cylinders draw from or
    deliver to; "flange-1", "flange-2" that of each cylinder, or of each end of double-acting ones, head
    before crank end. With plenums "flange" is their neck at the line.

    Args:
        pipes: from node to node.
        volumes: bottles and vessels.
        orifices: plates and other resistances.
        ends: of pipes that lead to neither flange nor line; closed where none is given.
        runs: straight pieces on whose bends the pressure acts.
        vessels: bottles whose length counts, with the force on their end plates.
        temperature: [K] of the gas in the pipes; absent: in the suction line that of the gas as it
            comes, in the discharge line the mean of what is delivered.
        orders: harmonics of the revolution.

    Raises:
        BadInput: a network that is not joined, or whose mean flow finds no way to the line.
    """

    kind: ClassVar[str] = "piping"

    pipes: tuple[Pipes, ...]
    volumes: tuple[Volume, ...] = ()
    orifices: tuple[Orifice, ...] = ()
    ends: tuple[AbstractEnd, ...] = ()
    runs: tuple[Run, ...] = ()
    vessels: tuple[Vessel, ...] = ()
    temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="of the gas in the pipes", usual=(150.0, 700.0)
    )
    orders: int = eqx.field(static=True, default=64)

    def __check_init__(self):
        if not FEWEST_ORDERS <= self.orders <= MOST_ORDERS:
            bound = f">= {FEWEST_ORDERS} and <= {MOST_ORDERS}, harmonics of the revolution"
            raise BadInput("orders", self.orders, bound)
        if not self.pipes:
            raise BadInput("pipes", "none", 'one pipe or more, from "flange" to "line"')
        self._check_names()
        self._check_ways()

    def _check_names(self):
        joined = set(self.nodes)
        last_nodes = f"pipes.{len(self.pipes) - 1}.nodes"
        if LINE not in joined:
            raise BadInput(
                last_nodes, self._names(), f'names of which one is "{LINE}", the given pressure'
            )
        if not self.flanges:
            bound = f'names of which one is "{FLANGE}", the side of the valves'
            raise BadInput("pipes.0.nodes", self._names(), bound)
        numbers = [f"{FLANGE}-{number}" for number in range(1, len(self.flanges) + 1)]
        if self.flanges not in ((FLANGE,), tuple(numbers)):
            bound = f'"{FLANGE}" of all cylinders, or "{FLANGE}-1", "{FLANGE}-2" and so on of each'
            raise BadInput("pipes.0.nodes", ", ".join(self.flanges), bound)
        self._check_elements(joined)
        self._check_ends()
        self._check_shaken()

    def _check_elements(self, joined: set[str]):
        for entry in ("volumes", "ends"):
            for number, element in enumerate(getattr(self, entry)):
                place = f"{entry}.{number}.node"
                if element.node not in joined:
                    names = ", ".join(f'"{node}"' for node in self.nodes)
                    raise BadInput(place, element.node, f"a node of the pipes: {names}")
                if element.node == LINE:
                    bound = f'another node than "{LINE}", whose pressure is given'
                    raise BadInput(place, LINE, bound)
        for number, run in enumerate(self.runs):
            if not set(run.nodes) <= joined:
                unknown = ", ".join(node for node in run.nodes if node not in joined)
                raise BadInput(f"runs.{number}.nodes", unknown, "nodes of the pipes")

    def _check_shaken(self):
        """Refuse two names for one force."""
        names = self.run_names
        for number, vessel in enumerate(self.vessels):
            name = "-".join(vessel.ends)
            if names.count(name) > 1:
                bound = f"other nodes than those of another vessel or run: {name} is one force"
                raise BadInput(f"vessels.{number}.nodes", ", ".join(vessel.nodes), bound)

    def _check_ends(self):
        numbers = {}
        for number, end in enumerate(self.ends):
            if end.node in self.flanges:
                bound = "another node than a flange, which the valves end"
                raise BadInput(f"ends.{number}.node", end.node, bound)
            if end.node in numbers:
                value = f"{end.node}, {end.kind}"
                bound = f"a node without an end: ends.{numbers[end.node]} is there already"
                raise BadInput(f"ends.{number}.node", value, bound)
            numbers[end.node] = number

    def _check_ways(self):
        reached = self._reached(LINE)
        for entry in ("pipes", "vessels"):
            for number, duct in enumerate(getattr(self, entry)):
                for node in duct.nodes:
                    if node not in reached:
                        bound = f'joined to "{LINE}" by pipes or orifices; "{node}" leads nowhere'
                        raise BadInput(f"{entry}.{number}.nodes", node, bound)
        for number, orifice in enumerate(self.orifices):
            for node in orifice.nodes:
                if node not in reached or node not in self._ends_of_others(orifice):
                    bound = f'joined to "{LINE}" as well: "{node}" leads nowhere'
                    raise BadInput(f"orifices.{number}.nodes", node, bound)

    def _ends_of_others(self, orifice: Orifice) -> set[str]:
        """Names of nodes that other elements have, and of the line."""
        nodes = {LINE}
        for element in (*self.orifices, *self.ducts):
            if element is not orifice:
                nodes.update(element.nodes)
        return nodes

    def _names(self) -> str:
        return ", ".join(self.nodes)

    def edges(self) -> Iterator[tuple[str, str]]:
        """Pairs of nodes that a pipe, a vessel or an orifice joins."""
        for element in (*self.ducts, *self.orifices):
            yield from zip(element.nodes, element.nodes[1:], strict=False)

    def _reached(self, start: str) -> set[str]:
        reached = {start}
        before = 0
        while len(reached) > before:
            before = len(reached)
            for edge in self.edges():
                if reached & set(edge):
                    reached |= set(edge)
        return reached

    @property
    def ducts(self) -> tuple[Pipes | Vessel, ...]:
        """All that waves run along."""
        return (*self.pipes, *self.vessels)

    @property
    def pipe_count(self) -> int:
        """Number of pipes between two nodes, which stand before vessels in the arrays of a network."""
        return sum(len(pipes.nodes) - 1 for pipes in self.pipes)

    @property
    def shaken(self) -> tuple[Run | Vessel, ...]:
        """All that waves push to and fro."""
        return (*self.runs, *self.vessels)

    @property
    def run_names(self) -> list[str]:
        """Names of these: those of their ends with a hyphen."""
        return ["-".join(element.ends) for element in self.shaken]

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of all nodes, in the order of the file."""
        return tuple(dict.fromkeys(chain.from_iterable(self.edges())))

    @property
    def flanges(self) -> tuple[str, ...]:
        """Names of the nodes at valves: one of all cylinders, or one of each."""
        numbered = [node for node in self.nodes if node.startswith(f"{FLANGE}-")]
        common = [FLANGE] if FLANGE in self.nodes else []
        return (*common, *sorted(numbered, key=lambda name: (len(name), name)))

    @property
    def follows_delivery(self) -> bool:
        """Whether the temperature of the gas is that of what is delivered or comes."""
        return self.temperature is None
