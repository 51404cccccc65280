"""From JPEG bytes to a picture, or one clear sentence why not."""

from typing import Sequence

import cv2
import numpy as np

from obst_avoid.core.types import Array

LEAST_SPREAD = 32
"""Grey levels between black and white of a picture that shows anything."""


class PictureError(ValueError):
    """A picture that cannot be used. The message says what was found and what was expected."""


def decode_jpeg(data: bytes) -> Array:
    """Decode one JPEG to (H, W, 3) uint8, BGR.

    Raises PictureError for bytes that are empty, not JPEG, cut off, not decodable, or without colour. The end
    marker is checked here because OpenCV decodes half a picture without an error.
    """
    if not data:
        raise PictureError('the picture is empty, expected JPEG bytes')
    if data[:2] != b'\xff\xd8':
        raise PictureError('the picture starts with %s, expected a JPEG (ff d8)' % data[:2].hex())
    if b'\xff\xd9' not in data[-32:]:  # a camera may pad behind the end marker
        raise PictureError('the picture of %d bytes has no end marker, expected a whole JPEG (ff d9)' % len(data))
    return decode(data)


def decode(data: bytes) -> Array:
    """Decode a picture in any format that OpenCV knows to (H, W, 3) uint8, BGR. Raises PictureError."""
    try:
        picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # for example of a size that no camera has
        picture = None
    if picture is None:
        raise PictureError('the picture of %d bytes does not decode, expected a JPEG or PNG' % len(data))
    return check_picture(picture)


def encode_jpeg(picture: Array, quality: int = 90) -> bytes:
    """The inverse of decode_jpeg, with losses. picture: (H, W, 3) uint8, BGR. quality: 0 to 100."""
    return bytes(cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def stretched(picture: Array, low: Sequence[int], high: Sequence[int]) -> Array:
    """A picture whose channels are spread so that low becomes 0 and high 255. low, high: in the picture's order, BGR.

    Raises PictureError where they are no levels, or so near to each other that noise would fill the picture.
    """
    if not all(0 <= a <= b - LEAST_SPREAD and b <= 255 for a, b in zip(low, high)):
        raise PictureError(
            'the black levels are %s and %s, expected 0 <= low < high <= 255, %d apart'
            % (list(low), list(high), LEAST_SPREAD)
        )
    first, last = np.array(low, float), np.array(high, float)
    table = np.clip((np.arange(256)[:, None] - first) * 255 / (last - first) + 0.5, 0, 255).astype(np.uint8)
    spread: Array = cv2.LUT(picture, table[:, None])
    return spread


def check_picture(picture: Array) -> Array:
    """Return the picture if it is (H, W, 3) uint8 and not tiny. Raises PictureError."""
    if picture.ndim == 2:
        raise PictureError('the picture has one channel, expected colour: grey says nothing about duckies and cones')
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise PictureError(
            'the picture has shape %s of %s, expected (height, width, 3) of uint8' % (picture.shape, picture.dtype)
        )
    if min(picture.shape[:2]) < 16:
        raise PictureError('the picture is %dx%d, expected at least 16x16' % (picture.shape[1], picture.shape[0]))
    return picture
