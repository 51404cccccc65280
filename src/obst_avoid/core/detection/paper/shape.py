"""Connected regions of one colour, and the inertia criteria that tell things from paint (report, steps 4 and 5)."""

import math
from dataclasses import dataclass
from typing import List

from skimage.measure import label, regionprops

from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.types import Array, Box, Kind


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Blob:
    """One connected region of the bird view.

    box: [px]. pixels: (N, 2) int, columns u, v. area: [px^2]. major, minor: [px^2] eigenvalues of the inertia
    tensor. area, major and minor are scaled to the reference scale, so that they compare with the settings.
    refused: why it is not an obstacle, '' when it passes the criteria for a single picture.
    """

    kind: Kind
    box: Box
    pixels: Array
    area: float
    major: float
    minor: float
    refused: str

    @property
    def ratio(self) -> float:
        """Major / minor; infinite for a streak one pixel wide."""
        return _ratio(self.major, self.minor)


def find_blobs(mask: Array, kind: Kind, pixels_per_metre: float, settings: PaperSettings) -> List[Blob]:
    """Segment a mask and judge each region by itself.

    mask: (H, W) uint8, 0 outside. pixels_per_metre: of the mask's bird view; an area or eigenvalue in px^2 means
    the same size on the road in every view after scaling by its square.
    """
    scale = (settings.reference_scale / pixels_per_metre) ** 2
    blobs = []
    for region in regionprops(label(mask > 0, connectivity=2)):
        top, left, bottom, right = region.bbox
        box = Box(left, top, right, bottom)
        area, major, minor = float(region.area) * scale, 0.0, 0.0
        if area < settings.smallest_area:  # most are: the eigenvalues are not worth their time
            refused = 'area %.0f px^2, at least %.0f' % (area, settings.smallest_area)
        else:
            major, minor = (max(float(value), 0.0) * scale for value in region.inertia_tensor_eigvals)
            refused = _why_paint(kind, major, minor, settings)
        blobs.append(Blob(kind, box, region.coords[:, ::-1], area, major, minor, refused))
    return blobs


def confidence(blob: Blob, settings: PaperSettings) -> float:
    """0 to 1, one half where the report is sure: for ranking detections of single pictures, not a probability."""
    if blob.kind is Kind.DUCKIE:
        return blob.major / (blob.major + settings.sure_eigenvalue)
    return blob.ratio / (blob.ratio + settings.cone_ratio)


def _ratio(major: float, minor: float) -> float:
    return major / minor if minor > 0 else math.inf


def _why_paint(kind: Kind, major: float, minor: float, settings: PaperSettings) -> str:
    if kind is Kind.DUCKIE:
        if major > settings.duckie_eigenvalue:
            return ''
        return 'first eigenvalue %.0f px^2, more than %.0f for a duckie' % (major, settings.duckie_eigenvalue)
    ratio = _ratio(major, minor)
    if not math.isfinite(ratio):
        return 'one pixel wide: its ratio of eigenvalues says nothing'
    if ratio > settings.cone_ratio:
        return ''
    return 'ratio of eigenvalues %.0f, more than %.0f for a cone' % (ratio, settings.cone_ratio)
