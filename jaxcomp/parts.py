"""What parts of one's own are declared with: the base class, quantities with units, and their bounds."""

from ._extensions import ExtensionError as ExtensionError
from ._extensions import import_extensions as import_extensions
from ._fields import ANY as ANY
from ._fields import NONNEGATIVE as NONNEGATIVE
from ._fields import POSITIVE as POSITIVE
from ._fields import BadInput as BadInput
from ._fields import Bound as Bound
from ._fields import Part as Part
from ._fields import quantity as quantity
