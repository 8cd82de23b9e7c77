"""Segway RMP 110 over CAN: transport, codec, device, simulator."""

from drivers.rmp110.device.config import Rmp110Config as Rmp110Config
from drivers.rmp110.device.rmp110 import STANDBY as STANDBY
from drivers.rmp110.device.rmp110 import TRACTOR as TRACTOR
from drivers.rmp110.device.rmp110 import Rmp110 as Rmp110
from drivers.rmp110.errors import RmpError as RmpError
from drivers.rmp110.transport.can_bus import CanTransport as CanTransport
