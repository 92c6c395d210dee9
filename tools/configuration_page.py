"""Writes docs/reference/configuration.md: every key of `config.toml`, from the configuration's own inspect.

`python tools/configuration_page.py` rewrites it; with --check it only says whether it is current, which a test asks.
What each key means is written here; a key without a sentence, and a sentence without a key, end the tool.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import NODEFAULT, Struct, inspect
from textual.binding import Binding

from app.console.keys import DIGITAL_HAND, EVERYWHERE, PATIENTS, SESSION
from app.system.config import Config
from app.text.catalogue import languages, load
from app.text.compile import compile_catalogues

DOCUMENT = Path(__file__).parent.parent / "docs" / "reference" / "configuration.md"

SENTENCES = {
    "rules": "Rules by which gestures are recognised: ours, or the paper's ([gestures](../explanation/gestures.md)).",
    "model": "Path of a `hand_landmarker.task`; empty: the one that `rleex model` set up.",
    "patient": "Pseudonym of the patient whose session opens at once with simulated joints.",
    "language": "Language of screens and commands; `--language` chooses another one for a command.",
    "theme": "Colours of the console; F2 changes them until it ends.",
    "picture": "How the camera's image is drawn: in pixels where the terminal promises them, or always in blocks.",
    "control_core": "Core that control has for itself; none: one that the kernel sets apart, else the last of several.",
    "unattended_s": "A session without a console ends after this.",
    "idle_lock_s": "The console locks after this without a key or motion of the legs; 0: never by itself.",
    "checkpoint_copy": "A folder, or `syslog`, that gets a copy of each signed checkpoint of the trail; empty: none.",
    "camera.kind": "Which kind of [camera](cameras.md).",
    "camera.device": "Webcam: name or index. Recording: the path. RealSense: serial number, or path of a recording.",
    "camera.width_px": "Width of the images that are asked of it.",
    "camera.height_px": "Height of the images that are asked of it.",
    "camera.rate_hz": "Images a second that are asked of it; a recorded video keeps its own.",
    "camera.focal_px": "Focal length at this image size; none: as calibrated, else assumed. A RealSense has its own.",
    "camera.mirrored": "Whether a webcam or recording gives mirrored images, which are then turned back.",
    "camera.arm": "Where on the unmirrored image the patient's arm comes from.",
    "camera.seed": "Digital hand: which person.",
    "camera.hand": "Digital hand: which one it shows; one that the profile does not name is refused.",
    "camera.limit": "Digital hand: what it can't do.",
    "camera.depth": "Digital hand: give a D435i's depth also where the patient needs none.",
    "camera.depth_holes": "Digital hand: share of images whose depth misses the hand.",
    "joints.kind": "Simulated joints, or [drives](../how-to/drives.md) on CAN.",
    "joints.device": "Path of an `exoskeleton.toml`; empty: the built-in description.",
    "joints.motors": "Path of a TOML file that adds to the motor table.",
    "joints.interface": "python-can's interface in place of the description's.",
    "joints.channel": "Channel in place of the description's; for two buses `a,b`.",
    "joints.host": "The exoskeleton's [own computer](../how-to/two-computers.md); empty: the joints are here.",
    "button.x": "Centre of the button, as a share of the image's width.",
    "button.y": "Centre of the button, as a share of the image's height.",
    "button.mode": "Distance and button by our rules or by the paper's ([distance](../explanation/distance.md)).",
    "recording.on": "Whether sessions are [recorded](recording.md).",
    "recording.encrypt": "Whether recordings and pictures are [encrypted](recording.md#encryption).",
    "recording.keep_days": "`rleex recording expire` deletes older recordings and pictures; none: all are kept.",
    "sounds.press": "The bell rings when the button is pressed.",
    "sounds.release": "The bell rings when it is released.",
    "sounds.refusal": "The bell rings when an action is refused or a push cancelled.",
    "sounds.stop": "The bell rings when the legs are held or damped.",
    "voice.on": "Whether a spoken word [may stop](../safety.md#voice-may-stop-never-start) the legs.",
    "voice.kind": "A microphone, or a recording to try it without one.",
    "voice.device": "Microphone: part of its name, or its number; empty: the system's. Recording: path of a WAV file.",
    "inputs.name": "Its name on the screens and in the trail; each its own.",
    "inputs.role": "Whose button it is; `emergency-stop` is an auxiliary contact of the hardwired one.",
    "inputs.kind": "How its contact is read; `simulated` is refused beside real drives.",
    "inputs.can_id": "can: identifier of the module's frames; required there.",
    "inputs.extended": "can: whether that is an extended identifier, needed above 0x7FF.",
    "inputs.byte": "can: byte of the frame that holds the contact.",
    "inputs.bit": "can: bit of that byte, 0 the lowest.",
    "inputs.timeout_ms": "can: longer than this without a frame counts as open.",
    "inputs.bus.interface": "can: `bus` is a table in this one: python-can's interface of the module's own bus.",
    "inputs.bus.channel": "can: channel of that bus.",
    "inputs.bus.bitrate": "can: bit rate of that bus, where python-can sets it.",
    "inputs.bus.options": "can: further arguments of python-can's interface.",
    "inputs.closed": "What is read while the contact is closed: the bit, the line's level, or whether the key is down; "
    "none: 1, for evdev 0.",
    "inputs.device": "evdev, gpiod: the device's file; required there.",
    "inputs.key": "evdev: key of the pedal as `evtest` names it (`KEY_B`); required there.",
    "inputs.keyboard": "evdev: this device types letters and is the pedal all the same.",
    "inputs.line": "gpiod: offset of the line on the chip; required there.",
}
# What the program checks beyond the structs' types, in words.
FORMS: dict[str, Callable[[], str]] = {
    "language": lambda: _values(languages()),
    "joints.host": lambda: "name or IPv4 address, `:port` after it",
    "inputs.name": lambda: "1 to 20 of a–z, 0–9 and -, no - first",
}
UNITS = {"_px": "px", "_hz": "Hz", "_s": "s", "_ms": "ms", "_days": "days", "bitrate": "bit/s"}
TYPES = {
    inspect.StrType: "text",
    inspect.EnumType: "text",
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.BoolType: "true or false",
    inspect.DictType: "table",
}
HEADINGS = {
    "": "Above the first table",
    "camera": "`[camera]`",
    "joints": "`[joints]`",
    "button": "`[button]`: the button on the image",
    "recording": "`[recording]`",
    "inputs": "`[[inputs]]`: [buttons that stop](../safety.md#buttons-that-stop), a table each",
    "voice": "`[voice]`: stop by voice",
    "sounds": "`[sounds]`: when the terminal's bell rings",
}
BEGINNING = """# The configuration

What a lab sets once, in `config.toml` of the home. `rleex locate` prints where that is: the folder that `--home` names,
else the variable `RLEEX_HOME`, else `~/.local/share/rleex` (`$XDG_DATA_HOME/rleex`). Without the file, and for each key
that it leaves out, the defaults below hold. A key that does not exist, or a value that is not allowed, is refused with
its name.

Edit the file, or change single keys by `rleex configure camera.kind=webcam joints.kind=can`: comments stay, `none`
takes a value away, an engineer signs in where that is needed, and [the change is recorded](audit.md#roles).
`[[inputs]]` and names with a dot under `[keys]` need an editor. The console reads the file when it starts,
`rleex joints` when a session begins.

`python tools/configuration_page.py` writes this page from the program's own types.
"""
KEYS = """
## Keys

Under `[keys]`: a name of the console's keys, and the key or keys in place of its own, separated by commas:
`stop = "space,f12"`. A name with a dot needs quotes: `"patients.begin" = "f7"`.
[What is refused](../how-to/therapist.md#lock-watch-change-keys).

"""
PLACES = (("everywhere", EVERYWHERE), ("session", SESSION), ("digital hand", DIGITAL_HAND), ("patients", PATIENTS))


class Key(NamedTuple):
    """One key as its struct has it."""

    path: str
    field: inspect.Field

    @property
    def table(self) -> str:
        """The table that it stands in; "": none."""
        return self.path.split(".")[0] if "." in self.path else ""


def keys_of(table: inspect.StructType, prefix: str = "") -> Iterator[Key]:
    """Every key, dotted, also of the tables within; `keys` is a table of names that are listed apart."""
    for field in table.fields:
        path, kind = prefix + field.encode_name, field.type
        inner = kind.item_type if isinstance(kind, inspect.VarTupleType) else kind
        if isinstance(inner, inspect.StructType):
            yield from keys_of(inner, path + ".")
        elif path != "keys":
            yield Key(path, field)


def page() -> str:
    """The whole page."""
    described = inspect.type_info(Config)
    assert isinstance(described, inspect.StructType)
    keys = list(keys_of(described))
    check({key.path for key in keys}, {key.table for key in keys})
    parts = [BEGINNING]
    for table, heading in HEADINGS.items():
        parts.append(f"\n## {heading}\n\n{_heading('key', 'type', 'default', 'unit', 'allowed', 'meaning')}")
        parts += [_row(key) for key in keys if key.table == table]
    names = [_name(binding, place) for place, bindings in PLACES for binding in bindings]
    return "".join([*parts, KEYS, _heading("name", "its own key", "where", "does"), *names])


def check(paths: set[str], tables: set[str]) -> None:
    """Each key has its sentence and each table its heading, and there are no others."""
    for missing in sorted(paths - SENTENCES.keys()):
        sys.exit(f"{missing} has no sentence: add it to SENTENCES in tools/configuration_page.py")
    for needless in sorted((SENTENCES.keys() | FORMS.keys()) - paths):
        sys.exit(f"{needless} is no key of the configuration: remove it from tools/configuration_page.py")
    for table in sorted(tables ^ HEADINGS.keys()):
        sys.exit(f"HEADINGS in tools/configuration_page.py and the configuration differ: {table}")


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |\n"


def _heading(*cells: str) -> str:
    return _line(*cells) + f"|{'---|' * len(cells)}\n"


def _row(key: Key) -> str:
    name, kind = key.path.removeprefix(f"{key.table}."), _without_none(key.field.type)
    unit = next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")
    allowed = FORMS[key.path]() if key.path in FORMS else _allowed(key.path, kind)
    return _line(f"`{name}`", _type(kind), _default(key.field), unit, allowed, SENTENCES[key.path])


def _default(field: inspect.Field) -> str:
    if field.required:
        return "required"
    if field.default is None:
        return "none"
    value = field.default_factory() if field.default is NODEFAULT else field.default
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    """A value as TOML has it: JSON has these alike."""
    assert not isinstance(value, Struct)
    return json.dumps(value, ensure_ascii=False)


def _without_none(kind: inspect.Type) -> inspect.Type:
    if isinstance(kind, inspect.UnionType):
        return next(one for one in kind.types if not isinstance(one, inspect.NoneType))
    return kind


def _type(kind: inspect.Type) -> str:
    if isinstance(kind, inspect.LiteralType):
        return "integer" if isinstance(kind.values[0], int) else "text"
    return TYPES[type(kind)]


def _allowed(path: str, kind: inspect.Type) -> str:
    """Values, or least and most; "" where the type says all."""
    match kind:
        case inspect.LiteralType(values=values):
            return _values(values)
        case inspect.EnumType(cls=enum):
            return _values(member.value for member in enum)
        case inspect.IntType() | inspect.FloatType():
            return _range(kind)
        case inspect.StrType() if kind.pattern or kind.min_length or kind.max_length:
            sys.exit(f"{path} has a form: say it in FORMS in tools/configuration_page.py")
    return ""


def _range(kind: inspect.IntType | inspect.FloatType) -> str:
    least = f"above {_number(kind.gt)}" if kind.gt is not None else "" if kind.ge is None else f"{_number(kind.ge)}"
    most = f"below {_number(kind.lt)}" if kind.lt is not None else "" if kind.le is None else f"{_number(kind.le)}"
    if least and not most:
        return least if kind.gt is not None else f"{least} or more"
    return " to ".join(filter(None, (least, most)))


def _number(value: float) -> str:
    return f"{value:,.0f}" if value == int(value) else f"{value:,}"


def _values(values: Iterable[Any]) -> str:
    return ", ".join(f"`{_toml(value)}`" for value in values)


def _name(binding: Binding, place: str) -> str:
    text = load("en").gettext(f"bind.{binding.id}")
    return _line(f"`{binding.id}`", f"`{binding.key}`", place, text)


if __name__ == "__main__":
    compile_catalogues()
    if "--check" in sys.argv:
        written = DOCUMENT.read_text(encoding="utf-8")
        command = "python tools/configuration_page.py"
        sys.exit(page() != written and f"docs/reference/configuration.md is not current: run {command}")
    DOCUMENT.write_text(page(), encoding="utf-8")
