"""What keys will need and the first paint does not: loaded in a thread, so that no key waits for an import."""

from __future__ import annotations

import gc
from importlib import import_module

from app.console.sentences import learn_events

# numpy with the picture; the help page's parser; the messages of the palette.
_LATER = ("app.console.halfblock", "markdown_it", "textual.widgets.markdown", "textual.fuzzy")
# Young, middle, old: a full collection, which stops all threads, comes some hundred times more rarely than by default.
_THRESHOLDS = (5_000, 20, 50)


def keep_loaded() -> None:
    """Leave what is loaded by now out of every later collection of garbage.

    A full one would otherwise stop all threads for 0.1 to 0.2 s every few seconds, the sign of life and STOP among
    them. Undone by `let_go`.
    """
    gc.set_threshold(*_THRESHOLDS)
    gc.freeze()


def let_go() -> None:
    """The session has ended: all may be collected again."""
    gc.unfreeze()


def load_rest() -> None:
    """Load all that a key may need; takes up to a second."""
    for name in _LATER:
        import_module(name)
    learn_events()
    keep_loaded()
