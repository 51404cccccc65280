"""Pictures from files."""

import cv2
import numpy as np

from obst_avoid.core.picture import PictureError, check_picture, decode_jpeg, encode_jpeg
from obst_avoid.core.types import Array


def read_jpeg(path: str) -> bytes:
    """The bytes of one picture file as JPEG; another format is encoded anew. Raises PictureError, OSError."""
    with open(path, 'rb') as file:
        data = file.read()
    if data[:8] == b'\x89PNG\r\n\x1a\n':
        picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise PictureError('the picture does not decode, expected a PNG')
        return encode_jpeg(check_picture(picture), 95)
    return data


def read_picture(path: str) -> Array:
    """(H, W, 3) uint8, BGR. The message names the file. Raises PictureError, OSError."""
    try:
        return decode_jpeg(read_jpeg(path))
    except PictureError as error:
        raise PictureError('%s: %s' % (path, error)) from error
