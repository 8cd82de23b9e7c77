"""The streams a page can choose from: the camera's own, a smaller one, stills. What nobody watches is not made."""

from __future__ import annotations

import contextlib
import logging
from dataclasses import replace
from typing import TYPE_CHECKING

from drivers.theta_v.codec.sps_rewrite import rewritten
from drivers.theta_v.errors import ThetaMalformed
from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.transcode import Transcoder, jpeg_of, small_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ghal360_robot.telepresence.settings import PageSettings

MAX_GROUP_FRAMES = 64
"""Two seconds at 30 Hz; the camera begins a new group every second."""

MAX_GROUP_BYTES = 16 << 20
"""A second of 4K at 120 Mb/s."""

MAX_GROUP_AGE_NS = 1_000_000_000
"""Of a group's newest picture: a camera that fell silent has nothing to go on from."""

logger = logging.getLogger(__name__)


class Stream:
    """Pictures for whoever watches, and the group they are in for whoever comes."""

    def __init__(self) -> None:
        self._watchers: list[Callable[[Frame], None]] = []
        self._group: list[Frame] = []
        """The newest key picture and all since; nothing where that got too much."""
        self._group_bytes = 0

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

    def group(self, now_ns: int) -> tuple[Frame, ...]:
        """What a decoder has to be given to go on with this stream; nothing where it has to wait for a key picture."""
        if not self._group or now_ns - self._group[-1].stamp_ns > MAX_GROUP_AGE_NS:
            return ()
        return tuple(self._group)

    def give(self, frame: Frame) -> None:
        """One more picture."""
        self._keep(frame)
        for take in self._watchers:
            take(frame)

    def _keep(self, frame: Frame) -> None:
        if frame.key:
            self._group, self._group_bytes = [frame], len(frame.data)
        elif self._group:
            self._group.append(frame)
            self._group_bytes += len(frame.data)
            if len(self._group) > MAX_GROUP_FRAMES or self._group_bytes > MAX_GROUP_BYTES:
                self._group.clear()


class Streams:
    """All streams, fed with the camera's access units; enter it for the life of the server."""

    def __init__(self, settings: PageSettings) -> None:
        self._streams = {"camera": Stream(), "stills": Stream()}
        self._makers: dict[str, Transcoder] = {"stills": Transcoder(jpeg_of, keys_only=True)}
        if settings.small_codec:
            self._streams["small"] = Stream()
            self._makers["small"] = Transcoder(small_of(settings))
        self._lost = False
        """What the pictures up to the next key picture are built upon could not be given."""

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
        if frame.key:
            try:
                # A decoder that is not told of the missing reordering holds back pictures.
                frame = replace(frame, data=rewritten(frame.data))
            except ThetaMalformed as error:
                self._lost = True
                logger.warning("a key picture's parameters are damaged, and it is left out with its group: %s", error)
                return
            self._lost = False
        elif self._lost:
            return
        self._streams["camera"].give(frame)
        for name, maker in self._makers.items():
            if self._streams[name].watched:
                maker.offer(frame)
            else:
                maker.rest()
