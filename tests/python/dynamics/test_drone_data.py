"""The data of the bundled airframes: plausible bodies, the numbers of their sources, and a matching table."""

import json
import math
import re

import pytest
from conftest import ROOT
from messages import refused

import flockstep

NAMES = ["crazyflie", "f450", "f550", "hummingbird", "kingfisher", "naki", "racer5", "t650", "x500"]
QUADROTORS = [name for name in NAMES if name not in ("f550", "naki")]
GRAVITY = 9.81  # m/s^2
RPM = 2 * math.pi / 60  # rad/s

TEXTS = {"name", "description", "sources"}
BODY = {"mass_kg", "inertia_kgm2"}
ROTORS = {"position_m", "spin", "thrust_n", "max_speed_radps", "torque_ratio_m", "lag_up_s", "lag_down_s", "radius_m"}
OPTIONAL_ROTORS = {"min_speed_radps", "inertia_kgm2", "drag_n_per_radps_mps", "lift_n_per_mps2"}
DRAG = {"linear_n_per_mps", "quadratic_n_per_mps2"}
PARTS = {f"rotors/{field}" for field in ROTORS | OPTIONAL_ROTORS} | {f"drag/{field}" for field in DRAG}


def without_repetition(pairs):
    assert len({key for key, _ in pairs}) == len(pairs), pairs
    return dict(pairs)


def load(name):
    text = (ROOT / "drones" / f"{name}.json").read_text(encoding="utf-8")
    return json.loads(text, object_pairs_hook=without_repetition)


FRAMES = {name: load(name) for name in NAMES}


@pytest.fixture(params=NAMES)
def frame(request):
    return FRAMES[request.param]


def shape(frame):
    """The field of the collision body: a box for a prism, or the corners of its hull."""
    (field,) = {"size_m", "hull_m"} & set(frame)
    return field


def size(frame):
    if shape(frame) == "size_m":
        return frame["size_m"]
    return [max(corner[axis] for corner in frame["hull_m"]) * 2 for axis in range(3)]


def thrust(frame, speed):
    c0, c1, c2 = frame["rotors"]["thrust_n"]
    return c0 + c1 * speed + c2 * speed**2


def rotors_of(frame):
    return len(frame["rotors"]["spin"])


def thrust_to_weight(frame):
    return rotors_of(frame) * thrust(frame, frame["rotors"]["max_speed_radps"]) / (frame["mass_kg"] * GRAVITY)


def hover_speed(frame):
    c0, c1, c2 = frame["rotors"]["thrust_n"]
    return (-c1 + math.sqrt(c1**2 - 4 * c2 * (c0 - frame["mass_kg"] * GRAVITY / rotors_of(frame)))) / (2 * c2)


def test_these_frames_are_shipped():
    assert sorted(path.stem for path in (ROOT / "drones").iterdir() if path.suffix == ".json") == NAMES


def test_fields(frame):
    assert set(frame) - {"disputed", "drag"} == {"flockstep_drone", *TEXTS, *BODY, shape(frame), "rotors"}
    assert frame["flockstep_drone"] == 1
    assert FRAMES[frame["name"]] is frame
    assert ROTORS <= set(frame["rotors"]) <= ROTORS | OPTIONAL_ROTORS
    assert set(frame.get("drag", {})) <= DRAG


def test_every_physical_field_has_one_source(frame):
    physical = BODY | {shape(frame)} | PARTS
    covered = [part for key in frame["sources"] for part in key.split(", ")]
    assert set(covered) <= physical | {"drag"}
    fields = [field for part in covered for field in physical if field == part or field.startswith(f"{part}/")]
    assert sorted(fields) == sorted(physical)
    assert all(text.endswith(".") for text in frame["sources"].values())


def test_what_has_no_source_is_left_out(frame):
    for key, text in frame["sources"].items():
        if text.startswith(("None", "Unknown")):
            for part in key.split(", "):
                group, _, field = part.rpartition("/")
                assert field not in (frame[group] if group else frame), part


def test_rotors_are_in_our_order_and_balance(frame):
    places = frame["rotors"]["position_m"]
    signs = [[math.copysign(1, x) for x in place[:2]] for place in places]
    if frame["name"] == "f550":
        around = sorted(range(6), key=lambda rotor: math.atan2(places[rotor][1], places[rotor][0]))
        assert [frame["rotors"]["spin"][rotor] for rotor in around] == ["cw", "ccw"] * 3  # neighbours turn unlike
    else:
        assert signs[:4] == [[1, -1], [-1, 1], [1, 1], [-1, -1]]  # front right, rear left, front left, rear right
        assert frame["rotors"]["spin"][:4] == ["ccw", "ccw", "cw", "cw"]  # opposite rotors turn the same way
    if frame["name"] == "naki":
        spins = {(*place, spin) for place, spin in zip(places, frame["rotors"]["spin"], strict=True)}
        assert len(spins) == 8  # at each place two rotors, which turn unlike
        assert len({place[:3] for place in spins}) == 4
    for axis in range(2):
        assert sum(place[axis] for place in places) == 0  # relative to the centre of mass
    assert len({place[2] for place in places}) == 1


def test_rotors_are_possible(frame):
    """Rpm for rad/s, a diameter for a radius or a torque for its ratio would each be outside these ranges."""
    places, radius = frame["rotors"]["position_m"], frame["rotors"]["radius_m"]
    assert radius < min(math.dist(a, b) for a in places for b in places if a != b) / 2  # the propellers do not overlap
    speed = frame["rotors"]["max_speed_radps"]
    tip = speed * radius  # m/s; the speed of sound is 340
    assert 40 < tip < 250
    disc = math.pi * radius**2
    most = 0.05 if frame["name"] == "naki" else 0.035  # which its file disputes
    assert 0.005 < thrust(frame, speed) / (1.2 * disc * tip**2) < most  # the thrust coefficient in air of 1.2 kg/m^3
    assert 0.1 < frame["rotors"]["torque_ratio_m"] / radius < 0.4


def test_size_is_that_between_the_propellers_tips(frame):
    if frame["name"] == "t650":  # the body of the thesis, centred
        assert size(frame) == [0.93, 0.59, 0.2]
        corners = {tuple(corner) for corner in frame["hull_m"]}
        assert corners == {tuple(-x for x in corner) for corner in corners}
        return
    x, y = (max(place[axis] for place in frame["rotors"]["position_m"]) for axis in range(2))
    radius = frame["rotors"]["radius_m"]
    assert size(frame)[:2] == pytest.approx([2 * (x + radius), 2 * (y + radius)], abs=1e-3)


def test_inertia_is_that_of_a_body_of_its_size(frame):
    moments = frame["inertia_kgm2"]
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        assert moments[axis] < sum(moments[other] for other in others)
        half = max(size(frame)[other] for other in others) / 2
        assert 0.1 < math.sqrt(moments[axis] / frame["mass_kg"]) / half < 1


def test_drag_at_5_mps_is_a_part_of_the_weight(frame):
    drag = frame.get("drag", {})
    for axis in range(2):
        rotors = rotors_of(frame) * hover_speed(frame) * frame["rotors"].get("drag_n_per_radps_mps", [0, 0])[axis]
        linear, quadratic = (drag.get(field, [0, 0])[axis] for field in ("linear_n_per_mps", "quadratic_n_per_mps2"))
        force = (rotors + linear) * 5 + quadratic * 5**2
        assert (0.01 if frame["name"] == "naki" else 0.05) < force / (frame["mass_kg"] * GRAVITY) < 0.25


@pytest.mark.parametrize(
    ("name", "speed", "expected"),
    [
        ("crazyflie", 15000 * RPM, -5.382196214637237e-7 * 15000 + 2.4582929831265485e-10 * 15000**2),
        ("f450", 9068 * RPM, 1.2216e-7 * 9068**2),
        ("f550", 9068 * RPM, 1.2216e-7 * 9068**2),
        ("naki", 6376 * RPM, 5.7658e-7 * 6376**2),
        ("t650", 5832 * RPM, 7.3385e-7 * 5832**2),
        ("hummingbird", 838, 8.54858e-06 * 838**2),
        ("x500", 1000, 8.54858),
        ("kingfisher", 2800, 12.2502),
    ],
)
def test_thrust_is_that_of_the_source_in_its_units(name, speed, expected):
    assert thrust(FRAMES[name], speed) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("crazyflie", 0.0128176, 0.12), ("f450", 1.2216e-7 * 1360**2, 10.04505), ("t650", 7.3385e-7 * 875**2, 24.95987)],
)
def test_speeds_end_where_the_source_has_these_thrusts(name, low, high):
    rotors = FRAMES[name]["rotors"]
    ends = [thrust(FRAMES[name], rotors[field]) for field in ("min_speed_radps", "max_speed_radps")]
    assert ends == pytest.approx([low, high], rel=2e-3)


def test_racer5_has_the_ratios_that_were_identified():
    frame = FRAMES["racer5"]
    rotors = frame["rotors"]
    c2, (x, y, _) = rotors["thrust_n"][2], rotors["position_m"][2]
    jx, jy, jz = frame["inertia_kgm2"]
    assert c2 / frame["mass_kg"] == pytest.approx(2.49e-6)  # k_w
    assert y * c2 / jx == pytest.approx((6.55 + 6.61 + 6.36 + 6.67) / 4 * 1e-5, rel=1e-4)  # k_p1 to k_p4
    assert x * c2 / jy == pytest.approx((5.28 + 5.86 + 5.05 + 5.89) / 4 * 1e-5, rel=1e-4)  # k_q1 to k_q4
    assert 2 * rotors["torque_ratio_m"] * c2 * hover_speed(frame) / jz == pytest.approx(1.07e-2, rel=1e-3)  # k_r1
    assert rotors["inertia_kgm2"] / jz == pytest.approx(1.97e-3, rel=1e-3)  # k_r5
    drag = [k / frame["mass_kg"] for k in rotors["drag_n_per_radps_mps"]]
    assert drag == pytest.approx([4.85e-5, 7.28e-5, 0], rel=1e-4)  # k_x, k_y


@pytest.fixture(scope="module")
def table():
    """The rows of the table of docs/reference/drones.md by frame name, as the numbers of each cell."""
    text = (ROOT / "docs" / "reference" / "drones.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| [")]
    names = [re.search(r"drones/(\w+)\.json", row[0])[1] for row in rows]
    assert sorted(names) == NAMES
    return {name: [re.findall(r"[\d.]+", cell) for cell in row[1:6]] for name, row in zip(names, rows, strict=True)}


def test_the_table_says_what_the_files_say(frame, table):
    rotors = frame["rotors"]
    mass, extents, _, speed, lag = ([float(number) for number in cell] for cell in table[frame["name"]])
    lags = sorted({1000 * rotors[f"lag_{way}_s"] for way in ("up", "down")})
    assert mass == pytest.approx([frame["mass_kg"]], rel=5e-3)
    assert extents == pytest.approx(size(frame), abs=5.001e-3)
    assert table[frame["name"]][2] == [f"{thrust_to_weight(frame):.2g}"]
    assert speed == pytest.approx([hover_speed(frame)], abs=0.5)
    assert lag == pytest.approx(lags)


def estimated(name, frame):
    (x, y, _), *_ = frame["rotors"]["position_m"]
    rotors = frame["rotors"]
    return flockstep.estimate_airframe(
        mass_kg=frame["mass_kg"],
        wheelbase_m=2 * math.hypot(x, y),
        propeller_m=2 * rotors["radius_m"],
        max_thrust_n=thrust(frame, rotors["max_speed_radps"]),
        brushed=name == "crazyflie",
    )


@pytest.mark.parametrize("name", QUADROTORS)
def test_estimates_are_within_the_factors_that_the_helper_states(name):
    frame = FRAMES[name]
    ours, rotors = estimated(name, frame), FRAMES[name]["rotors"]
    for guess, true in zip(ours["inertia_kgm2"], frame["inertia_kgm2"], strict=True):
        assert 1 / 1.5 < guess / true < 1.5
    assert 0.5 < ours["rotors"]["torque_ratio_m"] / rotors["torque_ratio_m"] < 2
    assert 0.5 < ours["rotors"]["lag_s"] / math.sqrt(rotors["lag_up_s"] * rotors["lag_down_s"]) < 2
    assert 0.5 < ours["rotors"]["max_speed_radps"] / rotors["max_speed_radps"] < 2
    flies = flockstep.DroneModel.from_dict(ours)  # without a warning
    assert flies.thrust_to_weight == pytest.approx(thrust_to_weight(frame), rel=1e-3)


def test_estimates_refuse_what_cannot_be():
    sheet = {"mass_kg": 0.62, "wheelbase_m": 0.25, "propeller_m": 0.127, "max_thrust_n": 12.4}
    with refused(ValueError, "propeller_m", "0.177", 5):
        flockstep.estimate_airframe(**sheet | {"propeller_m": 5})
    with refused(ValueError, "max_speed_radps", 0):
        flockstep.estimate_airframe(**sheet, max_speed_radps=0)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("inertia_kgm2", [14, 22, 33], ("inertia_kgm2", 33)),
        ("max_thrust_n", 1260, ("rotors max_thrust_n", 20, "828.")),
        ("max_speed_radps", 24500, ("rotors max_speed_radps", 340, 1555.75)),
    ],
)
def test_numbers_in_another_unit_are_doubted(tmp_path, field, value, said):
    data = flockstep.estimate_airframe(mass_kg=0.62, wheelbase_m=0.25, propeller_m=0.127, max_thrust_n=12.4)
    (data if field in data else data["rotors"])[field] = value
    with refused(UserWarning, *said) as caught:
        flockstep.DroneModel.from_dict(data)
    assert len(caught) == 1
    assert len(str(caught[0].message)) <= 200
    (tmp_path / "quad.json").write_text(json.dumps(data))
    with refused(UserWarning, *said):
        flockstep.plan(flockstep.World.load("arena/hall"), (0, 0, 2), [(1, 0, 2)], drone=str(tmp_path / "quad.json"))
    del data["rotors"]["radius_m"]  # then the distance between the rotors tells
    with refused(UserWarning, said[0]):
        flockstep.DroneModel.from_dict(data)
