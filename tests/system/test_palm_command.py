"""`rleex profile calibrate` with its model: one palm is measured, and none of two."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli.tree import tree
from app.evaluate.hand_motions import held, take
from app.system.paths import Home
from hal.cameras.digital_hand.render import lens_for, person_of
from profiles.errors import ProfileError, ProfileFault


def test_a_second_hand_beside_the_palm_is_no_sample(
    home: Home, hand_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (moment,) = held(
        "5", person=person_of(4711), lens=lens_for(1280, 720), distance_m=0.45, turn_rad=(0.0, 0.0), seed=3, frames=1
    )
    one = take(moment, 5)[0][:, 320:960]
    folder = tmp_path / "images"
    for needed in (home.root, folder):
        needed.mkdir()
    for number in range(20):
        cv2.imwrite(str(folder / f"{number:02}.png"), np.hstack([one, one[:, ::-1]]))
    home.config.write_text(f'model = "{hand_model}"\n[camera]\nkind = "recording"\ndevice = "{folder}"\n')
    monkeypatch.setenv("RLEEX_HOME", str(home.root))
    done = CliRunner().invoke(tree(), ["profile", "calibrate", "demo", "--distance", "45"])
    assert isinstance(done.exception, ProfileError), done.output
    assert (done.exception.code, done.exception.values["count"]) == (ProfileFault.TOO_FEW_SAMPLES, 0)
