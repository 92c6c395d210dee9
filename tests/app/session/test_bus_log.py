"""The process that records the buses says in the trail why there is no file, and why it ended."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path

import pytest

from app.ipc.links import OrderedReceiver, address, new_link_directory
from app.ipc.streams import AUDIT
from app.session.bus_log import run_bus_log
from app.system.config import Config, JointsConfig, SessionSetup
from logs.reason import Reason
from logs.records import Entry, Note, ProcessEnd
from profiles.schema import DEMO_PATIENT

pytestmark = pytest.mark.serial

LIMIT_S = 60.0


def test_a_bus_that_can_not_be_opened_is_the_reason_of_its_end(tmp_path: Path) -> None:
    setup = SessionSetup(
        session="s",
        home=tmp_path,
        links=new_link_directory(tmp_path),
        config=Config(joints=JointsConfig(kind="can", interface="socketcan", channel="absent")),
        profile=DEMO_PATIENT,
        operator="ann",
        host_pid=os.getpid(),
    )
    receiver = OrderedReceiver(address(setup.links, AUDIT.name), Entry)
    process = multiprocessing.get_context("spawn").Process(target=run_bus_log, args=(setup,), daemon=True)
    process.start()
    found: list[object] = []
    try:
        while not (found and isinstance(found[-1], ProcessEnd)):
            entry = receiver.receive(LIMIT_S)
            assert entry is not None
            found.append(entry.body)
    finally:
        process.kill()
        process.join()
        receiver.close()
    _, note, end = found
    assert isinstance(note, Note)
    assert isinstance(end, ProcessEnd)
    assert isinstance(note.text, Reason)
    assert note.text.code == "BusLogNotice.NOT_RECORDED"
    assert end.reason == note.text
