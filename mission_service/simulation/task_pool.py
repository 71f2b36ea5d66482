"""Runs many independent tasks on the cores of this machine, or on a Dask cluster."""

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any

from mission_service.errors import MissionServiceError

SECONDS_TO_CONNECT = 30
HOW_TO_INSTALL = "pip install 'mission-service[cluster]'"

# Runs ``work(item, job)`` for each item, and yields the results in item order.
Run = Callable[[Callable[[Any, Any], Any], Sequence[Any], Any], Iterator[Any]]


@contextmanager
def on_threads(workers: int) -> Iterator[Run]:
    """Yield a function that runs tasks in threads of this process; the kernels release the GIL."""
    pool = ThreadPoolExecutor(workers, thread_name_prefix="fires")
    try:
        yield lambda work, items, job: iter(pool.map(partial(_done, work=work, job=job), items))
    finally:
        pool.shutdown(cancel_futures=True)


def _done(item: Any, work: Callable[[Any, Any], Any], job: Any) -> Any:
    return work(item, job)


@contextmanager
def on_cluster(scheduler: str, command: str) -> Iterator[Run]:
    """Yield a function that runs tasks on the workers of a Dask scheduler (tcp://HOST:8786).

    This package must be installed on each worker. If a worker is lost, its tasks are repeated on
    other workers. Error messages begin with ``command``. Raises MissionServiceError if Dask is not
    installed, or if there is no scheduler or no worker.
    """
    with dask_client(scheduler, command) as client:

        def run(work: Callable[[Any, Any], Any], items: Sequence[Any], job: Any) -> Iterator[Any]:
            import distributed

            # The job is sent to each worker once. With hash=False, a later equal job is sent again.
            shared = client.scatter(job, broadcast=True, hash=False)
            futures = client.map(_done, items, work=work, job=shared, pure=False)
            try:
                for future in futures:
                    yield future.result()
            except (distributed.KilledWorker, CancelledError, OSError) as error:
                reason = " ".join(str(error).split())
                if "scheduler-connection-lost" in reason:
                    reason = "the connection to the scheduler was lost"
                raise MissionServiceError(
                    f"{command}: {scheduler}: a task failed on the cluster: {reason}; check the "
                    "cluster and run the command again"
                ) from None
            finally:
                client.cancel(futures)

        yield run


@contextmanager
def dask_client(scheduler: str, command: str) -> Iterator[Any]:
    """Yield a client of a Dask scheduler with workers. Raises the same errors as ``on_cluster``."""
    try:
        import distributed
    except ImportError:
        raise MissionServiceError(f"{command}: Dask is not installed; {HOW_TO_INSTALL}") from None
    if scheduler.startswith(("tls:", "wss:")):
        security_of: Any = distributed.Security
        if security_of().get_connection_args("client")["ssl_context"] is None:
            raise MissionServiceError(
                f"{command}: {scheduler}: no certificates; set distributed.comm.tls in Dask's "
                "configuration"
            )
    # Errors logged by the client and its connection are also raised as exceptions. Dask sets its
    # own level for the client's logger.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client_of: Any = distributed.Client
    try:
        client = client_of(scheduler, timeout=SECONDS_TO_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise MissionServiceError(f"{command}: no Dask scheduler at {scheduler}: {error}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=SECONDS_TO_CONNECT)
        except TimeoutError:
            raise MissionServiceError(
                f"{command}: {scheduler}: the scheduler has no workers; start some with "
                f"`dask worker {scheduler}`"
            ) from None
        yield client


def tasks_on(scheduler: str | None, workers: int, command: str) -> AbstractContextManager[Run]:
    """Return ``on_cluster`` if a scheduler is given, else ``on_threads``."""
    return on_cluster(scheduler, command) if scheduler else on_threads(workers)
