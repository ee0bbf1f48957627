"""What OpenStreetMap's tags say of a building: whether anything stands on the ground there, and how high.

https://wiki.openstreetmap.org/wiki/Key:height: metres unless another unit is written out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

FOOT_M = 0.3048
INCH_M = 0.0254
UNITS_M = {
    "": 1.0,
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "ft": FOOT_M,
    "feet": FOOT_M,
}
NUMBER = r"\d+(?:[.,]\d+)?"
WITH_UNIT = re.compile(rf"(?P<number>{NUMBER})\s*(?P<unit>[a-z]*)")
FEET_AND_INCHES = re.compile(rf"(?P<feet>{NUMBER})\s*'\s*(?:(?P<inches>{NUMBER})\s*(?:\"|''))?")
LEVELS = re.compile(rf"{NUMBER}(?:\s*;\s*{NUMBER})*")
LEVEL_M = 3.2
ROOF_M = 1.0
"""A house of n levels is taken as n * 3.2 m + 1 m high."""
HEIGHT_MAX_M = 300.0
HEIGHT_BY_TYPE_M = {"garage": 3.0, "garages": 3.0, "shed": 2.5, "kiosk": 3.0, "house": 7.0, "church": 20.0}
HEIGHT_DEFAULT_M = 10.0


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def length_m(text: str) -> float | None:
    """A length as OpenStreetMap writes it: `12`, `12.5 m`, `40 ft`, `39'4"`; None for what is no positive length."""
    text = text.strip().lower()
    if found := FEET_AND_INCHES.fullmatch(text):
        metres = _number(found["feet"]) * FOOT_M + _number(found["inches"] or "0") * INCH_M
    elif (found := WITH_UNIT.fullmatch(text)) and found["unit"] in UNITS_M:
        metres = _number(found["number"]) * UNITS_M[found["unit"]]
    else:
        return None
    return metres if metres > 0 else None


def height_m(tags: Mapping[str, str]) -> tuple[float, bool]:
    """A building's height [m] by `height`, else by `building:levels`, else by its type; and whether that is a guess."""
    if (told := length_m(tags.get("height", ""))) is not None:
        return round(min(told, HEIGHT_MAX_M), 1), False
    levels = tags.get("building:levels", "").strip()
    if LEVELS.fullmatch(levels) and (highest := max(map(_number, re.findall(NUMBER, levels)))) > 0:
        return round(min(highest * LEVEL_M + ROOF_M, HEIGHT_MAX_M), 1), False
    return HEIGHT_BY_TYPE_M.get(tags.get("building", ""), HEIGHT_DEFAULT_M), True


def absence(tags: Mapping[str, str]) -> str | None:
    """Why nothing stands on the ground here although there is a `building` tag, None where something does."""
    if tags.get("building") in ("no", "demolished", "razed", "proposed", "construction"):
        return "torn down or not yet built"
    if tags.get("location") == "underground" or tags.get("layer", "0").startswith("-"):
        return "underground"
    if (
        tags.get("building") == "roof"
        or length_m(tags.get("min_height", ""))
        or tags.get("building:min_level", "0") != "0"
    ):
        return "raised, open underneath"
    return None
