"""The page that shows a file in a notebook."""

from __future__ import annotations

import builtins
import json
import os
import pathlib
from typing import Any

from . import _native

# Maximum size in bytes of a message to the page; its reader requests less.
_MAX_BYTES = 64 << 20


def title_of(path: str) -> str:
    """Returns the title of a file's page: its name without directory and extension."""
    return os.path.splitext(os.path.basename(path))[0]


def shown(path: str, start: dict[str, Any], height: int) -> Any:
    """Returns a widget with the page of a file, which the kernel reads for it."""
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise ImportError("show() is for notebooks, and needs the package anywidget: pip install 'spinney[notebook]'") from error
    if not os.path.isfile(path):
        raise ValueError(f"{path}: is not a local file, which show() needs; write a page with export('index.html')")
    size, pixels = os.path.getsize(path), height
    html = _native.page_html(os.path.basename(path), title_of(path), size, start)

    class Page(anywidget.AnyWidget):
        """The page of a file; `polygon` is the polygon drawn last, as GeoJSON, and `statistics` are
        those of its cells.
        """

        _esm = pathlib.Path(__file__).with_name("show.js")
        _html = traitlets.Unicode(html).tag(sync=True)
        _drawn = traitlets.Unicode("").tag(sync=True)
        height = traitlets.Int(pixels).tag(sync=True)

        def __init__(self) -> None:
            super().__init__()
            self.on_msg(self._send_range)

        @property
        def polygon(self) -> dict[str, Any] | None:
            """The geometry drawn last: in longitude and latitude, or in the file's own coordinates
            if it is shown in these.
            """
            return json.loads(self._drawn)["geometry"] if self._drawn else None

        @property
        def crs(self) -> str | None:
            """The polygon's coordinates, as an argument of `zonal`: "lonlat", or "world", the
            file's own.
            """
            return json.loads(self._drawn)["crs"] if self._drawn else None

        @property
        def statistics(self) -> dict[str, Any] | None:
            """The statistics on the page; cells count by their share inside the polygon."""
            return json.loads(self._drawn)["zone"] if self._drawn else None

        def _send_range(self, _widget: Any, message: Any, _buffers: Any) -> None:
            number = message["range"]
            try:
                start, end = int(message["start"]), int(message["end"])
                if not 0 <= start <= end <= size or end - start > _MAX_BYTES:
                    raise ValueError(f"bytes {start} to {end} of {size} in {path}")
                with builtins.open(path, "rb") as file:
                    file.seek(start)
                    data = file.read(end - start)
                self.send({"range": number}, buffers=[data])
            except (OSError, ValueError) as error:
                self.send({"range": number, "failure": str(error)})

    return Page()
