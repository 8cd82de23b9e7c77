from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from ghal360_robot.config import RobotConfig, load_config, parse_config, with_overrides
from ghal360_robot.errors import UsageError

EXAMPLE = Path(__file__).parent.parent / "robot.toml"


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_shows_every_setting_with_its_default() -> None:
    assert load_config(EXAMPLE) == RobotConfig()
    shown = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    assert {s: set(v) for s, v in shown.items()} == {s: set(v) for s, v in RobotConfig().model_dump().items()}


def test_every_setting_of_the_example_is_explained_or_named_with_its_unit() -> None:
    lines = [line for line in EXAMPLE.read_text(encoding="utf-8").splitlines() if "=" in line and line[0] != "#"]
    silent = [line.split()[0] for line in lines if "#" not in line]
    assert all("_" in key or key in {"port", "host", "channel", "accel", "v_max", "w_max"} for key in silent), silent


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[safety]\nvmax = 1", "unknown setting 'safety.vmax'"),
        ("[safety]\nv_max = 9", "setting 'safety.v_max'"),
        ("[safety]\nv_max = nan", "setting 'safety.v_max'"),
        ("[tim571]\nport = 'x'", "setting 'tim571.port'"),
        ("[guidance]\npolicy = 'magic'", "setting 'guidance.policy'"),
        ("[safety]\noperator_hold_s = 60\noperator_lost_s = 60", "operator_hold_s is 60 s"),
        ("[safety]\nlidar_lost_s = 0.1", "is shorter than lidar_hold_s"),
        ("[safety]\nv_max = 1.5\ndecel = 0.1", "to stop"),
        ("[safety]\nlocks = {pause = 256}", "setting 'safety.locks.pause'"),
        ("[rmp110]\ninterface = 'socketcand'", "needs host and port"),
        ("[safety\n", "not valid TOML"),
        ("\x00", "not valid TOML"),
        ("[safety]\nw_accel = 6.0\n", "is more than rmp110.stored_w_accel"),
        ("[safety]\ntick_gap_s = 0.3\n", "tick_gap_s"),
    ],
)
def test_a_wrong_setting_is_one_sentence_that_names_it(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        load_config(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_an_unreadable_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read the configuration"):
        load_config(tmp_path / "absent.toml")
    with pytest.raises(UsageError, match="cannot read the configuration"):
        load_config(tmp_path)


def test_bytes_that_are_not_text_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot read the configuration"):
        load_config(path)


def test_overrides_are_checked_like_the_file() -> None:
    assert with_overrides(RobotConfig(), {"perception": {"target": "bottle"}}).perception.target == "bottle"
    with pytest.raises(UsageError, match=r"safety\.v_max"):
        with_overrides(RobotConfig(), {"safety": {"v_max": -1}})


def test_the_hash_is_of_the_settings_not_of_the_file(tmp_path: Path) -> None:
    assert load_config(write(tmp_path, "# empty\n")).sha256() == RobotConfig().sha256()
    assert load_config(write(tmp_path, "[safety]\nv_max = 0.4")).sha256() != RobotConfig().sha256()


def test_recorded_settings_come_back_equal_and_damaged_ones_are_one_sentence() -> None:
    config = with_overrides(RobotConfig(), {"safety": {"v_max": 0.4, "locks": {"pause": 50}}})
    assert parse_config(config.model_dump_json(), "run") == config
    for text in ("{", "[1]", "{'a'}", '{"safety": {"v_max": 9}}'):
        with pytest.raises(UsageError, match=r"^run: "):
            parse_config(text, "run")
