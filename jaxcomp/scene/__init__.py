"""Scene files: machines in TOML with units, and the source of every value."""

from .._words import did_you_mean as did_you_mean
from ._change import with_lists as with_lists
from ._change import with_machine as with_machine
from ._change import with_value as with_value
from ._change import with_values as with_values
from ._describe import DescribedValue as DescribedValue
from ._describe import ImplausibleValue as ImplausibleValue
from ._describe import describe as describe
from ._describe import implausible_values as implausible_values
from ._explain import Explained as Explained
from ._explain import explained as explained
from ._explain import part_places as part_places
from ._explain import start as start
from ._explain import starts as starts
from ._scene import Bundled as Bundled
from ._scene import Scene as Scene
from ._scene import dump as dump
from ._scene import load as load
from ._scene import loads as loads
from ._scene import machines as machines
from ._schema import NAMED as NAMED
from ._schema import SECTIONS as SECTIONS
from ._text import NUMBER as NUMBER
from ._text import SceneError as SceneError
from ._text import visible as visible
from ._units import to_si as to_si
