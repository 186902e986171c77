# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Process many bags or jobs on local processes or a Dask cluster; results in job order."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.errors import UsageError, UserError, first_line
from estimator_pkg.optional import needs

SCHEDULER_WAIT = '8s'  # longest wait for a scheduler

Map = Callable[[Callable[..., Any], Sequence[tuple]], Iterator[Any]]


@contextmanager
def workers(jobs: int = 1, scheduler: str | None = None) -> Iterator[Map]:
    """Yield a function (function, argument tuples) -> results in the same order, as they arrive.

    Parameters
    ----------
    jobs : local processes; 1: this one.
    scheduler : address of a Dask scheduler, used instead of local processes.

    Raises
    ------
    UsageError : fewer than one job.
    UserError : Dask is missing, or the scheduler does not answer.
    """
    if jobs < 1:
        raise UsageError(f'--jobs is {jobs}: it must be 1 or more')
    if scheduler is not None:
        with _cluster(scheduler) as client:
            yield lambda function, items: _of_cluster(client, function, items)
    elif jobs == 1:
        yield lambda function, items: (function(*item) for item in items)
    else:
        context = multiprocessing.get_context('spawn')  # threads and ROS do not survive a fork
        pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
        try:
            yield lambda function, items: _of_pool(pool, function, items)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Ignore Ctrl-C and HUP, which reach every process of the terminal: the parent decides.

    A parent that is killed leaves no worker behind.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for number in interrupts.NUMBERS:
        if number != signal.SIGTERM:  # the pool ends them with SIGTERM
            signal.signal(number, signal.SIG_IGN)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _of_pool(
    pool: ProcessPoolExecutor, function: Callable[..., Any], items: Sequence[tuple]
) -> Iterator[Any]:
    futures = [pool.submit(function, *item) for item in items]
    try:
        for future in futures:
            yield future.result()
    except BrokenProcessPool as error:
        if interrupts.came():  # TERM to the whole group, too
            raise KeyboardInterrupt from error
        raise UserError('a worker process died: check the memory, or use fewer --jobs') from error


def _of_cluster(client: Any, function: Callable[..., Any], items: Sequence[tuple]) -> Iterator[Any]:
    from distributed import CancelledError, TimeoutError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        futures = [client.submit(function, *item, pure=False) for item in items]
        for future in futures:
            yield future.result()
    except (CommClosedError, KilledWorker, CancelledError, TimeoutError) as error:
        raise UserError(f'the Dask cluster failed: {first_line(error)}') from error


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise UserError(needs('distributed')) from error
    logging.disable()  # its tracebacks are not for the user
    try:
        try:
            client = Client(address, timeout=SCHEDULER_WAIT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            reason = f'{first_line(error)}: check the address'
            raise UserError(f"no Dask scheduler answers at '{address}': {reason}") from error
        with client:
            yield client
    finally:
        logging.disable(logging.NOTSET)
