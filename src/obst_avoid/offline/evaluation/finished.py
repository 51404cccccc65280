"""What is finished, kept on disk, so that an interrupted evaluation goes on."""

import json
import os
import sqlite3
import zlib
from typing import Mapping, Optional

from obst_avoid.offline.evaluation.tasks import Result, Task
from obst_avoid.offline.tool import ToolError


def open_store(path: str, call: Mapping[str, str]) -> sqlite3.Connection:
    """The results of finished tasks, kept for this call alone. call: what the results depend on, by its name.

    Raises ToolError in one sentence when the file holds another call's results, or is none of ours.
    """
    store = sqlite3.connect(path)
    try:
        store.executescript(
            'PRAGMA synchronous = NORMAL;'
            'CREATE TABLE IF NOT EXISTS call (name TEXT PRIMARY KEY, value TEXT);'
            'CREATE TABLE IF NOT EXISTS finished (task TEXT PRIMARY KEY, result BLOB);'
        )
        before = dict(store.execute('SELECT name, value FROM call'))
        if not before:
            store.executemany('INSERT INTO call VALUES (?, ?)', sorted(call.items()))
            store.commit()
    except sqlite3.Error as error:
        raise ToolError('%s cannot be used: %s' % (path, error)) from error
    differing = sorted(name for name in {*before, *call} if before.get(name) != call.get(name))
    if before and differing:
        words = ', '.join(differing)
        raise ToolError('%s holds an evaluation with other %s, expected a new folder' % (os.path.dirname(path), words))
    return store


def finished_count(store: sqlite3.Connection) -> int:
    """How many tasks are finished."""
    return int(store.execute('SELECT count(*) FROM finished').fetchone()[0])


def finished_result(store: sqlite3.Connection, task: Task) -> Optional[Result]:
    """The result of a task from an earlier call."""
    row = store.execute('SELECT result FROM finished WHERE task = ?', (task.name,)).fetchone()
    return None if row is None else json.loads(zlib.decompress(row[0]))


def store_result(store: sqlite3.Connection, task: Task, result: Result) -> None:
    """Keep a result at once: what is stored survives an interruption."""
    blob = zlib.compress(json.dumps(result).encode(), 1)
    store.execute('INSERT OR REPLACE INTO finished VALUES (?, ?)', (task.name, blob))
    store.commit()
