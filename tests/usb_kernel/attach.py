"""What `usbip attach` does, in Python: import the camera, give the socket to the kernel's vhci_hcd."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

from drivers.theta_v.codec import usbip

VHCI = Path("/sys/devices/platform/vhci_hcd.0")
PORT_FREE = 4  # VDEV_ST_NULL, in vhci_hcd's status file
RETRY_S = 0.1
TRANSFER_S = 5.0


class Cable:
    """Plugs the camera in whenever it shows up at its USB/IP server, as a USB port does by itself."""

    def __init__(self, host: str, port: int, busid: str = "1-1") -> None:
        self._address, self._busid = (host, port), busid
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Cable:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(RETRY_S):
            if occupied():
                continue
            try:
                taken = self._take()
            except OSError as error:
                print(f"attaching: {error}", flush=True)
                continue
            if taken is not None:
                stream, device = taken
                with stream:
                    attach = f"{free_port()} {stream.fileno()} {device.devid} {device.speed}"
                    (VHCI / "attach").write_text(attach, encoding="ascii")

    def _take(self) -> tuple[socket.socket, usbip.Device] | None:
        """Import it, if it is there and free."""
        stream = socket.create_connection(self._address, timeout=TRANSFER_S)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream.sendall(usbip.operation(usbip.OP_REQ_IMPORT) + self._busid.encode().ljust(usbip.BUSID_BYTES, b"\0"))
        if usbip.decode_operation(_exactly(stream, usbip.OP_BYTES), usbip.OP_REP_IMPORT) != usbip.ST_OK:
            stream.close()
            return None
        device = usbip.Device.decode(_exactly(stream, usbip.DEVICE.size))
        stream.settimeout(None)  # the kernel wants to block on it
        return stream, device


def occupied() -> bool:
    """Whether something is plugged in."""
    lines = (VHCI / "status").read_text(encoding="ascii").splitlines()[1:]
    return any(int(line.split()[2]) != PORT_FREE for line in lines)


def free_port() -> int:
    """A free high-speed port. Raises OSError."""
    for line in (VHCI / "status").read_text(encoding="ascii").splitlines()[1:]:
        hub, port, state = line.split()[:3]
        if hub == "hs" and int(state) == PORT_FREE:
            return int(port)
    raise OSError("no free port at vhci_hcd")


def _exactly(stream: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        piece = stream.recv(count - len(data))
        if not piece:
            raise ConnectionResetError("the USB/IP server hung up")
        data += piece
    return data
