"""Floors of real recordings against their claims: error over covariance, for every shared recording with a known floor.

The pipeline processes each recording as for any user: with its poses, and with the published distortion of its kind of
sensor. NEES per degree of freedom of tilt and height, the truth's own uncertainty counted. No parameter is chosen on
these recordings: the sizes of the distortion are published, and simulated views (seeds 5000 to 5023) set what is left
for calibrated cameras.

Source: ours; reference planes of the data sets (floor.csv), exact poses of the rendered ones, heights in the
descriptions where there is no more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from perception.depth import points, stereo, structured_light
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.primitives.frame import DepthView, StereoView
from perception.primitives.plane import Plane

from ...recordings.description import read_description
from ...recordings.euroc import open_euroc
from ...recordings.poses import read_trajectory_log
from ...recordings.stereo_calibration import read_rectified_pair
from ..support import real_data
from ..support.experiment import Say
from .floors import estimates
from .stereo import LAB_HEIGHT_M, REACH_M, floor_of

Pairs = list[tuple[Plane, Plane]]
