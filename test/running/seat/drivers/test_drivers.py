from seen_on_crossing import sight_at

from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.manoeuvres import Manoeuvre


def test_the_shipped_driver_makes_way_and_its_card_says_how_it_learned() -> None:
    driver = driver_of("learned")
    manoeuvres = {
        emv_m: driver.step(driver.start, sight_at(emv_m=emv_m))[0].aim.manoeuvre for emv_m in (15.0, 30.0, 150.0)
    }
    assert manoeuvres == {15.0: Manoeuvre.PULL_OVER, 30.0: Manoeuvre.PULL_OVER, 150.0: Manoeuvre.KEEP}
    card = driver.network.card
    assert card["kind"] == "driver"
    assert card["minutes"] < 30.0
    assert card["task"]["seeds"][1] <= 1000
    assert card["fit"]["templates"] == ["S1", "S2"]
