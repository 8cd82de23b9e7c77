"""`ghal360 probe rmp110`: everything in words, nothing moved and nothing written."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import pytest

from drivers.rmp110.codec.feedback import FACTORY_BITMAPS
from drivers.rmp110.codec.frames import CONFIG_ID
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.errors import RmpFaulted, RmpLimitsDiffer, RmpWrongMode
from drivers.rmp110.simulator.packet_wires import PtyWire, UdpWire
from drivers.rmp110.simulator.serve import serve_v3
from drivers.rmp110.simulator.v3_model import V3Model
from ghal360_robot.cli.probe_base import NOT_TOLD, Way, in_words, probe_base, refused_because
from ghal360_robot.errors import UsageError

pytestmark = pytest.mark.usefixtures("short_listening")

CAN = Way("can", "socketcan", "can0", None, "auto", None, 8080, "")
LISTEN_S = 0.3


async def test_a_can_base_is_told_in_words_and_left_as_it_is(rig: Any) -> None:
    async with rig("socketcand", compact=False) as it:
        it.sim.model.state = OperationalState.TRACTOR
        way = dataclasses.replace(CAN, channel=it.channel, address=f"127.0.0.1:{it.sim.port}")
        found = await probe_base(way, LISTEN_S, fault_log=True)
        assert it.sim.model.stored.bitmaps == FACTORY_BITMAPS
        assert it.sim.model.state is OperationalState.TRACTOR, "left as it was found"
        assert set(it.sim.received) == {CONFIG_ID}, "no motion"
    assert (found["dialect"], found["firmware"], found["mode"]) == ("B2", "SP 1246, UIP 1279", "TRACTOR")
    assert found["stored"]["track_width"] == pytest.approx(0.481224)
    assert found["differences"]["max_decel"] == [4.0, 0.5]
    assert "max_accel = 4 m/s^2, the configuration expects 0.5" in found["motion_refused_because"]
    assert found["batteries"]["front 1"].endswith("degC")
    assert found["faults"] == found["warnings"] == []
    assert found["rate_hz"] > 30
    assert "power cycles" in found["fault_log"][0]


async def test_for_people_stored_parameters_have_units_and_what_was_expected(rig: Any) -> None:
    async with rig("socketcand", compact=False) as it:
        way = dataclasses.replace(CAN, channel=it.channel, address=f"127.0.0.1:{it.sim.port}")
        said = in_words(await probe_base(way, LISTEN_S, fault_log=False))
    assert said["stored"]["max_decel"] == "4 m/s^2, expected 0.5"
    assert said["stored"]["input_bitmap"] == "0x00000101"
    assert said["stored"]["ip_address"] == "192.168.0.40"
    assert said["stored"]["ip_port"] == "8080"
    assert "differences" not in said


async def test_what_the_compact_set_does_not_tell_is_said(rig: Any) -> None:
    async with rig("socketcand") as it:
        way = dataclasses.replace(CAN, channel=it.channel, address=f"127.0.0.1:{it.sim.port}")
        found = await probe_base(way, LISTEN_S, fault_log=False)
    assert found["firmware"] == NOT_TOLD
    assert found["temperature_degc"] is None
    assert "fault_log" not in found


@pytest.mark.parametrize("protocol", ["v3-udp", "v3-usb"])
async def test_a_v3_base_is_told_in_words(protocol: str, tmp_path: Path) -> None:
    path = tmp_path / "ttyACM0"
    model = V3Model(time.monotonic_ns(), boot_s=0.0)
    wire = UdpWire("127.0.0.1", 0) if protocol == "v3-udp" else PtyWire(path)
    async with serve_v3(wire, model=model) as sim:
        way = dataclasses.replace(CAN, protocol=protocol, host="127.0.0.1", port=sim.port, device=str(path))
        found = await probe_base(way, LISTEN_S, fault_log=True)
    assert found["dialect"] == "V3"
    assert "packed build ids" in found["firmware"]
    assert found["temperature_degc"] is not None
    assert found["rate_hz"] > 60
    assert "power cycles" in found["fault_log"][0]
    assert any("charger" in warning for warning in found["warnings"]), "the works' own setting"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"interface": "socketcand"}, "needs --address"),
        ({"protocol": "v3"}, "--protocol is one of can, v3-udp, v3-usb"),
        ({"protocol": "v3-udp"}, "needs --host"),
        ({"dialect": "B2"}, "--dialect is one of"),
        ({"address": "nowhere"}, "is no HOST:PORT"),
    ],
)
async def test_a_wrong_option_is_one_sentence(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        await probe_base(dataclasses.replace(CAN, **change), LISTEN_S, fault_log=False)


def test_a_base_that_could_be_armed_is_not_called_refused() -> None:
    class Standing:
        mode = OperationalState.STANDBY

    class Booting:
        mode = OperationalState.CCU_INIT

    standing, booting = Standing(), Booting()
    wrong_mode = RmpWrongMode("nobody asked")
    assert refused_because(None, standing) is None  # type: ignore[arg-type]
    assert refused_because(wrong_mode, standing) is None  # type: ignore[arg-type]
    assert refused_because(wrong_mode, booting) == "nobody asked"  # type: ignore[arg-type]
    for error in (RmpFaulted("fault"), RmpLimitsDiffer("limits")):
        assert refused_because(error, standing) == str(error)  # type: ignore[arg-type]
