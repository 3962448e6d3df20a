"""The kinds of worlds, and the measures of their streets, for both layouts."""

from typing import Any, Literal

WorldKind = Literal["campus", "city", "terraces", "squares", "trees", "tunnels", "repeating"]

#: Height above the ground of the lowest ceiling over a street, where there is any (metres).
LOWEST_CEILING: dict[WorldKind, float] = {"tunnels": 2.5}

#: Width of the sidewalk beyond the kerb on both sides of a street (metres).
SIDEWALK: dict[WorldKind, float] = {
    "campus": 3.0,
    "city": 3.0,
    "terraces": 3.0,
    "squares": 3.0,
    "trees": 0.0,  # the verge begins at the road
    "tunnels": 3.0,
    "repeating": 3.0,
}

#: Settings of each kind of world that differ from the defaults, which are the campus's. The street
#: free of standing objects is twice ``lane_offset + lateral_offset + 1.5`` wide.
MEASURES: dict[WorldKind, dict[str, Any]] = {
    "campus": {},
    "city": {
        "block": 115.0,
        "rows": 3,
        "crossing_jitter": 12.0,
        "building_share": 0.9,
        "tree_spacing": 12.0,
        "ground_relief": 0.6,
        "trees_changed": 0.3,
        "parking_share": 0.65,
        "mover_vehicle_share": 0.8,
        "lateral_offset": 2.5,
        "lane_offset": 3.5,
    },
    "terraces": {
        "block": 90.0,
        "crossing_jitter": 16.0,
        "street_bend": 8.0,
        "tree_spacing": 14.0,
        "ground_relief": 0.8,
        "trees_changed": 0.15,
        "structures_changed": 0.3,
        "bare_season": 1.2,
        "parking_share": 0.6,
        "movers": 6.0,
        "mover_vehicle_share": 0.25,
        "lateral_offset": 0.8,
        "lane_offset": 1.2,
    },
    "squares": {
        "block": 125.0,
        "rows": 3,
        "crossing_jitter": 14.0,
        "ground_relief": 0.4,
        "trees_changed": 0.2,
        "structures_changed": 0.35,
        "parking_share": 0.5,
        "movers": 22.0,
        "mover_vehicle_share": 0.25,
        "lateral_offset": 2.5,
        "lane_offset": 1.5,
    },
    "trees": {
        "block": 95.0,
        "crossing_jitter": 16.0,
        "street_bend": 10.0,
        "ground_relief": 1.2,
        "trees_changed": 0.15,
        "structures_changed": 0.15,
        "parking_share": 0.3,
        "movers": 4.0,
        "mover_vehicle_share": 0.3,
        "lateral_offset": 1.5,
        "lane_offset": 1.2,
    },
    "tunnels": {
        "block": 110.0,
        "rows": 3,
        "crossing_jitter": 8.0,
        "building_share": 0.9,
        "tree_spacing": 14.0,
        "ground_relief": 0.3,
        "trees_changed": 0.3,
        "parking_share": 0.55,
        "movers": 8.0,
        "mover_vehicle_share": 0.8,
        "lateral_offset": 1.2,
        "lane_offset": 1.8,
    },
    "repeating": {
        "block": 120.0,
        "rows": 3,
        "crossing_jitter": 10.0,
        "tree_spacing": 16.0,
        "ground_relief": 0.4,
        "trees_changed": 0.2,
        "structures_changed": 0.3,
        "parking_share": 0.5,
        "movers": 8.0,
        "mover_vehicle_share": 0.6,
        "lateral_offset": 1.5,
        "lane_offset": 1.5,
    },
}
