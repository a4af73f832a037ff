"""Ground truth of a walk over several levels, written to truth/; only the evaluation reads it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..results.row_stream import PoseStream, RowStream
from ..results.run_folder import RunFolder

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot
    from sim.scene import Scene

LANDINGS = ("stamp_s", "carried", "middle", "expected_rise_m", "rise_m", "struck_m")


class LevelTruth:
    """Writes pose with height, clearance, how every foot stands, and the ground."""

    def __init__(self, robot: SimulatedRobot, scene: Scene, folder: RunFolder) -> None:
        from sim.truth import Truth

        self._robot, self._truth, self._folder = robot, Truth(robot), folder
        self._scene = scene
        self._poses = PoseStream(folder, "truth/trajectory.txt")
        self._clearances = RowStream(
            folder, "truth/clearance.csv", ("stamp_s", "clearance_m", "object")
        )
        self._faults = RowStream(folder, "truth/faults.csv", ("stamp_s", "fault"))
        self._landings = RowStream(folder, "truth/footsteps.csv", LANDINGS)

    def note(
        self, stamp_s: float, faults: Sequence[str] = (), views: Sequence[object] = ()
    ) -> None:
        """A frame; arguments as for `TruthLog`, there are no views here."""
        for fault in faults:
            self._faults.append((stamp_s, fault))
        pose = self._truth.robot_pose()
        height_m = self._robot.body.true_height_m
        self._poses.append((stamp_s, pose.x, pose.y, height_m, pose.yaw))
        self._clearances.append((stamp_s, *self._truth.clearance_m()))
        landing = getattr(self._robot.body, "landing", None)
        if landing is not None and landing.number > self._landings.rows:
            self._landings.append(
                (stamp_s, landing.carried, landing.middle, landing.expected_m, landing.rise_m, landing.struck_m)
            )  # fmt: skip

    def finish(self) -> None:
        """Close all tables, and write the ground: name, outline and height of every piece."""
        from sim.shapes import outline

        for table in (self._poses, self._clearances):
            table.close()
        for table in (self._landings, self._faults):
            table.close(keep_empty=False)
        pieces = [
            {"name": item.name, "top_m": part.top_m, "outline_m": outline(part).tolist()}
            for item in self._scene.static_objects
            if not item.wall
            for part in item.parts
        ]
        self._folder.write_json("truth/ground.json", pieces)
