"""What packages that are built on this one take from it, and users need not."""

from ._best import BestCurve as BestCurve
from ._best import shown_column as shown_column
from ._run import sweep_machines as sweep_machines
from ._store import quantity_names as quantity_names
from ._store import status_words as status_words
from ._summary import columns as columns
from ._summary import machine_parts as machine_parts
from ._summary import summary as summary
