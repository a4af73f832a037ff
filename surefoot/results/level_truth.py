"""Ground truth of a walk over several levels, written to truth/; only the evaluation reads it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..results.row_stream import PoseStream, RowStream
from ..results.run_folder import RunFolder

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot
    from sim.scene import Scene

STRUCK_M = 0.01  # ours: of a foot below the ground on its way
LANDINGS = ("stamp_s", "carried", "middle", "expected_rise_m", "rise_m", "struck_m")


class LevelTruth:
    """Writes pose with height, clearance, how every foot stands, and the ground."""

    def __init__(self, robot: SimulatedRobot, folder: RunFolder) -> None:
        from sim.truth import Truth

        self._robot, self._truth, self._folder = robot, Truth(robot), folder
        self._poses = PoseStream(folder, "truth/trajectory.txt")
        self._clearances = RowStream(
            folder, "truth/clearance.csv", ("stamp_s", "clearance_m", "object")
        )
        self._landings = RowStream(folder, "truth/footsteps.csv", LANDINGS)

    def note(self, stamp_s: float) -> None:
        """A frame."""
        pose = self._truth.robot_pose()
        height_m = self._robot.body.true_height_m
        self._poses.append((stamp_s, pose.x, pose.y, height_m, pose.yaw))
        self._clearances.append((stamp_s, *self._truth.clearance_m()))

    def landed(self, stamp_s: float, foot: int, expected_m: float) -> bool:
        """A foot has landed, which was expected so much higher than the other; whether the robot still stands."""
        body, ground = self._robot.body, self._robot.ground
        if ground is None:
            return True
        place, _ = body.feet_body[0 if foot > 0 else 1]
        carried, middle = ground.carried(body.true_pose @ place)
        left_m, right_m = body.foot_heights()
        rise_m = (left_m - right_m) * foot
        swung, path = body.true_swing  # type: ignore[attr-defined]  # of the kinematic body
        struck_m = ground.struck(path) if swung else 0.0
        self._landings.append((stamp_s, carried, middle, expected_m, rise_m, struck_m))
        return middle and abs(rise_m - expected_m) <= self._robot.config.gait.lift_m

    def finish(self, scene: Scene) -> None:
        """Close all tables, and write the ground: name, outline and height of every piece."""
        from sim.shapes import outline

        for table in (self._poses, self._clearances):
            table.close()
        self._landings.close(keep_empty=False)
        pieces = [
            {"name": item.name, "top_m": part.top_m, "outline_m": outline(part).tolist()}
            for item in scene.static_objects
            if not item.wall
            for part in item.parts
        ]
        self._folder.write_json("truth/ground.json", pieces)
