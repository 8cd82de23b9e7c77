"""Reading and writing telegram parameters in either dialect, so that each telegram is described once.

A layout is a string of `struct` letters (`B H I` unsigned, `h i` signed, `f` float32), `S`, a string with its
length in front, and `R`, whatever is left, as bytes. CoLa-A writes each letter as one blank-separated token,
CoLa-B as big-endian bytes.
"""

from __future__ import annotations

from typing import Any

from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import Fault
from drivers.tim571.codec.readers import BinaryReader, Reader, TextReader
from drivers.tim571.codec.writers import BinaryWriter, TextWriter, Writer
from drivers.tim571.errors import TimMalformedError


def reader(dialect: Dialect, body: bytes) -> Reader:
    """A reader of a telegram's body."""
    return TextReader(body) if dialect is Dialect.A else BinaryReader(body)


def writer(dialect: Dialect) -> Writer:
    """An empty writer."""
    return TextWriter() if dialect is Dialect.A else BinaryWriter()


def unpack(dialect: Dialect, body: bytes, layout: str) -> tuple[Any, ...]:
    """All parameters of a short telegram; raises TimMalformedError where too few, too many or wrong."""
    source = reader(dialect, body)
    values: list[Any] = []
    for letter in layout:
        if letter == "R":
            return (*values, source.rest)
        values += (source.string(),) if letter == "S" else source.take(letter)
    if source.rest:
        raise TimMalformedError("more parameters than expected", Fault.BUFFER_OVERFLOW)
    return tuple(values)


def pack(dialect: Dialect, layout: str, *values: Any) -> bytes:
    """The parameters of a short telegram; raises ValueError for one that does not fit."""
    sink = writer(dialect)
    for letter, value in zip(layout, values, strict=True):
        if letter == "S":
            sink.string(value)
        elif letter == "R":
            sink.raw(value)
        else:
            sink.put(letter, value)
    return sink.body()
