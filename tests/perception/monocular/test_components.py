"""Connected components against the statistics of OpenCV."""

import cv2
import numpy as np
import pytest

from perception.monocular.components import components


@pytest.mark.parametrize("connectivity", [4, 8])
@pytest.mark.parametrize("seed", range(20))
def test_boxes_areas_and_centroids_equal_those_of_opencv(seed, connectivity):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 80, 2)
    noise = cv2.GaussianBlur(rng.random((height, width)), (0, 0), rng.uniform(0.3, 2.0))
    mask = (noise > rng.uniform(0.3, 0.7)).astype(np.uint8) * 255
    labels, boxes, centroids = components(mask, connectivity)
    _, expected, stats, expected_centroids = cv2.connectedComponentsWithStats(
        mask, connectivity=connectivity, ltype=cv2.CV_16U
    )
    np.testing.assert_array_equal(labels, expected)
    used = stats[:, cv2.CC_STAT_AREA] > 0
    np.testing.assert_array_equal(boxes[used], stats[used])
    np.testing.assert_array_equal(centroids[used], expected_centroids[used])
    assert not boxes[~used, 4].any()
