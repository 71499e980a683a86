"""Journal bearings with a hydrodynamic film: position, friction, stiffness and damping."""

from ._bearing import (
    JournalBearing as JournalBearing,
)
from ._bearing import (
    PreparedBearing as PreparedBearing,
)
from ._bearing import (
    bush_moment as bush_moment,
)
from ._bearing import (
    eccentricity_ratio as eccentricity_ratio,
)
from ._bearing import (
    entrainment_speed as entrainment_speed,
)
from ._bearing import (
    friction_moment as friction_moment,
)
from ._bearing import (
    load_number as load_number,
)
from ._bearing import (
    minimum_film as minimum_film,
)
from ._bearing import (
    prepare as prepare,
)
from ._bearing import (
    running_state as running_state,
)
from ._bearing import (
    stiffness_damping as stiffness_damping,
)
from ._explicit import ExplicitFit as ExplicitFit
from ._film import (
    AbstractFilm as AbstractFilm,
)
from ._film import (
    AbstractSolvedFilm as AbstractSolvedFilm,
)
from ._film import (
    DynamicCoefficients as DynamicCoefficients,
)
from ._film import (
    FilmState as FilmState,
)
from ._film import (
    coefficients_per_load as coefficients_per_load,
)
from ._film import (
    convert_load_number as convert_load_number,
)
from ._film import (
    dynamic_coefficients as dynamic_coefficients,
)
from ._film import (
    film_forces as film_forces,
)
from ._film import (
    film_ratio as film_ratio,
)
from ._film import (
    film_state as film_state,
)
from ._film import (
    friction_at as friction_at,
)
from ._film import (
    load_number_at as load_number_at,
)
from ._guembel import Guembel as Guembel
from ._ocvirk import Ocvirk as Ocvirk
from ._reynolds import Reynolds as Reynolds
