"""The udev rule gives away what the driver looks for, and nothing else."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

from drivers.theta_v.transport.base import PRODUCT_PREFIX, RICOH

SYSTEMD = Path(__file__).parents[3] / "systemd"
RULES = (SYSTEMD / "70-ghal360-theta.rules").read_text(encoding="ascii").splitlines()
CLAUSE = re.compile(r'[A-Z_]+(\{[^}]+\})?(==|!=|=|\+=)"[^"]*"')


def test_every_line_is_a_comment_or_clauses_udev_understands() -> None:
    for line in RULES:
        assert line.startswith("#") or all(CLAUSE.fullmatch(clause) for clause in line.split(", ")), line


def test_it_applies_to_the_cameras_the_driver_takes_and_to_no_other() -> None:
    assert f'ATTR{{idVendor}}!="{RICOH:04x}", GOTO="theta_end"' in RULES
    assert f'ATTR{{product}}!="{PRODUCT_PREFIX}*", GOTO="theta_end"' in RULES
    assert RULES[-1] == 'LABEL="theta_end"'


def test_its_group_is_the_one_the_service_runs_in() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.read(SYSTEMD / "ghal360-robot.service")
    (clause,) = (c for line in RULES for c in line.split(", ") if c.startswith("GROUP="))
    assert clause == f'GROUP="{unit["Service"]["Group"]}"'
