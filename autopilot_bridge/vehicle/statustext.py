"""Assembles long STATUSTEXTs, which autopilots send in chunks of 50 bytes with the same id."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message

CHUNK_BYTES = 50


class StatustextAssembler:
    """The chunks of one incomplete text; the last chunk or a HEARTBEAT ends the text."""

    def __init__(self) -> None:
        self._begun: Message | None = None  # contains the part of the text that has arrived
        self._next_chunk = 0

    def receive(self, message: Message) -> list[Message]:
        """Return the messages to process, in order: assembled texts, other messages unchanged."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            return [*self._end(), message]
        if kind != "STATUSTEXT":
            return [message]
        # A text of one chunk has id 0, and so has PX4's first long text.
        continues = message.id or message.chunk_seq
        if continues and self._begun is not None and self._begun.id == message.id:
            if message.chunk_seq < self._next_chunk:
                return []  # duplicate
            if message.chunk_seq == self._next_chunk:
                return self._add(message, self._begun.text + message.text)
        before = self._end()  # the chunk belongs to another text, or a chunk was lost
        return [*before, *self._add(message, message.text)]

    def _add(self, chunk: Message, text: str) -> list[Message]:
        whole = mavlink.MAVLink_statustext_message(chunk.severity, b"", chunk.id, chunk.chunk_seq)
        whole._header = chunk.get_header()
        whole.text = text
        self._begun, self._next_chunk = whole, chunk.chunk_seq + 1
        return self._end() if len(chunk.text.encode()) < CHUNK_BYTES else []

    def _end(self) -> list[Message]:
        begun, self._begun = self._begun, None
        return [] if begun is None else [begun]
