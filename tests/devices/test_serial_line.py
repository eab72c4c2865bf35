"""Framing and parser of the line protocol, as properties."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.devices.serial_line import MAX_LINE, Identity, Line, LineParser, crc16, encode

NUMBERS = st.lists(st.integers(-(2**31), 2**32 - 1), max_size=8)
LINES = st.tuples(st.sampled_from("FPSRWN"), st.integers(0, 65535), NUMBERS)


def lines_of(items: list[tuple[str, int, list[int]]]) -> list[Line]:
    return [Line(kind, sequence, tuple(map(str, fields))) for kind, sequence, fields in items]


def test_the_check_value_of_the_crc() -> None:
    assert crc16(b"123456789") == 0x29B1


@given(st.lists(LINES, max_size=8), st.integers(1, 64))
def test_any_cut_into_pieces_gives_the_same_lines(
    items: list[tuple[str, int, list[int]]], size: int
) -> None:
    data = b"".join(encode(kind, sequence, *fields) for kind, sequence, fields in items)
    parser = LineParser()
    found = [line for i in range(0, len(data), size) for line in parser.feed(data[i : i + size])]
    assert found == lines_of(items)
    assert (parser.statistics.good, parser.statistics.bad) == (len(items), 0)


@given(LINES, st.data())
def test_a_changed_byte_is_never_taken_for_a_measurement(
    item: tuple[str, int, list[int]], data: st.DataObject
) -> None:
    good = encode(item[0], item[1], *item[2])
    at = data.draw(st.integers(0, len(good) - 2))
    value = data.draw(st.integers(0, 255).filter(lambda b: b != good[at]))
    parser = LineParser()
    parser.feed(encode("N", 0))
    # Only the check digits may change in a way that means the same: from capital to small letters.
    for line in parser.feed(good[:at] + bytes([value]) + good[at + 1 :]):
        assert line == lines_of([item])[0]


@given(st.binary(max_size=400), LINES)
def test_after_any_noise_the_next_line_is_found(
    noise: bytes, item: tuple[str, int, list[int]]
) -> None:
    parser = LineParser()
    parser.feed(noise)
    parser.feed(b"\n")
    assert parser.feed(encode(item[0], item[1], *item[2])) == lines_of([item])


@given(st.lists(st.integers(0, 50), min_size=1, max_size=20), st.integers(0, 65535))
def test_gaps_are_counted_through_the_wrap(gaps: list[int], start: int) -> None:
    parser = LineParser()
    sequence = start
    parser.feed(encode("F", sequence, 1, 2))
    for gap in gaps:
        sequence += gap + 1
        parser.feed(encode("F", sequence % 65536, 1, 2))
    assert parser.statistics.lost == sum(gaps)
    assert parser.statistics.restarts == 0


def test_answers_do_not_count_as_gaps() -> None:
    parser = LineParser()
    for data in (encode("F", 7, 1), encode("A", 500), encode("F", 8, 1)):
        parser.feed(data)
    assert parser.statistics.lost == 0


def test_an_endless_line_is_dropped_once_and_does_not_pile_up() -> None:
    parser = LineParser()
    for _ in range(100):
        assert parser.feed(b"x" * 100) == []
    assert len(parser._rest) <= MAX_LINE + 1
    assert parser.statistics.bad == 1
    parser.feed(b"\n")
    assert parser.feed(encode("F", 1, 2)) == [Line("F", 1, ("2",))]


def test_the_first_cut_line_is_no_fault_of_the_wire() -> None:
    parser = LineParser()
    parser.feed(encode("F", 1, 2)[4:])
    assert parser.statistics.bad == 0
    parser.feed(encode("F", 1, 2)[4:])
    assert parser.statistics.bad == 1


@pytest.mark.parametrize(
    "bad", [("f", "1"), ("FF", "1"), ("F", "a,b"), ("F", "a*b"), ("F", "a\nb"), ("F", "ü")]
)
def test_what_cannot_be_sent_is_refused(bad: tuple[str, str]) -> None:
    with pytest.raises(ValueError):
        encode(bad[0], 0, bad[1])
    with pytest.raises(ValueError):
        encode("F", 0, "x" * MAX_LINE)


def test_identity_survives_the_line() -> None:
    identity = Identity("pianobot-fsr", "1.0", features={"bits": "12"})
    (line,) = LineParser().feed(encode("I", 3, *identity.fields()))
    assert Identity.from_line(line) == identity
    assert Identity.from_line(Line("I", 0, ("a", "b", "c"))) is None
