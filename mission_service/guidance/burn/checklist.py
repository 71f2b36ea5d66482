"""The GO/NO-GO checklist of a burn (NWCG PMS 515): no flight while an item is open. Pure."""

from typing import Any

from mission_service.events import (
    Aborted,
    AnyEvent,
    ChecklistAnswered,
    ClearingOrdered,
    Resumed,
)


class Checklist:
    """The checklist of a burn, in which an item is open unless its latest answer is GO.

    Answers do not expire. An abort, a restart of the service, and ``clear`` (called, for example,
    after a landing) reset every item.
    """

    def __init__(self, items: tuple[str, ...]) -> None:
        self.items = items
        self._answers: dict[str, ChecklistAnswered] = {}

    @property
    def open_items(self) -> tuple[str, ...]:
        """Return the items that are not GO, in checklist order."""
        return tuple(
            item for item in self.items if item not in self._answers or not self._answers[item].go
        )

    @property
    def complete(self) -> bool:
        """Return whether every item is GO; a list without items is complete."""
        return not self.open_items

    def apply(self, event: AnyEvent) -> str | None:
        """Apply an event; return a text for the operator if the event concerns the list."""
        match event:
            case ChecklistAnswered():
                return self._answered(event)
            case Aborted():
                return self.clear(f"abort by {event.by}")
            case ClearingOrdered():
                return self.clear(f"airspace clearing ordered by {event.by}")
            case Resumed():
                return self.clear("the service was restarted")
        return None

    def clear(self, why: str) -> str | None:
        """Reset every item; return a text for the operator if any item had an answer."""
        if not self._answers:
            return None
        self._answers.clear()
        return f"GO/NO-GO checklist: all {len(self.items)} items are open again ({why})"

    def _answered(self, event: ChecklistAnswered) -> str:
        if event.item not in self.items:
            items = "; ".join(self.items)
            return f'GO/NO-GO checklist: "{event.item}" is not an item; the items are: {items}'
        self._answers[event.item] = event
        word = "GO" if event.go else "NO-GO"
        left = len(self.open_items)
        state = "complete" if not left else f"{left} of {len(self.items)} open"
        answer = f'{word} for "{event.item}" by {event.by} at {event.station}'
        return f"GO/NO-GO checklist: {answer}; {state}"

    def status(self) -> dict[str, Any]:
        """Return each item with its answer ("go", "no-go" or "open") and the operator's name."""
        return {
            "complete": self.complete,
            "open": len(self.open_items),
            "items": [self._item(item) for item in self.items],
        }

    def _item(self, item: str) -> dict[str, Any]:
        answer = self._answers.get(item)
        if answer is None:
            return {"item": item, "answer": "open"}
        return {
            "item": item,
            "answer": "go" if answer.go else "no-go",
            "by": answer.by,
            "station": answer.station,
            "at_s": answer.at_us / 1e6,
        }
