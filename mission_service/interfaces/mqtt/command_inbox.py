"""Queue of messages that were received from a broker and not handled yet."""

import asyncio
from collections import deque

import aiomqtt


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """Messages in order of arrival; bounded, and ``put_nowait`` never raises QueueFull.

    With ``urgent`` the messages of topics with this ending precede all others. If the queue is
    full, an urgent message replaces the last of the others, and any other message is dropped: its
    sender gets no reply and may send it again. Without ``urgent`` the oldest message is dropped, so
    that a slow process does not handle outdated messages.
    """

    def __init__(self, size: int, urgent: str = "", newest: tuple[str, ...] = ()) -> None:
        """``newest``: endings of topics of which only the newest message is kept."""
        super().__init__(size)
        self.dropped = 0
        self._urgent_ending, self._newest = urgent, newest

    def _init(self, maxsize: int) -> None:
        self._urgent: deque[aiomqtt.Message] = deque()
        self._others: dict[object, aiomqtt.Message] = {}

    def qsize(self) -> int:
        """The number of waiting messages."""
        return len(self._urgent) + len(self._others)

    def empty(self) -> bool:
        """Whether the queue is empty."""
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
        """Add a message, or drop one."""
        if self.full():
            self.dropped += 1
            if not self._urgent_ending:
                self.get_nowait()
            elif self._others and self._is_urgent(item):
                self._others.popitem()
            else:
                return
        super().put_nowait(item)

    def _is_urgent(self, item: aiomqtt.Message) -> bool:
        return self._urgent_ending != "" and item.topic.value.endswith(self._urgent_ending)
