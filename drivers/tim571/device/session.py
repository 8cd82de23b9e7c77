"""One open connection in one dialect: a reader that sorts what arrives, and one request at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from drivers.tim571.codec import answers, commands
from drivers.tim571.codec.deframer import Damage
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import meaning
from drivers.tim571.codec.scandata import is_scan
from drivers.tim571.codec.telegram import ANSWER_OF, FAULT, Receiver, Telegram
from drivers.tim571.errors import (
    TimAnswerError,
    TimMalformedError,
    TimRefusedError,
    TimTimeoutError,
    TimUnreachableError,
)
from drivers.tim571.transport import Transport

_ANSWERS = frozenset(ANSWER_OF.values())  # not `sMA`: a method was accepted, and its answer is still to come


@dataclass(frozen=True, slots=True)
class Listeners:
    """Who gets what arrives unasked; called from the reader, so they must be quick."""

    on_frame: Callable[[int, bytes], None]
    """Every good frame as on the wire, answers included, with its arrival."""
    on_event: Callable[[Telegram], None]
    """Every telegram that no request waits for."""
    on_damage: Callable[[Damage], None]


@dataclass(slots=True)
class _Question:
    kind: str
    name: str
    answer: asyncio.Future[Telegram] = field(default_factory=lambda: asyncio.get_running_loop().create_future())


class Session:
    """Use after `open()`; ends by `close()`, or by itself with an error that `broken()` and requests raise."""

    def __init__(self, transport: Transport, dialect: Dialect, listeners: Listeners) -> None:
        self.dialect = dialect
        self.device = f"TiM571 at {transport.name}"
        self._transport = transport
        self._listeners = listeners
        self._receiver = Receiver(dialect)
        self._question: _Question | None = None
        self._unanswered = 0
        self._turn = asyncio.Lock()
        self._reader: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connect and start reading; raises what the transport raises."""
        await self._transport.open()
        self._reader = asyncio.create_task(self._read(), name=f"read {self.device}")

    async def close(self) -> None:
        """Disconnect."""
        if self._reader is not None:
            self._reader.cancel()
            await asyncio.wait({self._reader})
            if not self._reader.cancelled():
                self._reader.exception()  # already told by `broken`, or of no interest any more
        await self._transport.close()

    async def broken(self, timeout_s: float) -> None:
        """Wait for that long; raise the error that ended the connection if one does."""
        reader = self._running()
        await asyncio.wait({reader}, timeout=timeout_s)
        if reader.done():
            reader.result()

    async def request(self, request: Telegram, timeout_s: float) -> Telegram:
        """Send a request and return the answer of that name, of whatever kind; `sFA` has none and answers any.

        Scans and other events that come in between go to their listener. Raises TimTimeoutError if the answer
        doesn't come in time and TimUnreachableError if the connection breaks.
        """
        async with self._turn:
            reader = self._running()
            question = _Question(ANSWER_OF[request.kind], request.name)
            self._question = question
            try:
                await self._transport.write(request.to_wire())
                either: set[asyncio.Future[Any]] = {question.answer, reader}
                await asyncio.wait(either, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
            finally:
                self._question = None
            if question.answer.done():
                self._unanswered = 0  # a device answers in order: what it left out it will not say any more
                return question.answer.result()
            if reader.done():
                reader.result()
            self._unanswered += 1
            raise TimTimeoutError(f"{self.device} did not answer {request.kind} {request.name} within {timeout_s:g} s.")

    async def ask(self, request: Telegram, timeout_s: float) -> tuple[Any, ...]:
        """As `request`, returning the answer's values.

        Raises TimRefusedError for `sFA` and TimAnswerError for what is no answer to that request.
        """
        return commands.values_of(await self._good_answer(request, timeout_s))

    async def answer(self, request: Telegram, timeout_s: float) -> Any:
        """As `ask`, returning what the values mean (`answers.understand`)."""
        return answers.understand(await self._good_answer(request, timeout_s))

    async def _good_answer(self, request: Telegram, timeout_s: float) -> Telegram:
        answer = await self.request(request, timeout_s)
        what = f"{request.kind} {request.name}"
        try:
            values = commands.values_of(answer)
        except TimMalformedError as error:
            raise TimAnswerError(f"{self.device} answered {what} with nonsense: {error}.") from error
        if answer.kind == FAULT:
            code: int = values[0]
            raise TimRefusedError(f"{self.device} refused {what}: {meaning(code)} (sFA {code:X}).", code)
        if answer.kind != ANSWER_OF[request.kind]:
            raise TimAnswerError(f"{self.device} answered {what} with {answer.kind}, which answers something else.")
        return answer

    def _running(self) -> asyncio.Task[None]:
        if self._reader is None:
            raise TimUnreachableError(f"{self.device} is not connected.")
        return self._reader

    async def _read(self) -> None:
        while True:
            stamp_ns, data = await self._transport.read()
            events = self._receiver.feed(data, stamp_ns) if data else self._receiver.close()
            for event in events:
                if isinstance(event, Damage):
                    self._listeners.on_damage(event)
                else:
                    self._listeners.on_frame(event.stamp_ns, event.frame)
                    self._sort(event)
            if not data:
                raise TimUnreachableError(f"{self.device} closed the connection.")

    def _sort(self, telegram: Telegram) -> None:
        question = self._question
        if question is None or question.answer.done() or not self._answers(telegram, question):
            self._listeners.on_event(telegram)
        else:
            question.answer.set_result(telegram)

    def _answers(self, telegram: Telegram, question: _Question) -> bool:
        if telegram.kind == FAULT:
            if self._unanswered:  # it names nothing, so it may belong to a request that was given up
                self._unanswered -= 1
                return False
            return True
        if telegram.name != question.name or telegram.kind not in _ANSWERS:
            return False
        return telegram.kind == question.kind or not is_scan(telegram)
