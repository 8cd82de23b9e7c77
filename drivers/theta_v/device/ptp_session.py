"""PTP over any transport: one operation at a time, errors as sentences."""

from __future__ import annotations

import asyncio
import time

from drivers.theta_v.codec.descriptors import StillFunction
from drivers.theta_v.codec.ptp import (
    DATA,
    EVENT,
    KINDS,
    RESPONSE,
    Container,
    ContainerReader,
    DeviceInfo,
    Operation,
    Property,
    Response,
    Value,
    command,
    decode_value,
    encode_value,
)
from drivers.theta_v.errors import ThetaMalformed, ThetaRefused, ThetaStall, ThetaTimeout
from drivers.theta_v.transport.base import UsbTransport

SESSION_ID = 1
READ_BYTES = 16 << 10  # one request fetches any data set; a multiple of every packet size
ANSWER_S = 3.0  # the slowest answer seen in public traces is below a second
EVENT_BYTES = 28  # of the camera's event packets, where the descriptor does not say (fact sheet 4.1)
OPEN_TRIES, OPEN_PAUSE_S = 3, 0.5  # a sleeping camera fails the first session, one way or other (fact sheet 3.4)
BUSY_S, BUSY_PAUSE_S = 5.0, 0.1  # DeviceBusy: it wakes up or changes its mode; longer is a fault
MAX_READS = 64  # of one answer; the rest would be a device that never ends


class PtpRefused(ThetaRefused):
    """The camera answered an operation with another code than OK."""

    def __init__(self, what: str, code: int) -> None:
        name = Response(code).name.replace("_", " ").lower() if code in set(Response) else f"code {code:#06x}"
        super().__init__(f"the camera refuses {what}: {name}")
        self.code = code


class PtpSession:
    """Operations on the PTP interface of an open transport; claim it with `open` and leave with `close`."""

    def __init__(self, transport: UsbTransport, function: StillFunction) -> None:
        self._transport, self._function = transport, function
        self._transaction = 0
        self._reader, self._event_reader = ContainerReader(), ContainerReader()

    async def device_info(self) -> DeviceInfo:
        """Raises PtpRefused or ThetaMalformed."""
        return DeviceInfo.decode(await self.raw_device_info())

    async def raw_device_info(self) -> bytes:
        """Works without a session. Raises PtpRefused."""
        await self._transport.claim(self._function.interface)
        return await self._operate(Operation.GET_DEVICE_INFO, "its description")

    async def open(self) -> None:
        """Open a session; one that is open already will do. Raises ThetaError."""
        await self._transport.claim(self._function.interface)
        for left in reversed(range(OPEN_TRIES)):
            self._transaction = 0
            try:
                await self._operate(Operation.OPEN_SESSION, "a PTP session", SESSION_ID)
                break
            except (PtpRefused, ThetaStall, ThetaTimeout) as error:
                if isinstance(error, PtpRefused) and error.code == Response.SESSION_ALREADY_OPEN:
                    break
                if not left:
                    raise
                await asyncio.sleep(OPEN_PAUSE_S)
        self._transaction = 1

    async def close(self) -> None:
        await self._operate(Operation.CLOSE_SESSION, "to end the PTP session")
        await self._transport.release(self._function.interface)

    async def get(self, code: Property) -> Value:
        """Raises PtpRefused, or ThetaMalformed when the value has the wrong size."""
        what = f"to tell {code.name.lower()}"
        return decode_value(KINDS[code], await self._patiently(Operation.GET_PROPERTY, what, code))

    async def set(self, code: Property, value: Value) -> None:
        """Raises PtpRefused."""
        what = f"{code.name.lower()} = {value}"
        await self._patiently(Operation.SET_PROPERTY, what, code, data=encode_value(KINDS[code], value))

    async def event(self, timeout_s: float) -> Container | None:
        """What the camera says unasked; None for something that is no event. Raises ThetaTimeout when it is silent."""
        endpoint = self._function.events
        if endpoint is None:
            await asyncio.sleep(timeout_s)
            raise ThetaTimeout("the camera has no endpoint for events")
        length = endpoint.max_packet_bytes or EVENT_BYTES
        raw = await self._transport.interrupt_in(endpoint.address, length, timeout_s)
        try:
            containers = self._event_reader.feed(raw)
        except ThetaMalformed:
            return None
        return next((c for c in containers if c.kind == EVENT), None)

    async def ask(self, operation: int, what: str, parameter: int) -> bytes:
        """The data of any operation with one parameter. Raises PtpRefused."""
        return await self._operate(operation, what, parameter)

    async def _patiently(self, operation: int, what: str, parameter: int, data: bytes | None = None) -> bytes:
        """Ask again while the camera says it is busy, for some seconds."""
        deadline = time.monotonic() + BUSY_S
        while True:
            try:
                return await self._operate(operation, what, parameter, data=data)
            except PtpRefused as refusal:
                if refusal.code != Response.DEVICE_BUSY or time.monotonic() > deadline:
                    raise
                await asyncio.sleep(BUSY_PAUSE_S)

    async def _operate(self, operation: int, what: str, *parameters: int, data: bytes | None = None) -> bytes:
        try:
            return await self._transact(operation, what, *parameters, data=data)
        except ThetaStall:
            # Both pipes may be halted; cleared, they serve the next operation.
            for endpoint in (self._function.bulk_in, self._function.bulk_out):
                await self._transport.clear_halt(endpoint.address)
            self._reader = ContainerReader()
            raise

    async def _transact(self, operation: int, what: str, *parameters: int, data: bytes | None) -> bytes:
        transaction = self._transaction
        self._transaction += self._transaction > 0
        await self._send(command(operation, transaction, *parameters))
        if data is not None:
            await self._send(Container(DATA, operation, transaction, data))
        result = b""
        for _ in range(MAX_READS):
            raw = await self._transport.bulk_in(self._function.bulk_in.address, READ_BYTES, ANSWER_S)
            for container in self._reader.feed(raw):
                if container.transaction != transaction:
                    continue  # the late answer to an operation that was given up
                if container.kind == DATA and container.code == operation:
                    result = container.body
                elif container.kind == RESPONSE and container.code == Response.OK:
                    return result
                elif container.kind == RESPONSE:
                    raise PtpRefused(what, container.code)
        raise ThetaMalformed(f"the camera never ends its answer to {what}; switch it off and on again")

    async def _send(self, container: Container) -> None:
        raw = container.encode()
        endpoint = self._function.bulk_out
        await self._transport.bulk_out(endpoint.address, raw)
        if endpoint.max_packet_bytes and len(raw) % endpoint.max_packet_bytes == 0:
            await self._transport.bulk_out(endpoint.address, b"")
