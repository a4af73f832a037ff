"""Features and surfaces in a round room, where depth cannot tell how the head is turned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import PriorConfig
from surefoot.experiments.seed_004 import panorama_rooms
from surefoot.experiments.seed_004.panorama_ablation import open3d_align
from surefoot.experiments.seed_004.panorama_scenes import errors_deg, nine_views


def rms_deg(views, true, config):
    config = replace(config, prior=PriorConfig(pan_deg=2.0, tilt_deg=2.0))
    placed, _, _ = place(views, np.random.default_rng(0), config)
    poses = [one.T_base_camera for one in placed]
    return math.sqrt(float(np.mean(errors_deg(poses, true, True) ** 2)))


def test_flush_posters_halve_the_errors_of_a_round_room():
    scene = panorama_rooms.load("textured", "round", 12)
    views, true = nine_views(scene, np.random.default_rng(12), 2.0)
    full = StitchConfig()
    without = rms_deg(views, true, replace(full, features=False))
    assert without > 0.6
    assert rms_deg(views, true, full) < 0.5 * without
    assert rms_deg(views, true, replace(full, features=False, aligner=open3d_align)) > without / 2
