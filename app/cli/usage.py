"""A command line that is not understood: Typer's errors as codes, so that they are said in every language."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from enum import Enum, auto
from typing import Any, NoReturn, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from app.system.errors import AppError
from app.text.catalogue import tr


class UsageFault(Enum):
    """Why a command did not begin. help: the command that shows what can be given."""

    NO_SUCH_COMMAND = auto()  # name, help
    NO_SUCH_OPTION = auto()  # option, help
    OPTION_VALUE = auto()  # option, help: it lacks its value, or has one and takes none
    MISSING = auto()  # parameter, help
    TOO_MANY = auto()  # help
    WHOLE_NUMBER = auto()  # parameter, value, help
    NUMBER = auto()  # parameter, value, help
    TOO_SMALL = auto()  # parameter, value, least, help
    TOO_LARGE = auto()  # parameter, value, most, help
    ONE_OF = auto()  # parameter, value, known, help


def run(command: TyperCommand | TyperGroup, arguments: Sequence[str]) -> NoReturn:
    """Run a command and end with its exit status. Raises AppError where the arguments are wrong."""
    try:
        status = command(arguments, standalone_mode=False)
    except typer.Abort:  # a question without an answer, or with no
        sys.stderr.write(f"rleex: {tr('cli.cancelled')}\n")
        raise SystemExit(1) from None
    except TyperException as error:
        fault = _fault_of(error, command, arguments)
        if fault is None:  # a group that was called without a command: what it says is its help
            sys.stderr.write(error.format_message())
            raise SystemExit(error.exit_code) from None
        raise fault from error
    raise SystemExit(status or 0)


def _fault_of(error: Any, command: TyperCommand | TyperGroup, arguments: Sequence[str]) -> AppError | None:
    """By what each of Typer's errors has: their classes are private to it."""
    path, left = ["rleex"], [argument for argument in arguments if not argument.startswith("-")]
    while isinstance(command, TyperGroup) and left and left[0] in command.commands:
        path.append(left[0])
        command = cast("TyperCommand | TyperGroup", command.commands[left.pop(0)])
    shown = {"help": f"`{' '.join(path)} --help`"}
    if hasattr(error, "possibilities"):
        return AppError(UsageFault.NO_SUCH_OPTION, option=error.option_name, **shown)
    if hasattr(error, "option_name"):
        return AppError(UsageFault.OPTION_VALUE, option=error.option_name, **shown)
    if hasattr(error, "param_type"):
        return AppError(UsageFault.MISSING, parameter=_name_of(error.param), **shown)
    if isinstance(error, typer.BadParameter):
        return _of_value(error, shown)
    if isinstance(command, TyperGroup):
        return AppError(UsageFault.NO_SUCH_COMMAND, name=left[0], **shown) if left else None
    return AppError(UsageFault.TOO_MANY, **shown)


_LIMITS = {
    "greater_than_equal": (UsageFault.TOO_SMALL, "least", "ge"),
    "less_than_equal": (UsageFault.TOO_LARGE, "most", "le"),
}
_KINDS = {int: UsageFault.WHOLE_NUMBER, float: UsageFault.NUMBER}


def _of_value(error: Any, shown: dict[str, str]) -> AppError:
    """By the code that pydantic gives each of its errors, and by what the parameter takes."""
    taken, found = error.param.type_descriptor, error.__cause__.errors()[0]
    values = {"parameter": _name_of(error.param), "value": str(found["input"]), **shown}
    if taken.choices is not None:
        known = ", ".join(str(getattr(choice, "value", choice)) for choice in taken.choices)
        return AppError(UsageFault.ONE_OF, known=known, **values)
    if found["type"] in _LIMITS and values["value"].lower() != "nan":
        fault, name, limit = _LIMITS[found["type"]]
        return AppError(fault, **{name: found["ctx"][limit]}, **values)
    return AppError(_KINDS[taken.annotation], **values)


def _name_of(parameter: Any) -> str:
    options: list[str] = [option for option in parameter.opts if option.startswith("-")]
    return options[0] if options else str(parameter.metavar or parameter.name).upper()
