"""viz.overlay: what a tracker remembers and no picture shows."""

import numpy as np
import pytest

from obst_avoid.core.bird_view import BirdViewSettings, footprint_box, make_bird_view
from obst_avoid.core.types import Obstacle
from obst_avoid.viz.overlay import draw_on_bird_view, draw_on_picture
from unit.cameras import Camera, calibration_of

VIEW = make_bird_view(calibration_of(Camera()), BirdViewSettings(crop_distance=1.7, horizon_margin=0.021))


@pytest.mark.parametrize('x, drawn', [(0.5, True), (0.02, False), (-0.15, False)])
def test_a_remembered_obstacle_is_drawn_where_it_would_be_seen(x: float, drawn: bool) -> None:
    remembered = Obstacle(None, x, 0.0, 0.03, True, bird_box=footprint_box(VIEW, x, 0.0, 0.03))
    picture = np.full((480, 640, 3), 90, dtype=np.uint8)
    assert (draw_on_picture(picture, [remembered], VIEW) != picture).any() == drawn
    bird = np.full((VIEW.height, VIEW.width, 3), 90, dtype=np.uint8)
    draw_on_bird_view(bird, [remembered])  # a box below the bird view is no error
