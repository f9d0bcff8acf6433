from collections.abc import Mapping

import pytest

from siren_ros.simulation.dynamics.vehicle_model import VehicleParameters, load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass


@pytest.fixture(scope="session")
def parameters() -> Mapping[ActorClass, VehicleParameters]:
    return load_vehicle_parameters()
