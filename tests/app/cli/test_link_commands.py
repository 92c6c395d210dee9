"""rleex joints and rleex link from the command line: what is refused ends with one sentence and exit status 2."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from app.cli import common, main
from app.demo.two_hosts import free_port, joints_process, wait_for
from app.link import wire
from app.link.keys import Peer, add_peer
from app.system.paths import Home


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Home:
    place = Home(tmp_path / "home")
    place.root.mkdir()
    monkeypatch.setenv("RLEEX_HOME", str(place.root))
    return place


def test_the_port_without_the_links_imports_is_the_links_own() -> None:
    assert common.PORT == wire.PORT


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    monkeypatch.setattr("sys.argv", ["rleex", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    monkeypatch.setattr("sys.argv", ["rleex", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    return capsys.readouterr().out


def test_the_system_s_refusal_names_its_file(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home.models.touch()
    assert str(home.models) in refused(monkeypatch, capsys, "model")


@pytest.mark.usefixtures("home")
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("link", "pair", "exo local"), "no address"),
        (("link", "pair", "127.0.0.1:9", "--code", "1234-5678"), "No answer from 127.0.0.1:9"),
        (("link", "pair", "127.0.0.1", "--port", "9", "--code", "1234-5678"), "No answer from 127.0.0.1:9"),
        (("link", "pair", "127.0.0.1:9", "--port", "8"), "no use for --port"),
        (("link", "pair", "--code", "1234-5678"), "no use for --code"),
        (("link", "forget", "exo"), "No paired computer is called exo"),
        (("link", "pair", "--port", "9"), "does not answer on port 9"),
    ],
)
def test_what_cannot_be_is_told_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    assert said in refused(monkeypatch, capsys, *arguments)


def test_a_code_is_shown_only_where_the_service_looks_for_it(
    home: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("app.link.pairing.LASTS_S", 0.0)  # nobody is to type it
    service, port = Home(tmp_path / "service"), free_port()
    service.root.mkdir()
    with joints_process(service, port) as process:
        wait_for(f"127.0.0.1:{port}", lambda: process.poll() is None)
        pairing = ("link", "pair", "--port", str(port))
        said = refused(monkeypatch, capsys, *pairing)
        monkeypatch.setattr("sys.argv", ["rleex", *pairing, "--home", str(service.root)])
        with pytest.raises(SystemExit):
            main()
        shown = capsys.readouterr()
        assert "The code is used up" in shown.err
        assert shown.out.endswith(f"rleex link pair ADDRESS:{port}\n")
    assert f"`rleex joints` with the home {home.root} does not answer on port {port}" in said


@pytest.mark.usefixtures("home")
def test_a_port_that_somebody_has_is_refused() -> None:
    """In a process of its own: it takes real-time scheduling and leaves control's core before it opens the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("0.0.0.0", 0))
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-c", "from app.cli import main; main()", "joints", "--port", port]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert f"Port {port} can't be used" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_joints_of_another_computer_are_not_served(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home.config.write_text('[joints]\nhost = "exo.local:7447"\n', encoding="utf-8")
    assert "joints.host (exo.local:7447)" in refused(monkeypatch, capsys, "joints")


def test_a_pre_flight_is_kept_on_the_computer_that_has_the_joints(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Control looks there alone."""
    home.config.write_text('[joints]\nhost = "exo.local:7447"\n', encoding="utf-8")
    said = refused(monkeypatch, capsys, "simulate", "sit-down", "-p", "demo", "--preflight")
    assert "joints.host (exo.local:7447)" in said
    assert [path.name for path in home.root.iterdir()] == ["config.toml"]


def test_a_malformed_address_in_the_configuration_is_named(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home.config.write_text('[joints]\nhost = "exo local"\n', encoding="utf-8")
    assert "joints.host" in refused(monkeypatch, capsys, "joints")


def test_the_list_names_peers_and_no_secret(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "Not paired" in run(monkeypatch, capsys, "link", "list")
    exo = Peer(name="exo", public="k" * 40, paired_at="2026-11-24T19:00:00+00:00", host="exo.local:7447")
    add_peer(home, exo)
    listed = run(monkeypatch, capsys, "link", "list")
    assert listed == f"exo  exo.local:7447  2026-11-24T19:00:00+00:00  {exo.fingerprint}\n"


def test_the_service_file_names_program_home_and_port(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = run(monkeypatch, capsys, "joints", "--print-service", "--port", "7500")
    assert f"joints --home {home.root} --port 7500" in text
    unit, service = (part.splitlines() for part in text.split("[Install]")[0].split("[Service]"))
    assert "StartLimitIntervalSec=0" in unit, "else five quick ends in 10 s are the last"
    assert {"Restart=always", "KillMode=process", "OOMPolicy=continue"} <= set(service)
