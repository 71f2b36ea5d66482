"""Delivers alarms to the receivers of ``[[service.alarm_receivers]]`` with the Apprise library."""

import asyncio
import logging
import re
import threading
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.signing import held
from mission_service.config.sections import KEY_SOURCE
from mission_service.config.service_section import AlarmReceiverSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.notifications.alarm_dispatch import (
    OWN_KIND,
    AlarmDispatch,
    AlarmMessage,
)
from mission_service.runtime.clocks import clock_us
from mission_service.runtime.redaction import hide

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

LOOK_S = 1.0  # interval between two checks of the alarms
ANSWER_S = 30.0  # time limit for one delivery
MAX_UNFINISHED = 8  # deliveries to one receiver that a server may keep open after the time limit

Deliver = Callable[[AlarmMessage], Coroutine[Any, Any, str]]


def alarm_notifier(
    receivers: Sequence[AlarmReceiverSection], site: str
) -> Callable[["RunContext"], Coroutine[Any, Any, None]]:
    """Return the coroutine function that sends alarms of the run ``site`` until cancelled.

    Raises MissionServiceError for receivers that cannot be used.
    """
    deliveries = [apprise_delivery(each) for each in receivers]

    async def run_interface(context: "RunContext") -> None:
        async with asyncio.TaskGroup() as group:
            for receiver, deliver in zip(receivers, deliveries, strict=True):
                group.create_task(notify(context, receiver, site, deliver))

    return run_interface


async def notify(
    context: "RunContext", receiver: AlarmReceiverSection, site: str, deliver: Deliver
) -> None:
    """Send the alarms of a run to one receiver until cancelled.

    ``deliver`` returns the reason why a message was not delivered, or "". From a failed delivery to
    the next successful one, the alarm ``notification/NAME`` is active.
    """
    view, dispatch = context.state_view, AlarmDispatch(receiver, site)
    key = f"{OWN_KIND}/{receiver.name}"
    while True:
        message = dispatch.next_message(list(view.alarms.values()), clock_us() / 1e6)
        if message is not None:
            problem = await deliver(message)
            if problem:
                dispatch.failed(clock_us() / 1e6)
                view.alarm(key, f"alarms are not delivered to {receiver.name}: {problem}")
            else:
                dispatch.delivered(message, clock_us() / 1e6)
                view.clear_alarm(key)
                context.service.announce("service", f"sent to {receiver.name}: {message.title}")
            context.ring()
        await asyncio.sleep(LOOK_S)


def apprise_delivery(receiver: AlarmReceiverSection) -> Deliver:
    """Return the coroutine function that delivers messages to a receiver.

    Raises MissionServiceError if the receiver's URL cannot be used.
    """
    what = f"[[service.alarm_receivers]] {receiver.name}: url"
    try:
        import apprise  # takes 0.3 s; only runs with receivers use it
    except ImportError:
        raise MissionServiceError(
            f"{what}: requires Apprise: pip install 'mission-service[notify]'"
        ) from None
    url = receiver.url
    if re.fullmatch(KEY_SOURCE, url):
        try:
            url = held(url, what)
        except BridgeError as error:
            raise MissionServiceError(str(error)) from None
        hide(url)
    logging.getLogger("apprise").propagate = False  # the reasons are in the results
    # Without a timeout of its own, Apprise sends in the calling thread; its pool of threads would
    # delay the end of the process, and servers that do not answer would block all receivers.
    asset = apprise.AppriseAsset(async_mode=False, service_timeout=0)
    service = apprise.Apprise(asset=asset)
    if not service.add(url):
        raise MissionServiceError(
            f"{what}: is not an address that Apprise supports; examples: "
            '"mailtos://USER:PASSWORD@HOST?to=ADDRESS", "jsons://HOST/PATH" '
            "(https://appriseit.com/services)"
        )

    unfinished: list[Future[Any]] = []

    async def deliver(message: AlarmMessage) -> str:
        unfinished[:] = [each for each in unfinished if not each.done()]
        if len(unfinished) >= MAX_UNFINISHED:
            return f"the server has not answered {MAX_UNFINISHED} earlier deliveries"
        send = partial(
            service.notify,
            title=message.title,
            body=message.body,
            # Apprise sends other mails as HTML, but alarms contain names that other people chose.
            body_format=apprise.NotifyFormat.TEXT,
        )
        sending = _in_daemon_thread(send)
        unfinished.append(sending)
        try:
            async with asyncio.timeout(ANSWER_S):
                result = await asyncio.wrap_future(sending)
        except TimeoutError:
            return f"no answer within {ANSWER_S:.0f} s"
        except Exception as error:  # its text may contain the address with the password
            return f"Apprise failed with {type(error).__name__}"
        if result:
            return ""
        return next((each.message for each in result.logs()), "the service refused the message")

    return deliver


def _in_daemon_thread(work: Callable[[], Any]) -> "Future[Any]":
    """Start ``work`` in a thread that delays neither the end of the process nor other threads.

    The event loop has few threads of its own, and the process ends only after them.
    """
    found: Future[Any] = Future()
    found.set_running_or_notify_cancel()  # a later cancellation has no effect

    def run() -> None:
        try:
            found.set_result(work())
        except Exception as error:  # raised in the caller
            found.set_exception(error)

    threading.Thread(target=run, name="alarm delivery", daemon=True).start()
    return found
