"""What other viewers get of a run."""

from __future__ import annotations

import json

import numpy as np
import pytest

from perception.primitives.errors import OutputError
from perception.primitives.gaussian import Gaussian
from surefoot.report import viewers
from surefoot.results.moment import Moment, SurfaceSeen
from surefoot.results.moments import MomentWriter
from surefoot.results.run_folder import RunFolder

SQUARE = np.array([[0.0, 0.0, 0.09], [1.0, 0.0, 0.09], [1.0, 1.0, 0.09], [0.0, 1.0, 0.09]])


def test_every_panel_of_the_layout_is_configured_and_placed(tmp_path):
    layout = json.loads(viewers.write_layout(tmp_path / "layout.json").read_text())

    def panels(node):
        return {node} if isinstance(node, str) else panels(node["first"]) | panels(node["second"])

    assert panels(layout["layout"]) == set(layout["configById"])
    with pytest.raises(OutputError, match="choose another file"):
        viewers.write_layout(tmp_path / "nowhere" / "layout.json")


def test_rerun_reads_back_poses_that_move_and_surfaces(tmp_path):
    chunk = pytest.importorskip("rerun.chunk", reason="rerun is not installed")
    run = RunFolder.create(tmp_path / "run")
    writer = MomentWriter(run)
    for k in range(5):
        pose = Gaussian(np.array([0.1 * k, 1.0, 0.5]), np.eye(3))
        seen = (SurfaceSeen(SQUARE, np.zeros(4, int)),) if k == 2 else None
        up = None if k < 2 else np.full(3, 0.09)
        writer.write(Moment(10.0 + k, pose, surfaces=seen, heights_m=up))
    writer.close(())
    out = viewers.write_rerun(run, tmp_path / "run.rrd")
    times, places, outlines = [], [], []
    for one in chunk.RrdReader(str(out)).stream():
        if str(one.entity_path) == "/map/body":
            batch = one.to_record_batch()
            times += batch.column("time").to_pylist()
            places += [row[0] for row in batch.column("Transform3D:translation").to_pylist()]
        if str(one.entity_path) == "/map/surfaces":
            outlines += one.to_record_batch().column("LineStrips3D:strips").to_pylist()
    assert [at.total_seconds() for at in times] == [0.0, 1.0, 2.0, 3.0, 4.0]
    heights = (0.0, 0.0, 0.09, 0.09, 0.09)
    np.testing.assert_allclose(places, [[0.1 * k, 1.0, heights[k]] for k in range(5)], atol=1e-6)
    np.testing.assert_allclose(outlines, [[[*SQUARE.tolist(), SQUARE[0].tolist()]]], atol=1e-6)
