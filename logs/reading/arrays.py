"""numpy's archives (npz) within limits: no pickles, no archive that unpacks to more than it may."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from logs.reading.errors import InputError, InputFault
from logs.reading.regular import open_regular

MAX_ARCHIVE = 1 << 30  # bytes, packed or unpacked


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Every array of an npz by name. Raises OSError, InputError."""
    with open_regular(path, MAX_ARCHIVE) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                members = archive.infolist()
                _check_size(sum(member.file_size for member in members))
                return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
        except InputError:
            raise
        except Exception as error:
            detail = f"{type(error).__name__}: {error}".splitlines()[0][:200]
            raise InputError(InputFault.MALFORMED, detail=detail) from error


def _check_size(unpacked_bytes: int) -> None:
    if unpacked_bytes > MAX_ARCHIVE:
        raise InputError(InputFault.TOO_LARGE, limit_bytes=MAX_ARCHIVE)


def check_finite(arrays: Mapping[str, Any]) -> None:
    """Raises InputError naming the array of numbers that has one which is not finite, or isn't numbers."""
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind not in "fiub" or not np.isfinite(array).all():
            raise InputError(InputFault.BAD_NUMBER, field=name)


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """One array, whose header claims no more than the member holds: numpy allocates what is claimed."""
    with archive.open(member) as file:
        version = npy.read_magic(file)
        header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = header(file)
        if math.prod(shape) * kind.itemsize > member.file_size:
            raise ValueError("an array longer than its file")
    with archive.open(member) as file:
        return npy.read_array(file, allow_pickle=False)
