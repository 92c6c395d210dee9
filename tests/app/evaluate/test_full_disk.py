"""A full disk when the figures are written: one sentence, the older file stays, and what was measured is shown."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.cli.compare_cameras import write_csv, write_plot
from app.evaluate.harness import EvaluateFault, write_json, write_whole
from app.perception.comparison import Comparison
from app.system.errors import AppError
from tests.app.perception.test_comparison import sample


@contextmanager
def full_disk() -> Iterator[None]:
    """No file can grow any more."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


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
    with full_disk(), pytest.raises(AppError) as refused:
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
    with full_disk(), pytest.raises(AppError):
        write_csv(compared(), tmp_path / "two.csv")
    assert capsys.readouterr().out == compared().as_csv()


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
