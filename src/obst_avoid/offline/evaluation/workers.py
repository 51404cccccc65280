"""Dask's workers: on this machine's cores, or those of a scheduler."""

import asyncio
import concurrent.futures
import contextlib
import itertools
import logging
import os
import signal
import sys
import tempfile
from multiprocessing import resource_tracker
from typing import Any, Callable, Dict, Iterable, Iterator, Optional, Tuple

import cv2

import obst_avoid
from obst_avoid.offline.evaluation.tasks import Job, Result, Task
from obst_avoid.offline.tool import ToolError

IN_FLIGHT = 4
"""Tasks a worker: none waits for work, and memory does not grow with the number of tasks."""
HERE = '127.0.0.1'
"""Nobody else can reach what this machine's workers do."""
PARTS = ('scheduler', 'worker', 'nanny')
"""Of Dask, each with a web page by default."""
START_SECONDS = 30
"""To find a scheduler and its first worker, or to start one."""
GONE = (concurrent.futures.CancelledError, asyncio.CancelledError, asyncio.TimeoutError, OSError)
"""What calls raise when the scheduler has gone, Dask's CommClosedError as an OSError. Nobody here cancels a task."""
LOGS = ('distributed', 'distributed.client', 'asyncio', 'tornado.application')
"""What they would say of a failure is said in one sentence."""
Done = Tuple[Task, Optional[Result], str]
"""A task with its result, or with None and why it failed."""


def work_here(function: Callable[[Job, Task], Result], job: Job, tasks: Iterable[Task]) -> Iterator[Done]:
    """Do the tasks one by one in this process."""
    threads = cv2.getNumThreads()
    try:
        for task in tasks:
            try:
                result, why = function(job, task), ''
            except Exception as error:  # as from a worker: one bad task does not end the others
                result, why = None, _failed(error)
            yield task, result, why
    finally:
        cv2.setNumThreads(threads)


def _failed(error: BaseException) -> str:
    return ('%s: %s' % (type(error).__name__, ' '.join(str(error).split())[:200])).rstrip(': ')


def work_through(
    client: Any,
    function: Callable[[Job, Task], Result],
    job: Job,
    tasks: Iterable[Task],
) -> Iterator[Done]:
    """Let the workers do the tasks, a bounded number at a time.

    A task whose worker dies is given to another one, as often as Dask's allowed-failures says.
    """
    from distributed import as_completed

    waiting = iter(tasks)
    running: Dict[str, Task] = {}
    finished = as_completed(loop=client.loop)

    def submit() -> None:
        """As many as the workers of this moment can take: more may come and some may go."""
        with _scheduler_there(client):
            most = IN_FLIGHT * max(1, len(client.scheduler_info()['workers']))
        for task in itertools.islice(waiting, max(0, most - len(running))):
            if task.name not in running:
                running[task.name] = task
                with _scheduler_there(client):
                    finished.add(client.submit(function, job, task, key='evaluate-' + task.name, pure=False))

    submit()
    for future in finished:
        with _scheduler_there(client):
            task = running.pop(future.key[len('evaluate-') :])
            if future.cancelled():  # before it was done; result() raises when it is lost on its way
                raise concurrent.futures.CancelledError
            error = future.exception()
            result = None if error is not None else future.result()
            future.release()
        submit()
        yield task, result, '' if error is None else _failed(error)


@contextlib.contextmanager
def _scheduler_there(client: Any) -> Iterator[None]:
    """Raises ToolError when the scheduler is not to be reached any more."""
    try:
        yield
    except GONE as error:
        words = (client.scheduler.address, 'the same call goes on where it stopped')
        raise ToolError('the scheduler at %s is gone; %s' % words) from error


@contextlib.contextmanager
def workers_of(jobs: int, scheduler: str) -> Iterator[Any]:
    """Workers on the cores of this machine, or those of a scheduler by its address. Raises ToolError.

    Dask is imported here: it takes a second, and what needs no workers does not wait for it.
    """
    import dask
    from distributed import Client, LocalCluster

    for name in LOGS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        if scheduler:
            try:
                client = stack.enter_context(Client(scheduler, timeout=START_SECONDS, set_as_default=False))
                client.wait_for_workers(1, timeout=START_SECONDS)
            except (OSError, ValueError, asyncio.TimeoutError) as error:
                words = ' '.join(str(error).split())[:200] or type(error).__name__
                raise ToolError('no Dask scheduler with workers at %s: %s' % (scheduler, words)) from error
        else:
            stack.enter_context(_built_package_first())
            stack.enter_context(dask.config.set(_settings()))
            space = stack.enter_context(tempfile.TemporaryDirectory(prefix='evaluate_'))
            try:
                with _interrupts_later():
                    cluster = LocalCluster(
                        n_workers=jobs,
                        threads_per_worker=1,
                        processes=True,
                        host=HERE,
                        dashboard_address=HERE + ':0',  # None would open its port to the network, without a dashboard
                        worker_dashboard_address=HERE + ':0',
                        local_directory=space,
                        silence_logs=logging.CRITICAL,
                        death_timeout=START_SECONDS,
                    )
                    stack.enter_context(cluster)
                client = stack.enter_context(Client(cluster, set_as_default=False))
            except Exception as error:  # whatever ended a worker, as it came back from its process
                raise ToolError('workers cannot be started: %s' % _failed(error)) from error
        yield client


def _settings() -> Dict[str, Any]:
    """Dask's settings for workers that only work.

    No web pages. No profiler, which takes a tenth of their time. One thread each. Not Dask's limit for giving memory
    back, with which the system clears each picture's memory anew: a quarter of the time.
    """
    threads = {name + '_NUM_THREADS': 1 for name in ('OMP', 'MKL', 'OPENBLAS')}
    return {
        **{'distributed.%s.http.routes' % name: [] for name in PARTS},
        'distributed.worker.profile.interval': '1h',
        'distributed.worker.profile.cycle': '1h',
        'distributed.nanny.pre-spawn-environ': {**threads, 'DASK_LOGGING__DISTRIBUTED': 'critical'},
    }


@contextlib.contextmanager
def _interrupts_later() -> Iterator[None]:
    """Ctrl-C goes to all processes of a terminal: those that are started in here leave it to this one to end them.

    They never get it, because threads and processes inherit which signals are blocked. Here it is remembered. Raises
    KeyboardInterrupt at the end when it came.
    """
    resource_tracker.ensure_running()  # which the first process would start, and unblock the signal by the way
    came = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if came:
            raise KeyboardInterrupt


@contextlib.contextmanager
def _built_package_first() -> Iterator[None]:
    """Take the source folder out of the search path, which worker processes inherit.

    Catkin's package in the devel space puts it first when it is imported; a process that begins with it there finds
    only the half of the package that is no messages.
    """
    roots = {os.path.dirname(path) for path in obst_avoid.__path__} if len(obst_avoid.__path__) > 1 else set()
    source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
    before = list(sys.path)
    sys.path[:] = [path for path in before if not (path == source and source in roots)]
    try:
        yield
    finally:
        sys.path[:] = before
