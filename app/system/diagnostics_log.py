"""The engineers' log: one rotating file a process in the home's `diagnostics` folder, a JSON object a line.

Records pass a queue to a thread that writes them, so that a rare record inside a tick costs no disk access. The
levels are logging's; the environment variable RLEEX_LOG_LEVEL (`rleex run --verbose` sets it) reaches every process.
It holds no patient data but the pseudonym, and replaces nothing in the audit trail.

The standard library's alone: importing structlog costs each of a session's processes a fifth of a second and 14 MB, and
only the trail's own process needs it.
"""

from __future__ import annotations

import atexit
import logging
import os
import queue
from collections.abc import Mapping, MutableMapping
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from typing import Any

import msgspec

from app.system.paths import Home

LEVEL_VARIABLE = "RLEEX_LOG_LEVEL"
MAX_BYTES = 1_000_000
BACKUPS = 3

_ROOT = logging.getLogger("rleex")
_ROOT.addHandler(logging.NullHandler())
_ROOT.propagate = False  # nothing reaches the terminal, where the screen is

_PLAIN = frozenset(vars(logging.makeLogRecord({})))  # what every record has; all else came with `extra`


class _Running:
    listener: QueueListener | None = None


class _Handover(QueueHandler):
    """Hands records over as they are; the thread that writes formats them."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record


class Logger(logging.LoggerAdapter[logging.Logger]):
    """Takes an event's values by name: `log.info("process spawned", child="control")`."""

    def process(self, msg: Any, kwargs: MutableMapping[str, Any]) -> tuple[Any, MutableMapping[str, Any]]:
        exc_info = kwargs.pop("exc_info", None)
        return msg, {"extra": dict(kwargs), "exc_info": exc_info}

    def log(self, level: int, msg: object, *args: object, **values: Any) -> None:
        """One line; dropped records cost one comparison of levels."""
        if self.isEnabledFor(level):
            text, keywords = self.process(msg, values)
            self.logger.log(level, text, *args, **keywords)


def get_logger(name: str) -> Logger:
    """A logger below `rleex`."""
    return Logger(_ROOT.getChild(name), {})


def set_verbose() -> None:
    """Debug level, in this process's log when it starts and in those of the processes it starts."""
    os.environ[LEVEL_VARIABLE] = "DEBUG"


def start_log(home: Home, process: str, **context: str) -> None:
    """Write this process's records to its file, each with the context (session, patient); drops them without a disk."""
    stop_log()
    folder = home.root / "diagnostics"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        file = RotatingFileHandler(folder / f"{process}.log", maxBytes=MAX_BYTES, backupCount=BACKUPS, encoding="utf-8")
    except OSError:
        return
    bound = {"process": process, "pid": os.getpid(), **{name: value for name, value in context.items() if value}}
    file.setFormatter(_JsonFormatter(bound))
    records: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    _Running.listener = QueueListener(records, file)
    _Running.listener.start()
    _ROOT.handlers = [_Handover(records)]
    named = os.environ.get(LEVEL_VARIABLE, "").upper()
    _ROOT.setLevel(logging.getLevelNamesMapping().get(named, logging.INFO))


def stop_log() -> None:
    """Write what is queued and close the file; no change when none is open."""
    listener, _Running.listener = _Running.listener, None
    if listener is not None:
        _ROOT.handlers = [logging.NullHandler()]
        listener.stop()
        for handler in listener.handlers:
            handler.close()


class _JsonFormatter(logging.Formatter):
    """A JSON object a line: the event with its values, and what is bound to this process."""

    def __init__(self, bound: Mapping[str, object]) -> None:
        super().__init__()
        self._bound = bound

    def format(self, record: logging.LogRecord) -> str:
        values: dict[str, object] = {name: value for name, value in vars(record).items() if name not in _PLAIN}
        values |= {
            "event": record.getMessage(),
            "level": record.levelname.lower(),
            "timestamp": datetime.fromtimestamp(record.created, UTC).isoformat(),
            "logger": record.name,
            **self._bound,
        }
        if record.exc_info:
            values["exception"] = self.formatException(record.exc_info)
        return msgspec.json.encode(values, enc_hook=str).decode()


atexit.register(stop_log)


def discard_output() -> None:
    """Of a process on the console's terminal: libraries write there, those in C++ past Python's streams."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
