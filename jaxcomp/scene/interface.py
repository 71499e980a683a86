"""What packages that are built on this one take from it, and users need not."""

from ._annotated import start_from as start_from
from ._annotated import starts as starts
from ._annotated import summary as summary
from ._change import with_lists as with_lists
from ._change import with_machine as with_machine
from ._describe import DescribedValue as DescribedValue
from ._describe import ImplausibleValue as ImplausibleValue
from ._describe import left_out as left_out
from ._explain import Explained as Explained
from ._explain import explained as explained
from ._explain import part_places as part_places
from ._scene import Bundled as Bundled
from ._schema import NAMED as NAMED
from ._schema import SECTIONS as SECTIONS
from ._text import NUMBER as NUMBER
from ._text import visible as visible
from ._units import to_si as to_si
from ._upgrade import upgraded as upgraded
