"""The order in which the kernel would end a session's processes, as each of them has set it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from app.session.child import ENTRY_POINTS
from app.system.scheduling import SCORES

OWN = Path("/proc/self/oom_score_adj")
TELL = "from app.system.scheduling import set_oom_score_adj; set_oom_score_adj({!r}); print(open('/proc/self/oom_score_adj').read())"  # noqa: E501

pytestmark = [
    pytest.mark.serial,
    pytest.mark.skipif(not OWN.exists(), reason="no Linux: the kernel has no such order"),
]


def score_of(name: str) -> int:
    """What the kernel has for a process that began under this name."""
    done = subprocess.run([sys.executable, "-c", TELL.format(name)], capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_every_process_has_its_place() -> None:
    assert set(SCORES) == {"session", *ENTRY_POINTS}


@pytest.mark.parametrize("name", ["perception", "audit", "control"])
def test_each_takes_its_place(name: str) -> None:
    born = int(OWN.read_text(encoding="ascii"))
    place = score_of(name)
    assert place == SCORES[name] or (place == born > SCORES[name]), "only a lower place needs a privilege"


def test_what_can_be_started_again_goes_before_what_holds_the_legs() -> None:
    order = sorted(SCORES, key=SCORES.__getitem__, reverse=True)
    assert order[0] == "perception"
    assert set(order[-3:]) == {"control", "guardian", "session"}


def test_who_is_no_process_of_a_session_keeps_its_place() -> None:
    assert score_of("somebody") == int(OWN.read_text(encoding="ascii"))
