"""One host's conversation with a USB/IP server, without a socket: fed bytes, it leaves its answers in `outbox`."""

from __future__ import annotations

from collections import deque

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import ISOCHRONOUS, parse_configuration
from drivers.theta_v.errors import ThetaMalformed, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.port import Port
from drivers.theta_v.simulator.usbip_schedule import Schedule, answered

BUSID = "1-1"
MAX_PENDING = 4096  # requests in flight of one host; the kernel keeps a few dozen
MAX_UNSENT_BYTES = 8 << 20  # a host that does not read gets no more video until it does


class Session:
    """An operation or two, and after an import the requests of one host.

    Every method may raise ThetaMalformed for what is not USB/IP, and ThetaGone once the camera has left.
    """

    def __init__(self, camera: SimulatedThetaV) -> None:
        self.outbox = bytearray()
        self._camera = camera
        self._port: Port | None = None
        self._inbox = bytearray()
        self._schedules: dict[int, Schedule] = {}
        self._reads: dict[int, deque[usbip.Submit]] = {}
        self._iso_endpoints: frozenset[int] = frozenset()

    @property
    def attached(self) -> bool:
        """Whether the host has imported the camera."""
        return self._port is not None

    @property
    def lost(self) -> bool:
        """Whether the imported camera has left the bus."""
        return self._port is not None and not self._port.connected

    @property
    def streaming(self) -> bool:
        """Whether isochronous requests wait for their microframes."""
        return any(schedule.waiting for schedule in self._schedules.values())

    def receive(self, data: bytes) -> None:
        """Take bytes as they came, and deal with all whole messages."""
        self._inbox += data
        while self._message():
            pass

    def complete(self, now_ns: int) -> None:
        """Answer the isochronous requests that are due, and whatever else the camera has something for."""
        port = self._port
        if port is None:
            return
        for endpoint, schedule in self._schedules.items():
            while len(self.outbox) < MAX_UNSENT_BYTES and (due := schedule.next_due(now_ns)) is not None:
                submit, descriptors, start_ns = due
                burst = port.isochronous(0x80 | endpoint, submit.packets, start_ns)
                self.outbox += answered(submit, descriptors, burst.packets)
        for endpoint, queue in self._reads.items():
            while queue:
                submit = queue[0]
                try:
                    data = port.read(0x80 | endpoint, submit.length)
                    status = 0
                except ThetaStall:
                    data, status = b"", -usbip.EPIPE
                if data is None:
                    break
                queue.popleft()
                self.outbox += usbip.Return(submit.sequence, status, len(data)).encode() + data

    def due_ns(self) -> int | None:
        """When `complete` has isochronous requests to answer, if any."""
        if len(self.outbox) >= MAX_UNSENT_BYTES:
            return None
        idle = self._port is not None and self._port.idle
        times = [due for s in self._schedules.values() if (due := s.due_ns(idle=idle)) is not None]
        return min(times, default=None)

    def close(self) -> None:
        """The host hung up."""
        port, self._port = self._port, None
        if port is not None:
            port.disconnect()

    def _message(self) -> bool:
        """Deal with one whole message at the front of the inbox; False when there is none."""
        inbox, port = self._inbox, self._port
        if port is None:
            return self._operation()
        if len(inbox) < usbip.HEADER_BYTES:
            return False
        kind = int.from_bytes(inbox[:4], "big")
        if kind == usbip.CMD_UNLINK:
            _, sequence, _, _, _, victim = usbip.UNLINK.unpack_from(inbox)
            del inbox[: usbip.HEADER_BYTES]
            self._unlink(sequence, victim)
            return True
        if kind != usbip.CMD_SUBMIT:
            raise ThetaMalformed(f"message of type {kind:#010x}")
        submit = usbip.Submit.decode(bytes(inbox[: usbip.HEADER_BYTES]))
        isochronous = submit.endpoint in self._iso_endpoints
        body = 0 if submit.inward else submit.length
        end = usbip.HEADER_BYTES + body + (16 * submit.packets if isochronous else 0)
        if len(inbox) < end:
            return False
        payload = bytes(inbox[usbip.HEADER_BYTES : end])
        del inbox[:end]
        if self._pending() >= MAX_PENDING:
            raise ThetaMalformed("more requests in flight than any host makes")
        if isochronous:
            schedule = self._schedules.setdefault(submit.endpoint, Schedule())
            if not schedule.add(submit, payload, self._camera.clock()):
                self.outbox += usbip.Return(submit.sequence, -usbip.EINVAL, 0, 0).encode()
        elif submit.endpoint and submit.inward:
            self._reads.setdefault(submit.endpoint, deque()).append(submit)
        else:
            self._transfer(port, submit, payload)
        return True

    def _pending(self) -> int:
        return sum(len(s.waiting) for s in self._schedules.values()) + sum(map(len, self._reads.values()))

    def _operation(self) -> bool:
        inbox = self._inbox
        if len(inbox) < usbip.OP_BYTES:
            return False
        version, code, _ = usbip.OP.unpack_from(inbox)
        if version >> 8 != usbip.VERSION >> 8:
            raise ThetaMalformed(f"protocol version {version:#06x}")
        if code == usbip.OP_REQ_DEVLIST:
            del inbox[: usbip.OP_BYTES]
            self.outbox += usbip.operation(usbip.OP_REP_DEVLIST) + self._devices()
            return True
        if code != usbip.OP_REQ_IMPORT:
            raise ThetaMalformed(f"operation {code:#06x}")
        size = usbip.OP_BYTES + usbip.BUSID_BYTES
        if len(inbox) < size:
            return False
        busid = bytes(inbox[usbip.OP_BYTES : size]).split(b"\0")[0]
        del inbox[:size]
        self.outbox += self._import(busid)
        return self.attached

    def _devices(self) -> bytes:
        if not self._camera.present:
            return bytes(4)
        interfaces = {s.interface: s.triple for s in reversed(parse_configuration(self._camera.configuration).settings)}
        triples = b"".join(bytes([*interfaces[i], 0]) for i in sorted(interfaces))
        return (1).to_bytes(4, "big") + self._device().encode() + triples

    def _device(self) -> usbip.Device:
        raw, configuration = self._camera.device_descriptor, self._camera.configuration
        vendor, product, release = (int.from_bytes(raw[i : i + 2], "little") for i in (8, 10, 12))
        return usbip.Device(
            f"/sys/devices/simulated/{BUSID}", BUSID, 1, 2, usbip.SPEED_HIGH, vendor, product, release,
            (raw[4], raw[5], raw[6]), configuration[5], raw[17], configuration[4],
        )  # fmt: skip

    def _import(self, busid: bytes) -> bytes:
        if busid != BUSID.encode():
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_NODEV)
        try:
            device = self._device().encode()
            self._port = self._camera.connect()
        except ThetaNotFound:
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_NODEV)
        except ThetaStall:
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_BUSY)
        settings = parse_configuration(self._camera.configuration).settings
        self._iso_endpoints = frozenset(
            e.address & 0x0F for s in settings for e in s.endpoints if e.kind == ISOCHRONOUS
        )
        return usbip.operation(usbip.OP_REP_IMPORT) + device

    def _transfer(self, port: Port, submit: usbip.Submit, data: bytes) -> None:
        """A control request, or an OUT transfer: answered now."""
        answer = b""
        status = 0
        try:
            if submit.endpoint == 0:
                answer = port.control(submit.setup, data)
            else:
                port.write(submit.endpoint, data)
        except ThetaStall:
            status = -usbip.EPIPE
        if status == 0 and len(answer) > submit.length:
            status = -usbip.EOVERFLOW
        if status or not submit.inward:
            moved, answer = (0 if status else submit.length), b""
        else:
            moved = len(answer)
        self.outbox += usbip.Return(submit.sequence, status, moved).encode() + answer

    def _unlink(self, sequence: int, victim: int) -> None:
        """Cancel a request that still waits; one that was answered already stays answered."""
        status = 0
        for schedule in self._schedules.values():
            found = [entry for entry in schedule.waiting if entry[0].sequence == victim]
            if found:
                schedule.waiting.remove(found[0])
                status = -usbip.ECONNRESET
        for queue in self._reads.values():
            for submit in [s for s in queue if s.sequence == victim]:
                queue.remove(submit)
                status = -usbip.ECONNRESET
        self.outbox += usbip.unlinked(sequence, status)
