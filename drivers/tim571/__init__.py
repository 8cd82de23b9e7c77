"""A direct driver of the SICK TiM571 lidar: transport, codec, device, and a simulator that speaks the wire."""

from drivers.tim571.codec.commands import OutputContent as OutputContent
from drivers.tim571.codec.commands import OutputRange as OutputRange
from drivers.tim571.codec.dialect import Dialect as Dialect
from drivers.tim571.deskew import deskew as deskew
from drivers.tim571.deskew import sensor_twist as sensor_twist
from drivers.tim571.device.config import TimConfig as TimConfig
from drivers.tim571.device.lidar import TiM571 as TiM571
from drivers.tim571.device.probe import probe as probe
from drivers.tim571.device.scan import Beam as Beam
from drivers.tim571.device.scan import Scan as Scan
from drivers.tim571.errors import TimError as TimError
from drivers.tim571.geometry import BEAM_YAW as BEAM_YAW
from drivers.tim571.simulator.server import Tim571Simulator as Tim571Simulator
from drivers.tim571.transport.tcp import TcpTransport as TcpTransport
from drivers.tim571.transport.usb import UsbTransport as UsbTransport
