"""Machine files: machines in TOML with units, and the source of every value."""

from ._annotated import start as start
from ._change import optimised_scene as optimised_scene
from ._change import with_value as with_value
from ._change import with_values as with_values
from ._describe import describe as describe
from ._describe import implausible_values as implausible_values
from ._json_schema import json_schema as json_schema
from ._scene import Scene as Scene
from ._scene import dump as dump
from ._scene import load as load
from ._scene import loads as loads
from ._scene import machines as machines
from ._text import SceneError as SceneError
