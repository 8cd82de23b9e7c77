"""Opening a python-can bus, and one clear sentence where that fails."""

from __future__ import annotations

import errno
from typing import Any

import can
from can.typechecking import CanFilter

from drivers.rmp110.codec.frames import FILTER_ID, FILTER_MASK
from drivers.rmp110.errors import RmpInterfaceError
from drivers.rmp110.transport.socketcand import SocketcandBus

FILTERS: tuple[CanFilter, ...] = ({"can_id": FILTER_ID, "can_mask": FILTER_MASK, "extended": False},)


def open_bus(interface: str, channel: str, options: dict[str, Any]) -> can.BusABC:
    """A bus that receives at least 0x500..0x57F, and error frames. Blocks. Raises RmpInterfaceError.

    Only the kernel filters: it passes error frames by a mask of their own, which python-can opens. Filters that
    python-can applies itself would hold error frames back, because their ids are no ids of the base.
    """
    try:
        return _open(interface, channel, options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
        raise RmpInterfaceError(_sentence(interface, channel, options, error)) from error


def _open(interface: str, channel: str, options: dict[str, Any]) -> can.BusABC:
    if interface == "socketcand":
        return SocketcandBus(channel, **options)
    filters = FILTERS if interface == "socketcan" else None
    bus = can.Bus(channel, interface, can_filters=filters, ignore_config=True, **options)
    if filters and not getattr(bus, "_is_filtered", True):
        # The kernel refused the filter and python-can would filter instead.
        bus.set_filters(None)
    return bus


def _sentence(interface: str, channel: str, options: dict[str, Any], error: Exception) -> str:
    if interface == "socketcand":
        where = f"{options.get('host')}:{options.get('port')}"
        return (
            f"no CAN bus {channel} at socketcand server {where}: {plain(error)}; "
            "check that the server (or the simulated base) runs and that host and port are right"
        )
    number = getattr(error, "errno", None) or getattr(error.__cause__, "errno", None)
    if interface == "socketcan" and number == errno.ENODEV:
        return (
            f"CAN interface {channel} not found: plug in the CAN adapter and run "
            f"'ip link set {channel} up type can bitrate 1000000'"
        )
    if interface == "socketcan" and number == errno.EAFNOSUPPORT:
        return f"CAN interface {channel} not found: this kernel has no CAN; load it with 'modprobe can_raw'"
    if number in (errno.EPERM, errno.EACCES):
        return f"CAN interface {channel} may not be opened by this user: {plain(error)}"
    if "msgpack" in str(error):
        return f"CAN interface {interface} needs the package msgpack: pip install msgpack"
    if isinstance(error, NotImplementedError):
        return f"CAN interface type '{interface}' is unknown to python-can: use socketcan, socketcand or virtual"
    return f"CAN interface {channel} ({interface}) could not be opened: {plain(error)}"


def plain(error: BaseException) -> str:
    """An error's own words, without numbers that only a programmer reads."""
    if isinstance(error, can.CanError):
        return str(error.args[0]) if error.args else type(error).__name__
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
