"""What is asked of a camera met for the first time, and the files that come of it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from drivers.theta_v import ThetaConfig, ThetaV
from drivers.theta_v.codec import h264
from drivers.theta_v.codec.ptp import DeviceInfo, Property, PropertyDescription
from drivers.theta_v.device.readings import MAX_HEADERS, Readings
from drivers.theta_v.device.survey import survey
from drivers.theta_v.errors import ThetaStall
from drivers.theta_v.simulator.attached import AttachedTransport
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import LIVE_CONFIGURATION, MTP_CONFIGURATION, Composition
from tests.drivers.theta_v.pictures import Feeder, stream, until

PICTURES = stream(30, 192, 96)
SLEEP_DELAY = f"{int(Property.SLEEP_DELAY_S):#06x}"


async def test_both_faces_the_negotiation_and_every_property_are_read() -> None:
    camera = SimulatedThetaV(composition=Composition.MTP, reenumeration_s=0.05)
    found = await survey(lambda: AttachedTransport(camera), None)
    assert [face["configuration"] for face in found.faces] == [MTP_CONFIGURATION.hex(), LIVE_CONFIGURATION.hex()]
    assert found.reenumeration_s is not None
    assert 0.05 < found.reenumeration_s < 5
    assert found.negotiation["PROBE GET_LEN"] == "3000"
    assert found.negotiation["3840x1920 PROBE SET_CUR 48"] == "taken"
    assert found.negotiation["1920x960 PROBE GET_CUR"][6:8] == "02"
    assert DeviceInfo.decode(bytes.fromhex(found.device_info)).serial == "00105377"
    still, live = (found.properties[face] for face in ("05ca:0368", "05ca:2712"))
    assert len(still) == len(live) == 49
    delays = [PropertyDescription.decode(bytes.fromhex(face[SLEEP_DELAY])).current for face in (still, live)]
    assert delays == [180, 0], "as it came, and as it was then told to be"
    assert still["0xd812"].endswith("invalid format"), "what it refuses is said in its place"
    camera.connect().disconnect()


async def test_a_camera_that_does_not_tell_the_length_of_its_block_is_asked_for_both_sizes_all_the_same() -> None:
    class Silent(AttachedTransport):
        async def control(
            self, request_type: int, request: int, value: int, index: int, data_or_length: bytes | int = b"",
            timeout_s: float = 5.0,
        ) -> bytes:  # fmt: skip
            wrong_length = isinstance(data_or_length, bytes) and len(data_or_length) == 48
            if request_type & 0x60 == 0x20 and (request == 0x85 or wrong_length):
                raise ThetaStall("the camera refuses it")
            return await super().control(request_type, request, value, index, data_or_length, timeout_s)

    camera = SimulatedThetaV(probe_bytes=34)
    found = await survey(lambda: Silent(camera), None)
    assert found.negotiation["PROBE GET_LEN"] == "the camera refuses it"
    for size, index in (("3840x1920", "01"), ("1920x960", "02")):
        assert found.negotiation[f"{size} PROBE SET_CUR 34"] == "taken"
        assert found.negotiation[f"{size} PROBE GET_CUR"][6:8] == index


async def test_the_folder_holds_headers_pictures_health_and_the_stream_itself(tmp_path: Path) -> None:
    camera = SimulatedThetaV()
    with Feeder(camera, PICTURES), Readings(tmp_path) as readings:
        found = await survey(lambda: AttachedTransport(camera), None)
        readings.conclude(found, {"error": "ended early"})
        theta = ThetaV(
            lambda: AttachedTransport(camera), ThetaConfig(health_s=0.05), on_packets=readings.packets,
            on_access_unit=readings.access_unit, on_health=readings.health,
        )  # fmt: skip
        async with theta:
            await until(lambda: theta.stats.received > 15 and theta.stats.battery_percent is not None)
        readings.conclude(found, {"received": theta.stats.received})
    saved = json.loads((tmp_path / "readings.json").read_text(encoding="utf-8"))
    assert saved["stream"]["received"] > 15
    assert saved["survey"]["faces"][0]["usb_id"] == "05ca:2712"
    with (tmp_path / "headers.csv").open(newline="", encoding="ascii") as file:
        headers = list(csv.DictReader(file))
    assert 0 < len(headers) <= MAX_HEADERS
    assert {row["head_hex"][:2] for row in headers if row["bytes"] != "0"} == {"02"}
    with (tmp_path / "units.csv").open(newline="", encoding="utf-8") as file:
        units = list(csv.DictReader(file))
    assert units[0]["key"] == "1"
    assert units[0]["nal_kinds"].startswith("7 8")
    with (tmp_path / "health.csv").open(newline="", encoding="ascii") as file:
        assert next(csv.DictReader(file))["battery_percent"] == "98"
    film = (tmp_path / "stream.h264").read_bytes()
    assert film.startswith(PICTURES[0])
    assert h264.split(film[: len(PICTURES[0])])[0].kind == h264.SPS
