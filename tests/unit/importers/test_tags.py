"""Heights as people write them, in feet by the book (0.3048 m) and in words."""

import pytest
from orograph.importers.tags import height_m, length_m


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("12", 12.0),
        ("12.5 m", 12.5),
        ("12,5m", 12.5),
        ("40 ft", 12.192),
        ("40'", 12.192),
        ("39'4\"", 11.9888),
        ("1200 cm", 12.0),
        ("0", None),
        ("-3", None),
        ("tall", None),
        ("1e3", None),
        ("12 km", None),
        ("", None),
        ("5-7", None),
    ],
)
def test_lengths(text: str, metres: float | None) -> None:
    assert length_m(text) == (pytest.approx(metres) if metres else None)


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({"height": "12.5"}, (12.5, False)),
        ({"height": "9000"}, (300.0, False)),
        ({"building:levels": "4"}, (13.8, False)),
        ({"building:levels": "3;4"}, (13.8, False)),
        ({"height": "tall", "building:levels": "1"}, (4.2, False)),
        ({"height": "0"}, (10.0, True)),
        ({}, (10.0, True)),
        ({"building": "garage"}, (3.0, True)),
        ({"building:levels": "many"}, (10.0, True)),
    ],
)
def test_heights_and_whether_they_are_guessed(tags: dict[str, str], height: tuple[float, bool]) -> None:
    assert height_m({"building": "yes", **tags}) == height
