"""An autopilot that fails in flight: it receives and sends nothing."""


class Dead:
    """An autopilot that no longer exists."""

    def next_timer(self) -> int:
        return 2**62

    def handle_timer(self, now_us: int) -> None:
        return None

    def receive_data(self, data: bytes, now_us: int) -> None:
        return None

    def data_to_send(self) -> list[bytes]:
        return []
