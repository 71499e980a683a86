"""Motors: torque over speed, one law a file."""

from ._motor import AbstractMotor as AbstractMotor
from ._motor import MotorEfficiency as MotorEfficiency
from .constant_speed import ConstantSpeed as ConstantSpeed
from .constant_torque import ConstantTorque as ConstantTorque
from .kloss import Kloss as Kloss
from .mean_speed import MeanSpeed as MeanSpeed
from .slip_line import SlipLine as SlipLine
