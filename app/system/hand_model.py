"""The hand model: found by path, or built once from the last mediapipe wheel that carries its two networks.

mediapipe 1.x ships no weights; version 0.10.21 is the last whose wheel does. The wheel is fetched by pip (so the
user's own index settings apply), its two networks are checked by SHA-256 and stored, uncompressed, as the bundle
that the hand landmarker task expects.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from enum import Enum
from pathlib import Path

from app.system.config import Config
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.regular import path_named

MODEL_NAME = "hand_landmarker.task"
BUNDLE_SHA256 = "ef3f184fa8d5e6905ea4770282627d6937975119af763054312d05985c059bda"
_REQUIREMENT = "mediapipe==0.10.21"
# Any of its wheels carries the same networks; a fixed one makes the same download on every host.
_WHEEL_OPTIONS = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.11", "--implementation", "cp")
# name in the bundle → (path in the wheel, SHA-256)
_NETWORKS = {
    "hand_detector.tflite": (
        "mediapipe/modules/palm_detection/palm_detection_full.tflite",
        "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    ),
    "hand_landmarks_detector.tflite": (
        "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
        "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
    ),
}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # fixed times make the bundle the same bytes everywhere


class ModelFault(Enum):
    """Why there is no usable hand model."""

    CONFIGURED = "configured"
    CONFIGURED_MISSING = "configured, missing"
    MISSING = "missing"
    DAMAGED = "damaged"
    UNEXPECTED_NETWORK = "unexpected network"
    NOT_IN_WHEEL = "not in the wheel"
    NOT_DOWNLOADED = "not downloaded"


def find_model(home: Home, config: Config) -> Path:
    """The model this home uses. Raises AppError when it is missing or not the one that was checked."""
    if config.model:
        path = path_named(config.model)
        if not path.is_file():
            raise AppError(ModelFault.CONFIGURED_MISSING, path=path)
        return path
    path = home.models / MODEL_NAME
    if not path.is_file():
        raise AppError(ModelFault.MISSING, path=path)
    if _sha256(path.read_bytes()) != BUNDLE_SHA256:
        raise AppError(ModelFault.DAMAGED, path=path)
    return path


def set_up_model(home: Home, config: Config, *, again: bool = False) -> Path:
    """Find the model, or download and build it. Raises AppError naming what is missing.

    again: build it in place of one that is there, which stays until then.
    """
    path = home.models / MODEL_NAME
    if again and config.model:
        raise AppError(ModelFault.CONFIGURED, path=config.model)
    if config.model or (path.is_file() and not again):
        return find_model(home, config)
    with tempfile.TemporaryDirectory() as folder:
        bundle = build_bundle(_download(Path(folder)))
    home.models.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.partial")
    partial.write_bytes(bundle)
    partial.replace(path)
    return path


def build_bundle(wheel: Path) -> bytes:
    """The task bundle, from the networks in a mediapipe wheel. Raises AppError when one is not as published."""
    target = wheel.with_name(MODEL_NAME)
    try:
        with zipfile.ZipFile(wheel) as source, zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as out:
            for name, (inside, expected) in _NETWORKS.items():
                network = source.read(inside)
                if _sha256(network) != expected:
                    raise AppError(ModelFault.UNEXPECTED_NETWORK, file=inside, wheel=wheel.name)
                out.writestr(zipfile.ZipInfo(name, _EPOCH), network)
    except (KeyError, OSError, zipfile.BadZipFile) as error:
        raise AppError(ModelFault.NOT_IN_WHEEL, wheel=wheel.name, detail=error) from error
    return target.read_bytes()


def _download(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
    command += ["--only-binary=:all:", *_WHEEL_OPTIONS, "--dest", str(folder), _REQUIREMENT]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode or not wheels:
        detail = next((line for line in reversed(done.stderr.splitlines()) if "ERROR" in line), "-")
        raise AppError(ModelFault.NOT_DOWNLOADED, package=_REQUIREMENT, detail=detail.removeprefix("ERROR: "))
    return wheels[0]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
