"""Refusals keep code and values where they leave a process: a worker's is pickled."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

from app.evaluate.harness import EvaluateFault
from app.system.errors import AppError
from hal.errors import CameraFault, HardwareError
from kgdfa.errors import KgdfaError, KgdfaFault
from logs.errors import AuditError, AuditFault
from logs.reading.errors import CodedError, InputError, InputFault
from profiles.errors import ProfileError, ProfileFault

REFUSALS: list[Any] = [
    AppError(EvaluateFault.FILE_UNREADABLE, file="a.csv", detail=InputError(InputFault.TOO_DEEP, limit=9)),
    HardwareError(CameraFault.NOT_OPEN, camera="webcam"),
    KgdfaError(KgdfaFault.IMAGE_CHANNELS, channels=5),
    AuditError(next(iter(AuditFault)), path="trail"),
    ProfileError(ProfileFault.SCATTER, residual=1.0, most=0.1),
    InputError(InputFault.HAS_NUL, line=3),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda one: type(one).__name__)
def test_a_refusal_comes_whole_out_of_another_process(refusal: Any) -> None:
    again = pickle.loads(pickle.dumps(refusal))
    assert (type(again), again.code, str(again)) == (type(refusal), refusal.code, str(refusal))


def test_every_kind_of_refusal_is_tried() -> None:
    assert {*CodedError.__subclasses__()} <= {type(one) for one in REFUSALS}
