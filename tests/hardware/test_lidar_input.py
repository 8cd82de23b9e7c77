"""From the configuration to the lidar's driver, and from its scans to the robot's."""

from __future__ import annotations

import pytest

from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.transport.tcp import TcpTransport
from drivers.tim571.transport.usb import UsbTransport
from ghal360_robot.config import Tim571Section
from ghal360_robot.hardware.lidar import driver_config, transport


def test_as_delivered_nothing_in_the_lidar_is_changed() -> None:
    config = driver_config(Tim571Section())
    assert (config.output, config.output_range, config.switch_to) == (None, None, None)
    assert config.dialects == (Dialect.B, Dialect.A)
    assert isinstance(transport(Tim571Section()), TcpTransport)


@pytest.mark.parametrize(("rssi", "on", "bits"), [("off", False, 8), ("8", True, 8), ("16", True, 16)])
def test_signal_strength_is_asked_for_as_configured(rssi: str, on: bool, bits: int) -> None:
    output = driver_config(Tim571Section.model_validate({"rssi": rssi})).output
    assert output is not None
    assert output.rssi is on
    assert not on or output.rssi_bits == bits


def test_usb_and_a_change_of_dialect_are_taken_from_the_configuration() -> None:
    section = Tim571Section(transport="usb", serial="17461662", switch_to="b", insist=True)
    config = driver_config(section)
    assert isinstance(transport(section), UsbTransport)
    assert (config.switch_to, config.insist, config.dialects[0]) == (Dialect.B, True, Dialect.A)
