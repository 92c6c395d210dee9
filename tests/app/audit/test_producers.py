"""Every field of every record has a producer: real processes and the product's own code fill each at least once."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from msgspec import structs
from textual.widgets import Select
from typer.testing import CliRunner

from app.audit import process as audit_process
from app.audit.sink import other_trail
from app.cli import cli
from app.console.operator import ConsoleTrail
from app.console.review_data import comments_on, open_session, write_comment
from app.console.screens.after import AfterScreen
from app.console.screens.calibration import calibration_record
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.control.loop import drives_record, lateness_record, limits_record
from app.control.telemetry import Histogram, JointStatisticsCollector
from app.demo.drives import emulated_drives
from app.ipc.links import new_link_directory
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import GaitState
from app.perception.comparison import Comparison, comparison_record
from app.perception.frames import FrameBatch, button_record
from app.perception.look import CameraSample
from app.perception.pipeline import camera_records, make_camera
from app.perception.reporting import MeasuredRate, records_between
from app.recording.schemas import CONTACT, TOPICS, FootContact
from app.recording.writer import RecordingWriter, file_record
from app.system.config import CameraConfig, Config, JointsConfig, SessionSetup
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home, pictures_path
from app.system.vocabulary import enrolment_record
from hal.errors import DrivesFault, HardwareError, StopInputFault
from hal.joints.guard import Quantity, Refusal
from hal.joints.protocol import TICK_NS, Joint
from kgdfa.button_state import ButtonMode, ButtonPlace, ButtonState, PressCancel, PressHint
from kgdfa.distance import DistanceChoice, DistanceSource
from kgdfa.gesture import Explanation, Gesture
from kgdfa.recognition import FrameReading
from kgdfa.vocabulary import VocabularyFault
from logs.comments import comments_path
from logs.disk import Disk
from logs.journal import CHANGES, Moment
from logs.keys import load_or_make_key
from logs.manifest import manifest_paths
from logs.mirror import CheckpointCopy
from logs.read import records, session_paths
from logs.records import Body, Note, SessionStart
from logs.verify import Evidence
from logs.writer import SessionWriter
from profiles.palm import Calibrated, reference_segment
from profiles.schema import DEMO_PATIENT, Calibration
from testing.authors import signed_in
from testing.fake_host import walk_steps
from testing.session import RealSession
from tests.app.console.conftest import Console, Opener
from tests.app.console.conftest import console as console  # noqa: PLC0414 - the fixture
from tests.app.console.conftest import home as home  # noqa: PLC0414 - the fixture
from tests.app.control.causes import with_switch
from tests.app.control.moments import A, K, S, moving, resting, standing
from tests.app.control.rig import SETTINGS, Rig
from tests.app.perception.test_reporting import REPORT, SCALE, compared
from tests.app.system.test_vocabulary_status import ENROLLED

pytestmark = [pytest.mark.serial, pytest.mark.xdist_group("perception")]

KINDS: tuple[type[Body], ...] = Body.__args__
PIN = "481516"


def filled(bodies: Iterable[Body]) -> set[tuple[str, str]]:
    """(kind, field) that hold something: not null, and neither empty, zero nor false unless it was measured."""
    return {
        (type(body).__name__, field.name)
        for body in bodies
        for field in msgspec.structs.fields(body)
        if (value := getattr(body, field.name)) not in (None, (None,) * 4) and (value or field.default is None)
    }


FORMER = {("OperatorChanged", field) for field in ("name", "role", "change")}  # in older trails; now `Change`
# The machine grants these, or not; control copies them field by field.
GRANTED = {("RealTimePrivilege", field) for field in ("fifo", "memory_locked", "core", "cores_awake")}


async def test_every_field_of_every_record_is_filled_by_somebody(
    tmp_path: Path, console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = [*of_a_real_session(tmp_path / "real"), *of_control(), *of_perception(tmp_path / "perception")]
    bodies += [of_a_recording(tmp_path / "recording.mcap"), *of_pictures(tmp_path / "pictures")]
    bodies += [of_the_other_host(tmp_path / "other"), *of_the_operators(tmp_path / "operators")]
    bodies += await of_the_console(console, home, monkeypatch)
    wanted = {(kind.__name__, field) for kind in KINDS for field in kind.__struct_fields__}
    assert wanted - filled(bodies) - GRANTED - FORMER == set(), f"let the product's own code fill it in {__file__}"


def of_a_real_session(root: Path) -> list[Body]:
    """Emulated drives on a bus, which vanish before the end, after a session that crashed; and a comment on it."""
    place = Home(root)
    leave_torn(place)
    with ExitStack() as drives:
        config = drives.enter_context(emulated_drives(JointsConfig(kind="can"), wearer=None))
        with RealSession(root, config) as session:
            session.send(OperatorKind.CONFIRM_PATIENT)
            session.until(lambda now: now.patient_confirmed and bool(now.allowed), "readiness")
            session.send(OperatorKind.ARM)

            def powered(now: ControlSnapshot) -> bool:
                session.towards_standing(now)  # again, where the host's stall stops the action before
                return now.enabled and session.heartbeat is not None and session.heartbeat.enabled

            session.until(powered, "power")
            drives.close()
            session.finish()
    path = session_paths(place.logs)[-1]
    found = records(path)
    write_comment(signed_in(place), path, found[-1], "A word.")
    comments = [comment for about in comments_on(open_session(path), Evidence())[0].values() for comment in about]
    journals = [record for manifest in manifest_paths(place.logs) for record in records(manifest)]
    assert comments_path(path).exists()
    return [record.body for record in (*found, *journals)] + comments


def of_a_recording(path: Path) -> Body:
    """A recording whose disk had little room for a while."""
    free = [0]
    writer = RecordingWriter(path, TOPICS, 0, floor_bytes=1, free_bytes=lambda _: free[0])
    writer.settle(1_000_000_000)
    writer.add(CONTACT, 1, FootContact(left_n=1.0, right_n=2.0))
    free[0] = 2
    writer.settle(2_000_000_000)
    writer.add(CONTACT, 2, FootContact(left_n=1.0, right_n=2.0))
    return file_record(writer, whole=writer.finish())


def of_pictures(root: Path) -> list[Body]:
    """A session whose planner is killed, and whose patient agrees to pictures and withdraws it."""
    with RealSession(root, perception=True, recording=True) as session:
        session.kill("planner")  # found long before the hand model is loaded
        session.until(lambda _: session.report is not None and session.report.hand, "a hand")
        session.record_pictures(consent=True)
        session.until(lambda _: session.report is not None and session.report.pictures_recorded, "perception's word")
        (path,) = [pictures_path(trail.parent, trail.stem) for trail in session_paths(Home(root).logs)]
        session.until(lambda _: path.exists() and path.stat().st_size > 0, "pictures")
        session.record_pictures(consent=False)
        session.until(lambda _: not path.exists(), "their end")
        session.finish()
    return [record.body for record in records(session_paths(Home(root).logs)[-1])]


def leave_torn(place: Home) -> None:
    """A session that crashed while it wrote a line."""
    place.logs.mkdir(parents=True)
    writer = SessionWriter(
        place.logs, "20260101T000000Z-0000", load_or_make_key(place.keys), Disk(), CheckpointCopy("")
    )
    writer.begin(SessionStart(versions={"rleex": "0"}, configuration={}, simulated=True), at(0))
    writer.take(at(1).entry(Note(text="before")))
    writer.settle(2)
    writer.close()
    with writer.path.open("ab") as file:
        file.write(b'{"body":{"kind":"no')


def at(second: int) -> Moment:
    return Moment(wall_ns=10**18 + second * 10**9, monotonic_ns=1 + second * 10**9, operator="ann")


def of_control() -> list[Body]:
    """Ticks of the step: actions by key and gesture, refusals, events, STOP."""
    rigs = [walked(), refused(), refused_by_an_event(), spoiled(), stopped(), paused(), stopped_by_a_button()]
    feedback = rigs[0].joints.feedback(rigs[0].now_ns + TICK_NS)
    faulty = replace(feedback, detail=HardwareError(DrivesFault.STAYS_DISABLED))
    late = Histogram()
    late.add(30_000_000, missed=15)
    held = JointStatisticsCollector(period_ticks=1)
    held.add(feedback, rigs[0].command)
    said = (drives_record(faulty), limits_record(SETTINGS), lateness_record(late), held.take(0.002, "sitting"))
    return [*(body for rig in rigs for body in rig.audit), *said]


def walked() -> Rig:
    rig = standing()
    rig.report = {"released_recognised_ns": rig.now_ns}
    rig.release(Gesture.FIVE)
    rig.tick(10)
    rig.run_until(lambda state: state.steps > 1, limit=5000)
    rig.send(K.ACT, A.WALK_END)
    rig.settle()
    rig.send(K.DISARM)
    rig.act(A.SIT_DOWN)  # by key, while gestures are refused
    return rig


def paused() -> Rig:
    """Control was late for a moment in the middle of a step, and foreign programs knocked."""
    rig = moving()
    rig.spoil.update(late_ns=30_000_000, missed_ticks=15, foreign_peers=3)
    rig.tick(520)
    return rig


def stopped_by_a_button() -> Rig:
    """A pendant that is unplugged."""
    rig = standing()
    with_switch(rig).fault = HardwareError(StopInputFault.UNPLUGGED, name="pendant")
    rig.tick(3)
    return rig


def refused() -> Rig:
    """By the gait machine, by the planner's check, by gesture and key, an acknowledgement of nothing."""
    rig = resting(S.SITTING)
    rig.release(Gesture.FIVE)
    rig.tick(20)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.send(K.ACT, A.WALK)  # by key, from a seat
    rig.tick(2)
    rig.refuse_plans = "too fast"
    rig.send(K.ACT, A.STAND_UP)
    rig.tick(20)
    return rig


def refused_by_an_event() -> Rig:
    """A joint too hot: the gesture is refused with the event's numbers."""
    rig = standing()
    feedback = rig.joints.feedback(rig.now_ns + TICK_NS)
    feedback.temperature_c[Joint.RIGHT_KNEE] = 81.0
    rig.spoil["feedback"] = feedback
    rig.report = {"released_recognised_ns": rig.now_ns}
    rig.release(Gesture.FIVE)
    rig.tick(40)
    return rig


def spoiled() -> Rig:
    """A command that the guard refuses, a clock that is moved, a stream that pauses."""
    rig = moving()
    rig.spoil["guard_refusal"] = Refusal(joint=Joint.LEFT_KNEE, quantity=Quantity.SPEED, value=9.0, limit=4.0)
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.watching = False
    rig.tick(500)
    rig.watching = True
    rig.tick(1500)
    return rig


def stopped() -> Rig:
    rig = moving()
    rig.send(K.STOP)
    rig.settle()
    rig.send(K.ACKNOWLEDGE)
    rig.tick(5)
    rig.send(K.ARM)
    rig.tick(2)
    return rig


def of_perception(root: Path) -> list[Body]:
    """A press that is released and one that is cancelled; the camera; a recording."""
    setup = setup_in(root)
    up = ButtonState(compared=compared())
    seen, hinted = replace(REPORT, button=up), replace(REPORT, button=structs.replace(up, hint=PressHint.KEEP_GESTURE))
    held = {"pressed_gesture": Gesture.ONE, "pressed_captured_ns": 3, "pressed_recognised_ns": 2}
    down = structs.replace(up, pressed=True, **held)
    pressed = replace(REPORT, button=down)
    away = structs.replace(down, release_count=1, released_gesture=Gesture.ONE, released_recognised_ns=4, released_ns=5)
    released = replace(REPORT, button=structs.replace(away, pressed=False))
    cancelled = replace(REPORT, button=structs.replace(up, cancel_count=1, cancel_reason=PressCancel.HAND_LOST))
    found: list[Body] = []
    steps = ((None, seen), (seen, hinted), (seen, pressed), (pressed, released), (pressed, cancelled))
    for before, now in steps:
        found += records_between(before, now, SCALE)
    found += framed()
    found.append(comparison_record(compared_cameras(), "table.csv"))
    found.append(enrolment_record(ENROLLED))
    found.append(enrolment_record(ENROLLED, Explanation(VocabularyFault.ABANDONED)))
    camera = make_camera(structs.replace(setup, config=Config()))  # images of a webcam that no test machine has
    camera.open()
    frame = camera.read(5.0)
    assert frame is not None
    rate = MeasuredRate()
    for captured_ns in (1, 2):
        rate.add(captured_ns, 1)
    found += camera_records(setup, camera.name, frame, rate)
    calibration = Calibration(
        camera=camera.name,
        focal_anchor_px_m=36.0,
        focal_px=600.0,
        distance_m=0.36,
        residual=0.01,
        calibrated_at="2026-01-01T00:00:00+00:00",
    )
    expected = reference_segment(DEMO_PATIENT)
    kept = Calibrated(calibration=calibration, reference_m=0.06, expected=expected, doubt=None)
    found.append(calibration_record("demo", kept))
    camera.close()
    return found


def compared_cameras() -> Comparison:
    """Two cameras at one value of a ruler, one of which loses the hand and presses falsely."""
    comparison = Comparison(threshold_m=0.2, ruler_m=0.3)
    for ruler_m in (0.3, 0.15):
        comparison.ruler_m = ruler_m
        for frame in (1, 2, 3):
            for which in (0, 1):
                number = frame + (10 if ruler_m < 0.2 else 0)
                comparison.take(which, looked(number, 0.3 + 0.01 * which))
    return comparison


def looked(frame: int, distance_m: float) -> CameraSample:
    return CameraSample(
        camera="c",
        captured_ns=frame * 10**8,
        frames=frame,
        lost=frame // 2,
        latency_ms=20.0,
        distance_m=distance_m,
        safe_m=distance_m,
        pressed=False,
        presses=frame,
    )


def framed() -> list[Body]:
    """The button's setup, and the frames of a second batch."""
    batch = FrameBatch()
    for captured_ns in (1, 2, 3):
        reading = FrameReading(
            captured_ns=captured_ns,
            hand=1,
            gesture=Gesture.ONE,
            cut_off=False,
            distance_m=0.3,
            beside_px=2.0,
            source=DistanceSource.DEPTH,
            bridge_m=0.32,
        )
        batch.add(reading, 0.9)
        list(batch.take(at_once=captured_ns == 1))
    place = ButtonPlace(x_px=640, y_px=360, radius_px=77, threshold_m=0.2)
    return [button_record(place, ButtonMode.ROBUST, DistanceChoice.BOTH), *batch.take(at_once=True)]


def setup_in(root: Path) -> SessionSetup:
    return SessionSetup(
        session="s",
        home=root,
        links=new_link_directory(root),
        config=Config(camera=CameraConfig(kind="webcam", mirrored=True)),
        profile=DEMO_PATIENT,
        operator="ann",
        role="therapist",
        host_pid=1,
    )


def of_the_other_host(root: Path) -> Body:
    """The other computer's newest record, as its audit process told it."""
    writer = SessionWriter(root, "other", load_or_make_key(root / "keys"), Disk(), CheckpointCopy(""))
    writer.begin(audit_process.start_record(setup_in(root)), at(0))
    writer.end(None, at(1))
    writer.finish(at(1))
    writer.close()
    found = other_trail(audit_process.health(writer, 0, 0), offset_ns=-5, uncertainty_ns=7)
    assert found is not None
    return found


def of_the_operators(root: Path) -> list[Body]:
    """An operator added by the command; a wall clock that was moved; a record too long for the trail."""
    added = CliRunner().invoke(
        cli, ["operator", "add", "Eva", "--role", "engineer", "--home", str(root)], input=f"{PIN}\n{PIN}\n"
    )
    assert added.exit_code == 0, added.output
    found = [record.body for record in records(root / "logs" / CHANGES)]
    writer = SessionWriter(root / "logs", "clock", load_or_make_key(root / "keys"), Disk(), CheckpointCopy(""))
    writer.begin(audit_process.start_record(setup_in(root)), at(0))
    moved = Moment(wall_ns=at(9).wall_ns, monotonic_ns=at(1).monotonic_ns, operator="ann")
    writer.take(moved.entry(Note(text="x" * 2_000_000)))
    writer.end(None, moved)
    writer.finish(moved)
    writer.close()
    found += [record.body for record in records(writer.path)]
    return found


async def of_the_console(console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch) -> list[Body]:
    """Wrong PINs, a sign-in, lock, unlock, a process that dies, note and rating, a sign-out."""
    found: list[Body] = []
    monkeypatch.setattr(ConsoleTrail, "emit", lambda _, body: found.append(body))
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Ben", Role.THERAPIST, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as opened:
        await opened.press("enter")
        await opened.shows("is this the patient?")
        await opened.press("ctrl+s")
        for name, pin in (("Ada", "000111"),) * 3 + (("Ben", PIN),):
            await opened.until(lambda: isinstance(opened.app.screen, SignInDialog))
            failures = len(found)
            await opened.sign_in(name, pin)
            await opened.until(lambda: len(found) > failures)  # noqa: B023 - awaited at once
        await opened.until(lambda: isinstance(opened.app.screen, SessionScreen))
        await opened.until(lambda: (state := opened.app.live_state()) and state.snapshot)
        await opened.press("ctrl+l")
        await opened.until(lambda: isinstance(opened.app.screen, SignInDialog))
        await opened.sign_in("Ben", PIN)
        await opened.until(lambda: isinstance(opened.app.screen, SessionScreen))
        await of_a_guided_test(opened)
        await opened.app.end_session()
        await opened.until(lambda: isinstance(opened.app.screen, AfterScreen))
        await opened.until(lambda: opened.app.screen.query("#discomfort #label"))  # composed after the screen is shown
        opened.type("note", "walked well")
        for name, rating in (("discomfort", 3), ("pain", 1), ("exertion", 13)):
            opened.app.screen.query_one(f"#{name}", Select).value = rating
        await opened.press("ctrl+s")
        await opened.until(lambda: opened.host.closed)
    return found


async def of_a_guided_test(opened: Console) -> None:
    """A 6-minute walk that a key stops after some steps."""
    opened.host.state = GaitState.STANDING
    await opened.until(lambda: (state := opened.app.live_state()) and state.snapshot and state.snapshot.enabled)
    await opened.press("g", "2")
    await opened.until(lambda: opened.app.guided.run)
    walk_steps(opened.host, 3)
    await opened.until(lambda: (run := opened.app.guided.run) and run.duration_s > 0 and run.steps)
    await opened.press("g", "y")
    await opened.until(lambda: opened.app.guided.results)
