"""The plain ring by the table of solutions of the Reynolds equation."""

from typing import ClassVar

from ._tabulated import AbstractTabulatedFilm


class Reynolds(AbstractTabulatedFilm):
    """Plain ring with the Reynolds (Swift-Stieber) boundary condition; the default.

    Beside a bearing with two axial grooves (`GroovedReynolds`, Someya's tables) at the same
    Sommerfeld number its stiffness differs by up to 10 % of the largest entry and its damping by
    8 % for L/D = 0.5 and S < 0.8, by 23 % and 14 % for L/D = 1 and S < 0.3.

    Args:
        length_ratio: [-] q = L/D. The table covers 0.1 to 2 and eps up to 0.995. Beyond that
            eccentricity the functions go over to their limits for a closing film with continuous
            slope; beyond that L/D they go on along the tangent in ln q, which is a guess.
    """

    table_name: ClassVar[str] = "reynolds_table.json"
    limits: ClassVar[str] = (
        "Table for L/D 0.1 to 2 and eps to 0.995, limits of a closing film beyond. Aligned, "
        "isoviscous, laminar, no roughness. A bearing with grooves differs: see `grooved`."
    )
