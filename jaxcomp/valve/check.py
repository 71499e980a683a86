"""The ideal check valve."""

from typing import ClassVar

from ._valve import AbstractValve


class CheckValve(AbstractValve):
    """An ideal valve: fully open while the pressure drives the flow forward, shut otherwise.

    Args:
        port_diameter: [m]
        flow_coefficient: [-] C_d.
        port_length: [m] must be absent: the flow is quasi-steady.

    Raises:
        ValueError: a port length.
    """

    kind: ClassVar[str] = "check"

    def __check_init__(self):
        if self.port_length is not None:
            raise ValueError("a check valve is quasi-steady; leave `port_length` out.")

    @property
    def oscillator(self):
        return None

    def flow_area(self, lift):
        return self.flow_coefficient * self.port_area + 0 * lift

    def force_area(self, lift):
        return self.port_area + 0 * lift
