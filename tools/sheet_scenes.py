"""The scenes of `tools/screen_sheets.py`: a host that stands still, what it says, a home with sessions behind it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

import msgspec

from app.console.session_index import Records, SessionRecord
from app.evaluate.outcomes.walks import RecordedWalk, Walk
from app.ipc.messages import HandCommand, PerceptionCommand, TriggerReport
from app.ipc.snapshot import ActionReport, ControlSnapshot, JointSnapshot
from app.ipc.states import Action, Effect, Event, GaitState, Outcome, Source
from app.motion.plan import patient_of
from app.perception.reporting import Image, PreviewPacer
from app.session.latest import Latest
from app.system.config import SessionSetup
from app.system.paths import Home
from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import keypoints_m, person_of, posed, render
from hal.joints.device import load_exoskeleton
from kgdfa.draw import draw_bones
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand, Side
from profiles.schema import DEMO_PATIENT, GaitParameters
from profiles.store import ProfileStore
from testing.authors import Named
from testing.fake_host import FakeHost
from testing.messages import event
from testing.trails import write_sample

NOW_NS = 1_795_000_000_000_000_000
BEGAN = datetime(2026, 11, 1, 9, 30, tzinfo=UTC)
TICK_NS = 150_000_000
BEFORE_TICKS = 40
STEP_S = 10.0
ANGLES_RAD = (0.38, 0.31, -0.19, 0.52)  # of a walk in mid-swing


class StillHost(FakeHost):
    """Six seconds of a push, then always the same moment; the hand that a key chose, as wide as the screen asks."""

    def __init__(self, setup: SessionSetup) -> None:
        self.now_ns = NOW_NS - BEFORE_TICKS * TICK_NS
        super().__init__(setup, lambda: self.now_ns)
        self._pacer = PreviewPacer()
        self._take_picture()

    def poll(self) -> Latest:
        """One tick later, until the moment has come."""
        self.now_ns = min(NOW_NS, self.now_ns + TICK_NS)
        return super().poll()

    def again(self) -> None:
        """Live through the time before the moment once more."""
        self.now_ns = NOW_NS - BEFORE_TICKS * TICK_NS

    def _before_s(self) -> float:
        return (NOW_NS - self.now_ns) / 1e9

    def _report(self, now_ns: int) -> TriggerReport:
        """A push three seconds ago."""
        near = math.exp(-(((self._before_s() - 3.0) / 0.6) ** 2))
        distance_m = 0.36 - 0.19 * near
        values = {"distance_m": distance_m, "safe_distance_m": distance_m + 0.02}
        sequence = self.now_ns // TICK_NS
        return msgspec.structs.replace(super()._report(now_ns), sequence=sequence, pressed=near > 0.9, **values)

    def _snapshot(self, now_ns: int) -> ControlSnapshot:
        """Joints on their way, while an action runs."""
        found = super()._snapshot(now_ns)
        if found.action is None:
            return found
        progress = max(0.0, found.progress - self._before_s() / STEP_S)
        swing = math.cos(math.pi * (found.progress - progress))
        joints = tuple(
            msgspec.structs.replace(
                joint,
                angle_rad=joint.angle_rad * swing,
                target_rad=joint.angle_rad * swing + 0.02 * math.sin(9 * swing),
            )
            for joint in found.joints
        )
        return msgspec.structs.replace(found, progress=progress, joints=joints)

    @property
    def at_rest(self) -> bool:
        """The moment has come."""
        return self.now_ns == NOW_NS

    def send_to_perception(self, command: HandCommand | PerceptionCommand) -> None:
        super().send_to_perception(command)
        if isinstance(command, PerceptionCommand):
            self._pacer.configure(command)
        self._take_picture()

    def _take_picture(self) -> None:
        image, draw = hand_image(self.gesture)
        self.picture = self._pacer.message(image, NOW_NS, draw if self.gesture else None)


def hand_image(gesture: Gesture | None) -> tuple[Image, Callable[[Image, float], None]]:
    """The digital hand, and what draws its bones on it."""
    scene = posed(gesture.value if gesture else "rest", person=person_of(7, left=False), position_m=(0.0, 0.02, 0.32))
    world_m = keypoints_m(scene)
    assert world_m is not None
    hand = Hand(image_px=project_px(world_m, scene.lens), world_m=world_m, presence=1.0, side=Side.RIGHT)
    return render(scene, 7).image_bgr, lambda image, scale: draw_bones(image, hand, scale)


def walking(host: FakeHost) -> None:
    """In the middle of a walk."""
    joints = tuple(
        JointSnapshot(
            angle_rad=angle, target_rad=angle + 0.02, speed_rad_s=0.4, torque_nm=9.0, temperature_c=34.0, age_ms=2.0
        )
        for angle in ANGLES_RAD
    )
    report = ActionReport(
        number=2,
        action=Action.WALK,
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        outcome=Outcome.RUNNING,
        first_motion_ns=NOW_NS - 4_000_000_000,
    )
    host.state, host.pressed = GaitState.LEFT_FORWARD, False
    host.walked = {
        "action": Action.WALK,
        "progress": 0.55,
        "allowed": (Action.WALK_END,),
        "joints": joints,
        "steps": 34,
        "distance_walked_m": 9.2,
        "reports": (report,),
    }


def stopped(host: FakeHost) -> None:
    """STOP in the middle of that walk."""
    walking(host)
    report = msgspec.structs.replace(host.walked["reports"][0], outcome=Outcome.STOPPED, ended_ns=NOW_NS - 850_000_000)
    host.state, host.effect = GaitState.BETWEEN, Effect.HOLD
    host.events = (event(Event.STOP, Effect.HOLD, NOW_NS - 1_000_000_000),)
    times = {"stop_received_ns": NOW_NS - 1_000_000_000, "stop_command_ns": NOW_NS - 996_000_000}
    host.walked |= {"action": None, "allowed": (), "reports": (report,), **times}


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """keys lead to the screen from a session (live) or from the list; shows: text that says it is there."""

    keys: tuple[str, ...] = ()
    live: bool = False
    shows: str = ""
    arrange: Callable[[FakeHost], None] | None = None  # what control says, once the keys are pressed
    joints: Literal["simulated", "can"] = "simulated"
    plays: bool = False  # shows what has just been: lived through again in each language
    review: bool = False  # of the newest session
    then: tuple[str, ...] = ()  # keys after `shows`


READY = ("c", "y", "a", "t", "0", "5")
SCENES = {
    "patients": Scene(),
    "form": Scene(keys=("e",)),
    "new-patient": Scene(keys=("n",), shows="New patient"),
    "history": Scene(keys=("h",)),
    "outcomes": Scene(keys=("down", "down", "m"), shows="sessions, "),
    "start": Scene(keys=("enter",)),
    "sign-in": Scene(keys=("enter", "ctrl+s"), joints="can"),
    "training": Scene(keys=("t", "5"), plays=True),
    "vocabulary": Scene(keys=("g", "0")),
    "review": Scene(review=True, shows="checked", then=("n", "n", "n")),
    "replay": Scene(review=True, shows="checked", then=("r", "pageup", "pageup")),
    "session-begins": Scene(live=True),
    "checks": Scene(live=True, keys=("s",)),
    "confirm": Scene(live=True, keys=("c",)),
    "session-ready": Scene(live=True, keys=READY, plays=True),
    "actions": Scene(live=True, keys=(*READY, "t")),
    "session-walk": Scene(live=True, keys=READY, arrange=walking, plays=True),
    "stopped": Scene(live=True, keys=READY, arrange=stopped, plays=True),
    "large": Scene(live=True, keys=(*READY, "b"), arrange=walking),
    "health": Scene(live=True, keys=(*READY, "i")),
    "guided": Scene(live=True, keys=(*READY, "g")),
    "guided-test": Scene(live=True, keys=(*READY, "g", "1"), arrange=walking),
    "compare": Scene(live=True, keys=(*READY, "v")),
    "help": Scene(live=True, keys=("f1",)),
    "palette": Scene(live=True, keys=("ctrl+p",)),
    "locked": Scene(live=True, keys=("ctrl+l",)),
    "after": Scene(live=True, keys=(*READY, "e", "y"), shows="After"),
}


def furnish(home: Home) -> None:
    """Three patients; two with sessions behind them, the demo patient's recorded."""
    device = load_exoskeleton()
    for number, length_m in enumerate((0.24, 0.30, 0.36), start=1):
        gait = GaitParameters(step_time_s=1.6, step_length_m=length_m)
        profile = msgspec.structs.replace(DEMO_PATIENT, gait=gait)
        parameters = {name: value for name, value in msgspec.to_builtins(profile).items() if name != "identifier"}
        trail = write_sample(home.root, minutes=3, seed=number, patient="demo", parameters=parameters)
        RecordedWalk(patient_of(profile, device), device, trail.with_suffix(".mcap")).perform(Walk(strides=2))
    store, sessions = ProfileStore(home.profiles), Records(home.root / "sessions", SessionRecord)
    for identifier, stature_m, mass_kg, note in (
        ("P-017", 1.58, 61.0, "spastic left leg; pause after ten steps"),
        ("P-023", 1.81, 84.0, ""),
    ):
        body = {"identifier": identifier, "stature_m": stature_m, "mass_kg": mass_kg, "note": note}
        store.create(msgspec.structs.replace(DEMO_PATIENT, **body), by=Named("therapist"), at=BEGAN)
    for patient, count in (("demo", 6), ("P-017", 4)):
        for number in range(count):
            sessions.add(_session(patient, number))


def _session(patient: str, number: int) -> SessionRecord:
    """One more step each time, so that a trend is seen."""
    return SessionRecord(
        session=f"S-{number}",
        patient=patient,
        at=(BEGAN + timedelta(days=3 * number)).isoformat(timespec="seconds"),
        operator="therapist",
        steps=60 + 14 * number,
        distance_m=17.0 + 4.1 * number,
        duration_s=620.0 + 35 * number,
        refusals=max(0, 5 - number),
        discomfort=2,
        pain=1,
        exertion=max(9, 13 - number),
        note="slower on the left, no pain" if number == 3 else "",
    )
