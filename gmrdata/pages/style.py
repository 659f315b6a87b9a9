"""Colours, figures and their bytes: the same drawing serves the page (SVG) and pictures (PNG)."""

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

COLOURS = {
    "paper": "#ffffff",
    "ink": "#1d2329",
    "muted": "#68717a",
    "rule": "#e2e4e6",
    "person": "#1565b0",
    "person-pale": "#b4d5f5",
    "camera": "#d9480e",
    "camera-pale": "#ffcba6",
    "gmr": "#7a3fc4",
    "good": "#237a3b",
    "bad": "#c4222e",
}
"""Role -> colour on white.  In the page each one becomes the CSS variable of that name, so that
plots follow the reader's light or dark scheme; no two roles may share a colour."""

_RC: Any = {
    "svg.fonttype": "none",
    "font.size": 9.5,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "axes.edgecolor": COLOURS["rule"],
    "axes.labelcolor": COLOURS["muted"],
    "axes.titlecolor": COLOURS["ink"],
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "grid.color": COLOURS["rule"],
    "grid.linewidth": 0.7,
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["rule"],
    "ytick.color": COLOURS["rule"],
    "xtick.labelcolor": COLOURS["muted"],
    "ytick.labelcolor": COLOURS["muted"],
    "axes.grid": True,
    "axes.axisbelow": True,
    "lines.solid_capstyle": "round",
}

_DIGITS = re.compile(r"(\.[0-9]{2})[0-9]+")
"""Decimals from the third on."""

Draw = Callable[[Figure], None]
"""Fills a figure; called inside the style."""


def svg(draw: Draw, width_in: float, height_in: float, name: str) -> str:
    """An inline SVG element whose colours are CSS variables.

    Args:
        draw: Fills the figure.
        width_in: Width [inch]; the page scales it to its column.
        height_in: Height [inch].
        name: Unique on the page: the SVG's inner ids are made from it.
    """
    stream = io.StringIO()
    with _style({"svg.hashsalt": name}):
        figure = _figure(draw, width_in, height_in, dpi=72)
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return _inline(stream.getvalue(), name)


def picture(
    draw: Draw,
    width_in: float,
    height_in: float,
    dpi: int = 150,
    kind: Literal["png", "jpeg"] = "png",
) -> bytes:
    """PNG or JPEG bytes of a figure on white."""
    stream = io.BytesIO()
    kept = {"metadata": {"Software": None}} if kind == "png" else {"pil_kwargs": {"quality": 90}}
    with _style({}):
        figure = _figure(draw, width_in, height_in, dpi)
        figure.savefig(stream, format=kind, facecolor=COLOURS["paper"], **kept)
    return stream.getvalue()


def _figure(draw: Draw, width_in: float, height_in: float, dpi: int) -> Figure:
    layout = ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05)
    figure = Figure(figsize=(width_in, height_in), layout=layout, dpi=dpi)
    FigureCanvasAgg(figure)
    draw(figure)
    return figure


@contextmanager
def _style(more: Any) -> Iterator[None]:
    """Our look alone, whatever the user's matplotlibrc says; the settings are put back after it."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_RC)
        mpl.rcParams.update(more)
        yield


def quiet(axes: Axes) -> None:
    """Take the ticks' strokes away; the grid says the same."""
    axes.tick_params(length=0)


def _inline(document: str, name: str) -> str:
    """The `<svg>` element of an SVG document, without what only a file of its own needs."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r'(<g\b[^>]*?) id="[^"]*"', r"\1", element)
    # matplotlib makes ids from coordinates whose last bit the layout's solver leaves to chance.
    for number, id in enumerate(dict.fromkeys(re.findall(r' id="([^"]*)"', element))):
        element = element.replace(f'id="{id}"', f'id="{name}-{number}"')
        element = element.replace(f"#{id})", f"#{name}-{number})")
        element = element.replace(f'href="#{id}"', f'href="#{name}-{number}"')
    # A hundredth of a point is finer than any screen, and long curves are mostly digits.
    element = re.sub(r"<[^>]*>", lambda tag: _DIGITS.sub(r"\1", tag[0]), element)
    # The size is the viewBox's; the page's column gives the width.
    element = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", element, count=1)
    element = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", element, count=1)
    for role, colour in COLOURS.items():
        element = element.replace(colour, f"var(--{role})")
    return element.strip()
