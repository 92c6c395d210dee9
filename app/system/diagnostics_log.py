"""The engineers' log: one rotating file a process in the home's `diagnostics` folder, a JSON object a line.

Records pass a queue to a thread that writes them, so that a rare record inside a tick costs no disk access. The
levels are logging's; the environment variable RLEEX_LOG_LEVEL (`rleex run --verbose` sets it) reaches every process.
It holds no patient data but the pseudonym, and replaces nothing in the audit trail.
"""

from __future__ import annotations

import atexit
import logging
import os
import queue
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler

import structlog
from structlog.stdlib import BoundLogger, ProcessorFormatter
from structlog.typing import EventDict, Processor, WrappedLogger

from app.system.paths import Home

LEVEL_VARIABLE = "RLEEX_LOG_LEVEL"
MAX_BYTES = 1_000_000
BACKUPS = 3

_ROOT = logging.getLogger("rleex")
_ROOT.addHandler(logging.NullHandler())
_ROOT.propagate = False  # nothing reaches the terminal, where the screen is

_SHARED: tuple[Processor, ...] = (
    structlog.stdlib.add_log_level,
    structlog.processors.TimeStamper(fmt="iso", utc=True),
)


class _Running:
    listener: QueueListener | None = None


class _Handover(QueueHandler):
    """Hands records over as they are; the thread that writes formats them."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record


def get_logger(name: str) -> BoundLogger:
    """A logger below `rleex`; dropped records cost one comparison of levels."""
    logger: BoundLogger = structlog.wrap_logger(
        _ROOT.getChild(name),
        processors=[
            structlog.stdlib.filter_by_level,
            *_SHARED,
            structlog.processors.format_exc_info,
            ProcessorFormatter.wrap_for_formatter,
        ],
        wrapper_class=BoundLogger,
    )
    return logger


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
    file.setFormatter(
        ProcessorFormatter(
            foreign_pre_chain=[*_SHARED, structlog.stdlib.ExtraAdder()],
            processors=[
                structlog.stdlib.add_logger_name,
                _adding(bound),
                ProcessorFormatter.remove_processors_meta,
                structlog.processors.JSONRenderer(default=str),
            ],
        )
    )
    records: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    _Running.listener = QueueListener(records, file)
    _Running.listener.start()
    _ROOT.handlers = [_Handover(records)]
    _ROOT.setLevel(os.environ.get(LEVEL_VARIABLE, "INFO"))


def stop_log() -> None:
    """Write what is queued and close the file; no change when none is open."""
    listener, _Running.listener = _Running.listener, None
    if listener is not None:
        _ROOT.handlers = [logging.NullHandler()]
        listener.stop()
        for handler in listener.handlers:
            handler.close()


def _adding(bound: dict[str, object]) -> Processor:
    def add(_logger: WrappedLogger, _method: str, event: EventDict) -> EventDict:
        event.update(bound)
        return event

    return add


atexit.register(stop_log)
