"""Small matrices, without LAPACK.

To invert a 3 x 3 matrix OpenBLAS wakes a thread a core, and these look for more work for some 20 ms, at full speed. A
node that inverts one at each picture keeps all cores busy that way. OpenCV inverts small matrices by itself.
"""

import cv2
import numpy as np

from obst_avoid.core.types import Array


def inverted(matrix: Array) -> Array:
    """The inverse of an (N, N) float64 matrix, N of a few. Raises numpy.linalg.LinAlgError when there is none."""
    there, inverse = cv2.invert(np.asarray(matrix, dtype=np.float64))
    if not there:
        raise np.linalg.LinAlgError('the matrix has no inverse: %s' % np.asarray(matrix).tolist())
    result: Array = inverse
    return result


def solved(matrix: Array, right: Array) -> Array:
    """What the matrix, (N, N) float64, has to be multiplied with for right: (N,) or (N, K), as the result. Raises
    numpy.linalg.LinAlgError when there is no such, or more than one.
    """
    there, result = cv2.solve(np.asarray(matrix, dtype=np.float64), np.asarray(right, dtype=np.float64))
    if not there:
        raise np.linalg.LinAlgError('the matrix has no inverse: %s' % np.asarray(matrix).tolist())
    shaped: Array = result.reshape(np.shape(right))
    return shaped
