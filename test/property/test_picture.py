"""core.picture: whatever comes over the wire, it is a picture or a PictureError."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.core.picture import PictureError, decode_jpeg

ACROSS, ALONG = np.meshgrid(np.arange(0, 256, 4), np.arange(0, 256, 5))
RAMP = np.dstack([ACROSS, ALONG, np.full_like(ACROSS, 90)]).astype(np.uint8)
GOOD = bytes(cv2.imencode('.jpg', RAMP)[1])


def picture_or_refusal(data: bytes) -> None:
    """Anything else than a colour picture or a PictureError fails the test."""
    try:
        picture = decode_jpeg(data)
    except PictureError:
        return
    assert picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3 and min(picture.shape[:2]) >= 16


@given(data=st.binary(max_size=400))
def test_any_bytes(data: bytes) -> None:
    picture_or_refusal(data)


@given(data=st.binary(max_size=400))
def test_any_bytes_between_the_markers(data: bytes) -> None:
    picture_or_refusal(b'\xff\xd8' + data + b'\xff\xd9')


@given(length=st.integers(0, len(GOOD) - 1))
def test_a_picture_that_was_cut_off_is_refused(length: int) -> None:
    try:
        decode_jpeg(GOOD[:length])
    except PictureError:
        return
    raise AssertionError('%d of %d bytes decoded' % (length, len(GOOD)))


@given(length=st.integers(2, len(GOOD) - 1))
def test_a_cut_picture_with_an_end_marker_does_no_harm(length: int) -> None:
    picture_or_refusal(GOOD[:length] + b'\xff\xd9')


@given(bits=st.lists(st.integers(16, len(GOOD) * 8 - 1), min_size=1, max_size=3))
def test_flipped_bits_do_no_harm(bits: list) -> None:
    data = bytearray(GOOD)
    for bit in bits:
        data[bit // 8] ^= 1 << bit % 8
    picture_or_refusal(bytes(data))
