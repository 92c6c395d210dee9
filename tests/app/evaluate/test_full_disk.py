"""A full disk when the figures are written: one sentence, the older file stays, and what was measured is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.cli.compare_cameras import write_csv, write_plot
from app.evaluate.harness import EvaluateFault, keep_line, kept_lines, write_json, write_whole
from app.perception.comparison import Comparison
from app.system.errors import AppError
from tests.app.perception.test_comparison import sample
from tests.support.disks import full_disk


def compared() -> Comparison:
    made = Comparison(threshold_m=0.2)
    for frame in (1, 2, 3):
        made.take(0, sample(frame, 0.3))
    return made


@pytest.mark.parametrize(
    "write",
    [
        lambda path: write_json({"figures": 1}, path),
        lambda path: write_csv(compared(), path),
        lambda path: write_plot(compared(), path),
    ],
    ids=["json", "csv", "plot"],
)
def test_the_older_file_stays_and_the_error_names_it(tmp_path: Path, write: Callable[[Path], None]) -> None:
    path = tmp_path / "figures"
    path.write_text("what was there")
    with full_disk(1), pytest.raises(AppError) as refused:
        write(path)
    assert refused.value.code is EvaluateFault.FILE_UNWRITABLE
    assert refused.value.values["file"] == path
    assert [*tmp_path.iterdir()] == [path], "no half of one"
    assert path.read_text() == "what was there"
    write(path)
    assert path.read_bytes()[:4] != b"what"


def test_what_two_cameras_measured_is_printed_where_it_can_t_be_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with full_disk(1), pytest.raises(AppError):
        write_csv(compared(), tmp_path / "two.csv")
    assert capsys.readouterr().out == compared().as_csv()


def test_a_line_that_was_cut_off_costs_none_of_the_others(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    path.write_bytes(b'{"a":1}\n{"a":')
    assert kept_lines(path, dict) == ({"a": 1},)
    keep_line({"a": 2}, path)
    assert kept_lines(path, dict) == ({"a": 1}, {"a": 2})
    path.write_bytes(b'{"a":\n{"a":1}\n{"a":')
    with pytest.raises(AppError) as refused:
        kept_lines(path, dict)
    assert refused.value.code is EvaluateFault.FILE_UNREADABLE
    assert path.read_bytes() == b'{"a":\n{"a":1}\n{"a":', "what is not ours stays as it is"


def test_a_disk_that_takes_half_a_line_keeps_none_of_it(tmp_path: Path) -> None:
    path = tmp_path / "kept.jsonl"
    keep_line({"a": 1}, path)
    with full_disk(path.stat().st_size + 3), pytest.raises(AppError) as refused:
        keep_line({"a": 2}, path)
    assert refused.value.code is EvaluateFault.FILE_UNWRITABLE
    assert path.read_bytes() == b'{"a":1}\n'


def test_a_link_is_written_through(tmp_path: Path) -> None:
    link, there = tmp_path / "link", tmp_path / "there"
    link.symlink_to(there)
    write_whole(link, b"new")
    assert link.is_symlink()
    assert there.read_bytes() == b"new"


@pytest.mark.filterwarnings("error")
def test_a_comparison_that_measured_nothing_is_plotted_without_a_word(tmp_path: Path) -> None:
    write_plot(Comparison(threshold_m=0.2), tmp_path / "two.png")
    assert (tmp_path / "two.png").stat().st_size > 1000
