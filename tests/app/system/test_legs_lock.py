"""One session has the legs, whoever of it is left."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import pytest
import tomlkit

from app.ipc.links import new_link_directory
from app.system import legs_lock
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.errors import AppError
from app.system.legs_lock import LegsLock, check_legs_free, claim_legs, lock_paths, share_legs
from app.system.paths import Home, LockFault, hold_home
from hal.errors import CanFault, DeviceFault
from hal.joints.device import BusDevice, load_exoskeleton
from profiles.schema import DEMO_PATIENT
from tests.support.disks import read_only_disk
from tests.support.errors import refused

SHARE = """
import sys
from pathlib import Path
from app.system.legs_lock import LegsLock
lock = LegsLock([Path(name) for name in sys.argv[1:]])
lock.share()
print("shared", flush=True)
sys.stdin.read()
"""


def setup_of(home: Path, joints: JointsConfig | None = None) -> SessionSetup:
    """A session of this home."""
    config = Config(joints=joints or JointsConfig())
    links = new_link_directory(home)
    return SessionSetup(session="s", home=home, links=links, config=config, profile=DEMO_PATIENT, operator="")


@contextmanager
def orphan(setup: SessionSetup) -> Iterator[subprocess.Popen[str]]:
    """A process that shares the legs of a session."""
    arguments = [sys.executable, "-c", SHARE, *map(str, lock_paths(setup))]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "shared\n"
        try:
            yield process
        finally:
            process.kill()


def test_whoever_outlives_the_host_keeps_the_next_session_off(tmp_path: Path) -> None:
    setup = setup_of(tmp_path)
    host = claim_legs(setup)
    with orphan(setup) as control:
        host.close()
        with pytest.raises(AppError, match=rf"LEGS_HELD pid={control.pid}\b"):
            claim_legs(setup)
        with pytest.raises(AppError, match="LEGS_HELD"):
            check_legs_free(Home(tmp_path))
        control.kill()
        control.wait()
        check_legs_free(Home(tmp_path))
        claim_legs(setup).close()


def test_another_session_can_neither_claim_nor_share_nor_come_between(tmp_path: Path) -> None:
    setup = setup_of(tmp_path)
    first = claim_legs(setup)
    own = share_legs(setup)
    for end in (first.close, own.close):
        with pytest.raises(AppError, match="LEGS_HELD"):
            claim_legs(setup)
        end()
    alone = LegsLock(lock_paths(setup))
    alone._lock(fcntl.LOCK_EX)  # one who has it alone, before it is shared
    with pytest.raises(AppError, match="LEGS_HELD"):
        share_legs(setup)
    alone.close()


def test_drives_are_the_same_to_every_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(legs_lock, "HOST_FOLDERS", (tmp_path,))
    joints = JointsConfig(kind="can", interface="local", channel="a/b")
    here, there = setup_of(tmp_path / "here", joints), setup_of(tmp_path / "there", joints)
    other = setup_of(tmp_path / "there", msgspec.structs.replace(joints, channel="c"))
    first = claim_legs(here)
    with pytest.raises(AppError, match="LEGS_HELD"):
        claim_legs(there)
    claim_legs(other).close()
    first.close()
    claim_legs(there).close()


def test_a_bus_that_one_program_alone_can_read_is_no_sessions(tmp_path: Path) -> None:
    """Control, guardian and bus log would each receive a third of the frames, in pieces."""
    setup = setup_of(tmp_path, JointsConfig(kind="can", interface="slcan", channel="/dev/ttyACM0"))
    with refused(CanFault.NOT_SHARED, bus="/dev/ttyACM0", interface="slcan"):
        claim_legs(setup)


def test_two_buses_on_one_channel_are_no_sessions(tmp_path: Path) -> None:
    two = msgspec.structs.replace(load_exoskeleton(), buses=(BusDevice(channel="can0"), BusDevice(channel="can1")))
    (tmp_path / "two.toml").write_text(tomlkit.dumps(msgspec.to_builtins(two)))
    setup = setup_of(tmp_path, JointsConfig(kind="can", device=str(tmp_path / "two.toml"), channel="can0"))
    with refused(DeviceFault.CHANNEL_SHARED, device=two.name, count=2, bus="can0"):
        claim_legs(setup)


def test_a_laptop_is_refused_no_bus_that_it_does_not_use(tmp_path: Path) -> None:
    """Its description of joints and device is from when it had the drives itself."""
    joints = JointsConfig(kind="can", interface="slcan", host="exo.local:7447", device=str(tmp_path / "none.toml"))
    assert lock_paths(setup_of(tmp_path, joints)) == (Home(tmp_path).legs_lock,)


def test_drives_are_the_same_to_a_user_who_may_not_write_to_the_first_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "run", tmp_path / "tmp"
    first.mkdir()
    second.mkdir()
    monkeypatch.setattr(legs_lock, "HOST_FOLDERS", (first, second))
    joints = JointsConfig(kind="can", interface="local", channel="a")
    here, there = setup_of(tmp_path / "here", joints), setup_of(tmp_path / "there", joints)
    held = claim_legs(here)
    monkeypatch.setattr(os, "access", lambda path, _: path == second)
    with pytest.raises(AppError, match="LEGS_HELD"):
        claim_legs(there)
    held.close()
    claim_legs(there).close()


@pytest.mark.parametrize(("device", "holders"), [("", "7"), ("00:2a", "7, 8")])
def test_a_lock_on_another_device_is_none_of_this_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str, holders: str
) -> None:
    """device: of the lock as the kernel names it, where it is not the file's."""
    path = tmp_path / "legs.lock"
    held = LegsLock([path])
    held.take_alone()
    file = path.stat()
    device = device or f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}"
    rows = [
        f"{one}: FLOCK  ADVISORY  WRITE {pid} {where}:{file.st_ino} 0 EOF"
        for one, pid, where in ((1, 7, device), (2, 8, "00:2b"))
    ]
    kernel = tmp_path / "locks"
    kernel.write_text("\n".join(rows))
    monkeypatch.setattr(legs_lock, "_HELD", kernel)
    with pytest.raises(AppError) as refused:
        LegsLock([path]).take_alone()
    assert refused.value.values["pid"] == holders
    held.close()


def test_a_file_of_another_user_serves_and_a_link_is_refused(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.touch(mode=0o444)
    lock = LegsLock([file])
    lock.take_alone()
    lock.close()
    link.symlink_to(file)
    with pytest.raises(AppError, match="UNUSABLE"):
        LegsLock([link])
    with suppress(AppError):
        LegsLock([file, link])
    LegsLock([file]).take_alone()


def test_a_strict_umask_keeps_no_other_user_off_the_drives(tmp_path: Path) -> None:
    path = tmp_path / "bus.lock"
    former = os.umask(0o077)
    try:
        LegsLock([path]).close()
    finally:
        os.umask(former)
    assert path.stat().st_mode & 0o777 == 0o644


def test_legs_are_held_on_nfs_and_a_lock_that_fails_names_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = fcntl.flock

    def flock(handle: int, how: int) -> None:
        """As NFS: an exclusive lock needs a file that is open for writing (flock(2))."""
        if how & fcntl.LOCK_EX and fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        real(handle, how)

    monkeypatch.setattr(fcntl, "flock", flock)
    home = Home(tmp_path)
    with hold_home(home):
        check_legs_free(home)
        with read_only_disk(), pytest.raises(AppError) as refused:
            check_legs_free(home)
    assert refused.value.code is LockFault.UNUSABLE
    assert refused.value.values == {"home": home.legs_lock, "detail": os.strerror(errno.EBADF)}
