"""The `rleex` command. This file stays light: every process of a session reads it again when it is spawned."""

from __future__ import annotations

import codecs
import sys
from contextlib import suppress
from io import TextIOWrapper
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from app.system.errors import AppError
from logs.reading.errors import CodedError, cause_of

if TYPE_CHECKING:
    import typer

# Module → the extra that brings it: what a session needs none of.
EXTRAS = {
    **dict.fromkeys(("matplotlib", "onnx", "onnxruntime", "sklearn", "tflite", "threadpoolctl"), "evaluate"),
    **dict.fromkeys(("duckdb", "ezc3d", "jinja2", "pyarrow"), "analysis"),
}
# The one sentence that no catalogue can hold: English, the fallback of all, is not compiled.
NOT_COMPILED = "The texts of this program are not compiled. Run `make`, or `python -m app.text.compile`, in its folder."


def main() -> None:
    """Run the command line; an error that a user can cause ends with its text and exit status 2."""
    _escape_unencodable()
    try:
        from app.cli.tree import command
        from app.cli.usage import run
        from app.text.catalogue import ask_language

        language, arguments = _language_in(sys.argv[1:])
        use_configured_language(arguments)
        ask_language(language)
        run(command(arguments), arguments)
    except CodedError as error:
        _refuse(error)
    except BrokenPipeError:
        raise  # who reads the output has had enough
    except KeyboardInterrupt:  # while modules are loaded; a command has its own end
        raise SystemExit(130) from None
    except OSError as error:  # a full disk, a folder without permission
        from app.cli.common import CliFault

        where = "" if error.filename is None else f"{error.filename}: "
        _refuse(AppError(CliFault.SYSTEM, detail=f"{where}{cause_of(error)}"))
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        from app.text.catalogue import tr

        sys.stderr.write(f"rleex: {tr('EvaluateFault.EXTRA_MISSING', extra=extra)}\n")
        raise SystemExit(2) from None


def _escape_unencodable() -> None:
    """A terminal whose locale is not UTF-8, or a pipe, gets the code of a character that its encoding has not."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and codecs.lookup(stream.encoding).name != "utf-8":
            stream.reconfigure(errors="backslashreplace")


def _refuse(error: Exception) -> NoReturn:
    """One line on stderr, with nothing in it that a terminal obeys."""
    from app.text.catalogue import TextFault, render
    from logs.reason import sanitize_terminal

    try:
        text = render(error)
    except AppError as fault:
        if fault.code is not TextFault.NOT_COMPILED:
            raise
        text = NOT_COMPILED
    sys.stderr.write(f"rleex: {sanitize_terminal(' '.join(text.split()))}\n")
    raise SystemExit(2) from None


def _language_in(arguments: list[str]) -> tuple[str, list[str]]:
    """The language that --language asks for, wherever it stands, and the other arguments."""
    language, rest = "", []
    waiting = iter(arguments)
    for argument in waiting:
        name, assigned, value = argument.partition("=")
        if name == "--language":
            language = value if assigned else next(waiting, "")
        else:
            rest.append(argument)
    return language, rest


def use_configured_language(arguments: list[str]) -> None:
    """Render in the configuration's language where it can be read: English otherwise, the command reports why."""
    from app.system.config import load_config
    from app.system.paths import find_home
    from app.text.catalogue import use_language

    parts = [part for argument in arguments for part in argument.split("=", 1)]
    given = next((Path(after) for option, after in pairwise(parts) if option == "--home"), None)
    with suppress(AppError):
        use_language(load_config(find_home(given).config).language)


def __getattr__(name: str) -> typer.Typer:
    if name == "cli":  # the whole tree, built when somebody asks for it
        from app.cli.tree import tree

        return tree()
    raise AttributeError(name)
