"""Is this machine fit for a session? Each finding comes with the command that repairs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import Enum
from pathlib import Path

from app.diagnostics.computer import check_clock, check_disk, check_real_time, check_terminal
from app.diagnostics.doctor_codes import DoctorFinding, Remedy, Subject, run
from app.diagnostics.findings import Finding, bad, good, note
from app.link.wire import LinkFault
from app.system.config import Config, load_config
from app.system.errors import AppError
from app.system.hand_model import ModelFault, find_model
from app.system.paths import Home
from app.voice.spotter import require_spotter
from hal.errors import HardwareError
from hal.inputs.device import Contact, InputDevice, StopInput
from hal.inputs.reader import InputReader, make_input
from hal.microphone import make_microphone
from logs.reason import Reason, reason, reason_of

MICROPHONE_BLOCKS = 10  # a second
F, R, T = DoctorFinding, Remedy, Subject


def examine(home: Home) -> Iterator[Finding]:
    """Every check, one after the other."""
    try:
        config = load_config(home.config)
    except AppError as error:
        yield bad(T.SETTINGS, reason_of(error), reason(R.EDIT_SETTINGS, path=home.config))
        config = Config()
    yield from check_model(home, config)
    yield from check_cameras(config)
    yield from check_realsense(config)
    yield from check_terminal(os.environ, is_terminal=sys.stdout.isatty())
    yield from check_real_time()
    yield from check_disk(home, config)
    yield from check_clock()
    yield from check_joints(config)
    yield from check_stop_buttons(config)
    yield from check_voice(config)
    yield from check_link(home, config)


def check_model(home: Home, config: Config) -> Iterator[Finding]:
    """The hand model is there and the one that was checked; a computer that serves joints needs none."""
    try:
        yield good(T.MODEL, F.MODEL_FOUND, path=find_model(home, config))
    except AppError as error:
        remedies: dict[Enum, Reason] = {
            ModelFault.DAMAGED: run("rleex model --again"),
            ModelFault.CONFIGURED_MISSING: reason(R.EDIT_SETTINGS, path=home.config),
        }
        grade = note if _serves_joints(home, config) else bad
        yield grade(T.MODEL, reason_of(error), remedies.get(error.code, run("rleex model")))


def _serves_joints(home: Home, config: Config) -> bool:
    """Whether a laptop is paired, which runs perception; keys that can't be read tell of none."""
    from app.link.keys import peers_of

    with suppress(AppError):
        return not config.joints.host and any(not peer.host for peer in peers_of(home))
    return False


def check_cameras(config: Config, devices: Path = Path("/dev")) -> Iterator[Finding]:
    """Video devices, and whether this user may read them."""
    found = sorted(devices.glob("video*"))
    readable = [path for path in found if os.access(path, os.R_OK | os.W_OK)]
    needed = config.camera.kind == "webcam"
    if readable:
        yield good(T.CAMERA, F.CAMERAS_READABLE, devices=", ".join(map(str, readable)))
    elif found:
        remedy = reason(R.RUN_THEN_LOG_IN, command=f"sudo usermod -aG video {os.environ.get('USER', '$USER')}")
        yield (bad if needed else note)(T.CAMERA, reason(F.CAMERA_NOT_PERMITTED, device=found[0]), remedy)
    elif needed:
        yield bad(T.CAMERA, reason(F.CAMERA_MISSING), reason(R.PLUG_IN))
    else:
        yield note(T.CAMERA, reason(F.CAMERA_NOT_NEEDED, kind=Reason(f"camera.{config.camera.kind}")))


def check_realsense(config: Config) -> Iterator[Finding]:
    """The RealSense library can be loaded."""
    grade = bad if config.camera.kind == "realsense" else note
    try:
        import pyrealsense2
    except ImportError as error:
        if "libusb" in str(error):
            install = run("sudo apt-get install libusb-1.0-0")
            yield grade(T.REALSENSE, reason(F.REALSENSE_NOT_LOADED, detail=str(error)), install)
        else:
            install = run(".venv/bin/python -m pip install --no-deps pyrealsense2")
            yield grade(T.REALSENSE, reason(F.REALSENSE_NOT_INSTALLED), install)
        return
    yield good(T.REALSENSE, F.REALSENSE_LOADED, version=getattr(pyrealsense2, "__version__", "?"))


def check_link(home: Home, config: Config) -> Iterator[Finding]:
    """The computer that has the joints: whether it answers, its version, its clock, and whether they are paired."""
    host = config.joints.host
    if not host:
        return
    from app.link.keys import PEERS, joints_at
    from app.link.questions import check_version, find

    try:
        found = find(host)
    except AppError as error:
        yield bad(T.LINK, reason_of(error), reason(R.CHECK_OTHER_COMPUTER))
        return
    try:
        check_version(host, found.link, found.program)
    except AppError as error:
        yield bad(T.LINK, reason_of(error), reason(R.UPDATE_OLDER))
        return
    values = {"round_trip_ms": found.round_trip_ns / 1e6, "uncertainty_ms": found.uncertainty_ns / 1e6}
    yield good(T.LINK, F.LINK_ANSWERS, host=host, version=found.program, offset_s=found.offset_ns / 1e9, **values)
    pair = f"rleex link pair {host}"
    try:
        if joints_at(home, host) is None:
            yield bad(T.LINK, reason(LinkFault.NOT_PAIRED, host=host), run(pair))
    except AppError as error:
        yield bad(T.LINK, reason_of(error), run(f"rm {home.link_keys / PEERS} && {pair}"))


def check_joints(config: Config) -> Iterator[Finding]:
    """The joints' buses, without asking the drives: `rleex can doctor` does."""
    if config.joints.host:
        return
    from app.diagnostics.can_doctor import examine as examine_can
    from app.system.config import load_device
    from hal.joints.can.bus import with_bus

    chosen = config.joints
    try:
        device = load_device(chosen)
        if chosen.kind != "can":
            yield note(T.JOINTS, reason(F.JOINTS_SIMULATED))
            return
        device = with_bus(device, chosen.interface, chosen.channel)
    except HardwareError as error:
        yield bad(T.JOINTS, reason_of(error), None)  # it says itself what to do
        return
    yield from examine_can(device, Path(chosen.motors) if chosen.motors else None, ask=False)


def check_stop_buttons(
    config: Config, make: Callable[[InputDevice, Path], StopInput] = make_input
) -> Iterator[Finding]:
    """Whether the contact of each stop button is closed now, on the computer that reads them: the joints'."""
    if config.joints.host:
        return
    if not config.inputs:
        yield note(T.STOP_BUTTON, reason(F.NO_STOP_BUTTON))
        return
    devices = tuple(device for device in config.inputs if device.kind != "simulated")
    for device in config.inputs:
        if device not in devices:
            yield note(T.STOP_BUTTON, reason(F.STOP_BUTTON_SIMULATED, name=device.name))
    reader = InputReader(devices, tuple(make(device, Path()) for device in devices))
    try:
        reader.start()
        readings = reader.newest.inputs
    finally:
        reader.close()
    for one in readings:
        values = {"name": one.name, "role": one.role}
        if one.contact is Contact.CLOSED:
            yield good(T.STOP_BUTTON, F.STOP_BUTTON_CLOSED, **values)
        elif one.contact is Contact.OPEN:
            yield bad(T.STOP_BUTTON, reason(F.STOP_BUTTON_OPEN, **values), reason(R.RELEASE_BUTTON))
        else:
            why = reason(F.STOP_BUTTON_SILENT, **values) if one.fault is None else reason_of(one.fault)
            yield bad(T.STOP_BUTTON, why, reason(R.CONNECT_BUTTON, name=one.name))


def check_voice(config: Config) -> Iterator[Finding]:
    """Whether a microphone is there and gives sound; a session is fit without it."""
    voice = config.voice
    if not voice.on:
        yield note(T.VOICE, reason(F.VOICE_OFF))
        return
    microphone, device = make_microphone(voice, lambda: None), voice.device or "default"
    try:
        require_spotter()
        microphone.open()
        sound = any(any(microphone.read()) for _ in range(MICROPHONE_BLOCKS))
    except HardwareError as error:
        yield note(T.VOICE, reason_of(error))
        return
    finally:
        microphone.close()
    if sound:
        yield good(T.VOICE, F.MICROPHONE_FOUND, device=device)
    else:
        yield note(T.VOICE, reason(F.MICROPHONE_MUTE, device=device))
