"""Writes down what a camera sends, packet headers and pictures, in files that can be sent to whoever asks."""

from __future__ import annotations

import csv
import json
import time
import zlib
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.access_units import AccessUnit
from drivers.theta_v.codec.health import Health
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.device.survey import Survey
from drivers.theta_v.errors import ThetaMalformed

MAX_HEADERS = 2000
MAX_STREAM_BYTES = 128 << 20  # 10 s of the largest stream; the table of pictures goes on without end
HEADER_BYTES = 24  # of each payload: more than any header has, and the picture's first bytes


class Readings:
    """`headers.csv`, `units.csv`, `health.csv`, `stream.h264` and `readings.json` in one folder.

    `packets`, `access_unit` and `health` are hooks for `ThetaV`; the first two run in its collecting thread.
    """

    def __init__(self, folder: Path) -> None:
        """Raises OSError when the folder cannot be written."""
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._left_headers, self._left_bytes = MAX_HEADERS, MAX_STREAM_BYTES
        self._header_file = (folder / "headers.csv").open("w", newline="", encoding="ascii")
        self._unit_file = (folder / "units.csv").open("w", newline="", encoding="utf-8")
        self._health_file = (folder / "health.csv").open("w", newline="", encoding="ascii", buffering=1)
        self._stream = (folder / "stream.h264").open("wb")
        self._headers, self._units = csv.writer(self._header_file), csv.writer(self._unit_file)
        self._health = csv.writer(self._health_file)
        self._health.writerow(["stamp_ns", "battery_percent", "battery_status", "error_bits"])
        self._headers.writerow(["stamp_ns", "status", "bytes", "head_hex"])
        self._units.writerow(
            ["sequence", "first_ns", "stamp_ns", "bytes", "crc32", "nal_kinds", "key", "damaged", "taint"]
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in (self._header_file, self._unit_file, self._health_file, self._stream):
            file.close()

    def packets(self, stamp_ns: int, packets: list[Packet]) -> None:
        for status, payload in packets[: self._left_headers]:
            self._left_headers -= 1
            self._headers.writerow([stamp_ns, status, len(payload), bytes(payload[:HEADER_BYTES]).hex()])

    def access_unit(self, unit: AccessUnit) -> None:
        try:
            kinds = " ".join(str(nal.kind) for nal in h264.split(unit.raw))
        except ThetaMalformed as error:
            kinds = str(error)
        crc = f"{zlib.crc32(unit.raw):08x}"
        self._units.writerow(
            [
                unit.sequence, unit.first_ns, unit.stamp_ns, len(unit.raw), crc, kinds, int(unit.keyframe),
                int(unit.damaged), unit.taint,
            ]
        )  # fmt: skip
        if len(unit.raw) <= self._left_bytes:
            self._left_bytes -= len(unit.raw)
            self._stream.write(unit.raw)

    def health(self, health: Health) -> None:
        bits = f"{health.error_bits:#010x}"
        self._health.writerow([time.monotonic_ns(), health.battery_percent, health.battery_status, bits])

    def conclude(self, survey: Survey, results: dict[str, Any]) -> None:
        text = json.dumps({"survey": asdict(survey), "stream": results}, indent=1)
        (self._folder / "readings.json").write_text(text, encoding="utf-8")
