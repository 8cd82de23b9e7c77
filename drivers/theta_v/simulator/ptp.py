"""The camera's PTP side: sessions, properties, and the switch between still and live mode."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from drivers.theta_v.codec.ptp import (
    COMMAND,
    DATA,
    EVENT,
    RESPONSE,
    CaptureMode,
    Container,
    ContainerReader,
    DeviceInfo,
    Operation,
    Property,
    Response,
    Value,
    decode_value,
    encode_value,
)
from drivers.theta_v.errors import ThetaMalformed, ThetaStall
from drivers.theta_v.simulator.descriptors import MANUFACTURER, PRODUCT
from drivers.theta_v.simulator.faults import FirstSession
from drivers.theta_v.simulator.properties import (
    EVENTS,
    OPERATIONS,
    PLAYBACK_FORMATS,
    UNREADABLE,
    WHILE_ASLEEP,
    factory_properties,
    rounded,
)

BULK_PACKET = 512  # at high speed
MAX_REQUEST_BYTES = 64 << 10  # far above any property
MAX_QUEUED = 256  # packets and events nobody fetches: the oldest go
PROPERTY_CHANGED = 0x4006
NO_TRANSACTION = 0xFFFFFFFF
WITH_DATA_OUT = frozenset({Operation.SET_PROPERTY})


class PtpResponder:
    """Not thread-safe; the camera model holds the lock. `on_mode` hears of a wish for another mode."""

    def __init__(
        self,
        serial: str,
        firmware: str,
        mode: CaptureMode,
        on_mode: Callable[[CaptureMode], None],
        on_power_down: Callable[[], None],
        *,
        asleep: bool = False,
        first_session: FirstSession = FirstSession.REFUSES,
    ) -> None:
        self.properties = factory_properties(serial, mode, asleep=asleep)
        self._on_mode, self._on_power_down = on_mode, on_power_down
        self._info = DeviceInfo(
            MANUFACTURER, PRODUCT, firmware, serial, OPERATIONS, EVENTS, tuple(self.properties),
            playback_formats=PLAYBACK_FORMATS,
        )  # fmt: skip
        self._drowsy = asleep
        self._first_session = first_session
        self.busy = 0
        """How many more questions about properties get DeviceBusy for an answer."""
        self.reset()

    def reset(self) -> None:
        """Bus reset or device reset request: no session, nothing under way."""
        self._reader = ContainerReader(MAX_REQUEST_BYTES)
        self._session = False
        self._pending: Container | None = None
        self._halted = False
        self._answers: deque[bytes] = deque(maxlen=MAX_QUEUED)
        self._events: deque[bytes] = deque(maxlen=MAX_QUEUED)

    @property
    def asleep(self) -> bool:
        return bool(self.properties[Property.SLEEP_MODE].current)

    @property
    def sleep_delay_s(self) -> int:
        """0: it never falls asleep."""
        return int(self.properties[Property.SLEEP_DELAY_S].current)

    def fall_asleep(self) -> None:
        self.set(Property.SLEEP_MODE, 1)
        self._drowsy = not self._session

    def set(self, code: int, value: Value) -> None:
        """The camera itself changes a property, and says so."""
        self.properties[code] = replace(self.properties[code], current=value)
        event = Container(EVENT, PROPERTY_CHANGED, NO_TRANSACTION, struct.pack("<I", code))
        self._events.append(event.encode())

    def clear_halt(self) -> None:
        self._halted = False

    def receive(self, data: bytes) -> None:
        """Bytes on the bulk OUT endpoint. Raises ThetaStall on what is no PTP; the endpoints halt then."""
        if self._halted:
            raise ThetaStall("the PTP endpoints are halted")
        try:
            for container in self._reader.feed(data):
                self._take(container)
        except ThetaMalformed as error:
            self._halted, self._pending = True, None
            raise ThetaStall(str(error)) from None

    def send(self, length: int) -> bytes | None:
        """What one IN transfer of `length` bytes gets, or None while there is nothing. Raises ThetaStall."""
        if self._halted:
            raise ThetaStall("the PTP endpoints are halted")
        if not self._answers:
            return None
        answer = self._answers.popleft()
        piece, rest = answer[:length], answer[length:]
        if rest and length % BULK_PACKET:
            raise ThetaStall("the host asked for less than one packet of a longer answer")
        # A request filled by whole packets cannot know that the answer ended: a zero-length packet says so.
        if rest or (piece and len(piece) == length and length % BULK_PACKET == 0):
            self._answers.appendleft(rest)
        return piece

    def event(self, length: int) -> bytes | None:
        return self._events.popleft()[:length] if self._events else None

    def class_request(self, request: int, length: int) -> bytes:
        """Cancel, Device Reset, Get Device Status (fact sheet 4.1). Raises ThetaStall."""
        match request:
            case 0x64 | 0x66:
                session = self._session and request == 0x64
                self.reset()
                self._session = session
                return b""
            case 0x67:
                return struct.pack("<HH", 4, Response.OK)[:length]
            case _:
                raise ThetaStall(f"unknown PTP class request {request:#04x}")

    def _take(self, container: Container) -> None:
        if container.kind == COMMAND and self._pending is None:
            if container.code in WITH_DATA_OUT:
                self._pending = container
            else:
                self._answer(container, b"")
        elif container.kind == DATA and self._pending is not None and _belongs(container, self._pending):
            command, self._pending = self._pending, None
            self._answer(command, container.body)
        else:
            raise ThetaMalformed(f"PTP container of type {container.kind} out of turn")

    def _answer(self, command: Container, data: bytes) -> None:
        if command.code == Operation.OPEN_SESSION and self._drowsy and self._first_session is FirstSession.SILENT:
            self._drowsy = False
            return
        response, result = self._execute(command, data)
        if result is not None and response is Response.OK:
            self._push(Container(DATA, command.code, command.transaction, result))
        self._push(Container(RESPONSE, response, command.transaction))
        if response is not Response.OK:
            return
        if command.code == Operation.POWER_DOWN:
            self._on_power_down()
        elif command.code == Operation.SET_PROPERTY and command.parameters[0] == Property.CAPTURE_MODE:
            self._on_mode(CaptureMode(int.from_bytes(data[:2], "little")))

    def _push(self, container: Container) -> None:
        self._answers.append(container.encode())

    def _execute(self, command: Container, data: bytes) -> tuple[Response, bytes | None]:
        parameters = command.parameters
        first = parameters[0] if parameters else 0
        match command.code:
            case Operation.GET_DEVICE_INFO:
                return Response.OK, self._info.encode()
            case Operation.OPEN_SESSION:
                return self._open(first), None
            case _ if not self._session:
                return Response.SESSION_NOT_OPEN, None
            case Operation.CLOSE_SESSION:
                self._session = False
                return Response.OK, None
            case Operation.POWER_DOWN:
                return Response.OK, None
            case Operation.GET_PROPERTY_DESCRIPTION | Operation.GET_PROPERTY:
                return self._get(command.code, first)
            case Operation.SET_PROPERTY:
                return self._set(first, data), None
            case Operation.RESET_PROPERTY:
                return self._reset_property(first), None
            case _:
                return Response.OPERATION_NOT_SUPPORTED, None

    def _open(self, session: int) -> Response:
        if session == 0:
            return Response.INVALID_PARAMETER
        if self._session:
            return Response.SESSION_ALREADY_OPEN
        if self._drowsy:
            self._drowsy = False
            if self._first_session is FirstSession.STALLS:
                raise ThetaMalformed("a sleeping camera opens no session")
            return Response.GENERAL_ERROR
        self._session = True
        return Response.OK

    def _get(self, operation: int, code: int) -> tuple[Response, bytes | None]:
        refusal = self._refusal(code)
        if refusal is not None:
            return refusal, None
        found = self.properties[code]
        if operation == Operation.GET_PROPERTY:
            return Response.OK, encode_value(found.kind, found.current)
        return Response.OK, found.encode()

    def _set(self, code: int, data: bytes) -> Response:
        refusal = self._refusal(code)
        if refusal is not None:
            return refusal
        found = self.properties[code]
        if not found.writable:
            return Response.ACCESS_DENIED
        try:
            value = decode_value(found.kind, data)
        except ThetaMalformed:
            return Response.INVALID_FORMAT
        if encode_value(found.kind, value) != data:
            return Response.INVALID_FORMAT
        if not found.allows(value) or (code == Property.CAPTURE_MODE and value not in set(CaptureMode)):
            return Response.INVALID_VALUE
        self.properties[code] = replace(found, current=rounded(code, value))
        return Response.OK

    def _reset_property(self, code: int) -> Response:
        refusal = self._refusal(code)
        if refusal is not None:
            return refusal
        self.properties[code] = replace(self.properties[code], current=self.properties[code].default)
        return Response.OK

    def _refusal(self, code: int) -> Response | None:
        if self.busy:
            self.busy -= 1
            return Response.DEVICE_BUSY
        if code not in self.properties:
            return Response.PROPERTY_NOT_SUPPORTED
        if self.asleep and code not in WHILE_ASLEEP:
            return Response.DEVICE_BUSY
        return Response.INVALID_FORMAT if code == UNREADABLE else None


def _belongs(data: Container, command: Container) -> bool:
    return (data.code, data.transaction) == (command.code, command.transaction)
