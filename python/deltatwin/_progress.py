"""Progress of long computations, as a bar of tqdm where that is installed."""

from __future__ import annotations

import math
import sys
from typing import Protocol


class _Shown(Protocol):
    n: float

    def refresh(self) -> object: ...

    def set_postfix_str(self, s: str, refresh: bool = True) -> None: ...

    def close(self) -> None: ...


class Bar:
    """A bar from 0 to 100 % that appears after a second."""

    def __init__(self, shown: _Shown) -> None:
        self._shown = shown

    def __call__(self, what: str, share: float) -> None:
        """Show that ``share`` (0 to 1, NaN if it is not known) is done, and what is done now."""
        if math.isfinite(share):
            self._shown.n = round(100.0 * min(max(share, 0.0), 1.0), 1)
        self._shown.set_postfix_str(what, refresh=False)
        self._shown.refresh()

    def close(self) -> None:
        """Remove the bar."""
        self._shown.close()


def bar(title: str) -> Bar | None:
    """A bar, or ``None`` without tqdm, or where neither a terminal nor a notebook shows it."""
    if not (sys.stderr is not None and sys.stderr.isatty()) and "ipykernel" not in sys.modules:
        return None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return Bar(tqdm(total=100, desc=title, unit="%", leave=False, delay=1.0))
