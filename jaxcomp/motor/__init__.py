"""Motors: torque over speed."""

from ._motors import AbstractMotor as AbstractMotor
from ._motors import ConstantSpeed as ConstantSpeed
from ._motors import ConstantTorque as ConstantTorque
from ._motors import Kloss as Kloss
from ._motors import MeanSpeed as MeanSpeed
from ._motors import MotorEfficiency as MotorEfficiency
from ._motors import SlipLine as SlipLine
