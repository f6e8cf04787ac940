"""The frame parsers under what hypothesis invents: whole, cut, doubled, damaged and arbitrary frames."""

from fuzz_frames import CORPUS, case
from hypothesis import given, settings
from hypothesis import strategies as st

CASES = settings(max_examples=150, deadline=None, derandomize=True)
listeners, cuts = st.integers(0, 2), st.integers(0, 31)
frames = st.sampled_from([bytes(frame[2:]) for frame in CORPUS])


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    frame = bytearray(draw(frames))
    at = draw(st.integers(0, len(frame) - 1))
    frame[at : at + draw(st.integers(0, 3))] = draw(st.binary(max_size=3))
    return bytes(frame)


@CASES
@given(listeners, cuts, st.lists(st.one_of(frames, damaged(), st.binary(max_size=12)), max_size=6))
def test_nothing_is_answered_or_believed_that_no_sound_frame_says(listener, cut, said) -> None:
    case(bytes((listener, cut)) + b"".join(said))


@CASES
@given(st.binary(max_size=300))
def test_arbitrary_bytes_do_nothing(data) -> None:
    case(data)
