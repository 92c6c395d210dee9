"""The rehearsals before real joints, in a process of their own: half a minute of physics must not delay a key."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from app.ipc.states import Action
from app.system.config import Config
from app.system.paths import Home
from profiles.schema import Profile

# What comes through the pipe: an action that begins; at the end the reasons why actions failed, or an error's words.
Word = Action | tuple[str, ...] | str


def rehearse_all(words: Connection, home: Path, config: Config, profile: Profile, actions: Sequence[Action]) -> None:
    """Rehearse what is not on record yet, keep the verdicts, tell of each."""
    from app.motion.patient import patient_of
    from app.motion.preflight import cleared_actions, run_preflight
    from app.system.scheduling import set_scheduling
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    set_scheduling("rehearsal")
    place = Home(home)
    device = load_exoskeleton(Path(config.joints.device) if config.joints.device else DEFAULT_DEVICE)
    patient = patient_of(profile, device)
    done = cleared_actions(place, patient, device)
    wanted = [action for action in actions if action not in done]
    try:
        results = run_preflight(place, patient, device, wanted, watch=words.send)
    except OSError as error:
        words.send(f"The rehearsals can't be kept in {home}: {error.strerror}; free space, then rehearse again.")
        return
    words.send(tuple(result.reason for result in results if not result.passed))
