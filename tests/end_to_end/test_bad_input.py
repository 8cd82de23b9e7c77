from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.end_to_end.conftest import Ran, ghal360


def check(ran: Ran, status: int, *fragments: str) -> None:
    assert ran.status == status, ran.err
    assert "Traceback" not in ran.err
    said = " ".join(ran.err.split())
    assert "error" in said.lower()
    for fragment in fragments:
        assert fragment in said, said


@pytest.fixture
def one_sentence(command: Callable[..., Ran]) -> Callable[..., None]:
    """Runs a command in this process and expects an exit status and words of one sentence on stderr."""

    def run(words: list[object], status: int, *fragments: str) -> None:
        check(command(*words), status, *fragments)

    return run


def test_an_unknown_configuration_key(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[safety]\nspeed = 1\n", encoding="utf-8")
    one_sentence(["run", "-c", path], 2, "unknown setting 'safety.speed'")


def test_an_absent_configuration_file(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    one_sentence(["run", "-c", tmp_path / "no.toml"], 2, "cannot read the configuration")


def test_an_unknown_target(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    one_sentence(["run", "--sim", "--target", "unicorn", "--record", tmp_path], 2, "unicorn", "backpack")
    one_sentence(["demo", "--target", "unicorn"], 2, "unicorn", "backpack")


def test_an_unknown_world(one_sentence: Callable[..., None]) -> None:
    one_sentence(["demo", "--world", "moon"], 2, "moon", "office")


def test_a_picture_folder_that_is_not_there(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    one_sentence(["run", "--sim", "--camera-images", tmp_path / "none", "--record", tmp_path], 2, "does not exist")


def test_a_picture_folder_without_pictures(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    check(ghal360("run", "--sim", "--camera-images", tmp_path, "--record", tmp_path / "runs"), 1, str(tmp_path))


def test_a_lidar_recording_that_is_none(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "noise.rec"
    path.write_bytes(b"\x00" * 100)
    one_sentence(["run", "--sim", "--lidar-replay", path, "--record", tmp_path / "runs"], 1, "noise.rec")


def test_an_unreachable_lidar(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "tim571", "--host", "127.0.0.1", "--port", "9"], 1, "127.0.0.1:9")


def test_a_missing_can_interface(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "rmp110", "--channel", "can7"], 1, "can7")


def test_a_camera_that_is_not_there(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "theta-v", "--usbip", "127.0.0.1:9"], 1, "127.0.0.1:9")


@pytest.mark.parametrize("host", ["a..b", "x" * 70])
def test_a_camera_host_that_is_no_name(one_sentence: Callable[..., None], host: str) -> None:
    one_sentence(["probe", "theta-v", "--usbip", f"{host}:9"], 1, "cannot reach")
    one_sentence(["simulate", "theta-v", "--usbip", f"{host}:0"], 1, "cannot listen")


def test_a_socketcand_base_without_its_server(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "rmp110", "--interface", "socketcand"], 2, "--address")


def test_an_unknown_detector(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('[perception]\ndetector = "yolo"\n', encoding="utf-8")
    one_sentence(["config", "check", path], 2, "yolo", "painted")


def test_a_camera_that_is_not_on_usb(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "theta-v", "--serial", "00000000"], 1, "USB")


def test_an_unknown_camera_mode(one_sentence: Callable[..., None]) -> None:
    one_sentence(["probe", "theta-v", "--mode", "8k"], 2, "8k")


def test_a_robot_whose_devices_are_away_says_which(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        '[robot]\nstartup_s = 2\n[theta]\ntransport = "usbip"\nport = 9\n[tim571]\nhost = "127.0.0.1"\nport = 9\n',
        encoding="utf-8",
    )
    one_sentence(["run", "-c", path, "--record", tmp_path / "runs"], 1, "not there after 2 s", "missing as well")


def test_a_recording_place_that_cannot_be_written(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    one_sentence(["run", "--sim", "--duration", "2", "--record", blocked], 1, str(blocked))


def test_inspecting_what_is_no_recording(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    one_sentence(["inspect", tmp_path], 1, str(tmp_path))


@pytest.mark.parametrize("text", ["tim571", "tim571@x+1", "radar@1+1", "tim571@1+0", "tim571@nan+1"])
def test_a_cut_that_is_none(one_sentence: Callable[..., None], text: str, tmp_path: Path) -> None:
    one_sentence(["run", "--sim", "--cut", text, "--record", tmp_path], 2, "is no cut")


def test_simulation_options_without_simulation(one_sentence: Callable[..., None], tmp_path: Path) -> None:
    one_sentence(["run", "--operator", "virtual", "--record", tmp_path], 2, "--sim")


@pytest.mark.parametrize("words", [["run", "--nonsense"], ["fly"], ["simulate", "tim571", "--dialect", "c"]])
def test_a_wrong_command_line_is_exit_2(command: Callable[..., Ran], words: list[str]) -> None:
    ran = command(*words)
    assert ran.status == 2
    assert "Traceback" not in ran.err


@pytest.mark.parametrize("text", ["127.0.0.1", "host:port", ":3240", "127.0.0.1:0", "127.0.0.1:99999"])
def test_an_address_that_is_none(one_sentence: Callable[..., None], text: str) -> None:
    one_sentence(["probe", "theta-v", "--usbip", text], 2, "HOST:PORT")
