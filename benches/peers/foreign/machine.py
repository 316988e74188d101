"""Machines for the simulator: the model file's numbers, changed as a real machine departs from its data sheet."""

import math
import tomllib

import numpy as np
from plant import Plant


def nominal(path) -> Plant:
    """The machine of a model file, nothing hidden."""
    with open(path, "rb") as file:
        m = tomllib.load(file)
    g, b, e = m["geometry"], m["bodies"], m["effects"]
    three, zero = np.ones(3), np.zeros(3)
    axis4, bar = e["axis4_friction"], e["telescope_friction"]
    return Plant(
        azimuth=np.radians([0.0, 120.0, 240.0]), base=g["base_radius"], arm=g["arm_length"], strut=g["strut_length"],
        platform=g["platform_radius"], hooke_up=g["upper_hooke_height"], hooke_low=g["lower_hooke_height"],
        gravity=np.array([0.0, 0.0, -m["gravity"]]),
        arm_x=b["arm"]["first_moment"][0] * three, arm_z=b["arm"]["first_moment"][2] * three,
        arm_i=b["arm"]["inertia"][1] * three,
        pair_m=2 * b["strut"]["mass"] * three, pair_mc=2 * b["strut"]["first_moment"][0] * three,
        pair_i=2 * b["strut"]["inertia"][1] * three,
        plate_m=b["platform"]["mass"], upper_mc=b["telescope_upper"]["first_moment"][2],
        upper_i=b["telescope_upper"]["inertia"][0], lower_m=b["telescope_lower"]["mass"],
        lower_mc=b["telescope_lower"]["first_moment"][2], lower_i=b["telescope_lower"]["inertia"][0],
        bar_spin=b["telescope_upper"]["inertia"][2] + b["telescope_lower"]["inertia"][2],
        rotor=b["rotor"]["inertia"][2], load_m=0.0, load_x=0.0, load_y=0.0, load_zz=0.0,
        coulomb=np.array(e["drive_friction"]["coulomb"]), viscous=np.array(e["drive_friction"]["viscous"]),
        steep=e["drive_friction"]["steepness"],
        a_c=axis4["coulomb"], a_v=axis4["saturating"], eps_v=axis4["saturation_speed"],
        bar_coulomb=bar["coulomb"], bar_viscous=bar["viscous"],
        power=zero, exponent=1.0, stribeck=zero, stribeck_speed=0.1, stribeck_shape=1.0, asymmetry=zero,
        cogging=zero, cogging_order=33.0, cogging_phase=zero, socket=0.0, socket_speed=0.05,
        hose=0.0, hose_preload=0.0, hose_at=zero, bristle=zero, bristle_torque=three,
        gear=zero, gear_damping=zero, motor=zero, drag=0.0, bumps=np.zeros((0, 3)), bumps_on=-1, cross=zero,
    )
