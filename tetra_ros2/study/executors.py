# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Who computes a study: processes of this machine, or a Dask cluster."""

from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
import os
import signal

from tetra_ros2 import installation
from tetra_ros2.config.parameters import ConfigurationError

ANSWER_TIMEOUT = 10.0
"""How long a scheduler may take to answer [s]."""


@contextmanager
def make_executor(workers: int | None, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """
    Yield a standard executor and how many tasks to keep under way.

    :param workers: processes on this machine; as many as it has processors by default
    :param scheduler: address of a Dask scheduler to use instead
    :raises ConfigurationError: if the scheduler cannot be used
    """
    if scheduler is None:
        workers = workers or os.cpu_count() or 1
        # Forking a process that has threads, such as those of a progress bar, can hang.
        executor = ProcessPoolExecutor(
            workers, mp_context=get_context('spawn'), initializer=_ignore_interrupts)
        try:
            yield executor, 2 * workers
        finally:
            executor.shutdown(cancel_futures=True)
        return
    try:
        from distributed import Client  # it is optional
    except ModuleNotFoundError:
        raise ConfigurationError(
            f'a Dask cluster needs distributed: {installation.install_command("cluster")}',
            key='--scheduler') from None
    try:
        client = Client(scheduler, timeout=ANSWER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] or type(error).__name__
        raise ConfigurationError(
            f'{scheduler} does not answer: {reason}', key='--scheduler') from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise ConfigurationError(
                f'{scheduler} has no workers', key='--scheduler')
        # Tasks are pure, but dask must not merge two that look alike into one future.
        executor = client.get_executor(pure=False)
        try:
            yield executor, 2 * threads
        finally:
            executor.shutdown(wait=False)


def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the process that was called."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
