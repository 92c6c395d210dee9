"""Links in a circle, in every place of the command line that follows links: a sentence, and the links stay."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.cli.common import CliFault
from app.perception.camera_names import refuse_same_device
from app.perception.look import LookFault
from app.system.config import CameraConfig
from app.system.errors import AppError
from app.system.files import write_whole
from logs import spark
from logs.errors import AuditError
from logs.sites import Site
from testing.trails import write_sample


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("home")
    write_sample(home, minutes=0.1)
    return home


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    """A link to itself."""
    path = tmp_path / "loop.json"
    path.symlink_to(path)
    return path


def test_a_trail_that_is_one_can_not_be_read(home: Path, loop: Path) -> None:
    done = CliRunner().invoke(cli, ["audit", "verify", str(loop), "--home", str(home)])
    assert (done.exit_code, "loop.json" in done.output) == (2, True), done.output
    for arguments in (["audit", "show", str(loop)], ["query", str(loop), "--ask", "sites"]):
        assert isinstance(CliRunner().invoke(cli, arguments).exception, AuditError)


@pytest.mark.parametrize(
    "arguments",
    [
        "audit key -o {loop}",
        "audit report last -o {loop}",
        "audit verify --json {loop}",
        "audit export --parquet {loop}",
        "outcomes --json={loop}",
        "export last --to csv -o {loop}",
        "can record {loop}",
    ],
)
def test_an_output_that_is_one_is_refused_before_the_work(home: Path, loop: Path, arguments: str) -> None:
    done = CliRunner().invoke(cli, [*arguments.format(loop=loop).split(), "--home", str(home)])
    assert isinstance(done.exception, AppError), (done.exception, done.output)
    assert done.exception.code is CliFault.OUTPUT_UNWRITABLE
    assert loop.is_symlink()


def test_it_is_never_replaced(loop: Path) -> None:
    with pytest.raises(OSError, match="symbolic links"):
        write_whole(loop, b"{}")
    assert loop.is_symlink()


def test_a_site_of_them_is_named_to_spark_as_it_is(loop: Path) -> None:
    site = Site(name="north", path=loop.parent, files=(loop,), is_parquet=False)
    assert spark.addresses(site) == [loop.as_uri()]


def test_two_cameras_that_are_one_are_one_device(loop: Path) -> None:
    camera = CameraConfig(kind="recording", device=str(loop))
    with pytest.raises(AppError) as refused:
        refuse_same_device(camera, camera)
    assert refused.value.code is LookFault.SAME_DEVICE
