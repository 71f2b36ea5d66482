"""Queues received messages that the service has not handled yet."""

import asyncio
from collections import deque

import aiomqtt


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """A bounded queue of messages in order of arrival; ``put_nowait`` never raises QueueFull.

    With ``urgent``, messages on topics with this ending come before all others. If the queue is
    full, an urgent message replaces the last of the others, and any other message is dropped. The
    sender of a dropped message receives no reply and may send it again. Without ``urgent``, a full
    queue drops its oldest message, so that a slow process does not handle outdated messages.
    """

    def __init__(self, size: int, urgent: str = "", newest: tuple[str, ...] = ()) -> None:
        """Make a queue of ``size`` messages.

        For each topic with an ending in ``newest``, the queue stores only the newest message.
        """
        super().__init__(size)
        self._urgent_ending, self._newest = urgent, newest

    def _init(self, maxsize: int) -> None:
        self._urgent: deque[aiomqtt.Message] = deque()
        self._others: dict[object, aiomqtt.Message] = {}

    def qsize(self) -> int:
        """Return the number of waiting messages."""
        return len(self._urgent) + len(self._others)

    def empty(self) -> bool:
        """Return whether the queue is empty."""
        return self.qsize() == 0

    def _put(self, item: aiomqtt.Message) -> None:
        topic = item.topic.value
        if self._is_urgent(item):
            self._urgent.append(item)
        else:
            self._others[topic if topic.endswith(self._newest) else object()] = item

    def _get(self) -> aiomqtt.Message:
        if self._urgent:
            return self._urgent.popleft()
        return self._others.pop(next(iter(self._others)))

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Add a message; if the queue is full, drop this message or another."""
        if self.full():
            if not self._urgent_ending:
                self.get_nowait()
            elif self._others and self._is_urgent(item):
                self._others.popitem()
            else:
                return
        super().put_nowait(item)

    def _is_urgent(self, item: aiomqtt.Message) -> bool:
        return self._urgent_ending != "" and item.topic.value.endswith(self._urgent_ending)
