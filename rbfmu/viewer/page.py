"""The panel that a page shows over the drawing: title, time, values with units, what the colours mean."""

import base64
import json
import re
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from rbfmu.viewer.geometry import STROBE, Geometry
from rbfmu.viewer.motion import Motion
from rbfmu.viewer.recording import LETTERS, MOMENTUM, RATE, TRACE, recorded_page
from rbfmu_kernels.quantities import OUTPUT

SEEN = {MOMENTUM: "#dca640", RATE: "#15a092", TRACE: "#c95fa6"}
"""What colours look like in the drawing's light."""


def motion_page(motion: Motion) -> str:
    """Return the page that plays a motion."""
    geometry = Geometry(motion)
    return _with_panel(recorded_page(geometry), geometry)


def _with_panel(page: str, geometry: Geometry) -> str:
    panel = files("rbfmu.viewer").joinpath("panel.html").read_text(encoding="utf-8")
    data = json.dumps(_data(geometry)).replace("<", "\\u003c")
    filled = {"TITLE": escape(geometry.motion.title), "LEGEND": _legend(geometry), "DATA": data}
    panel = re.sub(r"\$([A-Z]+)", lambda found: filled[found[1]], panel)
    page = re.sub("<title>.*?</title>", lambda _: f"<title>{filled['TITLE']}</title>", page, count=1)
    before, end, after = page.rpartition("</body>")
    return f"{before}{panel}{end}{after}"


def _data(geometry: Geometry) -> dict[str, Any]:
    result = geometry.motion.result
    span = float(result.time[-1] - result.time[0])
    return {
        "time": _packed(result.time),
        "played": _packed((result.time - result.time[0]) * (geometry.motion.played / span)),
        "quantities": [
            {
                "name": name,
                "unit": OUTPUT[name].unit,
                "meaning": OUTPUT[name].meaning,
                "components": OUTPUT[name].components,
                "values": _packed(values),
            }
            for name, values in result.quantities.items()
        ],
    }


def _packed(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")


def _legend(geometry: Geometry) -> str:
    motion = geometry.motion
    rows = [("axes", "thin axes: a, fixed in space; thick axes: b, fixed in the body; x red, y green, z blue")]
    if motion.angular_momentum is not None:
        point = "o" if motion.pivot else "the centre of mass"
        rows.append((SEEN[MOMENTUM], f"h: angular momentum about {point}, {_longest(motion.angular_momentum)} kg m²/s"))
    if motion.rate is not None:
        rows.append((SEEN[RATE], f"ω: angular velocity of b in a, {_longest(motion.rate)} rad/s"))
    if geometry.traced is not None:
        rows.append((SEEN[TRACE], f"trace: tip of the body's axis {LETTERS[geometry.traced]}_b"))
    rows += [("", note) for note in _notes(geometry)]
    return "".join(f'<li><i style="background:{color}"></i>{escape(text)}</li>' for color, text in rows)


def _notes(geometry: Geometry) -> list[str]:
    motion, span = geometry.motion, float(geometry.motion.result.time[-1] - geometry.motion.result.time[0])
    notes = [f"body: {motion.shape.text}"]
    if motion.ghosts:
        notes.append(f"pale bodies: {len(motion.ghosts)} runs of the ensemble")
    if geometry.enlarged > 1.0:
        notes.append(f"the body is drawn {geometry.enlarged:.3g} times too large beside its path")
    if np.any(geometry.origin_a):
        notes.append("the axes of a stand where the path begins")
    notes.append(_pace(span / motion.played))
    if motion.largest_turn > STROBE:
        turn = np.degrees(motion.largest_turn)
        notes.append(
            f"it turns by up to {turn:.0f}° between pictures, so its spin is not seen as it is: show a shorter time"
        )
    return [*notes, *motion.notes]


def _pace(factor: float) -> str:
    if abs(factor - 1.0) < 0.01:
        return "played in real time"
    return f"{factor:.3g} times as fast as it is" if factor > 1.0 else f"slowed down {1.0 / factor:.3g} times"


def _longest(vectors: Any) -> str:
    return f"longest {float(np.max(np.linalg.norm(vectors, axis=1))):.3g}"
