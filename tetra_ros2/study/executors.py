# Copyright 2026 The tetra_ros2 authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Who computes a study: processes of this machine, or a Dask cluster."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
import os
import signal
import threading
from typing import Any

from tetra_ros2 import installation, signals
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
        executor = _Workers(
            workers, mp_context=get_context('spawn'), initializer=_leave_the_end_to_the_parent)
        try:
            yield executor, 2 * workers
        except BaseException:
            # What they compute is not wanted any more, and takes seconds.
            for worker in active_children():
                worker.kill()
            raise
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


class _Workers(ProcessPoolExecutor):
    """Processes that no signal finds while they start, when they would print a traceback."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        # This is where processes are started. They inherit what is blocked.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, signals.SIGNALS)
        try:
            return super().submit(function, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave_the_end_to_the_parent() -> None:
    """Let a worker end when the process that was called does, and not by Ctrl-C."""
    signals.ignore()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, signals.SIGNALS)
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
