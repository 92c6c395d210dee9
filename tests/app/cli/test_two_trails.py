"""`rleex audit verify A B` and `merge A B`: the trails of two computers together."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from logs.mirror import SUFFIX
from logs.records import Note
from tests.app.cli.test_audit_commands import audit
from tests.support.two_trails import Host, sign_again, two_hosts


@pytest.fixture
def hosts(tmp_path: Path) -> tuple[Host, Host]:
    return two_hosts(tmp_path, seconds=3)


def test_verify_proves_the_join_each_by_its_own_consoles_key(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    findings = tmp_path / "findings.json"
    for places in ([host.path for host in hosts], [host.path.parent for host in hosts]):
        status, said = audit("verify", *map(str, places), "--json", str(findings))
        assert status == 0, said
        assert "s1 → j1" in said
        assert "j1 → s1" in said
        told = json.loads(findings.read_text())
        assert [join["status"] for join in told["joins"]] == ["sound", "sound"]
        assert {join["mentions"] for join in told["joins"]} == {3}


def test_verify_tells_the_first_contradiction_of_a_trail_that_was_signed_again(hosts: tuple[Host, Host]) -> None:
    console, joints = hosts
    sign_again(joints.path, joints.key, lambda found: [*found[:15], *found[16:]])
    for path in joints.path.parent.glob("manifest*"):
        path.unlink()  # its owner can do this, too
    alone, _ = audit("verify", str(joints.path))
    status, said = audit("verify", str(console.path), str(joints.path))
    assert (alone, status) == (0, 1), said
    assert "one of the two was rewritten, after record 11 of the other trail" in said


def test_one_trail_alone_proves_no_join_and_says_so(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    status, said = audit("verify", str(hosts[0].path))
    assert status == 0
    assert "session j1 3 times" in said
    strange, _ = two_hosts(tmp_path / "strange", seconds=1)
    status, said = audit("verify", str(hosts[0].path), str(strange.path))
    assert status == 1, "both were to be proven together"


def test_a_mirror_of_one_computer_says_nothing_of_the_others_trail(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    console, joints = hosts
    mirror = tmp_path / "mirror"
    mirror.mkdir()
    signed = [line for line in console.path.read_bytes().splitlines(keepends=True) if b'"checkpoint"' in line]
    for host in hosts:  # a session's trails have one name on both
        (mirror / (host.path.name + SUFFIX)).write_bytes(b"".join(signed))
    status, said = audit("verify", str(console.path), str(joints.path), "--copies", str(mirror))
    assert status == 0, said
    assert said.count("agree with the mirror") == 1
    assert said.count("by other keys only") == 1


def test_merge_prints_one_timeline(hosts: tuple[Host, Host]) -> None:
    paths = [str(host.path) for host in hosts]
    status, said = audit("merge", *paths)
    assert status == 0, said
    lines = said.splitlines()
    noted = [int(line.split()[-1]) for line in lines if " note " in line]
    assert noted == sorted(noted)
    assert len(noted) == 60
    assert "uncertain by at most" in said
    status, said = audit("merge", "--json", *paths)
    assert (status, said.isascii()) == (0, True)
    assert [json.loads(line)["at_ns"] for line in said.splitlines()] == sorted(
        json.loads(line)["at_ns"] for line in said.splitlines()
    )
    status, said = audit("merge", *paths, "--json")
    rows = [json.loads(line) for line in said.splitlines()]
    assert [row["at_ns"] for row in rows] == sorted(row["at_ns"] for row in rows)
    assert {row["trail"] for row in rows} == set(paths)


def test_merge_takes_sessions_by_name(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    paths = [tmp_path / "logs" / name for name in ("a.jsonl", "b.jsonl")]
    paths[0].parent.mkdir()
    for path, host in zip(paths, hosts, strict=True):
        path.write_bytes(host.path.read_bytes())
    status, said = audit("merge", "a", "b", "--home", str(tmp_path), "--json")
    assert status == 0, said
    assert said == audit("merge", *map(str, paths), "--json")[1]


def test_merge_refuses_what_does_not_belong_together(hosts: tuple[Host, Host], tmp_path: Path) -> None:
    strange, _ = two_hosts(tmp_path / "strange", seconds=2)
    status, said = audit("merge", str(hosts[0].path), str(strange.path))
    assert status != 0
    assert "do not belong together" in said
    sign_again(hosts[1].path, hosts[1].key, lambda found: [one for one in found if not isinstance(one.body, Note)])
    assert "contradict each other" in audit("merge", *(str(host.path) for host in hosts))[1]
    empty = tmp_path / "empty.jsonl"
    empty.touch()
    assert "holds no record of" in audit("merge", str(hosts[0].path), str(empty))[1]
    assert "nothing.jsonl" in audit("merge", str(hosts[0].path), str(tmp_path / "nothing.jsonl"))[1]
