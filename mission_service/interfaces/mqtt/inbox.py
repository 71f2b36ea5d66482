"""The queue of received commands."""

import asyncio
from collections import deque

import aiomqtt

from mission_service.interfaces.mqtt.commands import ABORT

MOST_WAITING = 100


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """Commands in the order of arrival, aborts before all others.

    When the queue is full, a new command is dropped without a reply; an abort replaces the last of
    the other commands.
    """

    def __init__(self) -> None:
        super().__init__(MOST_WAITING)
        self.dropped = 0

    def _init(self, maxsize: int) -> None:
        self._queue: deque[aiomqtt.Message] = deque()
        self._aborts = 0

    def _put(self, item: aiomqtt.Message) -> None:
        if _is_abort(item):
            self._queue.insert(self._aborts, item)
            self._aborts += 1
        else:
            self._queue.append(item)

    def _get(self) -> aiomqtt.Message:
        item = self._queue.popleft()
        self._aborts -= _is_abort(item)
        return item

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Add a message; never raises QueueFull."""
        if self.full():
            self.dropped += 1
            if not _is_abort(item) or self._aborts == len(self._queue):
                return
            self._queue.pop()
        super().put_nowait(item)


def _is_abort(message: aiomqtt.Message) -> bool:
    return message.topic.value.endswith(f"/{ABORT}")
