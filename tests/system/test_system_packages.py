"""The system libraries that `make` looks for."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "tools/system-packages"
LDCONFIG = shutil.which("ldconfig", path="/usr/sbin:/sbin") or ""


@pytest.mark.skipif(not LDCONFIG, reason="no ldconfig here")
def test_a_user_without_sbin_on_the_path_is_asked_only_for_what_is_missing(tmp_path: Path) -> None:
    stubs = {"id": "echo 1000", "sudo": "exit 1", "apt-get": "exit 1", "grep": f'exec {shutil.which("grep")} "$@"'}
    for name, line in stubs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{line}\n")
        (tmp_path / name).chmod(0o755)
    bash = shutil.which("bash")
    assert bash is not None
    done = subprocess.run([bash, SCRIPT], capture_output=True, text=True, check=True, env={"PATH": str(tmp_path)})
    there = subprocess.run([LDCONFIG, "-p"], capture_output=True, text=True, check=True).stdout
    assert ("libusb-1.0-0" in done.stderr) == ("libusb-1.0.so.0" not in there)
    assert ("libegl1" in done.stderr) == ("libEGL.so.1" not in there)
