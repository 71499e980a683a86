"""A plugin of pytest (`-p shape_checks`) that holds every call to the shapes that its annotations say.

Results that were brought to the host are arrays of NumPy where the annotations say `Array`: shape and
kind of number are checked, and not whose array it is.
"""

import jax
import jaxtyping
import numpy as np

jaxtyping.Array = jax.Array | np.ndarray | np.generic | float  # pyright: ignore[reportAttributeAccessIssue]
jaxtyping.install_import_hook("jaxcomp", "beartype.beartype")
