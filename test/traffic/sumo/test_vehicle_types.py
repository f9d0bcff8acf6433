import pytest
from defusedxml.ElementTree import fromstring
from traffic_helpers import load_map, plan_s2

from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.traffic.sumo.vehicle_types import type_id, vehicle_types_xml

PLAN = plan_s2(load_map(None)[1])[0]


@pytest.mark.parametrize(
    ("level", "device", "privileged"),
    [
        (EmergencyLevel.L0, False, False),
        (EmergencyLevel.L1, False, True),
        (EmergencyLevel.L2, False, True),
        (EmergencyLevel.L3, True, True),
    ],
)
def test_emv_has_device_and_privileges_of_its_level(level: EmergencyLevel, device: bool, privileged: bool) -> None:
    root = fromstring(vehicle_types_xml(PLAN.emvs, level, 37.0, TrafficConfig()))
    (emv,) = root.findall("vType")
    parameters = {param.get("key"): param.get("value") for param in emv.findall("param")}
    assert (parameters.get("has.bluelight.device") == "true") is device
    assert (parameters.get("device.bluelight.reactiondist") == "37") is device
    assert ("jmDriveAfterRedTime" in emv.attrib) is privileged
    assert emv.get("vClass") == "emergency"


def test_every_vehicle_has_its_own_type_with_its_body_and_driver() -> None:
    root = fromstring(vehicle_types_xml(PLAN.background, EmergencyLevel.L2, 40.0, TrafficConfig()))
    types = {element.get("id"): element for element in root.findall("vType")}
    assert set(types) == {type_id(vehicle) for vehicle in PLAN.background}
    for vehicle in PLAN.background:
        element = types[type_id(vehicle)]
        assert float(element.get("length")) == pytest.approx(vehicle.length_m)
        assert float(element.get("speedFactor")) == pytest.approx(vehicle.driver.speed_factor, rel=1e-4)
        assert float(element.get("speedDev")) == 0.0
        assert element.get("vClass") == "passenger"
        assert float(element.get("jmDriveAfterYellowTime")) == 1.0
