"""From assembled units to access units: parameter sets in front, damage carried until the next key picture.

A decoder flags only the picture that is broken, not those that inherit from it (fact sheet section 5.4),
so inheritance is tracked here: from the first flaw on, every picture is tainted until an IDR picture
arrives whole.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.payload import Quality, Unit
from drivers.theta_v.errors import ThetaMalformed

MAX_HELD_BYTES = 64 << 10  # parameter sets that came in units of their own, waiting for their picture
MAX_COUNTED_GAP = 300  # ten seconds of pictures; a larger jump of frame_num is a restart, not a loss

NOT_STARTED = "no key picture yet"


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One picture as the camera sent it. Stamps are `time.monotonic_ns` of the arrival of its bytes."""

    data: bytes
    """Annex B; in front of a key picture stand its SPS and PPS, whether or not the camera repeated them."""
    raw: bytes
    """The bytes exactly as they came over USB; what a recording keeps."""
    stamp_ns: int
    """Arrival of the last packet."""
    first_ns: int
    """Arrival of the first packet."""
    sequence: int
    """Running number since the driver was started; never reset by a reconnect."""
    keyframe: bool
    width: int
    height: int
    damaged: bool = False
    """Bytes of this very picture are missing or doubtful."""
    taint: str = ""
    """Why it must not be trusted: damaged itself, or built upon something damaged or lost. Empty if clean."""
    decodable: bool = True
    """False before the first key picture: no decoder can do anything with it."""

    @property
    def tainted(self) -> bool:
        return bool(self.taint)


class AccessUnitTracker:
    """Fed units in order, returns access units and remembers what they depend on.

    Keep one for as long as one stream lasts and call `restart()` when the stream was interrupted.
    """

    def __init__(self) -> None:
        self.lost = 0
        """Pictures that are known never to have arrived."""
        self.sps: h264.SequenceParameters | None = None
        """Of the newest picture that named one."""
        self._sps: dict[int, tuple[h264.SequenceParameters, bytes]] = {}
        self._pps: dict[int, tuple[h264.PictureParameters, bytes]] = {}
        self._held = b""
        self._held_ns = 0
        self._held_after_loss = False
        self._taint = NOT_STARTED
        self._started = False
        self._frame_num: int | None = None
        self._sequence = 0

    def restart(self) -> None:
        """The stream was interrupted: nothing that comes may be trusted before a key picture."""
        self._taint = self._taint or "the stream was interrupted"
        self._frame_num = None
        self._held, self._held_after_loss = b"", False

    def feed(self, unit: Unit) -> AccessUnit | None:
        """Take one unit; return its picture, or None for parameter sets that came without one."""
        flaw = "" if unit.quality is Quality.CLEAN else str(unit.flaws)
        nals: list[h264.Nal] = []
        try:
            nals = h264.split(unit.data)
        except ThetaMalformed as error:
            flaw = flaw or str(error)
        if not flaw and not h264.starts_with_code(unit.data):
            flaw = "its beginning is missing"
        if not flaw:
            flaw = self._learn(unit.data, nals)
        slices = [n for n in nals if n.kind in (h264.SLICE, h264.IDR)]
        if not slices and not flaw and len(self._held) + len(unit.data) <= MAX_HELD_BYTES:
            self._held_ns = self._held_ns if self._held else unit.first_ns
            self._held += unit.data
            self._held_after_loss |= unit.follows_loss
            return None
        if not slices and not flaw:
            flaw = "it holds no picture"
        return self._picture(unit, slices, flaw)

    def _learn(self, data: bytes, nals: list[h264.Nal]) -> str:
        """Remember the parameter sets of a unit that arrived whole; say what is wrong with them, if any."""
        try:
            for nal in nals:
                raw = data[nal.start : nal.end]
                if nal.kind == h264.SPS:
                    sps = h264.parse_sps(raw)
                    self._sps[sps.sps_id] = (sps, raw)
                elif nal.kind == h264.PPS:
                    pps = h264.parse_pps(raw)
                    self._pps[pps.pps_id] = (pps, raw)
        except ThetaMalformed as error:
            return str(error)
        return ""

    def _picture(self, unit: Unit, slices: list[h264.Nal], flaw: str) -> AccessUnit:
        keyframe = any(n.kind == h264.IDR for n in slices)
        prefix = b""
        gap = 0
        if not flaw:
            try:
                prefix, gap = self._check(unit.data, slices, keyframe)
            except ThetaMalformed as error:
                flaw = str(error)
        if unit.follows_loss or self._held_after_loss:
            gap = max(gap, 1)
        self.lost += gap
        if flaw:
            self._frame_num = None
            self._taint = f"a picture is damaged: {flaw}"
        elif keyframe:
            self._taint, self._started = "", True
        elif gap:
            self._taint = self._taint if not self._started else f"{gap} picture{'s' * (gap > 1)} lost before it"

        self._sequence += 1
        held, self._held, self._held_after_loss = self._held, b"", False
        raw = held + unit.data
        return AccessUnit(
            data=prefix + raw,
            raw=raw,
            stamp_ns=unit.stamp_ns,
            first_ns=self._held_ns if held else unit.first_ns,
            sequence=self._sequence,
            keyframe=keyframe,
            width=self.sps.width if self.sps else 0,
            height=self.sps.height if self.sps else 0,
            damaged=bool(flaw),
            taint=self._taint,
            decodable=self._started,
        )

    def _check(self, data: bytes, slices: list[h264.Nal], keyframe: bool) -> tuple[bytes, int]:
        """Look into the slices of an unflawed unit.

        Returns the parameter sets to put in front and how many pictures are missing before this one;
        raises ThetaMalformed when the unit is not exactly one picture that its parameter sets describe.
        """
        heads = [(data[n.start : min(n.end, n.start + h264.HEADER_BYTES)], n) for n in slices]
        starts = [h264.parse_slice_start(head) for head, _ in heads]
        if starts[0].first_macroblock != 0:
            raise ThetaMalformed("its first slice is missing")
        if sum(s.first_macroblock == 0 for s in starts) > 1:
            raise ThetaMalformed("two pictures run into one another")
        pps, pps_raw = self._pps.get(starts[0].pps_id, (None, b""))
        sps, sps_raw = self._sps.get(pps.sps_id, (None, b"")) if pps else (None, b"")
        if sps is None:
            if self._started or keyframe:
                raise ThetaMalformed("its parameter sets never arrived")
            return b"", 0
        self.sps = sps
        nal = slices[0]
        numbers = {h264.frame_num(head, start, sps) for (head, _), start in zip(heads, starts, strict=True)}
        if len(numbers) > 1 or len({n.kind for n in slices}) > 1:
            raise ThetaMalformed("slices of two pictures are mixed")
        number = numbers.pop()
        gap = 0 if keyframe or sps.gaps_allowed else self._gap(number, 1 << sps.log2_max_frame_num)
        if nal.reference:
            self._frame_num = number
        return self._missing(data, keyframe, sps_raw, pps_raw), gap

    def _gap(self, number: int, modulus: int) -> int:
        """Pictures missing before `number`: each reference picture counts one up (7.4.3)."""
        if self._frame_num is None:
            return 0
        gap = (number - self._frame_num - 1) % modulus
        return gap if gap <= min(MAX_COUNTED_GAP, modulus // 2) else 1

    def _missing(self, data: bytes, keyframe: bool, sps: bytes, pps: bytes) -> bytes:
        """What must be put in front: nothing, or both sets in the order a decoder needs them."""
        if not keyframe:
            return b""
        ahead = self._held + data
        if sps in ahead and pps in ahead:
            return b""
        return h264.START_CODE + sps + h264.START_CODE + pps
