"""The compressor behind pipes whose answers an independent solution in time gives."""

import numpy as np

from jaxcomp.cylinder import CycleOptions, Cylinder, DischargeLine, SuctionLine, solve_cycle
from jaxcomp.fluid import PerfectGas
from jaxcomp.mechanism import SliderCrank
from jaxcomp.piping import Orifice, Pipes, Piping
from jaxcomp.valve import PlateValve

SPEED = 1450 * np.pi / 30
AIR = PerfectGas(287.0, 1.4, 1.85e-5, 0.0261)


def valves():
    """Suction and discharge valve."""
    shared = {"flow_coefficient": 0.65, "force_coefficient": 1.1, "restitution": 0.0}
    shared |= {"sticking_speed": 1e-4}
    suction = PlateValve(
        port_diameter=0.022,
        port_length=0.020,
        stop=2e-3,
        damping=0.3,
        preload=0.0,
        mass=2e-3,
        stiffness=800.0,
        **shared,
    )
    discharge = PlateValve(
        port_diameter=0.018,
        port_length=0.018,
        stop=1.5e-3,
        damping=0.4,
        preload=0.2e-3,
        mass=2e-3,
        stiffness=3000.0,
        **shared,
    )
    return suction, discharge


def crank():
    """Slider-crank of the machine."""
    return SliderCrank(
        bore=0.06, crank_radius=0.0262, conrod_length=0.11, piston_mass=0.2, conrod_mass=0.2
    )


def cylinder(suction=None, discharge=None):
    """The machine behind networks of its lines."""
    return Cylinder(
        AIR,
        SuctionLine(pressure=1e5, temperature=300.0, piping=suction),
        DischargeLine(pressure=4e5, temperature=445.8, piping=discharge),
        *valves(),
        clearance_ratio=0.04,
    )


def suction_pipe(length, diameter=0.05, attenuation=0.02, resistance=9000.0, orders=64):
    """A pipe from the flange to a resistance at the line."""
    return Piping(
        (Pipes(("flange", "far"), length, diameter, attenuation=attenuation),),
        orifices=(Orifice(("far", "line"), resistance=resistance),),
        orders=orders,
    )


def solved(suction=None, discharge=None, **options):
    """Cycle of the machine."""
    return solve_cycle(
        cylinder(suction, discharge), crank(), SPEED, CycleOptions(**options), throw=False
    )
