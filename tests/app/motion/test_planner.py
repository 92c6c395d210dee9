"""The planner process answers over its links, and ends when its parent does."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path

import pytest

from app.ipc.links import OrderedReceiver, OrderedSender, address, new_link_directory
from app.ipc.states import Action, GaitState
from app.ipc.streams import PLAN_REPLY, PLAN_REQUEST
from app.motion.plan import Phase, Plan, PlanRequest, decode_table
from app.motion.planner import run_planner
from app.system.config import Config, SessionSetup
from app.system.scheduling import lock_touched_memory
from profiles.schema import DEMO_PATIENT

pytestmark = pytest.mark.serial

LIMIT_S = 60.0


def setup_of(home: Path, host_pid: int) -> SessionSetup:
    return SessionSetup(
        session="s",
        home=home,
        links=new_link_directory(home),
        config=Config(),
        profile=DEMO_PATIENT,
        operator="tester",
        host_pid=host_pid,
    )


def locked_kb(process: int) -> int:
    (line,) = [one for one in Path(f"/proc/{process}/status").read_text().splitlines() if one.startswith("VmLck")]
    return int(line.split()[1])


def test_requests_are_answered_in_order(tmp_path: Path) -> None:
    setup = setup_of(tmp_path, os.getpid())
    links = setup.links
    replies = OrderedReceiver(address(links, PLAN_REPLY.name), Plan, dec_hook=decode_table)
    planner = multiprocessing.get_context("spawn").Process(target=run_planner, args=(setup,), daemon=True)
    planner.start()
    requests = OrderedSender(address(links, PLAN_REQUEST.name))
    try:
        for number in (1, 2):
            request = PlanRequest(
                number=number,
                action=Action.INITIALISE,
                phase=Phase.WHOLE,
                from_state=GaitState.UNPOWERED,
                start_rad=(0.1, 0.2, 0.1, 0.2),
            )
            assert requests.send(request)
        answers = [replies.receive(LIMIT_S), replies.receive(LIMIT_S)]
        assert planner.pid is not None
        locked = locked_kb(planner.pid)
    finally:
        planner.kill()
        planner.join()
        requests.close()
        replies.close()
    plans = [answer for answer in answers if answer is not None]
    assert [plan.number for plan in plans] == [1, 2]
    with multiprocessing.get_context("spawn").Pool(1) as another:
        allowed = another.apply(lock_touched_memory)
    assert (locked > 0) == allowed, "locked where another process may lock, too"
    assert all(plan.check.ok and plan.to_state is GaitState.STANDING for plan in plans)


def test_it_ends_when_its_host_was_gone_before_its_first_look(tmp_path: Path) -> None:
    setup = setup_of(tmp_path, os.getppid())  # whose child this process is, not the planner
    planner = multiprocessing.get_context("spawn").Process(target=run_planner, args=(setup,), daemon=True)
    planner.start()
    try:
        planner.join(LIMIT_S)
        assert planner.exitcode == 0
    finally:
        planner.kill()
