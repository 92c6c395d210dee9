"""The installation's doctor: what is missing is reported with its remedy."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

import msgspec
import pytest
import tomlkit
from rich.cells import cell_len
from rich.console import Console
from typer.testing import CliRunner

from app.cli import cli
from app.demo.two_hosts import free_port
from app.diagnostics import computer, doctor
from app.diagnostics.can_doctor import CanFinding, CanRemedy
from app.diagnostics.doctor_codes import DoctorFinding as F
from app.diagnostics.doctor_codes import Remedy, Subject, run
from app.diagnostics.findings import Finding, Grade, note, show
from app.link.keys import Peer, add_peer
from app.link.server import JointsServer
from app.link.wire import LinkFault
from app.system.config import CameraConfig, Config, JointsConfig, JointsKind
from app.system.hand_model import MODEL_NAME
from app.system.paths import Home
from app.text.catalogue import knows, render, tr, use_language
from hal.errors import DeviceFault
from hal.inputs.device import Contact, ContactReading, InputDevice, InputRole
from hal.joints.device import BusDevice, load_exoskeleton
from logs.reason import Reason, key_of, reason


def one(findings: Iterator[Finding]) -> Finding:
    (finding,) = findings
    return finding


def rendered(finding: Finding) -> str:
    return " → ".join(render(each) for each in (finding.what, finding.remedy) if each is not None)


def test_every_finding_and_remedy_has_its_text() -> None:
    for code in (*F, *Remedy, *Subject, *CanFinding, *CanRemedy):
        assert knows(key_of(code)), code


def test_a_missing_model_is_bad_and_mended_by_its_command(tmp_path: Path) -> None:
    finding = one(doctor.check_model(Home(tmp_path), Config()))
    assert (finding.grade, finding.remedy) == (Grade.BAD, run("rleex model"))


def test_a_model_that_is_damaged_or_wrongly_named_has_a_remedy_of_its_own(tmp_path: Path) -> None:
    home = Home(tmp_path)
    home.models.mkdir()
    (home.models / MODEL_NAME).write_bytes(b"damaged")
    assert one(doctor.check_model(home, Config())).remedy == run("rleex model --again")
    named = one(doctor.check_model(home, Config(model=str(tmp_path / "none.task"))))
    assert named.remedy == reason(Remedy.EDIT_SETTINGS, path=home.config)


@pytest.mark.parametrize(
    ("peer", "joints", "grade"),
    [
        (Peer(name="laptop", public="k", paired_at=""), JointsConfig(), Grade.NOTE),
        (Peer(name="exo", public="k", paired_at="", host="exo.local:7447"), JointsConfig(), Grade.BAD),
        (Peer(name="laptop", public="k", paired_at=""), JointsConfig(host="exo.local:7447"), Grade.BAD),
    ],
)
def test_a_computer_that_serves_joints_needs_no_model(
    tmp_path: Path, peer: Peer, joints: JointsConfig, grade: Grade
) -> None:
    """Its laptop runs perception."""
    add_peer(Home(tmp_path), peer)
    assert one(doctor.check_model(Home(tmp_path), Config(joints=joints))).grade is grade


@contextmanager
def answering(home: Home) -> Iterator[str]:
    """An exoskeleton's computer that answers questions; its address."""
    number = free_port()
    server = JointsServer(home, number, ThreadPoolExecutor(1))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield f"127.0.0.1:{number}"
    finally:
        server.end()
        thread.join()
        server.close()


def test_keys_of_the_link_that_can_not_be_read_are_a_finding(tmp_path: Path) -> None:
    laptop = Home(tmp_path / "laptop")
    peers = laptop.link_keys / "peers.json"
    peers.parent.mkdir(parents=True)
    peers.write_text("{")
    with answering(Home(tmp_path / "joints")) as host:
        answers, keys = doctor.check_link(laptop, Config(joints=JointsConfig(host=host)))
    assert (answers.grade, keys.grade) == (Grade.GOOD, Grade.BAD)
    assert keys.what == reason(LinkFault.KEYS_DAMAGED, path=peers)
    assert keys.remedy == run(f"rm {peers} && rleex link pair {host}")


def test_a_webcam_that_is_named_but_missing_is_bad(tmp_path: Path) -> None:
    wanted = Config(camera=CameraConfig(kind="webcam"))
    assert one(doctor.check_cameras(wanted, tmp_path)).grade is Grade.BAD
    assert one(doctor.check_cameras(Config(), tmp_path)).grade is Grade.NOTE


def test_a_webcam_that_is_there_is_good(tmp_path: Path) -> None:
    (tmp_path / "video0").touch()
    assert one(doctor.check_cameras(Config(), tmp_path)).grade is Grade.GOOD


def test_without_a_webcam_the_camera_in_use_is_named_in_the_language_in_use(tmp_path: Path) -> None:
    finding = one(doctor.check_cameras(Config(), tmp_path))
    assert "the digital hand" in rendered(finding)
    use_language("zh")
    assert "数字手" in rendered(finding)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_findings_stand_in_a_column(language: str, capsys: pytest.CaptureFixture[str]) -> None:
    use_language(language)
    what = Reason("camera.good")
    show(Console(width=200), [note(subject, what) for subject in (*Subject, "slcan-left-hip")])
    *lines, longer = capsys.readouterr().out.splitlines()
    assert {cell_len(line.removesuffix(tr("camera.good"))) for line in lines} == {14}
    assert "slcan-left-hip " in longer


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_a_webcam_that_may_not_be_opened_names_the_group(tmp_path: Path) -> None:
    (tmp_path / "video0").touch(mode=0o000)
    assert "video" in rendered(one(doctor.check_cameras(Config(), tmp_path)))


@pytest.mark.parametrize(
    ("environment", "grade", "code"),
    [
        ({"TERM": "xterm-kitty", "LANG": "C.UTF-8"}, Grade.GOOD, F.PICTURES_FULL),
        ({"TERM": "xterm-256color", "COLORTERM": "truecolor", "LANG": "C.UTF-8"}, Grade.GOOD, F.PICTURES_TRUE_COLOUR),
        ({"TERM": "xterm-256color", "LANG": "C.UTF-8"}, Grade.NOTE, F.PICTURES_256_COLOURS),
        ({"TERM": "dumb", "LANG": "de_DE.UTF-8"}, Grade.NOTE, F.NO_PICTURES),
    ],
)
def test_terminals_are_distinguished(environment: dict[str, str], grade: Grade, code: F) -> None:
    finding = one(computer.check_terminal(environment, is_terminal=True))
    assert finding.grade is grade
    assert finding.what.code == key_of(code)


def test_a_locale_without_utf8_is_noted() -> None:
    findings = list(computer.check_terminal({"TERM": "xterm-kitty", "LANG": "C"}, is_terminal=True))
    assert findings[-1].what.code == key_of(F.LOCALE_NOT_UTF8)


def test_looking_at_real_time_leaves_the_process_as_it_was() -> None:
    before = os.sched_getscheduler(0)
    assert any("core" in rendered(finding) for finding in computer.check_real_time())
    assert os.sched_getscheduler(0) == before


@pytest.mark.parametrize(("limit", "code"), [(20, F.FIFO_NOT_ALLOWED), (80, F.FIFO_ALLOWED)])
def test_fifo_is_allowed_if_the_guardians_priority_is(monkeypatch: pytest.MonkeyPatch, limit: int, code: F) -> None:
    def schedule(_process: int, _policy: int, parameters: os.sched_param) -> None:
        if parameters.sched_priority > limit:
            raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    assert next(computer.check_real_time()).what.code == key_of(code)


def test_keys_that_others_may_read_are_bad(tmp_path: Path) -> None:
    home = Home(tmp_path)
    home.keys.mkdir()
    home.keys.chmod(0o755)
    grades = [finding.grade for finding in computer.check_disk(home, Config())]
    assert grades[-1] is Grade.BAD


@pytest.mark.parametrize(
    ("joints", "grade"),
    [
        (JointsConfig(kind="can"), Grade.BAD),  # 4 h of bus logs
        (JointsConfig(), Grade.GOOD),
        (JointsConfig(kind="can", host="exo.local:7447"), Grade.GOOD),  # they are written there
    ],
)
def test_where_buses_are_logged_a_disk_must_last_a_day(tmp_path: Path, joints: JointsConfig, grade: Grade) -> None:
    found = one(computer.check_disk(Home(tmp_path), Config(joints=joints), lambda _: 3_000_000_000))
    assert found.grade is grade


class StillContact:
    """A button whose contact stays as it is."""

    def __init__(self, reading: ContactReading) -> None:
        self._reading = reading

    def open(self, now_ns: int) -> None:
        """Nothing to open."""

    def read(self, now_ns: int) -> ContactReading:
        return self._reading

    def close(self) -> None:
        """Nothing to close."""


@pytest.mark.parametrize(
    ("reading", "grade", "what", "remedy"),
    [
        (ContactReading(Contact.CLOSED), Grade.GOOD, F.STOP_BUTTON_CLOSED, None),
        (ContactReading(Contact.OPEN), Grade.BAD, F.STOP_BUTTON_OPEN, Remedy.RELEASE_BUTTON),
        (ContactReading(Contact.SILENT), Grade.BAD, F.STOP_BUTTON_SILENT, Remedy.CONNECT_BUTTON),
    ],
)
def test_a_stop_button_is_found_as_its_contact_is(
    reading: ContactReading, grade: Grade, what: F, remedy: Remedy | None
) -> None:
    pendant = InputDevice(name="pendant", role=InputRole.WEARER, kind="can", can_id=0x181)
    finding = one(doctor.check_stop_buttons(Config(inputs=(pendant,)), lambda *_: StillContact(reading)))
    assert (finding.grade, finding.what.code) == (grade, key_of(what))
    assert finding.what.values["name"] == "pendant"
    assert (finding.remedy and finding.remedy.code) == (remedy and key_of(remedy))


def test_a_stop_button_that_cannot_be_opened_says_why() -> None:
    pedal = InputDevice(name="pedal", role=InputRole.THERAPIST, kind="evdev", device="/dev/input/none", key="KEY_B")
    finding = one(doctor.check_stop_buttons(Config(inputs=(pedal,))))
    assert finding.grade is Grade.BAD
    assert "pedal" in rendered(finding)


def test_without_a_stop_button_it_is_said() -> None:
    assert one(doctor.check_stop_buttons(Config())).what.code == key_of(F.NO_STOP_BUTTON)


def test_stop_buttons_are_judged_where_the_joints_are() -> None:
    pedal = InputDevice(name="pedal", role=InputRole.THERAPIST, kind="evdev", device="/dev/input/none", key="KEY_B")
    there = JointsConfig(host="exo.local:7447")
    for inputs in ((), (pedal,)):
        assert list(doctor.check_stop_buttons(Config(joints=there, inputs=inputs))) == []


def test_joints_on_can_are_examined(tmp_path: Path) -> None:
    config = Config(joints=JointsConfig(kind="can", interface="socketcan", channel="can77"))
    assert one(doctor.check_joints(config)).grade is Grade.BAD
    assert one(doctor.check_joints(Config())).grade is Grade.NOTE
    for kind in get_args(JointsKind):
        broken = Config(joints=JointsConfig(kind=kind, device=str(tmp_path / "none.toml")))
        assert "none.toml" in rendered(one(doctor.check_joints(broken)))
    two = msgspec.structs.replace(load_exoskeleton(), buses=(BusDevice(channel="can0"), BusDevice(channel="can1")))
    (tmp_path / "two.toml").write_text(tomlkit.dumps(msgspec.to_builtins(two)))
    shared = Config(joints=JointsConfig(kind="can", device=str(tmp_path / "two.toml"), channel="can77"))
    assert one(doctor.check_joints(shared)).what.code == key_of(DeviceFault.CHANNEL_SHARED)
    unused = msgspec.structs.replace(shared, joints=msgspec.structs.replace(shared.joints, kind="simulated"))
    assert one(doctor.check_joints(unused)).grade is Grade.NOTE


def test_the_command_ends_1_when_something_is_bad(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["doctor", "--home", str(tmp_path)])
    assert result.exit_code == 1
    assert "→ rleex model" in result.output


def test_a_broken_configuration_is_one_of_its_findings(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("joints = 3")
    result = CliRunner().invoke(cli, ["doctor", "--home", str(tmp_path)])
    assert "config.toml" in result.output
    assert result.exit_code == 1
