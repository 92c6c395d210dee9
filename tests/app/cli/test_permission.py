"""Who may change something from the command line: every command of the tree is tried, by nobody and by everybody."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import typer

from app.cli import permission as permissions
from app.cli.common import CliFault
from app.cli.permission import TOKEN_VARIABLE
from app.cli.tree import tree
from app.system import operators, sign_in
from app.system.authority import Authority, AuthorityFault, Proof, unsigned
from app.system.config import Config, ConfigFault, JointsConfig, load_config
from app.system.enrolment import TokenFault, by_token, enrol, enrol_first, give_pin, issue_token
from app.system.errors import AppError
from app.system.operators import PERMISSIONS, Permission, Role
from app.system.paths import Home
from app.text.catalogue import render, use_language
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError
from logs.errors import AuditError
from logs.journal import CHANGES as JOURNAL
from logs.journal import OPERATORS, parts_of
from logs.keys import by_fingerprint, known_keys, read_anchors
from logs.read import records
from logs.records import Change, SignInFailed
from logs.verify import Evidence, exit_status, verify
from profiles.errors import ProfileError
from profiles.store import ProfileStore
from tests.support.bad_input import in_time

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN = "483920"
ROOT = Path(__file__).parents[3]
REFUSED = (AuthorityFault.SIGN_IN_NEEDED, AuthorityFault.NO_OPERATORS)

# Command → the permission it asks for, and the arguments without which it only reads.
CHANGES: dict[str, tuple[Permission, tuple[str, ...]]] = {
    "camera calibrate": (Permission.CALIBRATE, ()),
    "can doctor": (Permission.CONFIGURE, ()),  # asks the drives, unless it only listens
    "can monitor": (Permission.CONFIGURE, ("--ask",)),  # disables drives that are enabled
    "can scan": (Permission.CONFIGURE, ()),  # disables drives that are enabled
    "can zero": (Permission.CONFIGURE, ()),
    "configure": (Permission.CONFIGURE, ()),
    "emulate-drives": (Permission.CONFIGURE, ()),  # answers in the drives' place
    "link forget": (Permission.CONFIGURE, ()),
    "link pair": (Permission.CONFIGURE, ()),
    "model": (Permission.CONFIGURE, ("--again",)),
    "operator add": (Permission.MANAGE_OPERATORS, ()),
    "operator disable": (Permission.MANAGE_OPERATORS, ()),
    "operator pin": (Permission.MANAGE_OPERATORS, ()),
    "operator token": (Permission.EDIT_PATIENTS, ("--may", "edit patients")),  # of those it is given
    "profile archive": (Permission.EDIT_PATIENTS, ()),
    "profile calibrate": (Permission.CALIBRATE, ()),
    "profile import": (Permission.EDIT_PATIENTS, ()),
    "profile new": (Permission.EDIT_PATIENTS, ()),
    "profile set": (Permission.EDIT_PATIENTS, ()),
    "recording delete-pictures": (Permission.EDIT_PATIENTS, ()),
    "recording expire": (Permission.EDIT_PATIENTS, ()),
    "simulate": (Permission.OPERATE, ("--preflight",)),
}
# Writes nothing but what its options name, and a demonstration's own session. `run` asks in the console itself.
READS = frozenset(
    {
        *(
            f"audit {name}"
            for name in (
                "explain",
                "export",
                "key",
                "list",
                "merge",
                "query",
                "replay",
                "report",
                "schema",
                "show",
                "verify",
            )
        ),
        *(f"camera {name}" for name in ("compare", "list", "show")),
        *(f"can {name}" for name in ("decode", "record")),
        *(f"profile {name}" for name in ("export", "history", "list", "show")),
        *(f"recording {name}" for name in ("info", "schema", "verify")),
        "demo",  # simulated joints, or emulated drives on a bus of its own
        "doctor",
        "export",
        "query",
        "joints",  # its sessions are begun by an operator who signs in at the laptop
        "replay",
        "link list",
        "locate",
        "operator list",
        "outcomes",
        "press-input",  # a simulated button, which stops; nothing moves by letting it go
        "run",
    }
)  # and every `evaluate`


def _commands(group: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{path}{name} ")
        else:
            yield f"{path}{name}", command


COMMANDS: dict[str, Any] = dict(_commands(typer.main.get_group(tree())))


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Home:
    """A home with drives configured and nobody enrolled, which every command finds."""
    place = Home(tmp_path / "home")
    place.root.mkdir()
    place.config.write_text('[joints]\nkind = "can"\ninterface = "local"\nchannel = "43999"\n')
    monkeypatch.setenv("RLEEX_HOME", str(place.root))
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    return place


@pytest.fixture
def clinic(home: Home) -> Home:
    """The same with one operator of each role, all with the same PIN."""
    ada = enrol_first(home, "Ada", PIN)
    enrol(ada, "Ben", Role.THERAPIST, PIN)
    enrol(ada, "Rex", Role.REVIEWER, PIN)
    return home


def call(name: str, *extra: str) -> None:
    """A command with anything for what it must have."""
    arguments = list(extra)
    for parameter in COMMANDS[name].params:
        if parameter.required:
            some = {"float": "1", "int": "1"}.get(parameter.bare_type(), "x")
            some = {"changes": "x=1", "to": "csv", "sex": "female"}.get(parameter.name, some)
            arguments += [parameter.opts[0], some] if parameter.param_type_name == "option" else [some]
    COMMANDS[name].main(arguments, standalone_mode=False)


def files(home: Home) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in sorted(home.root.rglob("*")) if path.is_file()}


def test_every_command_is_classified() -> None:
    evaluations = {name for name in COMMANDS if name.startswith("evaluate ")}
    assert set(CHANGES) | READS | evaluations == set(COMMANDS)
    assert not READS & set(CHANGES)


@pytest.mark.parametrize("name", sorted(set(CHANGES) - {"operator token"}))  # in your own name
def test_a_help_tells_whose_pin_is_asked(name: str) -> None:
    permission, extra = CHANGES[name]
    command = COMMANDS[name]
    texts = [command.help, *(one.help for one in command.params if set(extra) & set(one.opts))]
    found = re.findall(r"(?i)\ban? (\w+(?: or \w+)?) signs in first", " ".join(texts))
    assert [set(one.split(" or ")) for one in found] == [
        {role.value for role in Role if permission in PERMISSIONS[role]}
    ]


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_refused_where_there_is_nobody_to_ask(clinic: Home, name: str) -> None:
    before = files(clinic)
    with pytest.raises(AppError) as refused:
        call(name, *CHANGES[name][1])
    assert refused.value.code is AuthorityFault.SIGN_IN_NEEDED
    assert files(clinic) == before


@pytest.mark.parametrize("name", sorted(set(CHANGES) - {"operator add", "operator token"}))
def test_with_drives_and_nobody_enrolled_the_first_engineer_comes_first(home: Home, name: str) -> None:
    with pytest.raises(AppError) as refused:
        call(name, *CHANGES[name][1])
    assert refused.value.code is AuthorityFault.NO_OPERATORS
    assert [path for path in files(home) if path != home.config] == []


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("role", Role)
def test_a_role_without_the_right_is_refused_and_one_with_it_goes_on(
    clinic: Home, monkeypatch: pytest.MonkeyPatch, name: str, role: Role
) -> None:
    wanted, extra = CHANGES[name]
    signs_in(monkeypatch, next(one.name for one in operators.load_store(clinic.keys).operators if one.role is role))

    class WentOnError(Exception):
        """Whatever comes next."""

    def allowed(authority: Authority, permission: Permission) -> None:
        assert permission is wanted
        _require(authority, permission)
        raise WentOnError

    monkeypatch.setattr(Authority, "require", allowed)
    with pytest.raises((AppError, WentOnError)) as ended:
        call(name, *extra)
    assert isinstance(ended.value, WentOnError) == (wanted in PERMISSIONS[role])
    if isinstance(ended.value, AppError):
        assert ended.value.code is AuthorityFault.NOT_ALLOWED
        assert wording(ended.value)


_require = Authority.require


@pytest.mark.parametrize("name", sorted(READS - {"run", "demo", "joints", "can record"}))
def test_reading_asks_nobody_and_changes_nothing(clinic: Home, name: str) -> None:
    before = files(clinic)
    try:
        call(name)
        code = None
    except (AppError, AuditError, HardwareError, KgdfaError, ProfileError, SystemExit, typer.Exit) as ended:
        code = getattr(ended, "code", None)
    assert code not in REFUSED
    assert files(clinic) == before


def signs_in(monkeypatch: pytest.MonkeyPatch, name: str, pin: str = PIN) -> None:
    """Somebody sits at a terminal and answers."""
    answers = iter((name, pin))
    monkeypatch.setattr(permissions, "is_terminal", lambda: True)
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: next(answers))


def wording(error: AppError) -> list[str]:
    """One sentence or two in each language."""
    found = []
    for language in ("zh", "en"):
        use_language(language)
        found.append(render(error))
        assert "\n" not in found[-1]
    return found


def test_a_signed_change_is_on_record_and_the_trail_is_sound(clinic: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    signs_in(monkeypatch, "Ben")
    COMMANDS["profile set"].main(["demo", "mass_kg=71", "note=call Mr X"], standalone_mode=False)
    changes = [record for record in records(clinic.logs / JOURNAL) if isinstance(record.body, Change)]
    changed = changes[-1].body
    assert isinstance(changed, Change)
    assert (changes[-1].operator, changed.role, changed.proof) == ("Ben", "therapist", "pin")
    assert (changed.subject, changed.name) == ("patient", "demo")
    assert changed.values["mass_kg"][1] == 71
    assert "Mr X" not in (clinic.logs / JOURNAL).read_text()
    assert ProfileStore(clinic.profiles).history("demo")[-1].by == "Ben"
    assert [one.body.subject for one in changes if isinstance(one.body, Change)] == ["operator"] * 3 + ["patient"]
    assert judged(clinic) == 0
    lines = (clinic.logs / JOURNAL).read_bytes().splitlines(keepends=True)
    (clinic.logs / JOURNAL).write_bytes(b"".join(lines[:-2]))
    assert judged(clinic) == 1


def judged(home: Home) -> int:
    evidence = Evidence(keys=by_fingerprint(known_keys(home.keys)), anchors=read_anchors(home.keys))
    return exit_status(verify([home.logs], evidence))


def test_what_can_not_be_recorded_is_not_changed(clinic: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    signs_in(monkeypatch, "Ben")
    (clinic.logs / JOURNAL).unlink()
    (clinic.logs / JOURNAL).mkdir()
    with pytest.raises(AuditError):
        COMMANDS["profile set"].main(["demo", "mass_kg=71"], standalone_mode=False)
    assert not (clinic.profiles / "demo.toml").exists()


def test_without_drives_and_operators_changes_are_unsigned_and_recorded_as_that(
    home: Home, capsys: pytest.CaptureFixture[str]
) -> None:
    home.config.unlink()
    COMMANDS["profile set"].main(["demo", "mass_kg=71"], standalone_mode=False)
    (change,) = (record for record in records(home.logs / JOURNAL) if isinstance(record.body, Change))
    assert (change.operator, change.body) == (
        "",
        Change(subject="patient", name="demo", values={"mass_kg": (65.0, 71.0)}, proof="none", reason=""),
    )
    COMMANDS["profile history"].main(["demo"], standalone_mode=False)
    assert "Project-Id-Version" not in capsys.readouterr().out  # no reason was given


def test_an_engineer_calibrates_and_edits_no_patient(clinic: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    signs_in(monkeypatch, "Ada")
    with pytest.raises(AppError) as refused:
        COMMANDS["profile set"].main(["demo", "press_threshold_cm=22"], standalone_mode=False)
    assert refused.value.code is AuthorityFault.NOT_ALLOWED


def test_the_configuration_is_changed_by_an_engineer_with_its_comments_kept(
    clinic: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clinic.config.write_text('# ours\nlanguage = "en" # or zh\n[joints]\nkind = "can"\n')
    signs_in(monkeypatch, "Ada")
    COMMANDS["configure"].main(["language=zh", "camera.rate_hz=25"], standalone_mode=False)
    assert "# ours" in clinic.config.read_text()
    assert load_config(clinic.config) == Config(
        language="zh", camera=Config().camera.__class__(rate_hz=25.0), joints=JointsConfig(kind="can")
    )
    assert "language: en → zh" in capsys.readouterr().out
    for wrong, code in {
        "camera.rate_hz=1e9": ConfigFault.NOT_CHANGED,
        "nonsense=1": ConfigFault.NOT_CHANGED,
        "camera=1": ConfigFault.NOT_CHANGED,
        "language.x=1": ConfigFault.NO_SUCH_FIELD,
    }.items():
        signs_in(monkeypatch, "Ada")
        before = clinic.config.read_bytes()
        with pytest.raises(AppError) as refused:
            COMMANDS["configure"].main([wrong], standalone_mode=False)
        assert refused.value.code is code
        assert clinic.config.read_bytes() == before


class TestTokens:
    """Scripts."""

    @pytest.fixture
    def token(self, clinic: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """Ben's, to edit patients for eight hours."""
        signs_in(monkeypatch, "Ben")
        path = tmp_path / "token"
        COMMANDS["operator token"].main([str(path)], standalone_mode=False)
        monkeypatch.setattr(permissions, "is_terminal", lambda: False)
        monkeypatch.setenv(TOKEN_VARIABLE, str(path))
        return path

    def test_a_script_changes_what_its_token_allows(self, clinic: Home, token: Path) -> None:
        assert token.stat().st_mode & 0o777 == 0o600
        COMMANDS["profile set"].main(["demo", "mass_kg=71"], standalone_mode=False)
        last = [record for record in records(clinic.logs / JOURNAL) if isinstance(record.body, Change)][-1]
        assert (last.operator, last.body.proof) == ("Ben", "token")  # type: ignore[union-attr]
        for name in ("profile calibrate", "can zero", "operator add"):
            with pytest.raises(AppError) as refused:
                call(name)
            assert refused.value.code is AuthorityFault.NOT_BY_TOKEN
            assert wording(refused.value)

    @pytest.mark.parametrize(("name", "known"), [("Ada", "operate, calibrate, configure"), ("Rex", "review")])
    def test_who_has_not_the_usual_right_is_told_which_to_name(
        self, clinic: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, known: str
    ) -> None:
        signs_in(monkeypatch, name)
        with pytest.raises(AppError) as refused:
            COMMANDS["operator token"].main([str(tmp_path / "token")], standalone_mode=False)
        assert refused.value.code is CliFault.TOKEN_FOR_WHAT
        assert known in wording(refused.value)[0]
        assert not (tmp_path / "token").exists()

    def test_it_expires_and_its_pin_voids_it(self, clinic: Home, token: Path) -> None:
        assert by_token(clinic, token).proof is Proof.TOKEN
        faults = [refusal(clinic, token, now_s=4e9)]
        give_pin(enrolled(clinic), "Ben", "135790")
        faults.append(refusal(clinic, token))
        assert faults == [TokenFault.EXPIRED, TokenFault.REVOKED]

    def test_a_changed_foreign_or_open_one_is_refused(self, clinic: Home, token: Path) -> None:
        data = token.read_bytes()
        token.write_bytes(data.replace(b"Ben", b"Ada"))
        assert refusal(clinic, token) is TokenFault.NOT_OURS
        token.write_bytes(re.sub(rb'"expires_s":[0-9.]+', b'"expires_s":9e9', data))
        assert refusal(clinic, token) is TokenFault.NOT_OURS
        token.write_bytes(b"{")
        assert refusal(clinic, token) is TokenFault.UNREADABLE
        token.write_bytes(data)
        token.chmod(0o644)
        assert refusal(clinic, token) is TokenFault.EXPOSED
        token.unlink()
        assert refusal(clinic, token) is TokenFault.UNREADABLE

    def test_none_manages_operators_or_begets_another(self, clinic: Home, token: Path) -> None:
        with pytest.raises(AppError, match="NEVER_BY_TOKEN"):
            issue_token(enrolled(clinic), frozenset({Permission.MANAGE_OPERATORS}), 1.0)
        with pytest.raises(AppError, match="PIN_NEEDED"):
            issue_token(by_token(clinic, token), frozenset({Permission.EDIT_PATIENTS}), 1.0)


def enrolled(home: Home) -> Authority:
    authority, _ = permissions_of(home)
    return authority


def permissions_of(home: Home) -> tuple[Authority, object]:
    from app.system.authority import sign_in_by_pin

    authority, result = sign_in_by_pin(home, "Ada", PIN)
    assert authority is not None
    return authority, result


def refusal(home: Home, token: Path, now_s: float | None = None) -> object:
    with pytest.raises(AppError) as refused:
        by_token(home, token, now_s)
    assert wording(refused.value)
    return refused.value.code


def test_wrong_pins_are_counted_recorded_and_lock_over_restarts(clinic: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, found = 1e9, []
    for _ in range(sign_in.LOCKS_AFTER + 2):
        signs_in(monkeypatch, "Ben", "000111")
        monkeypatch.setattr("app.cli.permission.time.time", lambda: now_s)  # noqa: B023 - called at once
        with pytest.raises(AppError) as refused:
            call("profile new")
        found.append(refused.value.code.name)
        now_s += 1000.0
    assert found == ["WRONG_NAME_OR_PIN"] * sign_in.LOCKS_AFTER + ["LOCKED"] * 2
    signs_in(monkeypatch, "Ben")
    with pytest.raises(AppError, match="LOCKED") as refused:
        call("profile new")
    assert wording(refused.value)
    failed = [record for part in parts_of(clinic.logs / OPERATORS) for record in records(part)]
    assert sum(isinstance(record.body, SignInFailed) for record in failed) == sign_in.LOCKS_AFTER + 3
    give_pin(enrolled(clinic), "Ben", "135790")
    assert sign_in.try_pin(clinic.keys, "Ben", "135790", now_s).operator is not None


AT_ITS_TERMINAL = """
import fcntl, termios
from app.cli import main
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
main()
"""


def at_a_terminal(home: Home, name: str, pin: str) -> tuple[int, str]:
    """`rleex profile archive demo` as a process of its own at a terminal of its own; its status and what it printed."""
    ours, theirs = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-c", AT_ITS_TERMINAL, "profile", "archive", "demo", "--home", str(home.root)],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )
    os.close(theirs)
    answers, printed = [name, pin], ""
    try:
        with in_time(60):
            while text := _read(ours):
                printed += text
                if answers and printed.rstrip().endswith(":"):
                    while len(answers) == 1 and termios.tcgetattr(ours)[3] & termios.ECHO:
                        time.sleep(0.01)  # what is typed before its echo is off is discarded
                    os.write(ours, answers.pop(0).encode() + b"\n")
            return child.wait(), printed
    finally:
        child.kill()
        child.wait()
        os.close(ours)


def _read(terminal: int) -> str:
    try:
        return os.read(terminal, 4096).decode()
    except OSError:  # it has ended
        return ""


def test_from_outside_wrong_pins_make_the_right_one_wait_and_lock_it(clinic: Home) -> None:
    """Each attempt is a process: what was tried before it counts."""
    for _ in range(sign_in.FREE_FAILURES + 4):
        assert sign_in.try_pin(clinic.keys, "Ada", "000111", time.time()).operator is None
        _let_the_wait_pass(clinic, "Ada")
    assert sign_in.try_pin(clinic.keys, "Ada", "000111", time.time()).wait_s > 10.0
    status, printed = at_a_terminal(clinic, "Ada", PIN)
    assert (status, "wait" in printed) == (2, True), printed
    for _ in range(sign_in.LOCKS_AFTER):
        sign_in.try_pin(clinic.keys, "Ben", "000111", time.time())
        _let_the_wait_pass(clinic, "Ben")
    status, printed = at_a_terminal(clinic, "Ben", PIN)
    assert (status, "locked" in printed) == (2, True), printed


def _let_the_wait_pass(home: Home, name: str) -> None:
    store = operators.load_store(home.keys)
    after = tuple(
        msgspec.structs.replace(one, wait_until_s=0.0) if one.name == name else one for one in store.operators
    )
    operators.save_store(home.keys, msgspec.structs.replace(store, operators=after))


def test_only_signing_in_makes_an_authority(home: Home) -> None:
    with pytest.raises(TypeError):
        Authority(
            home=home,
            name="Dr Nobody",
            role=Role.ENGINEER,
            permissions=frozenset(Permission),
            proof=Proof.PIN,
            origin=object(),
        )
    with pytest.raises(AppError, match="NO_OPERATORS"):
        unsigned(home, Config())  # the home's own joints are real, whatever a command line chose
