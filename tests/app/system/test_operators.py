"""Who gets in, who does not, how attempts are slowed down, and what each role may do."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from app.cli import cli, permission
from app.system.config import Config, JointsConfig
from app.system.errors import AppError
from app.system.operators import (
    PERMISSIONS,
    OperatorFault,
    OperatorStore,
    Permission,
    Role,
    add_operator,
    change_pin,
    disable_operator,
    load_store,
    needs_sign_in,
    save_store,
    store_held,
)
from app.system.paths import Home
from app.system.sign_in import FREE_FAILURES, LOCKS_AFTER, LONGEST_WAIT_S, is_locked, sign_in, try_pin, wait_after
from logs.journal import CHANGES, OPERATORS
from logs.keys import by_fingerprint, known_keys
from logs.read import records
from logs.records import Change, SignInFailed
from logs.verify import Evidence, exit_status, verify
from tests.support.disks import full_disk, read_only_disk

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN, OTHER_PIN = "135792", "802461"


@pytest.fixture
def store() -> OperatorStore:
    """An engineer and a therapist."""
    return add_operator(add_operator(OperatorStore(), "Eva", Role.ENGINEER, PIN), "Tom", Role.THERAPIST, OTHER_PIN)


def test_the_right_pin_lets_in_and_forgets_failures(store: OperatorStore) -> None:
    failed = sign_in(store, "Tom", PIN, 0.0)
    assert failed.operator is None
    good = sign_in(failed.store, " tom ", OTHER_PIN, 1.0)
    assert good.operator is not None
    assert (good.operator.name, good.operator.failures) == ("Tom", 0)


def test_names_and_pins_are_refused_with_the_same_text(store: OperatorStore) -> None:
    assert sign_in(store, "Tom", PIN, 0.0).fault is sign_in(store, "Nobody", PIN, 0.0).fault


def test_a_disabled_operator_stays_out_and_in_the_store(store: OperatorStore) -> None:
    disabled = disable_operator(store, "Tom")
    assert sign_in(disabled, "Tom", OTHER_PIN, 0.0).operator is None
    assert disabled.find("Tom") is not None
    assert sign_in(change_pin(disabled, "Tom", PIN), "Tom", PIN, 0.0).operator is not None


@pytest.mark.parametrize("name", ["Tom", "Nobody"])
def test_failures_wait_longer_and_longer_and_a_wait_is_not_cut_short(store: OperatorStore, name: str) -> None:
    now_s = 0.0
    waits: list[float] = []
    for _ in range(LOCKS_AFTER):
        attempt = sign_in(store, name, "000000", now_s)
        store, waits = attempt.store, [*waits, attempt.wait_s]
        if attempt.wait_s > 0:
            early = sign_in(store, name, OTHER_PIN, now_s + attempt.wait_s * 0.9)
            assert early.operator is None
            assert early.store == store
        now_s += attempt.wait_s
    assert waits[:FREE_FAILURES] == [0.0] * FREE_FAILURES
    assert waits == sorted(waits)
    assert waits[-1] == LONGEST_WAIT_S
    locked = sign_in(store, name, OTHER_PIN, now_s)
    fault = OperatorFault.LOCKED if name == "Tom" else OperatorFault.WRONG_NAME_OR_PIN
    assert (locked.operator, locked.fault) == (None, fault)
    assert [one.name for one in store.operators if is_locked(store, one)] == ["Tom"] * (name == "Tom")
    found = sign_in(change_pin(store, "Tom", PIN), "Tom", PIN, now_s)
    assert (found.operator is not None, found.store.stranger_failures) == (True, 0)


def test_the_last_engineer_waits_and_is_never_locked_out(store: OperatorStore) -> None:
    now_s = 0.0
    for _ in range(3 * LOCKS_AFTER):
        attempt = sign_in(store, "Eva", "000000", now_s)
        store, now_s = attempt.store, now_s + attempt.wait_s
    assert sign_in(store, "Eva", PIN, now_s).operator is not None


def test_pins_tried_side_by_side_all_count(tmp_path: Path, store: OperatorStore) -> None:
    save_store(tmp_path, store)
    tried = FREE_FAILURES + 1  # any further one would have to wait, and is not tried
    with ThreadPoolExecutor(tried) as pool:
        list(pool.map(lambda number: try_pin(tmp_path, "Tom", f"99900{number}", 1000.0), range(tried)))
    tom = load_store(tmp_path).find("Tom")
    assert tom is not None
    assert tom.failures == tried


@pytest.mark.parametrize("name", ["Tom", "Nobody"])
def test_a_clock_set_back_locks_nobody_out_and_goes_on_counting(store: OperatorStore, name: str) -> None:
    for _ in range(FREE_FAILURES + 1):
        store = sign_in(store, name, PIN, 1e9).store
    assert sign_in(store, name, OTHER_PIN, 1e9).fault is OperatorFault.TOO_MANY_ATTEMPTS
    wrong = sign_in(store, name, PIN, 0.0)
    assert (wrong.failures, wrong.wait_s) == (FREE_FAILURES + 2, wait_after(FREE_FAILURES + 2))
    assert sign_in(store, "Tom", OTHER_PIN, 0.0).operator is not None


@pytest.mark.parametrize("disk", [full_disk, read_only_disk])
@pytest.mark.parametrize("failures", [0, 1])
def test_a_disk_that_takes_nothing_keeps_the_right_pin_from_nothing(
    tmp_path: Path, store: OperatorStore, disk: Callable[[], AbstractContextManager[None]], failures: int
) -> None:
    save_store(tmp_path, store)
    for _ in range(failures):
        try_pin(tmp_path, "Tom", PIN, 0.0)
    with store_held(tmp_path):
        kept = load_store(tmp_path)
    with disk():
        right = try_pin(tmp_path, "Tom", OTHER_PIN, 0.0)
        with pytest.raises(AppError, match="STORE_NOT_SAVED"):
            try_pin(tmp_path, "Tom", PIN, 0.0)
    assert right.operator is not None
    assert load_store(tmp_path) == kept


@given(st.integers(min_value=0, max_value=10_000))
def test_a_wait_never_shrinks_with_failures(failures: int) -> None:
    assert 0.0 <= wait_after(failures) <= wait_after(failures + 1) <= LONGEST_WAIT_S


@given(st.text(max_size=20))
@settings(deadline=None)
def test_a_pin_is_six_to_twelve_digits_that_nobody_tries_first(pin: str) -> None:
    digits = pin.isascii() and pin.isdigit() and 6 <= len(pin) <= 12
    if not digits:
        with pytest.raises(AppError, match="BAD_PIN"):
            add_operator(OperatorStore(), "Eva", Role.ENGINEER, pin)


@pytest.mark.parametrize("pin", ["000000", "123456", "987654", "77777777"])
def test_pins_that_count_or_repeat_are_refused(pin: str) -> None:
    with pytest.raises(AppError, match="GUESSABLE_PIN"):
        add_operator(OperatorStore(), "Eva", Role.ENGINEER, pin)


@pytest.mark.parametrize("name", ["", "   ", "a\x1bb", "x" * 61, "\u202eEva"])
def test_unusable_names_are_refused(name: str) -> None:
    with pytest.raises(AppError, match="BAD_NAME"):
        add_operator(OperatorStore(), name, Role.ENGINEER, PIN)


def test_the_first_is_an_engineer_and_the_last_engineer_stays(store: OperatorStore) -> None:
    with pytest.raises(AppError, match="FIRST_NOT_ENGINEER"):
        add_operator(OperatorStore(), "Tom", Role.THERAPIST, PIN)
    with pytest.raises(AppError, match="LAST_ENGINEER"):
        disable_operator(store, "eva")
    with pytest.raises(AppError, match="NAME_TAKEN"):
        add_operator(store, "EVA", Role.REVIEWER, PIN)


def test_only_engineers_manage_operators_and_reviewers_move_nobody() -> None:
    assert [role for role in Role if Permission.MANAGE_OPERATORS in PERMISSIONS[role]] == [Role.ENGINEER]
    assert PERMISSIONS[Role.REVIEWER] == {Permission.REVIEW}
    assert set(PERMISSIONS) == set(Role)


def test_sign_in_is_needed_where_drives_can_move() -> None:
    assert not needs_sign_in(Config())
    assert needs_sign_in(Config(joints=JointsConfig(kind="can")))


def test_the_store_is_kept_private_and_comes_back(tmp_path: Path, store: OperatorStore) -> None:
    save_store(tmp_path, store)
    assert load_store(tmp_path) == store
    assert (tmp_path / "operators.json").stat().st_mode & 0o777 == 0o600
    assert PIN.encode() not in (tmp_path / "operators.json").read_bytes()
    assert load_store(tmp_path / "nowhere") == OperatorStore()
    (tmp_path / "operators.json").write_text("{")
    with pytest.raises(AppError, match="STORE_UNREADABLE"):
        load_store(tmp_path)


def test_the_list_shows_who_is_locked_or_disabled(tmp_path: Path, store: OperatorStore) -> None:
    failed = [msgspec.structs.replace(one, failures=LOCKS_AFTER) for one in store.operators]
    for enabled, word in ((True, "locked"), (False, "disabled")):
        eva, tom = failed[0], msgspec.structs.replace(failed[1], enabled=enabled)
        save_store(Home(tmp_path).keys, OperatorStore(operators=(eva, tom)))
        printed = CliRunner().invoke(cli, ["operator", "list", "--home", str(tmp_path)]).output
        states = {name: word in line for line in printed.splitlines() for name in ("Eva", "Tom") if name in line}
        assert states == {"Eva": False, "Tom": True}, printed  # the last engineer only waits


def test_operators_are_managed_from_the_command_line_and_all_of_it_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(permission, "is_terminal", lambda: True)

    def rleex(*arguments: str, answers: str = "") -> str:
        result = CliRunner().invoke(cli, ["operator", *arguments, "--home", str(tmp_path)], input=answers)
        return result.output + str(result.exception or "")

    assert "added as engineer" in rleex("add", "Eva", "--role", "engineer", answers=f"{PIN}\n{PIN}\n")
    assert "WRONG_NAME_OR_PIN" in rleex("add", "Tom", answers="Eva\n999999\n")
    assert "added as therapist" in rleex("add", "Tom", answers=f"Eva\n{PIN}\n{OTHER_PIN}\n{OTHER_PIN}\n")
    assert "NOT_ALLOWED" in rleex("disable", "Eva", answers=f"Tom\n{OTHER_PIN}\n")
    assert "can't sign in" in rleex("disable", "Tom", answers=f"Eva\n{PIN}\n")
    assert "disabled" in rleex("list")
    assert "NO_SUCH_ROLE" in rleex("add", "X", "--role", "king")
    bodies = [record.body for record in records(tmp_path / "logs" / OPERATORS)]
    changed = [(record.operator, record.body) for record in records(tmp_path / "logs" / CHANGES)]
    changes = [(by, one.name, one.values) for by, one in changed if isinstance(one, Change)]
    assert changes == [
        ("Eva", "Eva", {"role": (None, "engineer")}),
        ("Eva", "Tom", {"role": (None, "therapist")}),
        ("Eva", "Tom", {"enabled": (True, False)}),
    ]
    assert [body.failures for body in bodies if isinstance(body, SignInFailed)] == [1]
    evidence = Evidence(keys=by_fingerprint(known_keys(tmp_path / "keys")))
    assert exit_status(verify([tmp_path / "logs"], evidence)) == 0
