"""A recording holds what was sent: every message, every sample; the trail holds its hash."""

from __future__ import annotations

import json
from collections import Counter
from hashlib import sha256
from math import nan
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from msgspec import Struct
from msgspec.structs import replace

from app.control.recording import TickRecorder
from app.control.telemetry import snapshot
from app.ipc.links import OrderedReceiver
from app.ipc.recording import BATCH_TICKS, HandFrame, LinkAges, TickBatch
from app.recording import schemas
from app.recording.process import BATCH, SessionRecording, take_batch
from app.recording.read import HashCheck, Recording, messages, proof_of, survey
from app.recording.schemas import TOPICS, schema_of
from app.recording.sink import RecordingSink
from app.recording.topics import TickMessages, of_hand
from app.recording.writer import RecordingWriter
from hal.joints.protocol import TICK_NS
from logs.records import RecordingFile
from tests.app.recording.conftest import STATUS, Collector, Session, WatchedRig, frame, setup_in

JOINTS = ["left_hip", "left_knee", "right_hip", "right_knee"]


def test_joint_states_are_controls_own_sample_by_sample(recorded: Session) -> None:
    found: dict[str, list[tuple[int, list[float]]]] = {schemas.JOINT_STATE: [], schemas.JOINT_SETPOINT: []}
    for one in messages(Recording(path=recorded.path), *found):
        joints = one.value["joints"]
        assert [joint["name"] for joint in joints] == JOINTS
        found[one.topic].append((one.at_ns, [joint.get("position", nan) for joint in joints]))
    assert found[schemas.JOINT_STATE] == [(at_ns, measured) for at_ns, measured, _ in recorded.ticks]
    setpoints = [at_ns for at_ns, _ in found[schemas.JOINT_SETPOINT]], [q for _, q in found[schemas.JOINT_SETPOINT]]
    assert setpoints[0] == [at_ns for at_ns, _, _ in recorded.ticks]
    assert np.array_equal(setpoints[1], [commanded for _, _, commanded in recorded.ticks], equal_nan=True)
    assert np.isnan(setpoints[1][0]).all(), "the drives are off"
    assert np.isfinite(setpoints[1][-1]).all(), "the legs stand up"


def test_every_message_is_there(recorded: Session) -> None:
    found = survey(recorded.path)
    ticks, frames = len(recorded.ticks), len(recorded.frames)
    batches = -(-ticks // 25)
    wanted = {
        schemas.JOINT_STATE: ticks,
        schemas.JOINT_SETPOINT: ticks,
        schemas.CONTACT: ticks,
        schemas.GAIT: batches,
        schemas.LINKS: batches,
        schemas.JOINT_HEALTH: batches,
        schemas.OPERATOR: recorded.commands,
        schemas.KEYPOINTS: frames,
        schemas.VERDICT: frames,
        schemas.BUTTON: frames,
        schemas.TRAIL: recorded.trail_lines,
        schemas.LOG: recorded.trail_lines,
    }
    assert {topic: found.counts[topic] for topic in wanted} == wanted
    assert found.counts[schemas.JOINT_GAINS] > 0
    assert found.whole
    assert not found.lost


def test_keypoints_are_perceptions_own(recorded: Session) -> None:
    found = [one.value for one in messages(Recording(path=recorded.path), schemas.KEYPOINTS)]
    for sent, read in zip(recorded.frames, found, strict=True):
        assert np.array(read["image_px"]).tobytes() == sent.image_px
        assert np.array(read["world_m"]).tobytes() == sent.world_m


def test_the_libraries_own_reader_opens_it(recorded: Session) -> None:
    with recorded.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert summary is not None
    assert counts == survey(recorded.path).counts
    assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}


def test_the_trail_gets_hash_and_counts(recorded: Session) -> None:
    (body,) = recorded.sink.bodies
    assert isinstance(body, RecordingFile)
    assert body.sha256 == sha256(recorded.path.read_bytes()).hexdigest()
    assert body.size_bytes == recorded.path.stat().st_size
    assert body.messages == survey(recorded.path).counts
    assert (body.lost, body.whole, body.fault) == ({}, True, None)
    assert proof_of(recorded.path)[0] is HashCheck.UNKNOWN  # the sample trail ended before the recording


AGES = LinkAges(report_ms=1, console_ms=1, audit_ms=1, guardian_ms=1)


class FullQueue(RecordingSink):
    """Takes each third batch."""

    def __init__(self) -> None:
        self.offered = 0
        self.taken: list[TickBatch] = []

    def send(self, message: Struct) -> bool:
        assert isinstance(message, TickBatch)
        self.offered += 1
        if self.offered % 3 == 1:
            self.taken.append(message)
        return self.offered % 3 == 1


def test_what_a_refused_batch_would_have_held_is_counted_lost_by_topic(tmp_path: Path) -> None:
    rig, setup, queue = WatchedRig(), setup_in(tmp_path), FullQueue()
    recorder, recording = TickRecorder(setup.links), SessionRecording(setup, Collector())
    recorder.close(rig.tick().streams, snapshot(rig.tick(), rig.given, STATUS))  # its own queue
    recorder._sink = queue
    for _ in range(7 * BATCH_TICKS):
        state = rig.tick()
        assert rig.outputs is not None
        recorder.add(rig.given, rig.outputs.command)
        recorder.add_contact(rig.now_ns, (1.0, 2.0))
        if recorder.full:
            recorder.send(state.streams, snapshot(state, rig.given, STATUS))
    for batch in queue.taken:
        recording.take(batch)
    recording.close()
    made = recorder.made.messages
    found = survey(recording.writer.path)
    assert (made[schemas.GAIT], found.lost[schemas.GAIT], found.lost[schemas.CONTACT]) == (7, 4, 4 * BATCH_TICKS)
    assert {topic: found.counts[topic] + found.lost.get(topic, 0) for topic in made} == made


def test_batches_lost_before_control_was_restarted_stay_counted() -> None:
    rig = WatchedRig()
    shown = snapshot(rig.tick(), rig.given, STATUS)
    messages_of = TickMessages(0)
    values, times = np.zeros((25, 8, 4)).tobytes(), np.zeros(25, dtype=np.int64).tobytes()
    for first_tick, lost in ((0, 0), (100, 75), (125, 75), (25, 25), (50, 25)):
        losses = {schemas.JOINT_STATE: lost}
        batch = TickBatch(first_tick=first_tick, lost=losses, at_ns=times, values=values, ages=AGES, snapshot=shown)
        assert len([one for one in messages_of.of(batch) if one[0] == schemas.JOINT_STATE]) == 25
    assert messages_of.lost == {schemas.JOINT_STATE: 75 + 25}


def test_frames_before_the_cameras_first_image_are_at_their_own_time() -> None:
    sent = frame(2, 5_000_000_000)
    waiting = replace(sent, report=replace(sent.report, captured_ns=0))
    assert [at_ns for _, at_ns, _ in of_hand(waiting)] == [5_000_000_000] * 3
    seen = replace(sent, report=replace(sent.report, captured_ns=4_980_000_000))
    assert [at_ns for _, at_ns, _ in of_hand(seen)] == [4_980_000_000] * 3


def test_a_recording_that_begins_at_the_clocks_zero_lasts_from_there(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "s.mcap", TOPICS, 0)
    for at_ns in (0, 5_000_000_000):
        writer.add(schemas.CONTACT, at_ns, schemas.FootContact(left_n=1.0, right_n=2.0))
    assert writer.finish()
    assert survey(writer.path).duration_s == 5.0
    assert Recording(path=writer.path).duration_s == 0.0


def test_frames_lost_before_perception_was_restarted_stay_counted(tmp_path: Path) -> None:
    recording = SessionRecording(setup_in(tmp_path), Collector())
    # Sequence and losses of each frame; another camera begins an incarnation in the same process, which counts on.
    for incarnation, sequence, lost in ((1, 1, 0), (1, 5, 3), (2, 6, 3), (3, 3, 2), (3, 4, 2)):
        sent = frame(sequence, sequence * TICK_NS)
        recording.take(replace(sent, lost=lost, report=replace(sent.report, incarnation=incarnation)))
    recording.close()
    assert {topic: recording.writer.lost[topic] for topic in schemas.HAND_TOPICS} == dict.fromkeys(
        schemas.HAND_TOPICS, 3 + 2
    )


class Backlog(OrderedReceiver[TickBatch | HandFrame]):
    """Has these messages waiting."""

    def __init__(self, waiting: list[HandFrame]) -> None:
        self.waiting = waiting

    def receive(self, timeout_s: float = 0.0) -> HandFrame | None:
        return self.waiting.pop(0) if self.waiting else None


def test_a_recorder_behind_by_more_than_a_batch_loses_nothing(tmp_path: Path) -> None:
    recording = SessionRecording(setup_in(tmp_path), Collector())
    behind = Backlog([frame(number, number * TICK_NS) for number in range(1, 2 * BATCH + 4)])
    assert [take_batch(behind, recording) for _ in range(4)] == [BATCH, BATCH, 3, 0]
    recording.close()
    found = [one.value["frame"] for one in messages(Recording(path=recording.writer.path), schemas.BUTTON)]
    assert found == list(range(1, 2 * BATCH + 4))
    assert not recording.writer.lost.total()


def test_every_topic_has_a_schema() -> None:
    for topic in TOPICS:
        assert schema_of(topic)["title"]


def test_the_commands_show_and_prove_it(recorded: Session, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from app.cli import cli

    values = tmp_path / "info.json"
    shown = CliRunner().invoke(cli, ["recording", "info", str(recorded.path), "--json", str(values)])
    assert shown.exit_code == 0, shown.output
    assert schemas.JOINT_STATE in shown.output
    assert json.loads(values.read_text())["messages"][schemas.JOINT_STATE] == len(recorded.ticks)
    home = ["--home", str(recorded.setup.home)]
    proved = CliRunner().invoke(cli, ["recording", "verify", recorded.setup.session[:12], *home])
    assert proved.exit_code == 1, "its trail names no hash"
    assert (
        CliRunner().invoke(cli, ["recording", "schema"]).output
        == Path("docs/reference/recording-schema.json").read_text()
    )
