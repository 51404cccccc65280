"""Pictures from files."""

from obst_avoid.core.picture import PictureError, decode, decode_jpeg, encode_jpeg
from obst_avoid.core.types import Array


def read_jpeg(path: str) -> bytes:
    """The bytes of one picture file as JPEG; another format is encoded anew. Raises PictureError, OSError."""
    with open(path, 'rb') as file:
        data = file.read()
    if data[:8] == b'\x89PNG\r\n\x1a\n':
        return encode_jpeg(decode(data), 95)
    return data


def read_picture(path: str) -> Array:
    """(H, W, 3) uint8, BGR. The message names the file. Raises PictureError, OSError."""
    try:
        return decode_jpeg(read_jpeg(path))
    except PictureError as error:
        raise PictureError('%s: %s' % (path, error)) from error
