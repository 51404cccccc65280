"""Small matrices, without LAPACK.

To invert a 3 x 3 matrix OpenBLAS wakes a thread a core, and these look for more work for some 20 ms, at full speed. A
node that inverts one at each picture keeps all cores busy that way. OpenCV inverts small matrices by itself. Where it
gives up, since a pivot is small or a determinant overflows, NumPy decides: a covariance may say 1e20 of what nobody
knows.
"""

import math

import cv2
import numpy as np

from obst_avoid.core.types import Array


def inverted(matrix: Array) -> Array:
    """The inverse of an (N, N) float64 matrix, N of a few. Raises numpy.linalg.LinAlgError when there is none."""
    there, inverse = cv2.invert(matrix)
    usable: Array = inverse if there and 0 < cv2.norm(inverse) < math.inf else np.linalg.inv(matrix)  # noqa: TID251
    return usable


def solved(matrix: Array, right: Array) -> Array:
    """What the matrix, (N, N) float64, has to be multiplied with for right, (N,) or (N, K) float64; as right. Raises
    numpy.linalg.LinAlgError when there is no such, or more than one.
    """
    there, solution = cv2.solve(matrix, right)
    if there and 0 < cv2.norm(solution) < math.inf:
        shaped: Array = solution.reshape(right.shape)
        return shaped
    result: Array = np.linalg.solve(matrix, right)  # noqa: TID251
    return result
