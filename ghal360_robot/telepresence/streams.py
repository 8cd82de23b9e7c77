"""The streams a page can choose from: the camera's own, a smaller one, stills. What nobody watches is not made."""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING

from drivers.theta_v.codec.sps_rewrite import rewritten
from drivers.theta_v.errors import ThetaMalformed
from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.transcode import Transcoder, jpeg_of, small_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ghal360_robot.telepresence.settings import PageSettings

logger = logging.getLogger(__name__)


class Stream:
    """Pictures for whoever watches."""

    def __init__(self) -> None:
        self._watchers: list[Callable[[Frame], None]] = []

    @property
    def watched(self) -> bool:
        return bool(self._watchers)

    @contextlib.contextmanager
    def watched_by(self, take: Callable[[Frame], None]) -> Iterator[None]:
        """Give `take` every picture while in the context."""
        self._watchers.append(take)
        try:
            yield
        finally:
            self._watchers.remove(take)

    def give(self, frame: Frame) -> None:
        for take in self._watchers:
            take(frame)


class Streams:
    """All streams, fed with the camera's access units; enter it for the life of the server."""

    def __init__(self, settings: PageSettings) -> None:
        self._streams = {"camera": Stream(), "stills": Stream()}
        self._makers: dict[str, Transcoder] = {"stills": Transcoder(jpeg_of, keys_only=True)}
        if settings.small_codec:
            self._streams["small"] = Stream()
            self._makers["small"] = Transcoder(small_of(settings))

    def get(self, name: str) -> Stream | None:
        return self._streams.get(name)

    def __enter__(self) -> Streams:
        for name, maker in self._makers.items():
            maker.start(self._streams[name].give)
        return self

    def __exit__(self, *_: object) -> None:
        for maker in self._makers.values():
            maker.close()

    def feed(self, frame: Frame) -> None:
        """One access unit of the camera."""
        try:
            # A decoder that is not told of the missing reordering holds back pictures.
            data = rewritten(frame.data) if frame.key else frame.data
        except ThetaMalformed as error:
            logger.warning("a key picture's parameters are damaged: %s", error)
            return
        if data is not frame.data:
            frame = Frame(data, frame.stamp_ns, frame.sequence, frame.width, frame.height, frame.key, frame.tainted)
        self._streams["camera"].give(frame)
        for name, maker in self._makers.items():
            if self._streams[name].watched:
                maker.offer(frame)
            else:
                maker.rest()
