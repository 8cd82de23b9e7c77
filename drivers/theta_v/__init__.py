"""RICOH THETA V over USB: live H.264 panorama, PTP bring-up, and a simulator that speaks the same wire."""

from drivers.theta_v.codec.access_units import AccessUnit as AccessUnit
from drivers.theta_v.device.camera import ThetaV as ThetaV
from drivers.theta_v.device.config import Mode as Mode
from drivers.theta_v.device.config import ThetaConfig as ThetaConfig
from drivers.theta_v.errors import ThetaError as ThetaError
