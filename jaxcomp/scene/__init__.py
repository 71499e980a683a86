"""Scene files: machines in TOML with units, and the source of every value."""

from .._words import did_you_mean as did_you_mean
from ._annotate import start as start
from ._annotate import starts as starts
from ._describe import Row as Row
from ._describe import describe as describe
from ._errors import SceneError as SceneError
from ._errors import visible as visible
from ._explain import Explained as Explained
from ._explain import explained as explained
from ._explain import part_places as part_places
from ._plausible import ImplausibleValue as ImplausibleValue
from ._plausible import implausible_values as implausible_values
from ._scene import NAMED as NAMED
from ._scene import SECTIONS as SECTIONS
from ._scene import Bundled as Bundled
from ._scene import Scene as Scene
from ._scene import dump as dump
from ._scene import load as load
from ._scene import loads as loads
from ._scene import machines as machines
from ._scene import with_lists as with_lists
from ._scene import with_machine as with_machine
from ._scene import with_value as with_value
from ._scene import with_values as with_values
from ._units import NUMBER as NUMBER
from ._units import to_si as to_si
