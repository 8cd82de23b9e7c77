"""The simulated camera through pyusb, as a PTP program written for a real one would use it."""

from __future__ import annotations

import time

import pytest

from drivers.theta_v.codec import ptp
from drivers.theta_v.codec.descriptors import find_still, find_video, parse_configuration
from drivers.theta_v.codec.ptp import EVENT, RESPONSE, CaptureMode, Container, ContainerReader, Property, Response
from drivers.theta_v.errors import ThetaNotFound
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import LIVE_CONFIGURATION, Composition

usb_core = pytest.importorskip("usb.core")
usb_util = pytest.importorskip("usb.util")
pyusb_backend = pytest.importorskip("drivers.theta_v.simulator.pyusb_backend")

EPIPE, ENODEV, EBUSY, ENOENT = 32, 19, 16, 2


def found(camera: SimulatedThetaV):  # type: ignore[no-untyped-def]
    return usb_core.find(idVendor=0x05CA, backend=pyusb_backend.PyUsbBackend(camera))


def ask(device, command: Container, data: bytes | None = None) -> tuple[int, bytes]:  # type: ignore[no-untyped-def]
    device.write(0x01, command.encode())
    if data is not None:
        device.write(0x01, Container(ptp.DATA, command.code, command.transaction, data).encode())
    reader, result = ContainerReader(), b""
    while True:
        for container in reader.feed(bytes(device.read(0x81, 16384, 1000))):
            if container.kind == RESPONSE:
                return container.code, result
            result = container.body


def test_the_camera_is_found_and_describes_itself() -> None:
    device = found(SimulatedThetaV())
    assert (device.idProduct, device.product, device.serial_number) == (0x2712, "RICOH THETA V", "00105377")
    configuration = device.get_active_configuration()
    assert configuration.bNumInterfaces == 5
    alternates = [(i.bInterfaceNumber, i.bAlternateSetting, len(i.endpoints())) for i in configuration]
    assert alternates == [(0, 0, 3), (1, 0, 1), (2, 0, 0), (2, 1, 1), (3, 0, 0), (4, 0, 0), (4, 1, 1)]
    video = configuration[(2, 0)]
    assert len(video.extra_descriptors) == 168
    assert configuration[(2, 1)].endpoints()[0].wMaxPacketSize == 0x1400
    raw = bytes(device.ctrl_transfer(0x80, 6, 0x0200, 0, 432))
    assert raw == LIVE_CONFIGURATION
    usb_util.dispose_resources(device)


def test_no_camera_is_found_while_it_is_unplugged_and_an_old_one_stays_dead() -> None:
    camera = SimulatedThetaV()
    old = found(camera)
    assert old.product
    camera.unplug()
    assert found(camera) is None
    camera.replug()
    with pytest.raises(usb_core.USBError) as error:
        old.ctrl_transfer(0x80, 6, 0x0100, 0, 18)
    assert error.value.errno == ENODEV
    assert found(camera).product


def test_ptp_wakes_the_camera_and_sends_it_to_live_mode() -> None:
    camera = SimulatedThetaV(composition=Composition.MTP, asleep=True, reenumeration_s=0.05)
    device = found(camera)
    assert device.idProduct == 0x0368
    still = find_still(parse_configuration(camera.configuration))
    assert still is not None
    device.set_configuration()
    open_session = ptp.command(ptp.Operation.OPEN_SESSION, 0, 1)
    assert ask(device, open_session)[0] == Response.GENERAL_ERROR
    assert ask(device, open_session)[0] == Response.OK
    assert ask(device, ptp.command(0x1015, 1, Property.BATTERY_LEVEL)) == (Response.OK, b"\x62")
    assert ask(device, ptp.command(0x1015, 2, Property.CAPTURE_MODE))[0] == Response.DEVICE_BUSY
    assert ask(device, ptp.command(0x1016, 3, Property.SLEEP_MODE), b"\0")[0] == Response.OK
    live = CaptureMode.LIVE.to_bytes(2, "little")
    assert ask(device, ptp.command(0x1016, 4, Property.CAPTURE_MODE), live)[0] == Response.OK
    until = time.monotonic() + 5
    while (device := found(camera)) is None or device.idProduct != 0x2712:
        assert time.monotonic() < until, "it did not come back in live mode"
        time.sleep(0.005)
    assert find_video(parse_configuration(camera.configuration)) is not None
    assert device.serial_number == "00105377"


def test_an_event_comes_through_the_interrupt_endpoint_and_silence_is_a_timeout() -> None:
    camera = SimulatedThetaV()
    device = found(camera)
    with pytest.raises(usb_core.USBTimeoutError):
        device.read(0x82, 28, 20)
    camera.ptp.set(Property.ERROR_INFO, 0x00100000)
    (event,) = ContainerReader().feed(bytes(device.read(0x82, 28, 1000)))
    assert (event.kind, event.parameters) == (EVENT, (Property.ERROR_INFO,))


def test_a_stall_is_a_pipe_error_and_is_cleared() -> None:
    device = found(SimulatedThetaV())
    with pytest.raises(usb_core.USBError) as error:
        device.write(0x01, bytes(64))
    assert error.value.errno == EPIPE
    with pytest.raises(usb_core.USBError):
        device.ctrl_transfer(0xA1, 0x81, 0x0900, 2, 4)
    device.clear_halt(0x81)
    assert ask(device, ptp.command(0x1001, 0))[0] == Response.OK


def test_an_answer_of_whole_packets_ends_with_a_zero_length_packet() -> None:
    camera = SimulatedThetaV()
    device = found(camera)
    assert ask(device, ptp.command(0x1002, 0, 1))[0] == Response.OK
    camera.ptp.set(0xD805, "x" * 245)
    device.write(0x01, ptp.command(0x1014, 1, 0xD805).encode())
    assert [len(device.read(0x81, 512)) for _ in range(3)] == [512, 0, 12]


def test_one_program_at_a_time_has_the_camera() -> None:
    camera = SimulatedThetaV()
    one, two = found(camera), found(camera)
    assert one.product
    with pytest.raises(usb_core.USBError) as error:
        two.ctrl_transfer(0x80, 6, 0x0100, 0, 18)
    assert error.value.errno == EBUSY
    usb_util.dispose_resources(one)
    assert two.product


def test_the_video_interface_negotiates_and_its_packets_are_not_to_be_had() -> None:
    device = found(SimulatedThetaV())
    usb_util.claim_interface(device, 2)
    assert bytes(device.ctrl_transfer(0xA1, 0x85, 0x0100, 2, 2)) == b"\x30\x00"
    device.set_interface_altsetting(2, 1)
    with pytest.raises(NotImplementedError):
        device.read(0x84, 3072)


def test_there_is_nothing_left_open_to_hinder_the_next() -> None:
    camera = SimulatedThetaV()
    device = found(camera)
    assert device.product
    usb_util.dispose_resources(device)
    camera.connect().disconnect()
    camera.unplug()
    with pytest.raises(ThetaNotFound):
        camera.connect()
