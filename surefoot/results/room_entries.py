"""Rooms and doorways as entries of rooms.json."""

from __future__ import annotations

from typing import Any

from mapping.grid.rooms import RoomMap

ROOMS = "rooms.json"


def room_entries(found: RoomMap) -> dict[str, Any]:
    """The content of rooms.json; its keys are documented in docs/outputs.md."""
    return {
        "rooms": [
            {
                "number": room.number,
                "centre_m": list(room.centre),
                "area_m2": room.area_m2,
                "sigma_area_m2": room.sigma_m2,
                "outline_m": room.outline.tolist(),
            }
            for room in found.rooms
        ],
        "doors": [
            {
                "rooms": list(door.rooms),
                "centre_m": list(door.centre),
                "jambs_m": [list(jamb) for jamb in door.jambs],
                "width_m": door.width_m,
                "sigma_width_m": door.sigma_m,
            }
            for door in found.doors
        ],
        "floors": [list(floor) for floor in found.floors],
    }
