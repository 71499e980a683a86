"""What parts of one's own are declared with: the base class, quantities with units, and their bounds."""

from ._core.errors import BadInput as BadInput
from ._core.extensions import ExtensionError as ExtensionError
from ._core.extensions import import_extensions as import_extensions
from ._core.fields import ANY as ANY
from ._core.fields import NONNEGATIVE as NONNEGATIVE
from ._core.fields import POSITIVE as POSITIVE
from ._core.fields import Bound as Bound
from ._core.fields import Part as Part
from ._core.fields import quantity as quantity
