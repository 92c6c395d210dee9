"""The paper's tables 3 to 7, each made by its own command of `rleex evaluate` and kept with how it was made.

A folder holds `table-3.json` and `table-3.run.json`, and so on, each as soon as it is made: an interrupted run goes on
with the next table. A table is made again where its command, the list of its data or the program is another now. Table
7 takes hours; a file such as `table-7.kept-1-3.jsonl` holds the sessions of its hands, and it goes on from these, also
after it gave up.
"""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from hashlib import sha256
from os.path import realpath
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from app.evaluate.harness import EvaluateFault, write_whole, writing
from app.system.errors import AppError
from app.system.files import partial_file
from app.system.program import PROGRAM, ROOT, VERSION, program_identity
from logs.reading.regular import read_text

Content = TypeVar("Content")
DIGITAL_HANDS = 10  # a pose, where there are no photos
EVALUATE = (sys.executable, "-c", "from app.cli import main; main()", "evaluate")
ENDING_S = 10.0  # within which an interrupted command has ended the processes of its own
INTERRUPTED = 130  # exit status of a command that the operator ended


@dataclass(frozen=True, slots=True)
class Job:
    """A table, and the arguments of `rleex evaluate` that make it.

    kept: the hands whose sessions it keeps, each with its program. data: the file that lists what it is made of.
    """

    table: int
    arguments: tuple[str, ...]
    kept: str = ""
    data: Path | None = None

    @property
    def command(self) -> str:
        """As a person would type it."""
        return shlex.join(("rleex", "evaluate", *self.arguments))


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """How a table was made. program: SHA-256 of the program's files; data: of the list of its data, and where that is.

    – in the place of what is not known of it: sessions of table 7 may be kept from another version, or from several.
    """

    command: str
    date: str
    version: str
    program: str
    commit: str
    machine: str
    status: int
    took_s: float = 0.0  # the last of its runs, where it was interrupted
    data: str = ""


def jobs(data: Path | None, *, attempts: int, hands: str, changes: int, onnx: Sequence[Path]) -> tuple[Job, ...]:
    """The five tables. data: a folder with `gestures` and `distance`; None: digital hands everywhere."""
    photos = ("--digital", str(DIGITAL_HANDS)) if data is None else (str(data / "gestures"),)
    frames = () if data is None else (str(data / "distance"),)
    listed = (None, None) if data is None else (data / "gestures" / "labels.csv", data / "distance" / "frames.csv")
    others = tuple(part for path in onnx for part in ("--onnx", str(path)))
    return (
        Job(3, ("gestures", *photos), data=listed[0]),
        Job(4, ("speed", *frames, "--workers", "0", *others), data=listed[1]),
        Job(5, ("distance",)),
        Job(6, ("trigger", "--changes", str(changes))),
        Job(7, ("response", "--trials", str(attempts), "--seeds", hands), kept=hands.replace(" ", "")),
    )


def make(job: Job, out: Path, options: Sequence[str] = (), program: Sequence[str] = EVALUATE) -> None:
    """Make the table unless it was made so before, by a process of its own; older figures stay until it is made.

    options: of every command, such as where data are stored. program: what is given the job's arguments.

    Raises KeyboardInterrupt when its command was interrupted, AppError when it left no figures.
    """
    figures, kept = figures_file(out, job.table), run_file(out, job.table)
    if made_before(job, out) is not None:
        return
    keep = ("--keep", str(out / f"table-{job.table}.kept-{job.kept}.jsonl")) if job.kept else ()
    began_s = time.monotonic()
    with partial_file(figures) as partial:
        command = [*program, *job.arguments, *keep, "--json", str(partial), *options]
        data = _data_of(job)
        status = _status_of(command)
        if status == INTERRUPTED:
            raise KeyboardInterrupt
        if not partial.is_file():
            raise AppError(EvaluateFault.TABLE_NOT_MADE, table=job.table, command=job.command, status=status)
        run = _run(job, status, time.monotonic() - began_s, read_as(partial, _Kept).programs, data)
        with writing(figures):
            partial.replace(figures)
    write_whole(kept, msgspec.json.encode(run))


def _status_of(command: Sequence[str]) -> int:
    """Of the command's end. Interrupted with it by Ctrl-C, it ends by itself; else it is told."""
    with subprocess.Popen(command) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            with suppress(subprocess.TimeoutExpired):
                process.wait(ENDING_S)
            process.terminate()
            process.wait()
            raise


def made_before(job: Job, out: Path) -> Run | None:
    """How the table was made, if it is there, whole, by this command, of the same data and by this program.

    What can't be read, or gave up, is made again. Kept sessions may be of other programs: the page names them.
    """
    try:
        gave_up = read_as(figures_file(out, job.table), dict[str, Any]).get("gave_up")
        run = read_as(run_file(out, job.table), Run)
    except AppError:
        return None
    same = run.command == job.command and run.data == _data_of(job)
    same_program = bool(job.kept) or run.program == program_identity()[PROGRAM]
    return run if same and same_program and not gave_up else None


def _data_of(job: Job) -> str:
    """SHA-256 of the list of its data, and where that is; '' without one, or of one that its command refuses."""
    if job.data is None:
        return ""
    try:
        return sha256(f"{realpath(job.data)}\0{read_text(job.data)}".encode()).hexdigest()
    except OSError:
        return ""


class _Kept(msgspec.Struct, frozen=True):
    """What figures say of the programs that made them; () of those that keep nothing."""

    programs: tuple[str, ...] = ()


def _run(job: Job, status: int, took_s: float, programs: tuple[str, ...], data: str) -> Run:
    present = program_identity()
    programs = programs or (present[PROGRAM],)
    is_present = programs == (present[PROGRAM],)
    return Run(
        command=job.command,
        date=datetime.now().astimezone().isoformat(timespec="minutes"),
        version=present[VERSION] if is_present else "–",
        program=programs[0] if len(programs) == 1 else "–",
        commit=_commit() if is_present else "–",
        machine=f"{_processor()} ({len(os.sched_getaffinity(0))}), {platform.system()} {platform.release()}",
        status=status,
        took_s=took_s,
        data=data,
    )


def _commit() -> str:
    """Where the program runs from a checkout; '' elsewhere, and without git."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        return ""


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def figures_file(out: Path, table: int) -> Path:
    """Where a table's figures are."""
    return out / f"table-{table}.json"


def run_file(out: Path, table: int) -> Path:
    """Where it says how they were made."""
    return out / f"table-{table}.run.json"


def read_as(path: Path, wanted: type[Content]) -> Content:
    """A kept file. Raises AppError when it can't be read as that."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=wanted)
    except (OSError, msgspec.MsgspecError) as error:
        raise AppError(EvaluateFault.FILE_UNREADABLE, file=path, detail=str(error)) from error
