"""The room around the town, as a panorama: walls, windows, doors, furniture."""

import functools

import cv2
import numpy as np

from obst_avoid.core.types import Array

SIZE = (488, 2048)
"""(rows, columns): elevation -43 to 43 degrees from the first row to the last, azimuth once around."""
FURNITURE = np.array(
    [[120, 85, 55], [175, 140, 95], [60, 60, 65], [150, 150, 155], [95, 40, 35], [45, 65, 95], [190, 175, 140],
     [70, 90, 60], [205, 150, 120], [215, 215, 210]], dtype=np.float32
)  # fmt: skip
"""sRGB of wood, cardboard, metal, cloth, plants, skin, paper."""


@functools.lru_cache(maxsize=4)
def room_picture(seed: int) -> Array:
    """(*SIZE, 3) uint8 BGR, square root of linear light; the floor lies below the middle row."""
    random = np.random.RandomState(seed + 77)
    rows, columns = SIZE
    picture = np.empty((rows, columns, 3), dtype=np.float32)
    wall = random.uniform(110, 215) + random.uniform(-14, 14, 3)
    picture[...] = wall
    for corner in random.permutation(8)[:4]:  # walls catch light differently
        begin = int((corner + random.uniform(0, 0.5)) * columns / 8)
        picture[:, begin : begin + columns // 6] *= random.uniform(0.75, 1.1)
    horizon = rows // 2
    picture[horizon + rows // 3 :] = random.uniform(190, 250)  # ceiling
    for _ in range(random.randint(2, 5)):  # windows and lamps
        left, top = random.randint(columns), horizon + random.randint(8, rows // 3)
        cv2.rectangle(picture, (left, top), (left + random.randint(50, 200), top + random.randint(20, 90)),
                      (255, 255, 250), -1)  # fmt: skip
    for _ in range(60):  # furniture stands on the floor and hides the wall's foot
        color = FURNITURE[random.randint(len(FURNITURE))] * random.uniform(0.5, 1.1)
        left, width = random.randint(columns), random.randint(10, 130)
        height = int(abs(random.normal(0, 24))) + 4
        cv2.rectangle(picture, (left, 0), (left + width, horizon + height), tuple(float(c) for c in color), -1)
        if random.rand() < 0.5:
            inner = tuple(float(c) * 0.7 for c in color)
            cv2.rectangle(picture, (left + width // 6, horizon), (left + width // 2, horizon + height - 2), inner, -1)
    picture[:horizon] = (60, 55, 48)
    picture = cv2.GaussianBlur(picture, (0, 0), 1.2)
    linear = (np.clip(picture, 0, 255) / 255) ** 2.2 * 0.7
    encoded: Array = np.rint(255 * np.sqrt(linear[..., ::-1])).astype(np.uint8)
    return encoded
