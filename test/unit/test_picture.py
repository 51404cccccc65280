"""core.picture: bytes become a picture, or one sentence says why not."""

from typing import Any

import cv2
import numpy as np
import pytest

from obst_avoid.core.picture import PictureError, check_picture, decode, decode_jpeg, encode_jpeg, stretched


def painted(height: int = 48, width: int = 64) -> np.ndarray:
    """A picture with structure in all channels."""
    u, v = np.meshgrid(np.linspace(0, 255, width), np.linspace(0, 255, height))
    return np.dstack([u, v, 255 - u]).astype(np.uint8)


def encoded(picture: np.ndarray, extension: str = '.jpg') -> bytes:
    """A picture as OpenCV encodes it."""
    return bytes(cv2.imencode(extension, picture)[1])


GOOD = encoded(painted())


def refusal(data: bytes) -> str:
    """What decode_jpeg says when it refuses."""
    with pytest.raises(PictureError) as refused:
        decode_jpeg(data)
    return str(refused.value)


@pytest.mark.parametrize(
    'data, message',
    [
        pytest.param(b'', 'the picture is empty, expected JPEG bytes', id='empty'),
        pytest.param(b'\xff', 'the picture starts with ff, expected a JPEG (ff d8)', id='one byte'),
        pytest.param(b'hello', 'the picture starts with 6865, expected a JPEG (ff d8)', id='text'),
        pytest.param(encoded(painted(), '.png'), 'the picture starts with 8950, expected a JPEG (ff d8)', id='PNG'),
        pytest.param(bytes(64), 'the picture starts with 0000, expected a JPEG (ff d8)', id='zeros'),
        pytest.param(GOOD[2:], 'the picture starts with ff', id='without its beginning'),
        pytest.param(
            b'\xff\xd8' + bytes(60) + b'\xff\xd9', 'the picture of 64 bytes does not decode, expected a JPEG', id='junk'
        ),
        pytest.param(
            b'\xff\xd8\xff\xd9', 'the picture of 4 bytes does not decode, expected a JPEG', id='two markers alone'
        ),
        pytest.param(
            GOOD[: len(GOOD) // 2],
            'the picture of %d bytes has no end marker, expected a whole JPEG (ff d9)' % (len(GOOD) // 2),
            id='cut in the middle',
        ),
        pytest.param(GOOD[:-1], 'has no end marker, expected a whole JPEG', id='without its last byte'),
        pytest.param(encoded(painted(8, 8)), 'the picture is 8x8, expected at least 16x16', id='tiny'),
        pytest.param(encoded(painted(15, 640)), 'the picture is 640x15, expected at least 16x16', id='a strip'),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(data: bytes, message: str) -> None:
    assert message in refusal(data)


def test_a_grey_picture_is_refused_for_its_missing_colour() -> None:
    assert 'expected colour' in refusal(encoded(painted()[:, :, 0]))


def test_a_header_that_claims_an_absurd_size_is_refused() -> None:
    start = GOOD.index(b'\xff\xc0')  # start of frame: length (2), precision (1), height (2), width (2)
    assert 'expected a JPEG' in refusal(GOOD[: start + 5] + b'\xff\xff\xff\xff' + GOOD[start + 9 :])


@pytest.mark.parametrize('padding', [b'', b'\x00', bytes(8), b'\xff' * 16, bytes(30)], ids=len)
def test_a_whole_picture_decodes_with_padding_behind_its_end(padding: bytes) -> None:
    picture = decode_jpeg(GOOD + padding)
    assert (picture.shape, picture.dtype) == ((48, 64, 3), np.uint8)
    assert np.abs(picture.astype(int) - painted()).mean() < 8, 'blue, green, red in this order'


def test_files_of_other_formats_decode_too() -> None:
    np.testing.assert_array_equal(decode(encoded(painted(), '.png')), painted())
    assert decode(GOOD).shape == (48, 64, 3)


@pytest.mark.parametrize(
    'data, message',
    [
        pytest.param(b'', 'the picture of 0 bytes does not decode', id='empty'),
        pytest.param(b'hello', 'the picture of 5 bytes does not decode', id='text'),
        pytest.param(encoded(painted()[:, :, 0], '.png'), 'expected colour', id='a grey PNG'),
        pytest.param(encoded(painted().astype(np.uint16), '.png'), 'of uint16, expected', id='a PNG of 16 bits'),
        pytest.param(encoded(painted(8, 8), '.png'), 'the picture is 8x8, expected at least 16x16', id='a tiny PNG'),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_sentence(data: bytes, message: str) -> None:
    with pytest.raises(PictureError) as refused:
        decode(data)
    assert message in str(refused.value)


@pytest.mark.parametrize('quality, error', [(95, 3), (50, 12)])
def test_encoding_loses_little(quality: int, error: float) -> None:
    back = decode_jpeg(encode_jpeg(painted(), quality))
    assert np.abs(back.astype(int) - painted()).mean() < error
    assert len(encode_jpeg(painted(), 95)) > len(encode_jpeg(painted(), 50))


def test_the_smallest_picture_decodes() -> None:
    assert decode_jpeg(encoded(painted(16, 16))).shape == (16, 16, 3)


@pytest.mark.parametrize(
    'picture, message',
    [
        pytest.param(np.zeros((0, 0, 3), np.uint8), 'the picture is 0x0, expected at least 16x16', id='empty'),
        pytest.param(np.zeros((48, 64), np.uint8), 'expected colour', id='grey'),
        pytest.param(
            np.zeros((48, 64, 4), np.uint8), 'has shape (48, 64, 4) of uint8, expected (height, width, 3)', id='alpha'
        ),
        pytest.param(np.zeros((48, 64, 3), np.float32), 'has shape (48, 64, 3) of float32, expected', id='floats'),
        pytest.param(np.zeros((48, 64, 3, 2), np.uint8), 'has shape (48, 64, 3, 2) of uint8', id='four axes'),
    ],
)
def test_an_array_that_is_no_colour_picture_is_refused(picture: np.ndarray, message: str) -> None:
    with pytest.raises(PictureError) as refused:
        check_picture(picture)
    assert message in str(refused.value)


def test_a_good_array_is_returned_as_it_is() -> None:
    picture = painted()
    assert check_picture(picture) is picture


def test_black_levels_spread_each_channel() -> None:
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[0, 0], picture[0, 1], picture[1, 0] = (10, 20, 30), (110, 120, 230), (60, 70, 130)
    found = stretched(picture, (10, 20, 30), (110, 120, 230))
    assert found[0, 0].tolist() == [0, 0, 0] and found[0, 1].tolist() == [255, 255, 255]
    assert found[1, 0].tolist() == [128, 128, 128] and found[1, 1].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    'low, high',
    [((0, 0, 0), (0, 255, 255)), ((-1, 0, 0), (9, 9, 9)), ((0, 0, 0), (256, 99, 99)), ((9, 9, 9), (40, 99, 99))],
)
def test_black_levels_that_cannot_be(low: Any, high: Any) -> None:
    with pytest.raises(PictureError, match='the black levels are .*, expected 0 <= low < high <= 255, 32 apart'):
        stretched(np.zeros((1, 1, 3), np.uint8), low, high)
