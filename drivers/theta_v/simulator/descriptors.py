"""What the simulated camera says about itself.

Live mode is the 432-byte high-speed configuration of a THETA Z1 (fact sheet section 1.4) with the V's
device descriptor; MTP mode is the one-interface shape seen on both models.
"""

from __future__ import annotations

from enum import Enum


class Composition(Enum):
    """Which of its two USB faces the camera shows."""

    MTP = "mtp"
    LIVE = "live"


LIVE_CONFIGURATION = bytes.fromhex(
    "0902b00105010080fa0904000003060101000705810200020007050102000200"
    "070582031c0006080b01020e03000809040100010e0101080d240150013500e8"
    "03000001021224020101020000000000000000030600000d2405020100400300"
    "0000000009240303010100020007058303100008052503100009040200000e02"
    "01090e240101a8008400030000000100342413010201040076000002cc030000"
    "00000000cc03000000000000cc03000000000000000000000000000000000000"
    "0000000030241401000f80070100010040423300000100070025000000000000"
    "000000c0270900001c4e0e631705000163170500302414028007c00301000100"
    "40422800000100070025000000000000000000c0270900002d31016317050001"
    "6317050006240d01010409040201010e02010907058405001401080b03020100"
    "200009040300000101200009240100020325000008240a060101000011240202"
    "010200060433000000000300000c240304010100020603000009040400000102"
    "2000090404010101022000102401040001010000000433000000000624020103"
    "1807058505ff03040825010000000000"
)
_ISO_ALTERNATE = bytes.fromhex("09040201010e020109" + "07058405001401")
_BULK_ENDPOINT = bytes.fromhex("07058402000200")
_VIDEO_INTERFACE = bytes.fromhex("09040200000e020109")


def with_bulk_video(configuration: bytes) -> bytes:
    """The same camera with its video on a bulk endpoint of alternate setting 0, as UVC allows: no dump shows it."""
    video = configuration.replace(_ISO_ALTERNATE, _BULK_ENDPOINT)
    video = video.replace(_VIDEO_INTERFACE, _VIDEO_INTERFACE[:4] + b"\1" + _VIDEO_INTERFACE[5:])
    return video[:2] + len(video).to_bytes(2, "little") + video[4:]


LIVE_DEVICE = bytes.fromhex("12010002ef020140ca051227000101020301")
LIVE_QUALIFIER = bytes.fromhex("0a060002ef0201400100")

MTP_CONFIGURATION = bytes.fromhex(
    "09022700010100c0fa"  # one interface, 39 bytes
    "090400000306010100"
    "07058102000200"
    "07050102000200"
    "070582031c0006"
)
MTP_DEVICE = bytes.fromhex("1201000200000040ca056803000101020301")
MTP_QUALIFIER = bytes.fromhex("0a060002000000400100")

MANUFACTURER = "Ricoh Company, Ltd."
PRODUCT = "RICOH THETA V"

PTP_IN, PTP_OUT, PTP_EVENTS, VIDEO_STATUS, VIDEO, AUDIO = 0x81, 0x01, 0x82, 0x83, 0x84, 0x85
STILL_INTERFACE, CONTROL_INTERFACE, VIDEO_INTERFACE = 0, 1, 2


def string_descriptor(text: str) -> bytes:
    units = text.encode("utf-16-le")
    return bytes([2 + len(units), 3]) + units


def strings(serial: str) -> dict[int, bytes]:
    """String descriptors by index; index 0 is the list of languages (English)."""
    texts = {1: MANUFACTURER, 2: PRODUCT, 3: serial, 8: "UVC Camera", 9: "Video Streaming"}
    return {0: bytes([4, 3, 0x09, 0x04])} | {i: string_descriptor(t) for i, t in texts.items()}
