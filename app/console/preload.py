"""What keys will need and the first paint does not, loaded in a thread; and no long collections while legs may move."""

from __future__ import annotations

import gc
from importlib import import_module

from app.console.sentences import learn_events

# numpy with the picture; the messages of the palette.
_LATER = ("app.console.widgets.picture", "textual.fuzzy")
# Young, middle, old: a full collection, which stops all threads, comes some hundred times more rarely than by default.
_RARELY = (5_000, 20, 50)
_AS_USUAL = gc.get_threshold()


def collect_rarely() -> None:
    """Look for garbage some hundred times more rarely. Undone by `let_go`."""
    gc.set_threshold(*_RARELY)


def keep_loaded() -> None:
    """Leave what is in use by now out of every later collection of garbage; what no longer is, is freed first.

    A full one would otherwise stop all threads for 0.1 to 0.2 s every few seconds, the sign of life and STOP among
    them. Undone by `let_go`.
    """
    gc.collect()
    gc.freeze()


def let_go() -> None:
    """The session has ended: all may be collected again, as often as before."""
    gc.unfreeze()
    gc.set_threshold(*_AS_USUAL)


def load_rest() -> None:
    """Load all that a key may need; takes up to a second."""
    for name in _LATER:
        import_module(name)
    learn_events()
