"""Two trails, one truth: what either names of the other must be there; a trail that is changed alone is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from logs.findings import Finding, Status
from logs.join import Contradiction, Gap, Join, join_findings, joins
from logs.keys import load_or_make_key
from logs.mentions import TrailIndex, index_trail
from logs.reason import key_of
from logs.records import Note, OtherTrail, Record
from logs.scan import scan_file
from logs.verify import Evidence, verify
from tests.support.two_trails import Host, sign_again, two_hosts


@pytest.fixture
def hosts(tmp_path: Path) -> tuple[Host, Host]:
    return two_hosts(tmp_path)


def indexed(*paths: Path) -> list[TrailIndex]:
    return [index_trail(path, scan_file(path, {}).records) for path in paths]


def between(*hosts: Host) -> dict[str, Join]:
    """The joins by the name of the trail that names."""
    return {join.file.stem: join for join in joins(indexed(*(host.path for host in hosts)))}


def code(join: Join) -> str:
    return join.reason.code if join.reason else ""


def test_both_agree_and_what_is_newer_is_counted(hosts: tuple[Host, Host]) -> None:
    found = between(*hosts)
    assert {name: (join.status, join.mentions) for name, join in found.items()} == {
        "s1": (Status.SOUND, 5),
        "j1": (Status.SOUND, 5),
    }
    for host, name in zip(hosts, ("j1", "s1"), strict=True):
        assert found[name].confirmed + found[name].newer == indexed(host.path)[0].records
    assert found["s1"].newer == 3  # of the joints' trail: its own last mention, its end, the closing checkpoint
    assert found["j1"].newer == 2  # of the console's: its end, the closing checkpoint


def changed(found: list[Record]) -> list[Record]:
    found[20] = structs.replace(found[20], body=Note(text="another"))
    return found


def removed(found: list[Record]) -> list[Record]:
    return found[:20] + found[23:]


def added(found: list[Record]) -> list[Record]:
    return [*found[:20], found[19], *found[20:]]


def cut(found: list[Record]) -> list[Record]:
    return found[:20]


def begun_anew(found: list[Record]) -> list[Record]:
    found[0] = structs.replace(found[0], operator="somebody else")
    return found


CHANGES = {
    changed: Contradiction.OTHER_RECORD,
    removed: Contradiction.OTHER_RECORD,
    added: Contradiction.OTHER_RECORD,
    cut: Contradiction.ENDS_BEFORE,
    begun_anew: Contradiction.OTHER_BEGINNING,
}


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(("change", "expected"), CHANGES.items(), ids=lambda one: getattr(one, "__name__", ""))
def test_a_trail_that_its_owner_signs_again_contradicts_the_other(
    hosts: tuple[Host, Host], which: int, change: Callable[[list[Record]], list[Record]], expected: Contradiction
) -> None:
    host, other = hosts[which], hosts[1 - which]
    sign_again(host.path, host.key, change)
    scan = scan_file(host.path, {host.key.public.fingerprint: host.key.public})
    assert scan.fault is None, "by itself it is sound: that is the attack"
    told = between(*hosts)[other.session]
    assert (told.status, code(told)) == (Status.TAMPERED, key_of(expected))
    assert told.reason is not None
    first = next(one for one in indexed(other.path)[0].mentions if one.at == told.sequence)
    if change is not begun_anew:
        assert told.mentions == 1, "the first mention is of a record before the change and still agrees"
        assert (told.reason.values["at"], told.reason.values["sequence"]) == (first.at, first.of.sequence)
        assert told.confirmed <= 20 <= first.of.sequence


def test_a_trail_signed_again_with_another_key_is_told(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    _console, joints = hosts
    sign_again(joints.path, load_or_make_key(tmp_path / "another"), lambda found: found)
    assert code(between(*hosts)["s1"]) == key_of(Contradiction.OTHER_KEY)


def test_a_change_without_signing_again_ends_what_holds(hosts: tuple[Host, Host]) -> None:
    _console, joints = hosts
    joints.path.write_bytes(joints.path.read_bytes().replace(b'"text":"2450000000"', b'"text":"2450000001"'))
    told = between(*hosts)["s1"]
    assert code(told) == key_of(Contradiction.ENDS_BEFORE)
    assert told.mentions == 2


@given(sequence=st.integers(0, 43))
@settings(max_examples=15, deadline=None)
def test_any_single_change_before_the_last_mention_is_told(
    sequence: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    console, joints = two_hosts(tmp_path_factory.mktemp("pair"), seconds=4)

    def change(found: list[Record]) -> list[Record]:
        found[sequence] = structs.replace(found[sequence], operator="somebody else")
        return found

    sign_again(joints.path, joints.key, change)
    assert between(console, joints)["s1"].is_contradiction


def test_only_what_no_mention_covers_can_be_changed_unseen(hosts: tuple[Host, Host]) -> None:
    _console, joints = hosts
    untouched = between(*hosts)["s1"]
    sign_again(joints.path, joints.key, lambda found: found[: untouched.confirmed])
    assert between(*hosts)["s1"].status is Status.SOUND
    sign_again(joints.path, joints.key, lambda found: found[: untouched.confirmed - 1])
    assert between(*hosts)["s1"].is_contradiction


def mentions_moved(found: list[Record]) -> list[Record]:
    """The last mention's content in the place of the first: it names a record of which the other named this trail."""
    named = [one.body for one in found if isinstance(one.body, OtherTrail)]
    first = next(at for at, one in enumerate(found) if isinstance(one.body, OtherTrail))
    found[first] = structs.replace(found[first], body=named[-1])
    return found


def test_a_mention_of_what_did_not_exist_yet_is_told(hosts: tuple[Host, Host]) -> None:
    sign_again(hosts[0].path, hosts[0].key, mentions_moved)
    told = between(*hosts)["s1"]
    assert code(told) == key_of(Contradiction.LATER_THAN_ITS_MENTION)
    assert told.mentions == 0


def test_mentions_out_of_order_are_told(hosts: tuple[Host, Host]) -> None:
    def swapped(found: list[Record]) -> list[Record]:
        places = [at for at, one in enumerate(found) if isinstance(one.body, OtherTrail)]
        two, three = places[1:3]
        found[two], found[three] = (
            structs.replace(found[two], body=found[three].body),
            structs.replace(found[three], body=found[two].body),
        )
        return found

    console, joints = hosts
    sign_again(console.path, console.key, swapped)
    alone = list(indexed(console.path, joints.path))
    alone[1].mentions.clear()  # else the other's mentions tell it first
    assert code(joins(alone)[0]) == key_of(Contradiction.BACKWARDS)


def test_a_missing_trail_and_one_that_names_nothing_are_told(hosts: tuple[Host, Host]) -> None:
    console, joints = hosts
    (alone,) = between(console).values()
    assert (alone.status, code(alone), alone.other) == (Status.INCOMPLETE, key_of(Gap.OTHER_TRAIL_MISSING), None)
    assert alone.reason is not None
    assert alone.reason.values["session"] == "j1"
    both = indexed(console.path, joints.path)
    both[1].mentions.clear()
    silent = next(join for join in joins(both) if join.file == joints.path)
    assert (code(silent), silent.newer) == (key_of(Gap.NAMES_NOTHING), both[0].records)


def test_sessions_of_one_console_say_nothing_of_each_other(hosts: tuple[Host, Host]) -> None:
    _console, _joints = hosts
    findings: list[Finding] = []
    for host in hosts:
        evidence = Evidence(keys={host.key.public.fingerprint: host.key.public})
        findings += verify([host.path.parent], evidence)
    assert {finding.status for finding in findings} == {Status.SOUND}
    assert {join.status for join in join_findings(findings)} == {Status.SOUND}
    assert join_findings([]) == []
