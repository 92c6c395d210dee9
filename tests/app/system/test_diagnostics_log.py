"""The engineers' log: who wrote each line, tracebacks, levels, and that a flood stays in a few files."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.system import diagnostics_log
from app.system.diagnostics_log import LEVEL_VARIABLE, get_logger, set_verbose, start_log, stop_log
from app.system.paths import Home


@pytest.fixture(autouse=True)
def _closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv(LEVEL_VARIABLE, "INFO")
    yield
    stop_log()


def lines(home: Home, process: str = "control") -> list[dict[str, Any]]:
    stop_log()
    text = (home.root / "diagnostics" / f"{process}.log").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def test_each_line_names_process_session_and_patient(tmp_path: Path) -> None:
    log = get_logger("host")
    log.error("before any file: dropped")
    start_log(Home(tmp_path), "control", session="s-1", patient="p-7")
    log.warning("perception restarts", restarts=2)
    (line,) = lines(Home(tmp_path))
    assert line.items() >= {"process": "control", "session": "s-1", "patient": "p-7", "restarts": 2}.items()
    assert (line["event"], line["level"], line["logger"]) == ("perception restarts", "warning", "rleex.host")


def test_an_exception_brings_its_traceback_and_plain_logging_its_values(tmp_path: Path) -> None:
    start_log(Home(tmp_path), "control")
    try:
        raise ValueError("odd")  # noqa: TRY301
    except ValueError:
        get_logger("process").exception("process ended by an exception")
    logging.getLogger("rleex.links").warning("message rejected", extra={"link": "ipc://x"})
    failed, rejected = lines(Home(tmp_path))
    assert "ValueError: odd" in failed["exception"]
    assert (rejected["link"], rejected["process"]) == ("ipc://x", "control")


def test_debug_lines_come_with_verbose_only(tmp_path: Path) -> None:
    for number in range(2):
        start_log(Home(tmp_path), "control")
        get_logger("x").debug("detail", number=number)
        stop_log()
        set_verbose()
    assert [line["number"] for line in lines(Home(tmp_path))] == [1]


@pytest.mark.parametrize(("named", "shown"), [("debug", 2), ("Warning", 0), ("nonsense", 1), ("", 1)])
def test_the_level_is_named_in_any_case_and_a_wrong_name_is_the_usual_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str, shown: int
) -> None:
    monkeypatch.setenv(LEVEL_VARIABLE, named)
    start_log(Home(tmp_path), "control")
    get_logger("x").debug("detail")
    get_logger("x").info("line")
    assert len(lines(Home(tmp_path))) == shown


def test_files_are_rotated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnostics_log, "MAX_BYTES", 2_000)
    start_log(Home(tmp_path), "control")
    for number in range(200):
        get_logger("x").info("line", number=number)
    assert lines(Home(tmp_path))[-1]["number"] == 199
    assert len(list((tmp_path / "diagnostics").iterdir())) == 1 + diagnostics_log.BACKUPS


def test_a_home_that_can_not_be_written_drops_the_lines(tmp_path: Path) -> None:
    (tmp_path / "diagnostics").write_text("in the way")
    start_log(Home(tmp_path), "control")
    get_logger("x").error("dropped")
