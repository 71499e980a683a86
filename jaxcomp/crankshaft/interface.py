"""What packages that are built on this one take from it, and users need not."""

from ._bearings import ShaftBearings as ShaftBearings
from ._bearings import bearing_names as bearing_names
from ._bearings import film_journals as film_journals
from ._bearings import moving_journals as moving_journals
from ._bearings import shares as shares
from ._bearings import with_journal_positions as with_journal_positions
from ._crankshaft import OF_ROTOR as OF_ROTOR
from ._crankshaft import OrderSums as OrderSums
from ._loops import MachineLoops as MachineLoops
from ._loops import machine_loops as machine_loops
