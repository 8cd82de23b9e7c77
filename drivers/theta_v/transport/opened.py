"""What every transport knows of the camera it holds: its descriptors, and the interfaces it claimed."""

from __future__ import annotations

from drivers.theta_v.codec.descriptors import Configuration, parse_configuration
from drivers.theta_v.errors import ThetaGone
from drivers.theta_v.transport.base import (
    Identity,
    UsbTransport,
    read_configuration,
    read_device_descriptor,
    read_identity,
)


class OpenedCamera:
    """Read once after opening by `read_descriptors`. Using an interface without a claim is a mistake of ours."""

    def __init__(self) -> None:
        self._device_descriptor = b""
        self._configuration = b""
        self._parsed = Configuration(0, ())
        self._identity: Identity | None = None
        self._claims: set[int] = set()

    @property
    def identity(self) -> Identity:
        """Raises ThetaGone before the camera was opened."""
        if self._identity is None:
            raise ThetaGone("the camera is not open")
        return self._identity

    @property
    def device_descriptor(self) -> bytes:
        return self._device_descriptor

    @property
    def configuration(self) -> bytes:
        return self._configuration

    @property
    def configuration_value(self) -> int:
        return self._parsed.value

    async def read_descriptors(self, transport: UsbTransport) -> Identity:
        """Ask an open transport who is at the other end. Raises ThetaError."""
        self._device_descriptor = await read_device_descriptor(transport)
        self._configuration = await read_configuration(transport)
        self._parsed = parse_configuration(self._configuration)
        self._identity = await read_identity(transport, self._device_descriptor)
        return self._identity

    def claimed(self, interface: int) -> bool:
        return interface in self._claims

    def need(self, interface: int) -> None:
        if interface not in self._claims:
            raise RuntimeError(f"interface {interface} was not claimed")

    def need_endpoint(self, endpoint: int) -> None:
        """The interface of this endpoint must be claimed."""
        for setting in self._parsed.settings:
            if any(e.address == endpoint for e in setting.endpoints):
                self.need(setting.interface)
                return
        raise RuntimeError(f"the camera has no endpoint {endpoint:#04x}")
