"""From error frames to what a person has to know: counts, one warning per trouble, and the end of the bus."""

from __future__ import annotations

from drivers.rmp110.transport.base import BusErrors
from drivers.rmp110.transport.error_frames import OVERFLOW, PASSIVE, WARNING, Controller, ErrorClass, ErrorFrame

CHECK = "check cable, termination (120 ohm at both ends) and the bit rate of 1 Mbit/s"


class BusHealth:
    """Counts every error frame; a condition is told once, and again only after the controller recovered from it."""

    def __init__(self, channel: str) -> None:
        self._channel = channel
        self._told: set[str] = set()
        self.counts = BusErrors()

    def judge(self, frame: ErrorFrame) -> tuple[str | None, str | None]:
        """Take one error frame: a new warning, and why the bus is lost; None where there is none."""
        self._count(frame)
        if frame.has(ErrorClass.RESTARTED) or frame.controller & Controller.ACTIVE:
            self._told.clear()
        lost = self._bus_off() if frame.has(ErrorClass.BUS_OFF) else None
        warning = None
        if frame.controller & PASSIVE:
            warning = self._once("passive", self._passive(frame))
        elif frame.controller & OVERFLOW:
            warning = self._once("overflow", f"the CAN adapter of {self._channel} lost frames: its buffer was full")
        elif frame.has(ErrorClass.NO_ACK):
            warning = self._once("no ack", self._unheard())
        return warning, lost

    def _count(self, frame: ErrorFrame) -> None:
        counts = self.counts
        counts.frames += 1
        counts.passive += bool(frame.controller & PASSIVE)
        counts.warning += bool(frame.controller & WARNING)
        counts.overflow += bool(frame.controller & OVERFLOW)
        counts.no_ack += frame.has(ErrorClass.NO_ACK)
        counts.bus_off += frame.has(ErrorClass.BUS_OFF)
        counts.restarted += frame.has(ErrorClass.RESTARTED)

    def _once(self, condition: str, sentence: str) -> str | None:
        if condition in self._told:
            return None
        self._told.add(condition)
        return sentence

    def _passive(self, frame: ErrorFrame) -> str:
        counters = f" ({frame.tx_errors} transmit, {frame.rx_errors} receive errors)"
        return (
            f"CAN interface {self._channel} is error-passive"
            f"{counters if frame.tx_errors or frame.rx_errors else ''}: it still works and is about to fail; {CHECK}"
        )

    def _unheard(self) -> str:
        return (
            f"nobody acknowledges what CAN interface {self._channel} sends: "
            "check that the base is on and the cable plugged"
        )

    def _bus_off(self) -> str:
        name = self._channel
        return (
            f"CAN interface {name} went bus-off (too many errors on the wire) and has stopped: {CHECK}; "
            f"'ip link set {name} down' and 'ip link set {name} up type can bitrate 1000000 restart-ms 100' "
            "bring it back, from then on by itself"
        )
