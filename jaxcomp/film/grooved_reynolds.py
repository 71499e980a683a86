"""The bearing with two axial grooves, by the table of its solutions."""

from typing import ClassVar

from ._tabulated import AbstractTabulatedFilm


class GroovedReynolds(AbstractTabulatedFilm):
    """Bearing with two axial grooves of 10 degrees at right angles to the load (Someya's).

    The Swift-Stieber film of both pads, with p = 0 in the grooves. In the stiffness the film moves
    with the journal, as in Someya's Journal-Bearing Databook (1989). At his eccentricity ratios 0.2,
    0.5, 0.7 and 0.9 and L/D 0.5 and 1 his Sommerfeld numbers are met within 0.7 %, his damping
    within 4.5 % and his stiffness within 5 % of the largest entry (5.7 % at L/D = 1, eps = 0.9), his
    attitude angles within 1.1 degrees (2.5 at L/D = 1, eps = 0.2); (R/c) f is 2 to 6.4 % higher than
    his, because shear is counted over the whole ring. Rows of his between these differ by more: at
    L/D = 1 the damping by 6.2 % at eps = 0.8, the stiffness by 9 % at eps = 0.95. Grooves held fixed in
    the bearing would more than halve K_yx at light load and L/D = 1.

    Where the edge of the film meets a groove the coefficients have steep places, about which the
    nodes of the table crowd. At 90 places of eps 0.01 to 0.97 and L/D 0.1 to 2, half of them below
    eps = 0.5, load was within 1e-5 of the solver, stiffness within 1e-5 and damping within 9e-5 of the
    largest entry.

    Args:
        length_ratio: [-] q = L/D, with the range and the limits of `Reynolds`.
    """

    table_name: ClassVar[str] = "grooved_table.json"
    limits: ClassVar[str] = (
        "Two 10 degree grooves at right angles to the load; table for L/D 0.1 to 2 and eps to "
        "0.995, limits of a closing film beyond. In the stiffness the film moves with the journal, "
        "as Someya tabulates it; grooves fixed in the bearing change K_yx at light load."
    )
