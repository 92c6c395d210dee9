"""The paper's tables on one page: what is kept, what is made again, and what the page says."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from app.evaluate.distance.frames import DistanceFigures
from app.evaluate.distance.table5_results import PAPER_TABLE_5, Table5, Table5Row
from app.evaluate.gestures.measures import Figures, GestureFigures
from app.evaluate.gestures.report import PAPER_TABLE_3
from app.evaluate.gestures.report import as_json as gestures_json
from app.evaluate.harness import MODES, EvaluateFault, write_json
from app.evaluate.loop.speed import BARE, WHOLE, DetectorFigures, SpeedFigures
from app.evaluate.loop.table7 import ResponseResult
from app.evaluate.paper.make import Job, Run, figures_file, jobs, made_before, make, read_as, run_file
from app.evaluate.paper.page import write_page
from app.evaluate.trigger.chain import CAMERAS
from app.evaluate.trigger.table6 import TriggerRow
from app.system.errors import AppError
from app.system.program import PROGRAM as PROGRAM_HASH
from app.system.program import VERSION, program_identity
from app.text.catalogue import tr

JOB = Job(5, ("distance",))
# Counts how often it ran, in the file after --json; ends with the status that its last argument names.
COUNTING = """
import pathlib, sys
path = pathlib.Path(sys.argv[sys.argv.index("--json") + 1])
made = path.with_name("made")
made.write_text(str(int(made.read_text()) + 1 if made.exists() else 1))
status = int(sys.argv[-1])
if status != 2:
    path.write_text("{}")
raise SystemExit(status)
"""
PROGRAM = (sys.executable, "-c", COUNTING)


def made(out: Path, job: Job = JOB, status: int = 0) -> int:
    """How often the program ran so far."""
    make(job, out, (str(status),), PROGRAM)
    return int((out / "made").read_text())


def test_a_table_is_made_once_and_again_by_another_command(tmp_path: Path) -> None:
    assert [made(tmp_path), made(tmp_path)] == [1, 1]
    run = read_as(run_file(tmp_path, 5), Run)
    assert (run.command, run.status, len(run.program)) == ("rleex evaluate distance", 0, 64)
    assert made(tmp_path, Job(5, ("distance", "--hands", "2"))) == 2


def test_a_table_of_another_program_is_made_again_and_kept_sessions_are_not(tmp_path: Path) -> None:
    other = JOB, Job(7, ("response",), kept="1-3")
    for number, job in enumerate(other, start=1):
        assert made(tmp_path, job) == number
    for job in other:
        run = read_as(run_file(tmp_path, job.table), Run)
        write_json(msgspec.to_builtins(msgspec.structs.replace(run, program=OTHER)), run_file(tmp_path, job.table))
    assert made_before(other[0], tmp_path) is None
    kept_sessions = made_before(other[1], tmp_path)
    assert kept_sessions is not None
    assert kept_sessions.program == OTHER
    assert [made(tmp_path, job) for job in (*other, *other)] == [3] * 4


def test_a_table_of_another_list_or_folder_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there, out = (tmp_path / name for name in ("here", "there", "out"))
    for place in (here, there):
        (place / "data" / "gestures").mkdir(parents=True)
        (place / "data" / "gestures" / "labels.csv").write_text("path,label,source,group\na.png,1,,\n")
    out.mkdir()

    def count() -> int:
        (first, *_) = jobs(Path("data"), attempts=1, hands="1", changes=4, onnx=[])
        return made(out, first)

    monkeypatch.chdir(here)
    assert [count(), count()] == [1, 1]
    (here / "data" / "gestures" / "labels.csv").write_text("path,label,source,group\na.png,2,,\n")
    assert [count(), count()] == [2, 2]
    monkeypatch.chdir(there)
    assert [count(), count()] == [3, 3]
    (there / "data" / "gestures" / "labels.csv").unlink()
    assert count() == 4, "its command says what is missing"
    (there / "data" / "gestures" / "labels.csv").symlink_to("labels.csv")
    assert count() == 4, "and what a link to itself is"


def test_a_table_that_is_kept_is_not_said_to_be_made(tmp_path: Path) -> None:
    made(tmp_path)
    run = made_before(JOB, tmp_path)
    assert run is not None
    text = tr("evaluate.paper.kept", table=5, date=run.date, file=run_file(tmp_path, 5))
    assert text == f"Table 5: kept from {run.date}; to make it again, remove {tmp_path}/table-5.run.json."


# As a command that ends by itself when it is told to: it notes that it did.
TOLD = """
import os, pathlib, signal, sys
noted = pathlib.Path(sys.argv[-1])
def end(*_):
    noted.write_text("ended")
    raise SystemExit(130)
signal.signal(signal.SIGTERM, end)
os.kill(os.getppid(), signal.SIGINT)
while True:
    signal.pause()
"""


def test_a_command_is_told_to_end_where_only_this_process_was_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.evaluate.paper.make.ENDING_S", 0.0)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a suite in the background ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            make(JOB, tmp_path, (str(tmp_path / "noted"),), (sys.executable, "-c", TOLD))
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "noted").read_text() == "ended"
    assert not figures_file(tmp_path, 5).exists()


def test_figures_that_did_not_all_pass_are_kept_with_the_status(tmp_path: Path) -> None:
    made(tmp_path, status=1)
    assert read_as(run_file(tmp_path, 5), Run).status == 1


def test_an_interrupted_command_leaves_no_figures_and_is_made_again(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path, status=130)
    assert not figures_file(tmp_path, 5).exists()
    assert made(tmp_path) == 2


def test_a_table_that_gave_up_goes_on_the_next_time(tmp_path: Path) -> None:
    job = Job(7, ("response",), kept="1-3")
    made(tmp_path, job, status=1)
    write_json({"gave_up": {"code": "EvaluateFault.NO_ROUND"}}, figures_file(tmp_path, 7))
    assert [made(tmp_path, job), made(tmp_path, job)] == [2, 2]


# As `response`: goes on from what is kept of its seeds, and refuses what is kept of others.
KEEPING = """
import pathlib, sys
given = sys.argv
kept, seeds = pathlib.Path(given[given.index("--keep") + 1]), given[given.index("--seeds") + 1]
if kept.exists() and kept.read_text() != seeds:
    raise SystemExit(2)
kept.write_text(seeds)
pathlib.Path(given[given.index("--json") + 1]).write_text('{"seeds": "' + seeds + '"}')
"""


OWN, OTHER = program_identity()[PROGRAM_HASH], "f" * 64


@pytest.mark.parametrize(
    ("programs", "stamp"),
    [
        ([OWN], (program_identity()[VERSION], OWN, True)),
        ([OTHER], ("–", OTHER, False)),
        ([OTHER, OWN], ("–", "–", False)),
    ],
)
def test_the_stamp_is_of_the_program_that_made_the_sessions(
    tmp_path: Path, programs: list[str], stamp: tuple[str, str, bool]
) -> None:
    content = msgspec.json.encode({"programs": programs})
    program = "import pathlib, sys; pathlib.Path(sys.argv[sys.argv.index('--json') + 1]).write_bytes({!r})"
    make(Job(7, ("response",), kept="1-3"), tmp_path, (), (sys.executable, "-c", program.format(content)))
    run = read_as(run_file(tmp_path, 7), Run)
    assert (run.version, run.program, run.commit != "–") == stamp


@pytest.mark.parametrize(("programs", "named"), [((OWN,), False), ((OTHER, OWN), True)])
def test_the_page_names_the_programs_where_several_made_table_7(
    tmp_path: Path, programs: tuple[str, ...], *, named: bool
) -> None:
    kept(tmp_path, {7: ResponseResult(sessions=(), programs=programs).as_json()})
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert (f"2 versions of the program: {OTHER[:12]}, {OWN[:12]}" in page) == named


def test_without_git_a_table_is_made_once_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert [made(tmp_path), made(tmp_path)] == [1, 1]
    assert read_as(run_file(tmp_path, 5), Run).commit == ""


def test_other_hands_are_kept_apart(tmp_path: Path) -> None:
    for hands in ("1-3", "1, 2", "1-3"):
        (job,) = (one for one in jobs(None, attempts=1, hands=hands, changes=4, onnx=[]) if one.table == 7)
        make(job, tmp_path, (), (sys.executable, "-c", KEEPING))
        assert read_as(figures_file(tmp_path, 7), dict[str, str]) == {"seeds": hands}


@pytest.mark.parametrize(("status", "ends"), [(2, AppError), (130, KeyboardInterrupt)])
def test_older_figures_stay_where_no_new_ones_are_made(tmp_path: Path, status: int, ends: type[BaseException]) -> None:
    made(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != "made"}
    with pytest.raises(ends):
        made(tmp_path, Job(5, ("distance", "--hands", "2")), status)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != "made"} == before


def test_a_set_without_undefined_hands_has_no_share_of_them(tmp_path: Path) -> None:
    table = figures()[3]
    table["rules"]["robust"] |= {"accepted_undefined": None, "macro_f1": None}
    table["rules"]["robust"]["per_gesture"]["9"] |= {"f1": None, "ap": None}
    kept(tmp_path, {3: table})
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert "1.23 % by the published rules, – %" in page
    (nine,) = re.findall(r"<tr><td>9</td>(.*?)</tr>", re.sub(r"\s*\n\s*", "", page))
    assert nine.count("–") == 2


@pytest.mark.parametrize("damaged", [figures_file, run_file])
def test_a_damaged_table_is_made_again(tmp_path: Path, damaged: Callable[[Path, int], Path]) -> None:
    made(tmp_path)
    damaged(tmp_path, 5).write_text("{")
    assert [made(tmp_path), made(tmp_path)] == [2, 2]


def test_a_command_without_figures_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(AppError) as refused:
        made(tmp_path, status=2)
    assert refused.value.code is EvaluateFault.TABLE_NOT_MADE
    assert refused.value.values == {"table": 5, "command": "rleex evaluate distance", "status": 2}


def test_the_commands_are_those_a_person_would_type(tmp_path: Path) -> None:
    wanted = jobs(tmp_path, attempts=150, hands="1-3", changes=20, onnx=[Path("a.onnx")])
    assert [job.table for job in wanted] == [3, 4, 5, 6, 7]
    assert wanted[1].command == f"rleex evaluate speed {tmp_path}/distance --workers 0 --onnx a.onnx"
    assert wanted[4].command == "rleex evaluate response --trials 150 --seeds 1-3"
    assert jobs(None, attempts=1, hands="1", changes=4, onnx=[])[0].arguments == ("gestures", "--digital", "10")


def figures() -> dict[int, Any]:
    """As the commands write them: figures of the commands' own types."""
    line = GestureFigures(pre=1.0, re=0.5, iou=0.5, f1=0.654, ap=0.9, n=3)
    rules = Figures(
        macro_f1=0.654,
        map=0.9,
        accepted_undefined=0.0123,
        wrong_gesture=0.0,
        per_gesture=dict.fromkeys(PAPER_TABLE_3, line),
        per_kind={},
        per_source={},
        confusion=np.zeros((13, 13), np.int64),
    )
    detector = DetectorFigures(parameters=3_850_000, multiply_adds=None, ms=20.0, hands=30)
    speed = SpeedFigures(
        frames=60, hands=30, bare_ms=20.0, whole_ms=20.0, ratio=1.234, fps=50.0, stages_ms={},
        detectors={WHOLE: detector, BARE: detector, "other.onnx": detector},
    )  # fmt: skip
    by_mode = {"published": 1.5, "robust": float("nan")}
    rows = tuple(
        Table5Row(distance_cm=cm, mono_percent=by_mode, worst_percent=2.0, depth_percent=by_mode, depth_zero=0.0)
        for cm in PAPER_TABLE_5
    )
    zeros = dict.fromkeys(("mae_cm", "bias_cm", "p95_cm", "within_5cm", "near_3", "near_10"), 0.0)
    walk = DistanceFigures(frames=1, missing=0, **zeros)
    shares = {(camera, mode): 0.35 for camera in CAMERAS for mode in MODES}
    changes = [
        TriggerRow(distance_cm=cm, changes=20, pressed=shares, commands=dict.fromkeys(shares, 0), fps={}).as_json()
        for cm in PAPER_TABLE_5
    ]
    return {
        3: gestures_json(
            {"published": rules, "robust": rules}, {}, [], cross_validated=False, views=None, prepare="none"
        ),
        4: msgspec.to_builtins(speed),
        5: Table5(hands=1, focal_px=650.0, rows=rows, tilts=(), walk={"robust": walk}).as_json(),
        6: {"changes": 20, "table_6": changes},
        7: ResponseResult(sessions=()).as_json(),
    }


def kept(out: Path, tables: dict[int, Any], status: int = 0) -> None:
    for number, content in tables.items():
        write_json(content, figures_file(out, number))
        command = f"rleex evaluate {number}"
        run = Run(command=command, date="", version="", program="", commit="", machine="", status=status)
        write_json(msgspec.to_builtins(run), run_file(out, number))


def test_the_page_holds_every_table_with_the_papers_figures_its_plot_and_its_command(tmp_path: Path) -> None:
    kept(tmp_path, figures())
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert [page.count(f"<h2>Table {number}:") for number in (3, 4, 5, 6, 7)] == [1] * 5
    assert page.count("<svg") == 5
    assert page.count("<code>rleex evaluate") == 5
    for cells in (
        ("0", "93.1", "65.4", "65.4", "96.0", "90.0", "90.0"),
        ("other.onnx", "3.9", "–", "20.0", "50.0", "50.0"),
        ("10", "-7.0", "1.5", "–", "–", "1.5", "–"),
        ("25", "0", "35.0", "35.0", "32", "–", "90", "35.0", "35.0", "11", "–"),
        ("7", "0", "82.7", "–", "0.89", "–"),
    ):
        assert "".join(f"<td>{cell}</td>" for cell in cells) in page, cells
    assert "1.23 % by the published rules" in page
    assert "1.234 times" in page
    assert "On images it was fitted on, these figures flatter it" in page
    assert "not reproduced" in page
    assert "ended with status" not in page
    assert "http" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    ).replace("https://matplotlib.org", ""), "it fetches nothing"


def test_tables_that_are_missing_are_left_out_and_a_failed_one_says_so(tmp_path: Path) -> None:
    kept(tmp_path, {7: figures()[7]}, status=1)
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert page.count("<svg") == 1
    assert "ended with status 1" in page


def test_damaged_figures_are_refused_by_name(tmp_path: Path) -> None:
    kept(tmp_path, figures())
    figures_file(tmp_path, 6).write_text("{")
    with pytest.raises(AppError) as refused:
        write_page(tmp_path)
    assert refused.value.code is EvaluateFault.FILE_UNREADABLE
    assert refused.value.values["file"] == figures_file(tmp_path, 6)
