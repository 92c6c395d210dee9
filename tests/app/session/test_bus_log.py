"""The process that records the buses says in the trail why there is no file, and why it ended."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path

import msgspec
import pytest

from app.ipc.links import OrderedReceiver, address, new_link_directory
from app.ipc.streams import AUDIT
from app.session import bus_log
from app.session.bus_log import run_bus_log
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.paths import Home
from hal.errors import CanFault
from logs.reason import Reason
from logs.records import Entry, Note, ProcessEnd
from profiles.schema import DEMO_PATIENT
from tests.support.bad_input import in_time
from tests.support.errors import refused

LIMIT_S = 60.0


def setup_of(home: Path, joints: JointsConfig) -> SessionSetup:
    """A session with these joints that this process runs."""
    return SessionSetup(
        session="s",
        home=home,
        links=new_link_directory(home),
        config=Config(joints=joints),
        profile=DEMO_PATIENT,
        operator="ann",
        host_pid=os.getpid(),
    )


def test_the_end_of_the_disk_is_left_to_the_trail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_log, "FLOOR_BYTES", 1 << 62)
    joints = JointsConfig(kind="can", interface="virtual", channel="bus log")
    with in_time(), refused(CanFault.LOG_DISK_LOW, path=bus_log.log_path(Home(tmp_path), "s")):
        bus_log._record(msgspec.structs.replace(setup_of(tmp_path, joints), host_pid=os.getppid()), [], print)


@pytest.mark.serial
@pytest.mark.parametrize("writable", [True, False])
def test_a_bus_that_is_not_there_is_waited_for_and_a_file_that_can_not_be_written_ends_it(
    tmp_path: Path, *, writable: bool
) -> None:
    setup = setup_of(tmp_path, JointsConfig(kind="can", interface="socketcan", channel="absent"))
    if not writable:
        bus_log.log_path(Home(tmp_path), "s").mkdir(parents=True)
    receiver = OrderedReceiver(address(setup.links, AUDIT.name), Entry)
    process = multiprocessing.get_context("spawn").Process(target=run_bus_log, args=(setup,), daemon=True)
    process.start()
    found: list[object] = []
    try:
        while not (found and isinstance(found[-1], ProcessEnd)):
            entry = receiver.receive(LIMIT_S)
            assert entry is not None
            found.append(entry.body)
            if writable and isinstance(entry.body, Note):
                process.terminate()
    finally:
        process.kill()
        process.join()
        receiver.close()
    _, note, end = found
    assert isinstance(note, Note)
    assert isinstance(end, ProcessEnd)
    assert isinstance(note.text, Reason)
    assert isinstance(end.reason, Reason)
    if writable:
        assert note.text.values["bus"] == "absent"
        assert (note.text.code, end.reason.code) == ("CanFault.LOG_PAUSED", "BusLogNotice.ASKED_TO_END")
    else:
        assert end.reason == note.text
        assert note.text.code == "BusLogNotice.NOT_RECORDED"
