import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.numerics.units import GRAVITY_MPS2
from siren_ros.base.params.input_files import FILES_ON_DISK, NotedFiles, RecordedFiles
from siren_ros.base.params.resources import params_dir
from siren_ros.errors import InputError
from siren_ros.simulation.dynamics.parameters import (
    ParameterTable,
    VehicleParameters,
    load_vehicle_parameters,
    read_vehicle_parameters,
)
from siren_ros.simulation.world.actors import TWO_WHEELED, VEHICLE_CLASSES, ActorClass


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copy = tmp_path / "vehicles"
    shutil.copytree(params_dir() / "vehicles", copy)
    return copy


def _edit(folder: Path, name: str, old: str, new: str) -> Path:
    file = folder / f"{name}.yaml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_every_class_has_parameters(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    assert set(parameters) == set(ActorClass)


@pytest.mark.parametrize("kind", VEHICLE_CLASSES)
def test_classes_are_plausible(parameters: Mapping[ActorClass, VehicleParameters], kind: ActorClass) -> None:
    vehicle = parameters[kind]
    radius_of_gyration_m = np.sqrt(vehicle.yaw_inertia_kgm2 / vehicle.mass_kg)
    assert 0.2 * vehicle.length_m < radius_of_gyration_m < 0.33 * vehicle.length_m
    understeer_deg_per_g = np.degrees(vehicle.understeer_gradient_s2pm * GRAVITY_MPS2)
    assert 0.5 < understeer_deg_per_g < 4.0
    assert vehicle.max_brake_decel_mps2 < vehicle.friction_coefficient * GRAVITY_MPS2
    cruise_kmph = 18.0 if kind is ActorClass.BICYCLE else 50.0
    assert vehicle.attainable_accel_mps2(cruise_kmph / 3.6) > 0.5
    assert 0.35 * vehicle.wheelbase_m < vehicle.centre_ahead_of_rear_axle_m < vehicle.wheelbase_m


def test_every_number_names_its_source() -> None:
    for file in sorted((params_dir() / "vehicles").glob("*.yaml")):
        for line in file.read_text(encoding="utf-8").splitlines():
            assert "#" in line, f"{file.name}: {line}"


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("mass_kg: 1560.0", "mass_kg: heavy", ("mass_kg", "heavy", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "mass_kg: -3.0", ("mass_kg", "-3.0", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "mass_kg: .nan", ("mass_kg", "nan", "a number from 60 to 45000")),
        ("mass_kg: 1560.0", "weight_kg: 1560.0", ("mass_kg", "None", "missing")),
        ("wheelbase_m: 2.8 ", "wheelbase_m: 4.5 ", ("wheelbase_m", "4.5", "less than length_m")),
        (
            "cg_to_front_axle_m: 1.3 ",
            "cg_to_front_axle_m: 2.9 ",
            ("cg_to_front_axle_m", "2.9", "less than wheelbase_m"),
        ),
        ("mass_kg: 1560.0", "colour: 1.0\nmass_kg: 1560.0", ("colour", "1.0", "keys brake_lag_s")),
    ],
)
def test_bad_values_are_refused(folder: Path, old: str, new: str, parts: tuple[str, str, str]) -> None:
    file = _edit(folder, "sedan", old, new)
    with pytest.raises(InputError) as caught:
        read_vehicle_parameters(folder)
    assert str(file) in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_missing_file_is_named(folder: Path) -> None:
    (folder / "bus.yaml").unlink()
    with pytest.raises(InputError, match=r"bus\.yaml"):
        read_vehicle_parameters(folder)


def test_table_rows_follow_the_list(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    kinds = [ActorClass.BUS, ActorClass.SEDAN, ActorClass.BUS]
    table = ParameterTable.of(kinds, parameters)
    assert len(table) == 3
    assert table.mass_kg.tolist() == [parameters[kind].mass_kg for kind in kinds]
    np.testing.assert_allclose(table.cg_to_front_axle_m + table.cg_to_rear_axle_m, table.wheelbase_m)
    assert len(ParameterTable.of((), parameters)) == 0


def test_records_of_earlier_episodes_have_no_two_wheels_and_nobody_on_foot() -> None:
    """Their vehicles are read from the record nevertheless."""
    noted = NotedFiles(FILES_ON_DISK)
    load_vehicle_parameters(noted)
    earlier = RecordedFiles(file for file in noted.seen if file.name not in {"bicycle", "motorcycle", "pedestrian"})
    assert set(load_vehicle_parameters(earlier)) == set(ActorClass) - TWO_WHEELED - {ActorClass.PEDESTRIAN}
    without_bus = RecordedFiles(file for file in noted.seen if file.name != "bus")
    with pytest.raises(InputError, match="bus"):
        load_vehicle_parameters(without_bus)


@pytest.mark.parametrize("kind", [ActorClass.SEDAN, ActorClass.BUS])
def test_a_longer_vehicle_has_its_axles_in_the_same_shares(
    parameters: Mapping[ActorClass, VehicleParameters], kind: ActorClass
) -> None:
    own = parameters[kind]
    assert own.sized(own.length_m, own.width_m, own.height_m) is own
    longer = own.sized(1.1 * own.length_m, own.width_m, 0.9 * own.height_m)
    assert (longer.length_m, longer.width_m, longer.height_m) == (1.1 * own.length_m, own.width_m, 0.9 * own.height_m)
    for name in ("wheelbase_m", "front_overhang_m", "cg_to_front_axle_m", "centre_ahead_of_rear_axle_m"):
        assert getattr(longer, name) == pytest.approx(1.1 * getattr(own, name))
    assert longer.yaw_inertia_kgm2 == pytest.approx(1.21 * own.yaw_inertia_kgm2)
    assert longer.understeer_gradient_s2pm == pytest.approx(own.understeer_gradient_s2pm)
