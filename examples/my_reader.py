"""A recording reader of your own: a folder of NumPy files, depth in mm with the pose of the camera.

    surefoot process FOLDER --reader examples.my_reader:NumpyFolder

FOLDER holds camera.txt (width height fx fy cx cy) and one NNNN.npz a frame with `depth_mm` (uint16), `stamp_s` and
`T_world_camera` (4, 4).
"""

from pathlib import Path

import numpy as np

from surefoot import Camera, DepthView, Frame, Pose3, RecordingInfo


class NumpyFolder:
    def __init__(self, path):  # what stands on the command line
        self.files = sorted(Path(path).glob("*.npz"))
        width, height, *rest = np.loadtxt(Path(path) / "camera.txt")
        self.camera = Camera(int(width), int(height), *rest)
        self.info = RecordingInfo(
            Path(path).name, kind="numpy", poses_given=True, frames=len(self.files),
            gravity_up_world=(0.0, 0.0, 1.0),
        )  # fmt: skip

    def frames(self):
        """One frame after the other, in the order of time."""
        for file in self.files:
            data = np.load(file)
            depth = data["depth_mm"].astype(np.float32) / 1000.0
            depth[depth == 0.0] = np.nan  # no depth
            pose = Pose3.from_matrix(data["T_world_camera"])
            view = DepthView(depth, self.camera)
            yield Frame(float(data["stamp_s"]), depth=view, T_world_camera=pose)
